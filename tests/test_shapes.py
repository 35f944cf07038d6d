"""A new shape needs a class and its registration: a paraboloid and a square plate, which only this file knows, go all the way."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
from fixtures.cases import ISOTROPIC, tiny_case
from numpy.testing import assert_allclose

from indentfit import indenters, samples
from indentfit.case import Indenter, Sample
from indentfit.case.keys import choices
from indentfit.curve import Curve
from indentfit.errors import CaseError
from indentfit.experiment.measured import read_case
from indentfit.indenters import Distance, Rings
from indentfit.report.case_text import case_lines
from indentfit.report.html_case import case_words
from indentfit.report.schema import CaseFacts, case_json
from indentfit.runs.key import Inputs
from indentfit.samples import Rectangle


@dataclass(frozen=True)
class Paraboloid:
    """A paraboloid of revolution, y = rho^2 / diameter: its radius of curvature at the tip is half the diameter."""

    name: ClassVar[str] = "paraboloid"
    end: ClassVar[str] = "sphere"
    diameter: float

    @property
    def half_width(self):
        return self.diameter / 2

    @property
    def edge_radius(self):
        return None

    @property
    def curvature(self):
        return 2 / self.diameter

    def faults(self):
        yield from ()

    def faults_on(self, extent, depth):
        if self.diameter > min(extent):
            yield "diameter", "too blunt for the sample"

    def partition(self, depth):
        return Rings(np.sqrt(self.diameter / 2 * depth))

    def may_touch(self, x, z):
        return np.hypot(x, z) < self.diameter / 2

    def distance(self, x, bottom):
        """The nearest point of the face is at the radius s with s^3 / (2 R^2) + s (1 - h / R) = rho, by Newton's method."""
        R, rho, h = self.diameter / 2, np.hypot(x[..., 0], x[..., 2]), x[..., 1] - bottom
        s = rho.copy()
        for _ in range(50):
            s = s - (s**3 / (2 * R**2) + s * (1 - h / R) - rho) / (1.5 * s**2 / R**2 + 1 - h / R)
        safe = np.where(rho > 0, rho, 1.0)
        out = np.stack([x[..., 0] / safe, 0 * rho, x[..., 2] / safe], axis=-1)
        out[rho == 0] = [1.0, 0.0, 0.0]
        up, steep = np.array([0.0, 1.0, 0.0]), np.sqrt(1 + (s / R) ** 2)
        n = ((s / R)[..., None] * out - up) / steep[..., None]
        gap = (rho - s) * s / R / steep - (h - s**2 / (2 * R)) / steep
        tangent, hoop = (out + (s / R)[..., None] * up) / steep[..., None], np.cross(out, up)
        meridian, parallel = 1 / (R * steep**3), 1 / (R * steep)
        bend = _weighted(meridian / (1 + meridian * gap), tangent) + _weighted(parallel / (1 + parallel * gap), hoop)
        return Distance(gap, n, bend)

    def motion_off_edge(self, x, u):
        return np.zeros(0)

    def words(self):
        return f"paraboloid, {self.diameter:g} mm across its latus rectum"

    def variants(self, extent) -> Iterator[tuple[str, float]]:
        yield "diameter", self.diameter / 2


def _weighted(weight, v):
    return weight[..., None, None] * v[..., :, None] * v[..., None, :]


@dataclass(frozen=True)
class Plate:
    """A square plate, with one key."""

    name: ClassVar[str] = "plate"
    width: float

    @property
    def outline(self):
        return Rectangle(self.width / 2, self.width / 2)

    def words(self):
        return f"plate, {self.width:g} mm square"


@pytest.fixture(autouse=True)
def _registered(monkeypatch):
    monkeypatch.setattr(indenters.SHAPES, "known", dict(indenters.SHAPES.known))
    monkeypatch.setattr(samples.SHAPES, "known", dict(samples.SHAPES.known))
    indenters.SHAPES.register(Paraboloid)
    samples.SHAPES.register(Plate)


