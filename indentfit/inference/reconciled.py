"""What would make tests agree that contradict each other: another contact point of one test, or a factor on its forces.

Both are undone on the measured curve of one test, and all tests are fitted together again. A cause explains a contradiction where
hardly anything is left of the squares by which the fit to all tests exceeds the fits to each. A late contact bends a curve where a
stiffer sample, another direction or a wrong gain multiplies it, so that mostly one of the two explains it.
"""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import minimize_scalar

from indentfit.arrays import Array
from indentfit.digits import quantity
from indentfit.inference.posterior import Shift
from indentfit.inverse.objective import Target

EXPLAINS = 0.9  # share of the contradiction that a cause removes
AS_LIKELY = 9.0  # squares by which a cause may leave more than the best one
FARTHEST = 0.2  # shift of a contact point, over the depth
LARGEST = 1.5  # logarithm of a factor
SEARCHED = 16  # fits of a search
AGREE = "the tests would agree if"
Least = Callable[[list[Array]], float]


def reconciled(tests: Sequence[Target], wrong: Sequence[int], pressed: Sequence[bool], least: Least, alone: float) -> str:
    """A sentence on what would make tests agree; empty where nothing is known.

    Parameters
    ----------
    tests : sequence of Target
    wrong : sequence of int
        The numbers of the tests that contradict the others.
    pressed : for each test whether it is an indentation, which has a contact point
    least : function
        From measured curves of all tests to the least weighted squares of one set of parameters.
    alone : float
        The squares that fits to each test leave.

    Returns
    -------
    str
    """
    measured = [test.curve.force for test in tests]
    too_many = least(measured) - alone
    if too_many <= 0:
        return ""
    pair = len(tests) == 2 and len(wrong) == 2
    said, left_by = [], []
    for n in wrong[-1:] if pair else wrong:
        name, other = tests[n].name, tests[1 - n].name if pair else ""
        shift = Shift.of(tests[n].curve.displacement)
        deepest = float(np.abs(tests[n].curve.displacement).max())

        def later(late: float, n: int = n, shift: Shift = shift) -> list[Array]:
            return _with(measured, n, shift.by(-late)[0] @ measured[n])

        def larger(log: float, n: int = n) -> list[Array]:
            return _with(measured, n, measured[n] * np.exp(-log))

        if pressed[n]:
            late, left = _least(least, later, FARTHEST * deepest)
            left_by.append(left)
            said.append(f"the contact point of {name} were {_by_length(late)}{f', or that of {other} {_by_length(-late)}' * pair}")
        log, left = _least(least, larger, LARGEST)
        left_by.append(left)
        said.append(
            f"the forces of {name} were {_by_factor(-log)}{f', or those of {other} {_by_factor(log)}' * pair} "
            "(another sample, direction or gain)"
        )
    most = min(alone + (1 - EXPLAINS) * too_many, min(left_by) + AS_LIKELY)
    explain = [words for left, words in sorted(zip(left_by, said, strict=True)) if left <= most]
    return f"{AGREE} {'; or if '.join(explain)}" if explain else ""


def _with(measured: Sequence[Array], n: int, curve: Array) -> list[Array]:
    return [curve if k == n else known for k, known in enumerate(measured)]


def _least(least: Least, changed: Callable[[float], list[Array]], most: float) -> tuple[float, float]:
    """The size of a cause that leaves the least squares, and these."""
    ended = minimize_scalar(
        lambda size: least(changed(size)), bounds=(-most, most), method="bounded", options={"maxiter": SEARCHED}
    )
    return float(ended.x), float(ended.fun)


def _by_length(late: float) -> str:
    return f"{quantity(abs(late), 'mm', 2)} {'later' if late > 0 else 'earlier'}"


def _by_factor(log: float) -> str:
    return f"{abs(np.expm1(log)):.0%} {'larger' if log > 0 else 'smaller'}"
