"""Figures of the studies: every text inside, none on another, and what is drawn is what was given."""

import itertools

import numpy as np
import pytest

from indentfit.curve import Curve
from indentfit.inference.result import ConfirmedPoint, ParameterEstimate, Profile
from indentfit.report import plots, study_plots

TESTS = {"parallel": 0, "a perpendicular test, second sample": 90}


def curves(stiffness):
    d = np.linspace(0.05, 0.3, 6)
    return {name: Curve(d, stiffness * (n + 1) * d) for n, name in enumerate(TESTS)}


def by_value(tests=TESTS, values=("0.2", "0.3", "stick", "0.45")):
    points = [(value, curves(60 + 5 * n)) for n, value in enumerate(values)]
    return study_plots.curves_by_value("indenter.friction", tests, ("0.5", curves(100)), points, None)


def ranked():
    rows = [(key, test, share) for key, share in (("material.mu", 0.3), ("indenter.edge_radius", 1e-5)) for test in TESTS]
    return study_plots.ranked(rows, TESTS, None)


def grid(keys=("indenter.friction", "material.mu")):
    points = [
        ((f, mu), (float(f), float(mu)), {n: float(f) * float(mu) * 50 for n in TESTS}) for f in ("0.2", "0.5") for mu in "12"
    ]
    return study_plots.forces_on_grid(keys, [*points, (("0.9", "1"), (0.9, 1.0), None)], TESTS, None)


def convergence(number=4):
    h = np.array([1.0, 0.8, 0.6])
    kinds = ("Force at the last\ndisplacement (mN)", "Stiffness (mN/mm)")
    line = np.column_stack([h, 70 + h])
    families = [(name, kind, h, 70 + h, line, (69.5, 71.0)) for name in TESTS for kind in kinds]
    return study_plots.mesh_convergence(families[:number], None)


def cost():
    series = {name: [0.5, 0.4, 0.35] for name in TESTS}
    return study_plots.error_and_cost(
        np.array([1.0, 0.8, 0.6]), ("RMSE against the measured curve (mN)", series), [2.1, 4.0, 9.0], None
    )


def profile():
    runs = (ConfirmedPoint(value=3.0, chi2=4.2, predicted=4.0), ConfirmedPoint(value=5.0, chi2=None, predicted=4.0))
    return plots.profile("zeta", Profile((3, 4, 5), (4, 0, 4), 4.0, (3, 5), runs), ParameterEstimate(4.0, "1"))


def steep():
    """A profile whose run at one end lies a thousand axes high: its marker takes no room."""
    runs = (ConfirmedPoint(value=3.0, chi2=8000.0, predicted=4.0), ConfirmedPoint(value=5.0, chi2=4.1, predicted=4.0))
    return plots.profile("Jm", Profile((3, 4, 5), (4, 0, 4), 4.0, (3, 5), runs), ParameterEstimate(4.0, "1"))


def course():
    return study_plots.course([9.0, 3.0, 4.0, 0.2], ["ga", "ga", "ga", "gauss-newton"])


FIGURES = {
    "by value": by_value,
    "by value, one test": lambda: by_value({"parallel": 0}),
    "by value, many": lambda: by_value(values=[f"{n / 50:g}" for n in range(40)]),
    "ranked": ranked,
    "grid": grid,
    "convergence": convergence,
    "convergence, one": lambda: convergence(1),
    "cost": cost,
    "profile": profile,
    "steep profile": steep,
    "course": course,
}


def shown(axis):
    """The labels of the ticks that lie within the axis."""
    low, high = sorted(axis.get_view_interval())
    slack = 1e-9 * (high - low)
    return [
        one for at, one in zip(axis.get_majorticklocs(), axis.get_ticklabels(), strict=True) if low - slack <= at <= high + slack
    ]


@pytest.mark.parametrize("name", FIGURES)
def test_texts_are_inside_of_the_figure_and_not_on_each_other(name):
    figure = FIGURES[name]()
    figure.canvas.draw()
    texts = []
    for axes in figure.axes:
        ticks = [label for axis in (axes.xaxis, axes.yaxis) for label in shown(axis)]
        texts += [axes.xaxis.label, axes.yaxis.label, axes.title, axes._left_title, *ticks, *axes.texts]
    texts += [text for legend in figure.legends for text in (*legend.get_texts(), legend.get_title())]
    boxes = [(text.get_text(), text.get_window_extent()) for text in texts if text.get_text() and text.get_visible()]
    boxes = list({(said, tuple(box.bounds)): (said, box) for said, box in boxes}.values())  # twin axes have the same ticks
    for said, box in boxes:
        assert box.x0 >= -1 and box.y0 >= -1 and box.x1 <= figure.bbox.x1 + 1 and box.y1 <= figure.bbox.y1 + 1, said
    overlapping = [
        (a, b)
        for (a, one), (b, other) in itertools.combinations(boxes, 2)
        if min(one.x1, other.x1) - max(one.x0, other.x0) > 1 and min(one.y1, other.y1) - max(one.y0, other.y0) > 1
    ]
    assert not overlapping


