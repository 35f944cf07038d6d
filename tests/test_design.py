"""The design of the next experiment: Fisher's information added up, and what the mechanics make of it."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from fixtures.cases import CASES, straight_curve, tiny_case, white_matter

from indentfit.case import Fit
from indentfit.case.measured_field import MeasuredField
from indentfit.cli import main
from indentfit.displacements import Displacements
from indentfit.errors import CaseError, ConvergenceError, DesignError
from indentfit.experiment.measured import read_case
from indentfit.fem.simulate import Model
from indentfit.report.html_design import design_page
from indentfit.report.schema import Stored
from indentfit.runs.forward import Evaluation
from indentfit.study import design as asking
from indentfit.study import further as module
from indentfit.study.design import Design, design
from indentfit.study.further import POINTS

STORED = Path(__file__).parent / "baseline" / "results-0.1"
COARSE = ("mesh.elements=40", "solver.element=q1p0", "fit.workers=1")
MU = "material.parameters={mu={start=2,min=0,max=10},zeta=4,phi=1}"
ZETA = "material.parameters={mu=1,zeta={start=3,min=0,max=20},phi=1}"


def moved(seen, mu):
    """Displacements of the sides of a spring."""
    along = np.where(seen.directions[:, 1] > 0, -0.5, 1.0)
    return along * seen.depths * seen.points[:, 1] * (0.3 + mu / 1000)


class Springs:
    """A pool whose sample is a spring of mu times the indenter's width, three times as stiff across the fibres.

    Its sides move outwards by (0.3 + mu / 1000) d y at depth d and height y, and their points move down by half of that.
    """

    def __init__(self, case, *_):
        self.case, self.runs, self.failures = case, 0, []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def differentiable(self):
        return frozenset()

    def evaluate(self, points, report=None, sensitivities=()):
        self.runs += len(points)
        return [Evaluation(point, tuple(self.forces(point)), None, 0.0, ()) for point in points]

    def forces(self, point):
        for test in self.case.tests:
            force = point["mu"] * self.case.indenter.width * (3 if test.angle == 90 else 1) * self.case.outputs(test)
            seen = [moved(field.points, point["mu"]) for field in test.field]
            yield np.concatenate([force, *seen])


def put(monkeypatch, pool):
    """A pool in the place of the finite elements, for the tests of the case and for further ones."""
    for place in (asking, module):
        monkeypatch.setattr(place, "RunPool", pool)


@pytest.fixture
def springs(monkeypatch):
    put(monkeypatch, Springs)
    return white_matter(MU)


def test_information_adds_up(springs):
    """By hand: var(mu) = 1 / (sum of (width k d)^2 / sigma^2 over all points + 12 / range^2)."""
    found = design(springs, noise=0.5)
    d = springs.outputs(springs.tests[0])
    own = np.sum((2 * d) ** 2 + (6 * d) ** 2) / 0.25 + 12 / 100
    assert found.stderr["mu"] == pytest.approx(own**-0.5, rel=1e-9)
    best = found.candidates[0]
    assert (best.change, best.angle) == ("width 4 mm", 90)
    assert best.depth == pytest.approx(1.5 * 0.33)
    further = best.depth * np.linspace(1, 6 * POINTS, POINTS).round() / (6 * POINTS)
    assert best.stderr["mu"] == pytest.approx((own + np.sum((12 * further) ** 2) / 0.25) ** -0.5, rel=1e-3)


def test_more_tests_never_determine_less(springs):
    found = design(springs)
    assert all(one.stderr["mu"] < found.stderr["mu"] for one in found.candidates)
    ranked = [one.half_width[found.worst] for one in found.candidates]
    assert ranked == sorted(ranked)
    assert found.noise == pytest.approx(0.01 * 2 * 6 * 0.33)
    assert all(one.half_width["mu"] > 1.96 * one.stderr["mu"] for one in found.candidates)  # noise has to be learned


def test_a_deeper_test_tells_more_of_a_spring(springs):
    same = {one.depth: one.stderr["mu"] for one in design(springs).candidates if (one.change, one.angle) == ("", 90)}
    assert [same[depth] for depth in sorted(same)] == sorted(same.values(), reverse=True)


def test_across_the_fibres_tells_more_of_them_than_along():
    """Under a bar that overhangs the sample, 0 degrees is nearly plane strain, where fibres do not show."""
    found = design(white_matter(ZETA, *COARSE))
    assert found.worst == "zeta"
    by = {one.angle: one.stderr["zeta"] for one in found.candidates if one.change == "" and one.depth == pytest.approx(0.33)}
    assert by[90] < 0.75 * found.stderr["zeta"]
    assert by[0] > 0.98 * found.stderr["zeta"]


def test_what_does_not_converge_is_a_line_and_no_number(springs, monkeypatch):
    class Wide(Springs):
        def evaluate(self, points, report=None, sensitivities=()):
            if self.case.indenter.width == 4:
                return [Evaluation(point, None, "too wide", 0.0, ()) for point in points]
            return super().evaluate(points)

    put(monkeypatch, Wide)
    found = design(springs)
    failed = [one for one in found.candidates if one.stderr is None]
    assert {one.change for one in failed} == {"width 4 mm"}
    assert all("too wide" in one.cause for one in failed)
    assert found.candidates[0].stderr is not None


def test_without_the_cases_own_derivatives_there_is_no_design(monkeypatch):
    def never(self, *_, **__):
        raise ConvergenceError("the fibres buckle", 0.1, 3, 4)

    monkeypatch.setattr(Model, "run", never)
    with pytest.raises(DesignError, match="the fibres buckle"):
        design(white_matter(ZETA, *COARSE))


IN_TIME = ("test.parallel.ramp=0.5", "test.perpendicular.ramp=0.5", "test.parallel.hold=5", "test.perpendicular.hold=5")
RELAXES = "material.relaxation={g=[{start=0.8,min=0,max=3}],tau=[2.0]}"


def test_rates_and_holds_are_further_tests_of_a_material_that_relaxes(monkeypatch):
    """By hand, of a spring: F = mu k d for every depth, so a ramp and a hold follow from the exponential in closed form."""
    put(monkeypatch, Springs)
    case = white_matter(MU, RELAXES, *IN_TIME)
    found = design(case, noise=0.5)
    assert set(found.stderr) == {"mu", "g1"}
    by = {(test.change, test.angle): test for test in found.candidates}
    further = by["ramp of 0.05 s, hold of 20 s", 90]
    assert further.kind == "indentation" and further.effort == "the same rig, 20.1 s"

    def rows(times, ramp, stiffness, depth=0.33):
        relaxed = np.where(
            times <= ramp,
            2.0 / ramp * -np.expm1(-times / 2.0),
            2.0 / ramp * -np.expm1(-ramp / 2.0) * np.exp(-np.maximum(times - ramp, 0) / 2.0),
        )  # of an exponential of 2 s over the ramp's unit of depth
        unit = stiffness * depth * np.minimum(times / ramp, 1.0)
        part = stiffness * depth * relaxed
        return np.column_stack([unit + 0.8 * part, 2.0 * part])  # by mu and g1, at mu = 2

    own = [rows(0.5 * case.curves[n].displacement / 0.33, 0.5, 2.0 * factor) for n, factor in enumerate((1, 3))]
    times = 0.05 * np.concatenate([np.arange(1, 25) / 24, 1 + np.geomspace(0.1, 400, 24)])
    every = np.vstack([*own, rows(times, 0.05, 6.0)])
    information = every.T @ every / 0.25 + np.diag([12 / 100, 12 / 9])
    exact = np.sqrt(np.diag(np.linalg.inv(information)))
    assert [further.stderr["mu"], further.stderr["g1"]] == pytest.approx(exact, rel=1e-3)
    assert not [test for test in found.candidates if test.kind != "indentation"]


def test_a_modulus_known_from_elsewhere_counts_in_a_design(springs):
    """Its information is that of its own standard deviation: here of a spring, whose stress is 2 mu per unit of strain."""
    case = white_matter(MU, "fit.prior={shear_across=[2.0, 0.1]}", "fit.method=least_squares")
    plain, known = (design(each, noise=0.5).stderr["mu"] for each in (white_matter(MU), case))
    assert known**-2 - plain**-2 == pytest.approx((2 / 0.1) ** 2, rel=1e-6)


def test_uncertain_inputs_that_a_design_takes_as_known_are_named(springs):
    case = springs.model_copy(update={"fit": Fit(uncertain={"friction": {"uniform": [0, 1]}, "offset": 0.01})})
    remarks = design(case, noise=0.5).remarks
    assert len(remarks) == 1 and remarks[0].startswith("friction, offset: uncertain in this case")
    assert not design(springs, noise=0.5).remarks


def test_an_estimate_is_judged_over_what_its_tests_leave_open(springs):
    """The stiffness of a spring is proportional to mu, so its information does not depend on it: only the noise that single fits
    learn is open. A modulus that is known to 1 % needs no other values."""
    sharp, vague = (design(springs, {"mu": 2.0}, noise=noise, estimated=True) for noise in (0.05, 5.0))
    assert sharp.between is None and sharp.candidates[0].between is None
    assert vague.runs == 4 * sharp.runs == 4 * design(springs, {"mu": 2.0}, noise=5.0).runs
    best = vague.candidates[0]
    ends = np.array(best.between["mu"]) / best.half_width["mu"]
    assert 0.7 < ends[0] < 0.97 and 1.03 < ends[1] < 4  # chi of 23 degrees of freedom: 0.76 and 1.25
    assert "in 90 % of fits" in vague.summary()
    again = Design.from_json(json.loads(json.dumps(vague.as_json())))
    assert again.summary() == vague.summary()


def test_values_at_which_a_test_has_no_solution_are_counted_and_told(monkeypatch, tmp_path):
    """Wide indenters fail beyond the estimate, among them at two of the three values that it leaves open; or at the estimate."""

    class Failing(Springs):
        highest = 0.0

        def evaluate(self, points, report=None, sensitivities=()):
            if self.case.indenter.geometry.width > 3 and any(point["zeta"] > self.highest for point in points):
                raise ConvergenceError("no equilibrium")
            return super().evaluate(points, report, sensitivities)

        def forces(self, point):
            return super().forces(point | {"mu": 1 + point["zeta"]})

    put(monkeypatch, Failing)
    case = white_matter(ZETA)
    for highest, unsolved in ((4.0, 1), (2.9, None)):
        monkeypatch.setattr(Failing, "highest", highest)
        told = design(case, {"zeta": 3.0}, noise=5.0, estimated=True)
        wide = [test for test in told.candidates if test.change.startswith("width 4")]
        assert {test.unsolved for test in wide if not test.cause} == ({unsolved} if unsolved else set())
        assert told.unsolved == 0 and not any(test.unsolved for test in told.candidates if test not in wide)
        words = "width 4 mm, angle 90°, to 0.495 mm: no solution at 1 of the values that the estimate leaves open"
        assert (words in told.summary()) == bool(unsolved)
        again = Design.from_json(json.loads(json.dumps(told.as_json())))
        assert again.summary() == told.summary()
        if unsolved:
            wide_pairs = [pair for pair in told.pairs if "width 4" in pair.first + pair.second]
            assert {pair.unsolved for pair in wide_pairs} == {1}
            said = f"{wide_pairs[0].first}; and {wide_pairs[0].second}: no solution at 1 of the values"
            lines = design_page(Stored(tmp_path, told, None, (), None, {}), told).sections[1].parts[-1].lines
            assert words in lines[0] and said in " ".join(lines) and "where there is no solution" in lines[0]
            last = replace(told, candidates=(*[test for test in told.candidates if test not in wide], *wide), pairs=())
            assert words not in last.summary()  # its table ends before them
            assert words in design_page(Stored(tmp_path, last, None, (), None, {}), last).sections[1].parts[-1].lines[0]
            lost = replace(told, between=None, unsolved=3)
            assert "the span is that of single fits" in told.summary() and "the span is" not in lost.summary()


def test_other_kinds_and_pairs_are_ranked(springs):
    """Simple shear of a spring, by hand; the best pair is better than any of its tests alone."""
    found = design(springs, noise=0.5)
    shear = next(test for test in found.candidates if test.change == "simple shear, fibres along, to a strain of 0.2")
    assert (shear.kind, shear.angle, shear.depth) == ("shear", None, None)
    d, strains = springs.outputs(springs.tests[0]), 0.2 * np.arange(1, POINTS + 1) / POINTS
    sigma = 0.5 / (2 * 6 * 0.33) * (2 * 2 * 0.2)  # the same share of the largest stress as of the largest force
    own = np.sum((2 * d) ** 2 + (6 * d) ** 2) / 0.25 + 12 / 100
    assert shear.stderr["mu"] == pytest.approx((own + np.sum((2 * strains) ** 2) / sigma**2) ** -0.5, rel=1e-6)
    assert found.pairs[0].stderr["mu"] < found.candidates[0].stderr["mu"]
    assert len({(pair.first, pair.second) for pair in found.pairs}) == len(found.pairs)


def test_side_views_are_ranked_by_the_information_of_their_points(springs):
    """By hand: a point's variance is that of the view's noise in both directions; an outline has only the part along its normal,
    which for a side that leans out by s = 0.302 d per height and is compressed by s / 2 is along (1 - s / 2, -s)."""
    found = design(springs, noise=0.5, view_noise=2e-4)
    assert found.view_noise == 2e-4
    d, further = springs.outputs(springs.tests[0]), 0.33 * np.linspace(1, 4 * POINTS, POINTS).round() / (4 * POINTS)
    own = np.sum((2 * d) ** 2 + (6 * d) ** 2) / 0.25 + 12 / 100 + np.sum((2 * further) ** 2) / 0.25
    heights = 3.3 * np.linspace(0.02, 0.98, 50)
    out, down, lean = 0.33e-3 * heights, -0.165e-3 * heights, 0.33 * 0.302
    normal = np.array([1 - lean / 2, -lean]) / np.hypot(1 - lean / 2, lean)
    seen = {"50 markers on the side facing x": (out, down), "outline of the side facing x": [normal[0] * out + normal[1] * down]}
    for words, rows in seen.items():
        (one,) = [
            test for test in found.candidates if (test.change, test.angle) == (words, 0) and test.depth == pytest.approx(0.33)
        ]
        assert (one.kind, one.solves) == ("side view", 1) and "a camera" in one.effort
        exact = (own + sum(np.sum(row**2) for row in rows) / 2e-4**2) ** -0.5
        assert one.stderr["mu"] == pytest.approx(exact, rel=2e-3), words
    assert {test.change[-8:] for test in found.candidates if test.kind == "side view"} == {"facing x", "facing z"}


def test_displacements_that_the_case_has_count_in_a_design(springs):
    """By hand, 20 points of 0.01 mm: information of a straight line adds up."""
    height = 3.3 * np.arange(1, 21) / 20
    points = np.column_stack([np.full(20, 7.0), height, np.zeros(20)])
    seen = Displacements.of(points, np.column_stack([0.02 * height, np.full((20, 2), np.nan)]), 0.01, depth=0.33)
    first = springs.tests[0].model_copy(update={"field": (MeasuredField(file=seen),)})
    known = springs.model_copy(update={"tests": (first, *springs.tests[1:])})
    plain, with_field = (design(case, noise=0.5).stderr["mu"] for case in (springs, known))
    assert with_field**-2 - plain**-2 == pytest.approx(np.sum((0.33e-3 * height) ** 2) / 0.01**2, rel=1e-6)


def test_discs_between_plates_are_further_tests_too(springs):
    found = {test.change: test for test in design(springs, noise=0.5).candidates if test.kind == "compression"}
    assert list(found) == [f"compression between sliding plates, fibres {way}, to a strain of 0.2" for way in ("along", "across")]
    assert {test.solves for test in found.values()} == {0}
    gel = white_matter("material.model=neo_hookean", "material.parameters={mu={start=2,min=0,max=10}}")
    found = {test.change: test for test in design(gel, noise=0.5).candidates if test.kind == "compression"}
    assert list(found) == [f"compression between {plates} plates, to a strain of 0.2" for plates in ("sliding", "bonded")]
    assert found["compression between bonded plates, to a strain of 0.2"].solves == 1


def test_a_pair_says_what_both_tests_need(springs):
    found = design(springs, noise=0.5)
    for pair in found.pairs:
        tests = [test for test in found.candidates if test.whole_words in (pair.first, pair.second)]
        assert pair.effort.split("; ") == list(dict.fromkeys(test.effort for test in (tests if len(tests) == 2 else 2 * tests)))
        assert pair.solves == sum(test.solves for test in tests)


# The command


def run(*arguments):
    return CliRunner().invoke(main, ["design", str(CASES / "white_matter_2017" / "case.toml"), *arguments])


def test_the_command_prints_a_table_or_json_and_writes_a_plot(springs, tmp_path):
    done = run("--set", MU)
    assert done.exit_code == 0, done.output
    assert "best for mu: width 4 mm, angle 90" in done.stdout
    done = run("--set", MU, "--json", "--noise", "0.5", "-o", str(tmp_path / "r"))
    found = json.loads(done.stdout)
    assert (found["worst"], found["noise_mN"]) == ("mu", 0.5)
    assert {"design.json", "design.svg", "design.png", "case.toml"} <= {path.name for path in (tmp_path / "r").iterdir()}
    assert run("--set", MU, "-o", str(tmp_path / "r")).exit_code == 2


def test_a_case_with_young_s_modulus_has_its_page(monkeypatch, tmp_path):
    """E = 2 mu (1 + nu): 2.9 mu at nu = 0.45. The page was looked for under `young` among the law's parameters, where it is not."""
    put(monkeypatch, Springs)
    straight_curve(tmp_path / "parallel.csv", 30)
    young = {"start": 2.9, "min": 0.29, "max": 29.0}
    case = read_case(tiny_case(tmp_path, material={"poisson_ratio": 0.45, "parameters": {"young": young}}))
    found = design(case, noise=0.5)
    for mu, said in ((1.0, None), (2.0, "material.young.start=5.8")):
        replace(found, parameters={"mu": mu}).write(tmp_path / "out", overwrite=True)
        page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
        assert said in page if said else "young.start" not in page