@pytest.fixture
def case(tmp_path):
    path = tiny_case(
        tmp_path,
        sample={"shape": "plate", "diameter": None, "width": 20.0, "thickness": 10.0},
        indenter={"shape": "paraboloid", "diameter": 8.0, "width": None, "length": None},
        mesh={"elements": 400},
        solver=None,
        material={"parameters": {"mu": 1.0}},
        test=[{"name": "run", "angle": 0, "depth": 0.01}],
        fit=None,
    )
    return read_case(path)


@pytest.mark.campaign
def test_a_paraboloid_on_a_thick_plate_follows_hertz(run):
    """F = 16/3 mu sqrt(R) d^1.5 of a half space is exact for a paraboloid; a contact of 2.5 % of the thickness adds 2 % here."""
    d = np.array([0.01, 0.02, 0.03])
    result = run(
        ISOTROPIC,
        "sample={shape='plate',width=20.0,thickness=10.0,base='sliding'}",
        "indenter={shape='paraboloid',diameter=4.0,friction=0.0}",
        "mesh.elements=300",
        f"test=[{{name='run',angle=0,depth={d[-1]}}}]",
        angle=0,
        depths=d,
    )
    assert result.force == pytest.approx(16 / 3 * np.sqrt(2.0) * d**1.5, rel=0.03)


def test_a_plate_is_a_block_of_two_equal_sides(run):
    keys = (
        "indenter={shape='strip',width=2.0,length=20.0,friction=0.3}",
        "mesh.elements=60",
        "test=[{name='run',angle=90,depth=0.1}]",
    )
    plate, block = (
        run(ISOTROPIC, f"sample={{{sizes},thickness=3.3,base='sliding'}}", *keys, angle=90, depths=[0.05, 0.1])
        for sizes in ("shape='plate',width=12.0", "shape='block',width=12.0,length=12.0")
    )
    assert np.array_equal(plate.force, block.force)


def test_a_new_shape_has_its_words_in_summary_and_report(case):
    summary = "\n".join(case_lines(case))
    assert "plate, 20 mm square, thickness 10 mm" in summary and "paraboloid, 8 mm across its latus rectum" in summary
    words = "\n".join(case_words(CaseFacts.from_json(case_json(case))))
    assert "plate, 20 mm square" in words and "paraboloid, 8 mm across" in words


def test_a_report_of_a_shape_that_is_not_installed_says_its_name(case, monkeypatch):
    facts = case_json(case)
    monkeypatch.delitem(indenters.SHAPES.known, "paraboloid")
    assert "rigid paraboloid, friction" in "\n".join(case_words(CaseFacts.from_json(facts)))


def test_the_case_knows_the_keys_of_a_new_shape():
    with pytest.raises(CaseError, match=r"indenter\.diameter: missing; a paraboloid needs it"):
        Indenter(shape="paraboloid", friction=0.5)
    with pytest.raises(CaseError, match=r"indenter\.edge_radius = 0\.1: does not belong to a paraboloid; remove it"):
        Indenter(shape="paraboloid", diameter=3, edge_radius=0.1, friction=0.5)
    with pytest.raises(CaseError, match=r"sample\.diameter = 3\.0: does not belong to a plate"):
        Sample(shape="plate", width=10, diameter=3.0, thickness=3, base="sliding")
    assert choices("indenter.shape") == ("strip", "cylinder", "sphere", "cone", "wedge", "paraboloid")


def test_a_new_shape_says_what_does_not_fit_and_replaces_another(case):
    with pytest.raises(CaseError, match=r"indenter\.diameter = 30.*too blunt for the sample"):
        read_case(case.path, ["indenter.diameter=30"])
    bar = read_case(case.path, ["indenter.shape=strip", "indenter.width=2", "indenter.length=30", "indenter.edge_radius=0.1"])
    again = read_case(case.path, ["indenter.shape=paraboloid", "indenter.diameter=8"])
    assert (bar.indenter.diameter, again.indenter) == (None, case.indenter)