def test_each_test_has_a_panel_with_the_case_and_its_values():
    figure = by_value()
    assert len(figure.axes) == 2
    for axes, (n, stiffness) in zip(figure.axes, enumerate((100, 200)), strict=True):
        drawn = [line.get_ydata()[-1] for line in axes.lines]
        assert drawn[0] == pytest.approx(0.3 * stiffness)
        assert drawn[1:] == pytest.approx([0.3 * (60 + 5 * m) * (n + 1) for m in range(4)])
        looks = {(line.get_linestyle(), tuple(np.atleast_1d(line.get_color()))) for line in axes.lines}
        assert len(looks) == 5


@pytest.mark.parametrize("objectives", [[0.2, 0.19, 0.185, 0.181], [9.0, 3.0, 4.0, 0.2], [0.5, 0.5]])
def test_a_course_fills_its_axes_and_no_marker_is_cut(objectives):
    """Whatever the range: from a tenth of the height, about, above the axis to as much below the top."""
    figure = study_plots.course(objectives, ["ga"] * len(objectives))
    figure.draw_without_rendering()
    axes = figure.axes[0]
    points = axes.transAxes.inverted().transform(axes.transData.transform(axes.lines[0].get_xydata()))
    assert (points > 0.03).all() and (points < 0.97).all()
    assert np.ptp(objectives) == 0 or np.ptp(points[:, 1]) > 0.7
    assert (axes.get_yscale() == "log") == (max(objectives) > 10 * min(objectives))


def test_a_course_never_rises_and_is_drawn_on_a_logarithm_where_it_falls_far():
    axes = course().axes[0]
    assert axes.lines[0].get_ydata().tolist() == [9.0, 3.0, 3.0, 0.2] and axes.get_yscale() == "log"


def test_axes_of_small_samples_are_in_small_units():
    """A bead of 5 um: depths of 1 um, forces of 5 nN."""
    d = np.linspace(2e-4, 1e-3, 5)
    small = {name: Curve(d, 5e-3 * d) for name in TESTS}
    axes = study_plots.curves_by_value("indenter.friction", TESTS, ("0.5", small), [("0.2", small)], None).axes[0]
    assert axes.get_xlabel() == "Displacement (µm)" and axes.get_ylabel() == "Force (nN)"
    assert axes.lines[0].get_xdata()[-1] == pytest.approx(1.0) and axes.lines[0].get_ydata()[-1] == pytest.approx(5.0)
    points = [((f,), (float(f),), dict.fromkeys(TESTS, 5e-6)) for f in ("0.2", "0.5")]
    axes = study_plots.forces_on_grid(["indenter.friction"], points, TESTS, None).axes[0]
    assert "(nN)" in axes.get_ylabel() and axes.lines[0].get_ydata()[0] == pytest.approx(5.0)
    h = np.array([1e-3, 8e-4])
    axes = study_plots.mesh_convergence([("press", "Force (mN)", h, 70 + h, None, None)], None).axes[0]
    assert axes.get_xlabel() == "Element size h (µm)" and axes.lines[0].get_xdata()[0] == pytest.approx(1.0)
    assert study_plots.course([2e-5, 5e-6], ["first", "last"]).axes[0].get_ylabel() == "Best objective (nN)"


@pytest.mark.filterwarnings("error")
def test_a_run_far_above_the_axes_leaves_them_their_room():
    figure = steep()
    figure.draw_without_rendering()
    assert figure.axes[0].get_position().height > 0.5


def test_the_profile_of_a_joint_fit_shades_the_interval_that_the_result_states():
    """Its curve goes through the runs, which its surrogate may miss near an end of a prior, and its interval is that of draws, in
    pieces."""
    runs, pieces = (ConfirmedPoint(1.0, 5.0, 4.0), ConfirmedPoint(3.0, 3.5, 4.0)), ((0.5, 0.7), (1.5, 2.5))
    profile = Profile((1.0, 2.0, 3.0), (4.0, 0.0, 4.0), 4.0, (1.0, 3.0), runs, joint=True)
    known = ParameterEstimate(2.0, "kPa", interval=(0.5, 2.5), pieces=pieces)
    (axes,) = plots.profile("mu", profile, known).axes
    assert list(axes.lines[0].get_ydata()) == [5.0, 0.0, 3.5]
    assert [(patch.get_x(), patch.get_x() + patch.get_width()) for patch in axes.patches] == list(pieces)
