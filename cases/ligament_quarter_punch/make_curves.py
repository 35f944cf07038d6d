"""Writes the curves of this case: the forward model itself at known parameters, and a little noise.

    python cases/ligament_quarter_punch/make_curves.py

Run it again only when the forward model has changed on purpose; the case's README states the truth and the noise.
"""

from pathlib import Path

import numpy as np

from indentfit.curve import Curve, write_curve
from indentfit.experiment.measured import read_case
from indentfit.runs.forward import simulate

HERE = Path(__file__).parent
TRUTH = {"mu": 2750.0, "zeta": 29.0, "phi": 0.0}
NOISE = 0.005  # standard deviation, of a curve's largest force
SEED = 1998
OUTPUTS = [f"test.{name}.{key}" for name in ("slack", "taut") for key in ("depth=0.3", "points=20")]  # mm


def main():
    rng = np.random.default_rng(SEED)
    case = read_case(HERE / "case.toml", OUTPUTS)
    for test in simulate(case, TRUTH, mesh_error=False).tests:
        noisy = test.force + NOISE * test.force.max() * rng.standard_normal(test.force.size)
        write_curve(HERE / "curves" / f"{test.name}.csv", Curve(np.round(test.displacement, 6), np.round(noisy, 2)))


if __name__ == "__main__":
    main()
