"""Make press.csv: the curve of this case at a known truth, on a finer mesh than the default, with the noise of a load cell.

    python make_curve.py

Truth: Young's modulus 9 kPa. The sphere goes 1 mm deep, 20 % of the gel's thickness, and 25 forces are recorded, each with an
independent error of 1 % of the largest.
"""

from pathlib import Path

import numpy as np

from indentfit.curve import Curve, write_curve
from indentfit.experiment.measured import read_case
from indentfit.runs.forward import simulate

HERE = Path(__file__).parent
YOUNG, NOISE, SEED = 9.0, 0.01, 17
FINER = ("mesh.elements=2500",)
DEPTH = ("test.press.depth=1.0", "test.press.points=25")


def exact_curve() -> Curve:
    """The curve at the truth, without noise, on the finer mesh."""
    case = read_case(HERE / "case.toml", (f"material.young={YOUNG}", *FINER, *DEPTH))
    return simulate(case).curves["press"]


def noisy(curve: Curve) -> Curve:
    """The curve with noise."""
    errors = np.random.default_rng(SEED).normal(size=curve.force.size)
    return Curve(curve.displacement.round(6), (curve.force + NOISE * curve.force.max() * errors).round(6))


if __name__ == "__main__":
    write_curve(HERE / "press.csv", noisy(exact_curve()))