def test_the_parameters_of_a_result_are_taken(springs, tmp_path):
    """Of a fit of version 0.1, too; a free parameter is put into its range."""
    result = json.loads((STORED / "fit" / "result.json").read_text())
    result["parameters"]["mu"]["value"], result["parameters"]["phi"]["value"] = 5.0, 2.5
    (tmp_path / "result.json").write_text(json.dumps(result))
    narrow = "material.parameters={mu={start=2,min=0,max=3},zeta=4,phi=1}"
    for keys, mu in ((MU, 5.0), (narrow, 3.0)):
        printed = json.loads(run("--set", keys, "--json", "--result", str(tmp_path)).stdout)
        assert printed["parameters"] == {"mu": mu, "zeta": result["parameters"]["zeta"]["value"], "phi": 2.5}


@pytest.mark.parametrize("arguments", [["--noise", "0"], ["--result", "no/such"], ["--overwrite"]])
def test_wrong_input_ends_with_2(springs, arguments):
    done = run("--set", MU, *arguments)
    assert done.exit_code == 2
    assert done.stderr


def test_a_result_of_another_material_is_refused_in_one_line(springs, tmp_path):
    """The result of another law, of another kind, and a damaged one."""
    law = (STORED / "fit" / "result.json").read_text().replace('"phi"', '"c10"')
    design_of_0_1 = (STORED / "design" / "design.json").read_text()
    for text, said in ((law, "holds no param"), (design_of_0_1, "holds no param"), ('{"parameters": 1}', "cannot be read")):
        (tmp_path / "result.json").write_text(text)
        done = run("--set", MU, "--result", str(tmp_path))
        assert done.exit_code == 2
        assert len(done.stderr.splitlines()) == 1
        assert "result.json" in done.stderr and said in done.stderr


def test_nothing_free_is_refused():
    done = run("--set", "material.parameters={mu=1,zeta=4,phi=1}")
    assert done.exit_code == 2
    assert "no parameter is free" in done.stderr
    with pytest.raises(CaseError, match="no parameter is free"):
        design(white_matter())
