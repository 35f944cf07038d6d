"""Records that were zeroed after contact are told from those of another law, and from late contacts."""

from types import SimpleNamespace

import numpy as np
import pytest

from indentfit.case import Case, Indenter, MaterialChoice, Range, Sample, Test
from indentfit.curve import Curve
from indentfit.inference.zeroed_late import zeroed_late
from indentfit.inverse.objective import Target

DEPTH = np.linspace(0.02, 0.5, 25)


def sphere(depth):
    """Hertz."""
    return 40 * np.maximum(depth, 0.0) ** 1.5


def said_of(measured, computed, shape="sphere", systematic=("press",)):
    size = {"radius": 2.0} if shape == "sphere" else {"diameter": 2.0}
    curve = Curve(DEPTH, measured)
    case = Case(
        sample=Sample(shape="disc", diameter=20.0, thickness=5.0, base="bonded"),
        indenter=Indenter(shape=shape, friction=0.0, **size),
        material=MaterialChoice(model="neo_hookean", parameters={"mu": Range(start=1.0, min=0.1, max=10.0)}, bulk_ratio=1000.0),
        tests=[Test("press", curve=curve)],
    )
    problem = SimpleNamespace(tests=(Target("press", curve, 1.0),), segmented=False)
    return list(zeroed_late(case, problem, [computed], systematic))


def test_a_sphere_whose_first_depths_are_lost_is_told_with_their_size():
    """Both zeroed after 0.1 mm; the optimum is 1.4 times as stiff, as by least squares."""
    (said,) = said_of(sphere(DEPTH + 0.1) - sphere(0.1), 1.4 * sphere(DEPTH))
    assert "the first 0.1 mm or so of press" in said and "zeroed" in said


@pytest.mark.parametrize(
    ("measured", "computed"),
    [
        (sphere(DEPTH), sphere(DEPTH)),
        (sphere(DEPTH - 0.05), 0.85 * sphere(DEPTH)),  # a late contact
        (sphere(DEPTH) * (1 + DEPTH), 1.4 * sphere(DEPTH)),  # a law that stiffens
    ],
    ids=["right", "late", "another law"],
)
def test_no_loss_is_told_of_other_curves(measured, computed):
    assert said_of(measured, computed) == []


def test_nothing_is_told_of_a_flat_punch_or_of_residuals_that_are_noise():
    measured = sphere(DEPTH + 0.1) - sphere(0.1)
    assert said_of(measured, 1.4 * sphere(DEPTH), shape="cylinder") == []
    assert said_of(measured, 1.4 * sphere(DEPTH), systematic=()) == []
