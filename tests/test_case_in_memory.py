"""A case made from values, for a notebook: no file, the same rules, and files that say the same."""

import pickle

import numpy as np
import pytest

from indentfit.case import Case, Fit, Indenter, MaterialChoice, Mesh, Sample, Test, case_toml, write_case
from indentfit.curve import Curve
from indentfit.errors import CaseError
from indentfit.experiment.measured import changed_case, read_case

DEPTH = np.linspace(0.02, 0.3, 10)
FORCE = 50 * DEPTH
DISC = {"shape": "disc", "diameter": 14, "thickness": 3.3, "base": "sliding"}
STRIP = {"shape": "strip", "width": 2, "length": 20, "friction": 0.5}
NEO_HOOKEAN = {"model": "neo_hookean", "bulk_ratio": 1000.0, "parameters": {"mu": {"start": 1, "min": 0.1, "max": 10}}}


def case(**keys):
    given = {
        "sample": DISC,
        "indenter": STRIP,
        "material": NEO_HOOKEAN,
        "tests": [Test("press", angle=0, curve=Curve(DEPTH, FORCE))],
    }
    return Case(**{**given, **keys})


def faults(**keys):
    with pytest.raises(CaseError) as caught:
        case(**keys)
    return caught.value.faults


def test_tables_are_given_as_values_or_as_dictionaries():
    values = case(sample=Sample(**DISC), indenter=Indenter(**STRIP), material=MaterialChoice(**NEO_HOOKEAN))
    assert values == case(tests=values.tests, curves=values.curves)
    assert values.hash == case().hash
    assert (values.path, values.warnings(), list(values.free)) == (None, [], ["mu"])
    np.testing.assert_array_equal(values.outputs(values.tests[0]), DEPTH)
    assert pickle.loads(pickle.dumps(values)).hash == values.hash


@pytest.mark.parametrize("columns", [(list(DEPTH), list(FORCE)), (tuple(DEPTH), FORCE)], ids=["lists", "a tuple and an array"])
def test_a_curve_is_made_of_any_numbers_in_a_row(columns):
    assert case(tests=(Test("press", angle=0, curve=Curve(*columns)),)).hash == case().hash


def test_a_curve_is_made_of_the_columns_of_a_frame():
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"displacement": DEPTH, "force": FORCE})
    assert case(tests=[Test("press", angle=0, curve=Curve(frame["displacement"], frame["force"]))]).hash == case().hash


def test_numbers_of_numpy_are_numbers():
    assert case(sample={**DISC, "thickness": np.float64(3.3), "diameter": np.int64(14)}).hash == case().hash


def test_a_test_with_a_depth_and_tables_of_the_search_and_the_solver():
    made = case(tests=[Test("press", angle=90, depth=0.3)], mesh=Mesh(elements=30), fit=Fit(method="cma"), solver={"penalty": 2})
    assert (made.curves, made.mesh.elements, made.fit.method, made.solver.penalty) == ((None,), 30, "cma", 2.0)
    assert made.outputs(made.tests[0])[-1] == pytest.approx(0.3)


def test_every_fault_of_every_table_comes_at_once_and_names_its_key_without_a_file():
    lines = faults(sample={**DISC, "thickness": -1}, tests=[{"name": "a", "angle": "x", "depth": 1}], fit=3, frobnicate=1)
    assert [line.split(": ")[0] for line in lines] == ["sample.thickness = -1", 'test.0.angle = "x"', "fit = 3", "frobnicate = 1"]


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"material": {**NEO_HOOKEAN, "parameters": {"muh": 1}}}, "muh = 1.0: unknown parameter; did you mean mu?"),
        ({"material": {**NEO_HOOKEAN, "model": "neo_hooken"}}, 'material.model = "neo_hooken": no material'),
        ({"material": {**NEO_HOOKEAN, "parameters": {"mu": 0}}}, "NeoHookean(mu=0) has a shear modulus of 0 kPa"),
        ({"tests": []}, "test = []: missing; give the list of tests"),
        ({"tests": [Test("a", angle=0, depth=2)]}, "test.a.depth = 2.0: goes 2 mm deep"),
        ({"tests": [Test("a", angle=0, curve="a.csv")]}, 'test.a.curve = "a.csv": is the name of a file'),
        ({"tests": [Test("a", angle=0, curve=Curve([1, 2], [1, 2]))]}, "test.a.curve: 2 points; a curve needs at least 5"),
        ({"tests": [Test("a", angle=0, curve=Curve(DEPTH[::-1], FORCE))]}, "point 1: displacement 0.268889 mm comes"),
        ({"tests": [Test("a", angle=0, curve=Curve(DEPTH, np.nan * FORCE))]}, "test.a.curve: holds numbers that are not finite"),
        ({"title": "two\nlines"}, "must be text on one line"),
    ],
    ids=lambda value: value[:40] if isinstance(value, str) else "",
)  # fmt: skip
def test_a_fault_is_told_as_in_a_file(keys, said):
    assert any(said in line for line in faults(**keys)), faults(**keys)