def test_raw_records_are_read_as_under_a_sphere_where_the_shape_says_so(case, monkeypatch):
    ends = []

    def curve(self, file, record, timed=False):
        ends.append(record.indenter)
        return Curve([0.01, 0.02, 0.03, 0.04, 0.05], [1.0, 2.0, 3.0, 4.0, 5.0])

    monkeypatch.setattr("indentfit.experiment.measured.Opened.curve", curve)
    raw = 'test=[{name="run",angle=0,record="run.csv"}]'
    read_case(case.path, [raw])
    read_case(case.path, [raw, "indenter.shape=cylinder", "indenter.diameter=2"])
    assert ends == ["sphere", None]


def test_the_key_of_a_run_knows_the_code_of_a_shape_from_elsewhere(case):
    ours = read_case(case.path, ["indenter.shape=sphere", "sample.shape=block", "sample.length=20"])
    assert len(Inputs(case).common["shapes"]) == 2 and Inputs(ours).common["shapes"] == []


def test_the_distance_from_the_paraboloid_has_the_right_derivatives():
    shape, h = Paraboloid(3.0), 1e-6
    x = np.random.default_rng(0).uniform([-1, 0.4, -1], [1, 1.1, 1], (200, 3))
    _, n, H = shape.distance(x, 1.0)
    assert_allclose(np.linalg.norm(n, axis=1), 1, rtol=1e-12)
    ahead, behind = ([shape.distance(x + s * h * e, 1.0) for e in np.eye(3)] for s in (1, -1))
    assert_allclose(np.stack([(a.gap - b.gap) / (2 * h) for a, b in zip(ahead, behind, strict=True)], axis=-1), n, atol=1e-8)
    turns = np.stack([(a.normal - b.normal) / (2 * h) for a, b in zip(ahead, behind, strict=True)], axis=-1)
    assert_allclose(turns, H, atol=1e-6)


@dataclass(frozen=True)
class _Entry:
    """An entry point of another package."""

    name: str
    loaded: object

    def load(self):
        if isinstance(self.loaded, Exception):
            raise self.loaded
        return self.loaded


@pytest.mark.parametrize(("diameter", "plate"), [(5.0, None), (5.5, False), (10.0, True)])
def test_a_cylinder_that_covers_the_sample_is_told_to_be_a_plate(diameter, plate):
    found = [text for _, text in Indenter(shape="cylinder", diameter=diameter, friction=0).geometry.faults_on((6.0, 6.0), 1.0)]
    assert ['kind = "compression"' in text for text in found] == ([] if plate is None else [plate])


def test_a_shape_of_another_package_is_loaded_when_a_case_asks_for_it(monkeypatch):
    asked = []

    def entry_points(group, name):
        asked.append((group, name))
        return [_Entry("paraboloid", Paraboloid)] if name == "paraboloid" else []

    monkeypatch.delitem(indenters.SHAPES.known, "paraboloid")
    monkeypatch.setattr("indentfit.shapes.entry_points", entry_points)
    Indenter(shape="cylinder", diameter=2, friction=0)
    assert not asked
    assert Indenter(shape="paraboloid", diameter=2, friction=0).geometry == Paraboloid(2)
    assert asked == [("indentfit.indenters", "paraboloid")]


def test_a_package_that_cannot_be_loaded_harms_only_its_own_shape(monkeypatch):
    broken = [_Entry("pyramid", ImportError("no module named pyramids"))]
    monkeypatch.setattr("indentfit.shapes.entry_points", lambda group, name: broken if name == "pyramid" else [])
    with pytest.raises(CaseError, match=r"indenter\.shape.*'pyramid' cannot be loaded: no module named pyramids"):
        Indenter(shape="pyramid", diameter=2, friction=0)
    with pytest.raises(
        CaseError, match="must be 'strip', 'cylinder', 'sphere', 'cone', 'wedge' or 'paraboloid'; did you mean sphere"
    ):
        Indenter(shape="spere", diameter=2, friction=0)
    assert Indenter(shape="sphere", diameter=2, friction=0).geometry.half_width == 1
