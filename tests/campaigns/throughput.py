"""Throughput of two workers against one on the search phase: runs of the forward model per second of wall time.

    python tests/campaigns/throughput.py [--case CASE] [--set KEY=VALUE ...] [--workers 2] [--repeat 3] [--cluster local]

The genetic algorithm on the true model, as `fit` runs it, from workers that are ready; fresh runs each time, no ledger.
Needs a quiet machine: prints the load, each time and the ratio of the best ones, and how busy the workers were, which does
not depend on the load. Exit code 1 below `--least` (1.8).
"""

import argparse
import os
import sys
import time
from pathlib import Path

CASE = Path(__file__).parents[2] / "cases" / "white_matter_2017" / "case.toml"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--case", type=Path, default=CASE)
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--cluster")
    parser.add_argument("--least", type=float, default=1.8)
    options = parser.parse_args()
    from indentfit.case import read_case

    case = read_case(options.case, options.set)
    print(f"load before: {os.getloadavg()[0]:.2f}")
    rates = {}
    for workers, cluster in ((1, None), (options.workers, options.cluster)):
        rates[workers] = max(rate(case, workers, cluster) for _ in range(options.repeat))
    ratio = rates[options.workers] / rates[1]
    print(f"{options.workers} workers reach {ratio:.2f} times the throughput of one (load after: {os.getloadavg()[0]:.2f})")
    sys.exit(ratio < options.least)


def rate(case, workers, cluster):
    """Runs per second of a search on workers that have made their models already."""
    from indentfit.inverse.genetic import search
    from indentfit.inverse.objective import problem_of
    from indentfit.inverse.workers import Pool

    problem = problem_of(case)
    options = case.fit.model_copy(update={"population": case.fit.population or 8, "generations": case.fit.generations or 4})
    with Pool(case, workers, cluster=cluster) as pool:
        first, start = next(iter(case.free)), case.start_values()
        pool.evaluate([{**start, first: start[first] * 1.01 ** (n + 1)} for n in range(workers)])  # not of the search
        before, busy, started = pool.runs, pool.seconds, time.perf_counter()
        search(problem, pool, options)
        seconds, runs = time.perf_counter() - started, pool.runs - before
        busy = (pool.seconds - busy) / seconds / workers
    print(f"{workers} workers: {runs} runs in {seconds:.1f} s, {runs / seconds:.3f} runs/s, {busy:.0%} busy", flush=True)
    return runs / seconds


if __name__ == "__main__":
    main()
