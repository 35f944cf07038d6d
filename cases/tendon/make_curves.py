"""Writes the curves of this case: the forward model itself at known parameters, and a little noise.

    python cases/tendon/make_curves.py

Run it again only when the forward model has changed on purpose; the case's README states the truth and the noise.
"""

from pathlib import Path

import numpy as np

from indentfit.curve import Curve, write_curve
from indentfit.experiment.measured import read_case
from indentfit.runs.forward import simulate

HERE = Path(__file__).parent
TRUTH = {"c": 2880.0, "c3": 570.0}  # kPa; the other parameters as case.toml has them
NOISE = 0.005  # standard deviation, of a curve's largest force
SEED = 1996
OUTPUTS = [f"test.{name}.depth=0.3" for name in ("along", "across")]  # mm, at 25 points


def main():
    rng = np.random.default_rng(SEED)
    case = read_case(HERE / "case.toml", OUTPUTS)
    for test in simulate(case, {**case.start_values(), **TRUTH}, mesh_error=False).tests:
        noisy = test.force + NOISE * test.force.max() * rng.standard_normal(test.force.size)
        write_curve(
            HERE / "curves" / f"{test.name.replace(' ', '_')}.csv", Curve(np.round(test.displacement, 6), np.round(noisy, 4))
        )


if __name__ == "__main__":
    main()
