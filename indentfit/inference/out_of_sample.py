"""Out-of-sample errors of a law: a part of the curves is left out of a fit on the surrogate, and predicted by that fit."""

from collections.abc import Iterator

import numpy as np

from indentfit.arrays import Array, Ints
from indentfit.inference.evidence import Density, find_peaks
from indentfit.inference.law_curves import LawCurves
from indentfit.inference.residual_noise import unknown_noise
from indentfit.inverse.problem import InverseProblem

DEEP = 2 / 3  # of the depth: deeper points are left out
LEAST = 4  # points of a curve above DEEP, with which the rest is predicted
DEPTH = "deep third"  # the name of that part


def parts_left_out(problem: InverseProblem) -> Iterator[tuple[str, list[Ints], list[Ints]]]:
    """The parts that are left out: the deep third of all curves, then each test where there are several.

    Yields
    ------
    name of the part, and for each test the numbers of its points that are fitted, and of those that are predicted
    """
    points: list[Ints] = [np.arange(test.curve.force.size if test.weight else 0) for test in problem.tests]
    none = np.arange(0)
    shallow: list[Ints] = [
        known[test.curve.displacement[known] <= DEEP * test.curve.displacement[-1]]
        for known, test in zip(points, problem.tests, strict=True)
    ]
    if all(part.size >= LEAST for part, known in zip(shallow, points, strict=True) if known.size):
        yield DEPTH, shallow, [np.setdiff1d(known, part) for known, part in zip(points, shallow, strict=True)]
    heavy = [n for n, known in enumerate(points) if known.size]
    for n in heavy if len(heavy) > 1 else []:
        fitted = [none if k == n else known for k, known in enumerate(points)]
        yield problem.tests[n].name, fitted, [known if k == n else none for k, known in enumerate(points)]


def out_of_sample(problem: InverseProblem, curves: LawCurves, mesh: float, seed: int) -> dict[str, float]:
    """The errors with which a law predicts what it was not fitted to.

    Parameters
    ----------
    problem : InverseProblem
        The tests.
    curves : LawCurves
    mesh : float
        Relative standard deviation of the forces' error by the mesh.
    seed : int

    Returns
    -------
    dict of part -> root mean square error over the largest force of each test
    """
    errors = {}
    for name, fitted, predicted in parts_left_out(problem):
        noise = unknown_noise(problem, mesh, fitted, curves.moves)
        best = find_peaks(Density(curves, noise), seed)[0]
        errors[name] = _error(problem, curves.forces(best.z[None])[0], predicted)
    return errors


def _error(problem: InverseProblem, force: Array, predicted: list[Ints]) -> float:
    squares, start = [], 0
    for test, points in zip(problem.tests, predicted, strict=True):
        off = force[start + points] - test.curve.force[points]
        squares.append((off / np.abs(test.curve.force).max()) ** 2)
        start += test.curve.force.size
    return float(np.sqrt(np.mean(np.concatenate(squares))))
