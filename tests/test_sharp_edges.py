"""Flat punches with sharp edges: what a fit takes of their curves."""

import numpy as np
import pytest

from indentfit import Case, Curve, Indenter, MaterialChoice, Mesh, Sample, Test, fit
from indentfit.case.measured_field import MeasuredField
from indentfit.case.search import Discrepancy, Fit
from indentfit.displacements import Displacements
from indentfit.errors import CaseError
from indentfit.inverse.sharp_edges import FOLDED, LEFT_OUT, without_folds
from indentfit.layer import Layer
from indentfit.report.first_screen import next_step

# A slice of brain under a flat punch of 1.5 mm: a straight line to 0.4 mm, of 3.79 mN/mm
DEPTHS = 0.02 * np.arange(1, 21)
STIFFNESS, RADIUS, THICKNESS = 3.79, 0.75, 5.0


def slice_of_brain(depths=DEPTHS, mesh=Mesh(error=0.03), preload=0.0, field=(), misfit=None, **indenter):  # noqa: B008
    return Case(
        sample=Sample(shape="disc", diameter=30.0, thickness=THICKNESS, base="bonded"),
        indenter=Indenter(shape="cylinder", diameter=2 * RADIUS, **{"friction": 0, **indenter}),
        material=MaterialChoice(model="neo_hookean", parameters={"mu": {"start": 0.6, "min": 0.05, "max": 10}}, bulk_ratio=1000.0),
        mesh=mesh,
        tests=[Test("white", curve=Curve(depths, preload + STIFFNESS * depths), field=list(field))],
        fit=Fit(
            workers=1,
            method="least_squares" if field else "ga",
            discrepancy=Discrepancy(scale=misfit),
        ),
    )


@pytest.mark.quick
def test_a_curve_ends_where_the_error_of_a_sharp_edge_reaches_that_of_the_mesh():
    """The error is half of the squared depth over the radius: 1 % at 0.141 radii, 3 % at 0.245."""
    for error, last in ((0.01, 0.106), (0.03, 0.184)):
        shallower = without_folds(slice_of_brain(mesh=Mesh(error=error)))
        kept = DEPTHS[last >= DEPTHS]
        assert shallower.case.curves[0].displacement == pytest.approx(kept)
        (said,) = shallower.said
        assert said.startswith(LEFT_OUT) and f"first {kept.size} of 20 points" in said and "edge_radius" in said


@pytest.mark.quick
@pytest.mark.parametrize(
    "case",
    [
        slice_of_brain(edge_radius=0.05),
        slice_of_brain(friction="stick"),
        slice_of_brain(0.1 * DEPTHS),
    ],
    ids=["rounded", "sticks", "shallow"],
)
def test_all_points_are_fitted_where_no_edge_folds(case):
    shallower = without_folds(case)
    assert shallower.case is case and not shallower.said


@pytest.mark.quick
def test_folded_points_that_are_fitted_since_too_few_would_be_left_are_told():
    case = slice_of_brain(0.2 * np.arange(1, 6))
    shallower = without_folds(case)
    assert shallower.case is case
    (said,) = shallower.said
    assert said.startswith(FOLDED) and "beyond 0.184 mm" in said


@pytest.mark.quick
def test_a_field_beside_a_curve_that_would_be_cut_is_refused():
    """Displacements of the deepest state would be compared with those of the last point that is left."""
    points, moved = np.array([[r, 5.0, 0.0] for r in (1.0, 2.0, 3.0, 4.0)]), np.array(4 * [[np.nan, -0.1, np.nan]])
    seen = Displacements.of(points, moved, 0.001, np.nan, "oct.csv")
    with pytest.raises(CaseError, match="edge_radius"):
        without_folds(slice_of_brain(field=[MeasuredField(file=seen)]))


def test_a_stiffness_at_small_strain_gives_the_modulus_of_the_exact_layer_and_a_deep_line_nearly_so():
    """A neo-Hookean gel is 1.4 % softer than the line at 0.13 radii and 9 % at 0.53, whose fit had a mu that was 9 % too large."""
    exact = STIFFNESS / (THICKNESS * Layer(True, 0.4995).punch_stiffness(RADIUS / THICKNESS))
    shallow, deep = fit(slice_of_brain(0.02 * DEPTHS, Mesh())), fit(slice_of_brain(mesh=Mesh()))
    assert shallow.parameters["mu"].value == pytest.approx(exact, rel=0.01)
    low, high = shallow.parameters["mu"].interval
    assert 0.999 * low < exact < 1.001 * high  # the layer's own error is 0.1 %
    assert deep.parameters["mu"].value == pytest.approx(exact, rel=0.015)
    for result in (shallow, deep):
        assert result.parameters["mu"].verdict.startswith("determined")
    assert any(said.startswith(LEFT_OUT) for said in deep.conclusions)
    assert not any(said.startswith(LEFT_OUT) for said in shallow.conclusions)
    # the line is not the law's curve: its interval leaves out the layer's modulus, which the result says, with what holds it
    assert not deep.parameters["mu"].interval[0] < exact and "fit.discrepancy" in next_step(deep)
    wide = fit(slice_of_brain(mesh=Mesh(), misfit="unknown"))
    low, high = wide.parameters["mu"].interval
    assert low < exact < high and "fit.discrepancy" not in next_step(wide)


def test_a_punch_whose_curve_begins_with_a_preload_determines_nothing():
    """The interval is narrow, but the curve is that of another contact."""
    result = fit(slice_of_brain(0.2 * DEPTHS, preload=0.02))
    mu = result.parameters["mu"]
    assert mu.verdict.startswith("not determined: the recording of white") and mu.limited_by == "recording"
    assert result.conclusions[0].startswith("not determined by this curve")
    assert next_step(result).startswith("mend white first")
