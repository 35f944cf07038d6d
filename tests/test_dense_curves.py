"""Curves of many points are fitted as means of neighbours."""

import csv
import json

import numpy as np
import pytest
from click.testing import CliRunner
from fixtures.cases import tiny_case
from scipy.interpolate import CubicSpline

from indentfit.cli import main
from indentfit.curve import Curve, read_curve, write_curve
from indentfit.experiment.measured import read_case
from indentfit.inverse.dense_curves import DENSE, MOST, averaged, means_of
from indentfit.runs.forward import simulate

ROUND = {
    "sample": {"shape": "disc", "diameter": 12.0, "thickness": 3.0, "base": "bonded"},
    "indenter": {"shape": "sphere", "radius": 1.0, "friction": 0.0, "width": None, "length": None, "edge_radius": None},
    "mesh": {"elements": 40},
    "material": {"model": "neo_hookean", "parameters": {"mu": {"start": 1.0, "min": 0.1, "max": 10.0}}, "bulk_ratio": 1000.0},
    "test": [{"name": "press", "curve": "press.csv"}],
    "fit": {"workers": 1, "uncertain": {"mesh": 0}},
}


def hertz(points, noise=0.01, late=0.0):
    depth = np.linspace(0.3 / points, 0.3, points)
    force = 16.0 * depth**1.5
    return Curve(depth, force + noise * force.max() * np.random.default_rng(2).standard_normal(points))


def test_means_of_neighbours_and_their_deviations():
    depth, sd = np.arange(1.0, 8.0), np.array([1.0, 1, 2, 1, 1, 1, 4])
    known = means_of(Curve(depth, 10 * depth, ("a note",), 0.1, sd, depth), 3)
    assert known.displacement == pytest.approx([(1 + 2 + 3 / 4) / 2.25, 4.5 + 0.5 - 0.5 + 0.0, (6 + 7 / 16) / (1 + 1 / 16)])
    assert known.force == pytest.approx(10 * known.displacement) and known.time == pytest.approx(known.displacement)
    assert known.sd == pytest.approx([2.25**-0.5, 2**-0.5, (1 + 1 / 16) ** -0.5])
    assert known.notes == ("a note",) and known.contact == 0.1


@pytest.mark.parametrize("points", [DENSE + 1, 1000, 100_000])
def test_a_smooth_curve_loses_nothing(points):
    known = means_of(hertz(points, noise=0.0), -(-points // MOST))
    assert MOST / 2 < known.force.size <= MOST
    assert np.abs(known.force - 16.0 * known.displacement**1.5).max() < 5e-5 * 16 * 0.3**1.5


def test_what_is_not_dense_or_jumps_is_fitted_as_it_is(tmp_path):
    write_curve(tmp_path / "press.csv", hertz(DENSE))
    case = read_case(tiny_case(tmp_path, **ROUND))
    assert averaged(case).case is case and averaged(case).said == ()
    up_and_down = Curve([0.1, 0.3, 0.2] * 100, np.ones(300), time=np.arange(300.0))
    other = case.model_copy(update={"curves": (up_and_down,)})
    assert averaged(other).case is other


def test_crowded_points_are_fitted_as_they_are(tmp_path):
    """2,900 points in the first 2 % of the depth and 40 beyond: groups of equal numbers spanned most of the depth, and mu was 6 %
    off beside an interval of 0.3 %."""
    write_curve(tmp_path / "press.csv", hertz(DENSE))
    case = read_case(tiny_case(tmp_path, **ROUND))
    slow, ramp = np.linspace(2e-6, 0.006, 2900), np.linspace(0.008, 0.3, 40)
    depth = np.concatenate([slow, ramp])
    crowded = case.model_copy(update={"curves": (Curve(depth, 16.0 * depth**1.5),)})
    assert averaged(crowded).case is crowded
    even = case.model_copy(update={"curves": (hertz(2900),)})
    assert averaged(even).case.curves[0].force.size == 100


def test_a_dense_curve_has_the_estimate_of_all_of_its_points(tmp_path, undrawn):
    """Noise of 1 % on 1,000 points: the same value but for the waves of a coarse mesh (0.1 %: the means end at another depth), the
    interval as wide; the result has the means, its copy of the case all points."""
    write_curve(tmp_path / "press.csv", hertz(40))
    path = tiny_case(tmp_path, **ROUND)
    exact = simulate(read_case(path), {"mu": 2.5}).tests[0]
    follow = CubicSpline(np.append(0.0, exact.displacement), np.append(0.0, exact.force))
    depth = np.linspace(3e-4, 0.3, 1000)
    noise = 0.01 * exact.force.max() * np.random.default_rng(2).standard_normal(1000)
    write_curve(tmp_path / "press.csv", Curve(depth, follow(depth) + noise))
    done = CliRunner().invoke(main, ["fit", str(path), "-o", str(tmp_path / "means"), "--no-fields"], catch_exceptions=False)
    assert done.exit_code == 0 and "press: its 1,000 points are fitted as 100 means of 10 neighbours" in done.stdout
    means = json.loads((tmp_path / "means" / "result.json").read_text())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("indentfit.inverse.dense_curves.DENSE", 10_000)
        CliRunner().invoke(main, ["fit", str(path), "-o", str(tmp_path / "all"), "--no-fields"], catch_exceptions=False)
    every = json.loads((tmp_path / "all" / "result.json").read_text())
    known, other = (result["parameters"]["mu"] for result in (means, every))
    assert known["value"] == pytest.approx(other["value"], rel=1.5e-3)
    assert np.diff(known["interval"]) == pytest.approx(np.diff(other["interval"]), rel=0.2)
    assert read_curve(tmp_path / "means" / "press.csv").force.size == 1000
    with (tmp_path / "means" / "curves.csv").open() as file:
        assert len(list(csv.reader(file))) == 101


def test_laws_are_compared_on_means(tmp_path, undrawn):
    write_curve(tmp_path / "press.csv", hertz(200))
    path = tiny_case(tmp_path, **ROUND)
    words = ["compare", str(path), "--materials", "neo_hookean,mooney_rivlin", "-o", str(tmp_path / "out")]
    done = CliRunner().invoke(main, words, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    sizes = {len(law["curves"]["press"]) for law in result["laws"] if law["curves"]}
    assert sizes == {len(result["measured"]["press"]["force_mN"])} == {100}
