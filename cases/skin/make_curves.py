"""Writes the curves of this case: the forward model on a finer mesh, at known parameters, and the noise of a load cell.

    python cases/skin/make_curves.py

Run it again only when the forward model has changed on purpose; the case's README states the truth and the noise.
"""

from pathlib import Path

import numpy as np

from indentfit.curve import Curve, write_curve
from indentfit.experiment.measured import read_case
from indentfit.runs.forward import simulate

HERE = Path(__file__).parent
TRUTH = {"skin.mu": 11.7, "fat.mu": 0.67}
NOISE = 0.005  # standard deviation, of a curve's largest force
SEED = 2008
OUTPUTS = ["test.small.depth=0.4", "test.large.depth=1.2", "test.small.points=20", "test.large.points=20"]  # mm
FINER = "mesh.error=0.003"


def main():
    rng = np.random.default_rng(SEED)
    case = read_case(HERE / "case.toml", [*OUTPUTS, FINER])
    for test in simulate(case, TRUTH, mesh_error=False).tests:
        noisy = test.force + NOISE * test.force.max() * rng.standard_normal(test.force.size)
        write_curve(HERE / "curves" / f"{test.name}.csv", Curve(np.round(test.displacement, 6), np.round(noisy, 4)))


if __name__ == "__main__":
    main()
