"""Benchmark: the search on a surrogate against the genetic algorithm on the model itself, as the paper did it.

    python tests/campaigns/direct.py [--case CASE] [--set KEY=VALUE ...] [--workers N] [--ledger FILE]

Two fits of the case with `ga`: as it is, and with `--direct`, each followed by its polish. They must end at the same optimum: mu
within 0.5 %, zeta within 2 %, and the surrogate's objective at least as low (beyond 1e-4 of it, where the solver's own noise
begins). Prints both, what each cost, and a line for each claim; exit code 1 where one does not hold.

With --ledger every run is kept in FILE: a benchmark that was stopped goes on when it is given again.

Seen with --case cases/quickstart/case.toml: mu 0.001 %, zeta 0.012 % apart, the same objective (0.182581 mN); 11 sets of parameters
against 36.
"""

import argparse
import contextlib
import sys
from pathlib import Path

CASE = Path(__file__).parents[2] / "cases" / "white_matter_2017" / "case.toml"
WITHIN = {"mu": 0.005, "zeta": 0.02}
AS_LOW = 1e-4  # of the objective


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--case", type=Path, default=CASE)
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--workers", type=int)
    parser.add_argument("--ledger", type=Path)
    options = parser.parse_args()
    from indentfit.experiment.measured import read_case

    keys = [*options.set, "fit.method=ga", "fit.profiles=false", "fit.uncertain.mesh=0", "fit.published={}"]
    keys += [f"fit.workers={options.workers}"] if options.workers else []
    results = {}
    for direct in ("false", "true"):
        results[direct] = result = fitted(read_case(options.case, [*keys, f"fit.direct={direct}"]), options.ledger)
        values = ", ".join(f"{name} {result.parameters[name].value:.6g}" for name in result.free)
        print(
            f"{'ga --direct' if direct == 'true' else 'ga':<12} {values}; objective {result.objective:.6g} mN; "
            f"{result.nfev} sets of parameters, {result.runs} runs ({result.reused} reused), {result.seconds:.0f} s\n"
            f"             {result.message}",
            flush=True,
        )
    sys.exit(not all(claims(results["false"], results["true"])))


def fitted(case, path):
    from indentfit.inference.fit import fit
    from indentfit.runs.ledger import Ledger

    with Ledger(path, case) if path else contextlib.nullcontext() as ledger:
        return fit(case, ledger=ledger)


def claims(ours, direct):
    """Whether each claim holds, told as it is found."""
    for name, share in WITHIN.items():
        surrogate, itself = (result.parameters[name].value for result in (ours, direct))
        apart = abs(surrogate - itself) / abs(itself)
        yield told(f"{name}: {apart:.3%} apart, at most {share:.1%}", apart <= share)
    excess = ours.objective / direct.objective - 1
    yield told(f"objective: {excess:+.4%} against --direct, at most +{AS_LOW:.2%}", excess <= AS_LOW)
    yield told(f"both converged: {ours.success}, {direct.success}", ours.success and direct.success)


def told(words, holds):
    print(f"{'holds' if holds else 'FAILS'}  {words}")
    return holds


if __name__ == "__main__":
    main()
