"""Small numbers stay readable: units and digits of tables and figures."""

import numpy as np
import pytest
from fixtures.cases import tiny_case

from indentfit.curve import Curve
from indentfit.digits import Scale, fixed, plainly, quantity
from indentfit.experiment.measured import read_case
from indentfit.report import plots
from indentfit.report.digits import CurveScale
from indentfit.runs.forward import simulate

pytestmark = pytest.mark.quick


@pytest.mark.parametrize(
    ("values", "unit", "texts"),
    [
        ([0.0132, 0.33], "mm", ("mm", ["0.0132", "0.3300"])),
        ([0.00002, 0.0005], "mm", ("um", ["0.0200", "0.5000"])),
        ([4e-6, 2e-4], "mN", ("uN", ["0.0040", "0.2000"])),
        ([1.2e-7, 3e-6], "mN", ("nN", ["0.120", "3.000"])),
        ([24.0561, 0.5], "mN", ("mN", ["24.06", "0.50"])),
        ([99960.0], "mN", ("mN", ["99960"])),
        ([0.0, 0.0], "mN", ("mN", ["0.000", "0.000"])),
        ([float("nan"), 2.0], "mN", ("mN", ["nan", "2.000"])),
    ],
)
def test_a_column_has_one_unit_and_digits_that_line_up(values, unit, texts):
    scale = Scale.of(values, unit)
    assert (scale.unit, [scale.text(value) for value in values]) == texts


def test_an_error_shows_two_digits():
    scale = Scale.of([1.5], "mm")
    assert scale.text_with_error(1.5, 0.0123) == "1.500 +- 0.012"
    assert scale.text_with_error(1.5, 0.0000123) == "1.500000 +- 0.000012"
    assert Scale.of([0.0005], "mm").text_with_error(0.0002, 0.00001) == "0.2000 +- 0.0100"


def test_single_numbers():
    assert [quantity(1.2e-4, "mN"), quantity(3.3e-6, "mN"), quantity(0.33, "mm"), quantity(5e-4, "mm")] == [
        "0.12 uN", "3.3 nN", "0.33 mm", "0.5 um",
    ]  # fmt: skip
    assert quantity(19964.6, "mN") == "19960 mN"  # in full, not 2e+04
    texts = [fixed(value) for value in (24.05612, 0.5, 0.0001966, 0.0, -2e-5)]
    assert texts == [
        "24.056",
        "0.500",
        "0.000197",
        "0.000",
        "-0.0000200",
    ]


def test_a_figure_of_a_bead_has_its_units():
    curve = Curve(np.linspace(1e-5, 5e-4, 9), np.linspace(1e-7, 2e-6, 9))
    upper, lower = plots.force_displacement([("press", curve)], [("press", curve)], None).axes
    assert (upper.get_ylabel(), lower.get_xlabel()) == ("Force (nN)", "Displacement (µm)")
    assert upper.get_xlim()[1] == pytest.approx(0.5, rel=0.2)
    assert CurveScale.of([curve]).scaled(curve).force[-1] == pytest.approx(2.0)


def test_a_simulated_bead_can_be_read(tmp_path):
    """A flat punch of 1 um on 10 um of 333 Pa: the forces are nN, and the table tells each with three digits or more."""
    punch = {"shape": "cylinder", "width": None, "length": None, "diameter": 1e-3}
    size = {"diameter": 0.02, "thickness": 0.01, "base": "bonded"}
    gel = {"parameters": {"mu": 0.333}}
    test = [{"name": "press", "depth": 1e-4, "points": 2}]
    result = simulate(read_case(tiny_case(tmp_path, sample=size, indenter=punch, material=gel, test=test)))
    head, unit, first, last = result.summary().splitlines()[2:6]
    assert (head.split(), unit.split()) == (["displacement", "force,", "nN"], ["um", "press"])
    forces = [float(row.split()[1]) for row in (first, last)]
    np.testing.assert_allclose(forces, result.curves["press"].force * 1e6, rtol=2e-3)
    assert [row.split()[0] for row in (first, last)] == ["0.0500", "0.1000"]


def test_numbers_of_usual_size_are_written_in_full():
    numbers = (5000.0, 25.68, 0.0, 0.00123, 999.6, -3.0, 12345678.0, 5e-5)
    assert [plainly(number) for number in numbers] == ["5000", "25.7", "0", "0.00123", "1000", "-3", "1.23e+07", "5e-05"]
