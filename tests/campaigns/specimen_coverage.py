"""Coverage campaign of tests without an indenter: do the 95 % intervals hold the truth in 95 % of 400 fits?

    python tests/campaigns/specimen_coverage.py [--truths 20] [--draws 20]

Shear along and across the fibres and tension along them, 12 points each, white noise of 2 % of the largest stress. At each of the
truths (a Latin hypercube) runs on closed forms make a surrogate, on which profile intervals of least-squares fits are counted.

Seen: mu 380, zeta 384 and phi 381 of 400 (368 to 390 are allowed), 3 minutes.

Exit code 1 where a parameter's coverage is outside of the binomial 99 % band.
"""

import argparse
import sys

import numpy as np
from scipy.stats import binom, qmc

from indentfit.case import Case, MaterialChoice, Range, Test
from indentfit.curve import Curve
from indentfit.inference.certainty import coverage
from indentfit.inverse import genetic
from indentfit.inverse.exploration import Watched, explore
from indentfit.inverse.problem import inverse_problem
from indentfit.inverse.surrogate import learn
from indentfit.runs.forward import simulate
from indentfit.runs.pool import RunPool

NOISE = 0.02  # of each test's largest stress
TRUTHS = {"mu": (0.5, 3.0), "zeta": (1.0, 10.0), "phi": (0.2, 3.0)}
RANGES = {"mu": (0.1, 6.0), "zeta": (0.0, 20.0), "phi": (0.0, 6.0)}
KEYS = (
    {"name": "along", "kind": "shear", "fibres": "along"},
    {"name": "across", "kind": "shear", "fibres": "normal"},
    {"name": "pull", "kind": "uniaxial", "loading": "tension", "fibres": "along"},
)


def inside(truth, draws, seed):
    """Whether the intervals of each of some fits hold the truth, (draws, 3)."""
    simulated = simulate(_case(truth, [Test(**keys, strain=0.2, points=12) for keys in KEYS])).curves
    curves = [Curve(curve.displacement, curve.force) for curve in simulated.values()]
    free = {name: Range(start=truth[name], min=low, max=high) for name, (low, high) in RANGES.items()}
    case = _case(free, [Test(**keys, curve=curve) for keys, curve in zip(KEYS, curves, strict=True)])
    problem = inverse_problem(case)
    with RunPool(case, 1) as workers:
        pool = Watched(workers)
        explore(problem, pool, case.fit, genetic.search)
    return coverage(problem, learn(problem, pool.known), truth, [NOISE * curve.force[-1] for curve in curves], draws, seed)


def _case(parameters, tests):
    return Case(material=MaterialChoice(model="transversely_isotropic", parameters=parameters), tests=tests)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--truths", type=int, default=20)
    parser.add_argument("--draws", type=int, default=20)
    asked = parser.parse_args()
    low, high = np.array(list(TRUTHS.values())).T
    rows = low + qmc.LatinHypercube(len(TRUTHS), seed=0).random(asked.truths) * (high - low)
    held = [inside(dict(zip(TRUTHS, row, strict=True)), asked.draws, seed) for seed, row in enumerate(rows.tolist())]
    counts, fits = np.sum(np.concatenate(held), axis=0), asked.truths * asked.draws
    least, most = binom.interval(0.99, fits, 0.95)
    for name, count in zip(TRUTHS, counts.tolist(), strict=True):
        print(f"{name}: {count} of {fits} inside; allowed {least:.0f} to {most:.0f}")
    return 0 if all(least <= count <= most for count in counts) else 1


if __name__ == "__main__":
    sys.exit(main())
