"""What the tests share: cases made from keys, without files of their own."""

import os
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import pytest  # noqa: E402 - the numerical libraries read the number of threads when they are loaded

from indentfit.experiment.measured import read_case  # noqa: E402
from indentfit.fem.setup import Press  # noqa: E402
from indentfit.fem.simulate import Model  # noqa: E402
from indentfit.runs.points import setup_of  # noqa: E402

CASES = Path(__file__).parent.parent / "cases"
SHARED = Path(__file__).parent.parent.parent / "shared"
OPTIMUM = "material.parameters={mu=1.49,zeta=4.68,phi=0.68}"
ISOTROPIC = "material.parameters={mu=1.0,zeta=0.0,phi=0.0}"


def white_matter(*overrides):
    """The white-matter case at the paper's optimum, with `--set` texts on top."""
    return read_case(CASES / "white_matter_2017" / "case.toml", [OPTIMUM, *overrides])


@pytest.fixture
def run():
    """run(*overrides, angle=, depths=) -> TestResult on the white-matter case."""

    def run(*overrides, angle, depths):
        case = white_matter(*overrides)
        material = case.law(**case.start_values())
        kappa = case.material.bulk_modulus(material.shear_modulus)
        return Model(setup_of(case)).run(Press(material, kappa, angle, depths))

    return run


@pytest.fixture
def stiffness():
    """stiffness(*overrides, angle=) -> small-strain stiffness of the full sample, mN/mm."""

    def stiffness(*overrides, angle=0):
        case = white_matter(*overrides)
        material = case.law(**case.start_values())
        return Model(setup_of(case)).stiffness(material, case.material.bulk_modulus(material.shear_modulus), angle)

    return stiffness
