"""Writes the curves of this case: the forward model itself at known parameters, and a little noise.

    python cases/quickstart/make_curves.py

Run it again only when the forward model has changed on purpose; the case's README states the truth and the noise.
"""

from pathlib import Path

import numpy as np

from indentfit.curve import Curve, write_curve
from indentfit.experiment.measured import read_case
from indentfit.runs.forward import simulate

HERE = Path(__file__).parent
TRUTH = {"mu": 1.2, "zeta": 3.0, "phi": 0.8}
NOISE = 0.005  # standard deviation, of a curve's largest force
SEED = 2017
OUTPUTS = ["test.parallel.depth=0.33", "test.perpendicular.depth=0.33"]  # mm, at 25 points; the curves are yet to be


def main():
    rng = np.random.default_rng(SEED)
    for test in simulate(read_case(HERE / "case.toml", OUTPUTS), TRUTH).tests:
        noisy = test.force + NOISE * test.force.max() * rng.standard_normal(test.force.size)
        curve = Curve(np.round(test.displacement, 6), np.round(noisy, 4))
        write_curve(HERE / "curves" / f"{test.name}.csv", curve)


if __name__ == "__main__":
    main()