def test_a_table_alone_is_checked_when_it_is_made():
    with pytest.raises(CaseError) as caught:
        Sample(shape="disc", thickness="3 kPa", base="glued")
    assert [line.split(" = ")[0].split(":")[0] for line in caught.value.faults] == ["sample.thickness", "sample.base"]
    with pytest.raises(CaseError, match=r"^test\.name: missing; give the name of the test"):
        Test(angle=0, depth=0.3)


@pytest.mark.parametrize(
    "keys",
    [
        {},
        {"tests": [Test("a/b", angle=0, curve=Curve(DEPTH, FORCE)), Test("a b", angle=90, curve=Curve(DEPTH, 2 * FORCE))]},
        {"tests": [Test("nul", angle=0, depth=0.3, points=7, weight=0.2)], "fit": Fit(uncertain={"friction": 0.1, "base": False})},
        {"material": {"energy": "mu/2*(I1 - 3)", "parameters": {"mu": 1.1}, "kappa": 2000}, "mesh": {"size": 0.7}, "title": "one"},
        {"indenter": {"shape": "sphere", "diameter": 6, "friction": "stick"}, "record": {"rate": 10, "strains": [0.1]}},
        {"fit": {"uncertain": {"thickness": {"start": 3.3, "min": 3, "max": 4}}, "published": {"mu": 1.2}, "time_limit": 60}},
    ],
    ids=["curve", "names of files", "depth", "energy", "sphere", "uncertain"],
)
def test_a_case_that_is_written_reads_back_as_the_same(tmp_path, keys):
    made = case(**keys)
    read = read_case(write_case(made, tmp_path / "folder"))
    assert read.hash == made.hash
    elsewhere = {"path", "curves", "record"}
    assert read.model_dump(exclude=elsewhere) == made.model_dump(exclude=elsewhere)
    assert case_toml(read_case(write_case(read, tmp_path / "again"))) == case_toml(read)


def test_the_file_of_a_material_is_written_with_the_case(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(
        "from indentfit.material import Material, Parameter\n\n\nclass Mine(Material):\n"
        '    mu = Parameter("kPa", "shear modulus", min=0, scale=True)\n\n    def energy(self, I1):\n'
        "        return self.mu / 2 * (I1 - 3)\n"
    )
    made = case(material={**NEO_HOOKEAN, "model": "mine.py:Mine"})
    assert read_case(write_case(made, tmp_path / "folder")).hash == made.hash
    assert (tmp_path / "folder" / "plugins" / "mine.py").exists()


def test_keys_of_a_case_in_memory_are_changed_as_those_of_a_file():
    changed = changed_case(case(), ["fit.seed=3", "sample.shape=block", "sample.length=9", "sample.width=10 mm"])
    assert (changed.fit.seed, changed.sample.geometry.outline.extent) == (3, (9.0, 10.0))
    assert changed.curves[0].force.tolist() == FORCE.tolist()
    assert changed_case(case(), []).hash == case().hash
    with pytest.raises(CaseError) as caught:
        changed_case(case(), ["fit.sed=3", "test.press.angle=x"])
    assert [line.split(":")[0] for line in caught.value.faults] == ["fit.sed = 3", 'test.press.angle = "x"']
