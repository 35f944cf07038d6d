"""Campaign of force curves with 50 points of the sample's side: width and coverage of phi, and how often a wrong base is noticed.

    python tests/campaigns/field_coverage.py [--truths 10] [--draws 40] [--base 40]

The case is cases/quickstart (strip, two tests, 0.5 % noise of the forces) with 50 points on the side that faces x in the test
across the fibres, at their deepest, ux and uy with 5 um noise. At each of the truths (a Latin hypercube) runs make a surrogate, on
which profile intervals of least-squares fits are counted. With --base the curves and displacements are those of a bonded base, and
the fit believes in a sliding one: how many fits say that a test contradicts the others, or that displacements cannot be followed?

Seen, 10 truths with 40 draws each: mu 372, zeta 374 and phi 383 of 400 (368 to 390 are allowed); base: 20 of 20 noticed.

Exit code 1 where a parameter's coverage is outside of the binomial 99 % band.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy.stats import binom, qmc

from indentfit.case.field_tests import with_field_tests
from indentfit.case.measured_field import MeasuredField
from indentfit.displacements import Displacements
from indentfit.experiment.measured import read_case
from indentfit.inference.certainty import coverage
from indentfit.inference.consistency import predictions
from indentfit.inference.estimate import estimate
from indentfit.inference.misfit import no_fit
from indentfit.inverse import genetic
from indentfit.inverse.derivatives import evaluate_at_reference
from indentfit.inverse.exploration import Watched, explore
from indentfit.inverse.problem import inverse_problem
from indentfit.inverse.surrogate import learn
from indentfit.runs.parted import Parted
from indentfit.runs.pool import RunPool

QUICKSTART = Path(__file__).parents[2] / "cases" / "quickstart" / "case.toml"
POINTS, SD, NOISE = 50, 0.005, 0.005
TRUTH = {"mu": 1.2, "zeta": 3.0, "phi": 0.8}
TRUTHS = {"mu": (0.5, 3.0), "zeta": (1.0, 8.0), "phi": (0.2, 3.0)}


def with_side(case, moved=None):
    """The case with 50 points on its side, and their displacements (50, 2) along x and y."""
    y = np.linspace(0.02, 0.98, POINTS) * case.sample.thickness
    points = np.column_stack([np.full(POINTS, case.sample.diameter / 2), y, np.zeros(POINTS)])
    values = np.full((POINTS, 3), np.nan)
    values[:, :2] = 0.0 if moved is None else moved
    field = MeasuredField(file=Displacements.of(points, values, SD, name="side.csv"))
    across = case.tests[1].model_copy(update={"field": (field,)})
    return case.model_copy(update={"tests": (case.tests[0], across)})


def curves_at(case, truth):
    """Forces of both tests and the displacements of the side at a truth."""
    with RunPool(case, 1) as pool:
        return Parted.of(pool, case).evaluate([truth])[0].forces


def problem_with(case, forces):
    """The case whose measured curves are these, and its problem."""
    bare = case.model_copy(update={"tests": tuple(test.model_copy(update={"field": ()}) for test in case.tests)})
    curves = tuple(curve.with_force(force) for curve, force in zip(case.curves, forces[:2], strict=True))
    own = with_side(bare.model_copy(update={"curves": curves}), forces[2].reshape(POINTS, 2))
    return own, inverse_problem(with_field_tests(own))


def learned(own, problem):
    with RunPool(own, 1) as workers:
        pool = Watched(Parted.of(workers, own))
        explore(problem, pool, own.fit, genetic.search)
    return pool, learn(problem, pool.known)


def noticed(problem, surrogate, pool, seed):
    """Whether a fit on the surrogate says that its curves cannot be those of its base, and by which word."""
    x = estimate(problem, surrogate, problem.weights, problem.units(TRUTH))[0]
    best = problem.judge(problem.parameters(x), evaluate_at_reference(problem, surrogate, [problem.parameters(x)])[0].forces)
    if no_fit(problem, best, pool.known):
        return "no fit"
    known = predictions(problem, surrogate, x, [[] for _ in problem.tests], seed)
    return "contradicts" if any(each.contradicts for each in known.values()) else ""


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--truths", type=int, default=10)
    parser.add_argument("--draws", type=int, default=40)
    parser.add_argument("--base", type=int, default=0, help="draws of curves of another base, in place of the coverage")
    asked = parser.parse_args()
    case = with_side(read_case(QUICKSTART))
    if asked.base:
        bonded = case.model_copy(update={"sample": case.sample.with_key("base", "bonded")})
        forces, rng = curves_at(bonded, TRUTH), np.random.default_rng(0)
        own, problem = problem_with(case, forces)
        pool, surrogate = learned(own, problem)
        sds = [NOISE * forces[0][-1], NOISE * forces[1][-1], SD]
        said = [
            noticed(
                problem.measured([f + sd * rng.standard_normal(f.size) for f, sd in zip(forces, sds, strict=True)]),
                surrogate, pool, seed,
            )
            for seed in range(asked.base)
        ]  # fmt: skip
        print({word: said.count(word) for word in set(said)}, f"noticed {sum(map(bool, said))} of {asked.base}")
        return 0 if sum(map(bool, said)) >= 0.95 * asked.base else 1
    low, high = np.array(list(TRUTHS.values())).T
    rows, held = low + qmc.LatinHypercube(len(TRUTHS), seed=0).random(asked.truths) * (high - low), []
    for seed, row in enumerate(rows.tolist()):
        truth = dict(zip(TRUTHS, row, strict=True))
        forces = curves_at(case, truth)
        own, problem = problem_with(case, forces)
        pool, surrogate = learned(own, problem)
        sds = [NOISE * forces[0][-1], NOISE * forces[1][-1], SD]
        held.append(coverage(problem, surrogate, truth, sds, asked.draws, seed))
        print(truth, held[-1].sum(axis=0), pool.evaluations, flush=True)
    counts, fits = np.sum(np.concatenate(held), axis=0), asked.truths * asked.draws
    least, most = binom.interval(0.99, fits, 0.95)
    for name, count in zip(TRUTHS, counts.tolist(), strict=True):
        print(f"{name}: {count} of {fits} inside; allowed {least:.0f} to {most:.0f}")
    return 0 if all(least <= count <= most for count in counts) else 1


if __name__ == "__main__":
    sys.exit(main())
