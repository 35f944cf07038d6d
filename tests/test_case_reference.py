"""Template, reference page, JSON schema and choices of options say what the tables of the case say."""

import json
import re
import tomllib
from pathlib import Path

import pytest

from indentfit.case.keys import SECTIONS, TABLES, choices, keys
from indentfit.case.read import KEYS
from indentfit.case.reference import json_schema, reference_page
from indentfit.case.specimen import OF_SPECIMENS
from indentfit.case.template import template
from indentfit.cli.fit import command as fit
from indentfit.curve import Curve, write_curve
from indentfit.experiment.measured import read_case
from indentfit.fem.mesh import FAMILIES

CASES = sorted((Path(__file__).parent.parent / "cases").glob("*/case.toml"))
EVERY = {facts.key: facts for facts in keys()}
PLAIN = [key for key, facts in EVERY.items() if not facts.inner and key != "material.parameters" and not key.startswith("record.")]
CHANNELS = ("record.displacement.", "record.force.", "record.time.")


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """The template as a case file, with its curves and a raw record."""
    folder = tmp_path_factory.mktemp("template")
    (folder / "curves").mkdir()
    for name in ("parallel", "perpendicular"):
        write_curve(folder / "curves" / f"{name}.csv", Curve([0.1, 0.2, 0.3, 0.4, 0.5], [1.0, 2.0, 3.0, 4.0, 5.0]))
    (folder / "case.toml").write_text(template(), encoding="utf-8")
    return folder / "case.toml"


def test_the_tables_are_all_of_a_case():
    assert {model.place for model in TABLES} == {*SECTIONS, "test"} == set(KEYS) - {"title"}
    assert len(EVERY) == sum(len(facts.inner.model_fields) for facts in EVERY.values() if facts.inner) + sum(
        len(model.model_fields) for model in TABLES
    )


def test_the_template_is_a_valid_case(case):
    read = read_case(case)
    assert read.warnings() == []
    assert list(read.free) == ["mu", "zeta", "phi"]


@pytest.mark.parametrize("key", [key for key in EVERY if not key.startswith(CHANNELS)])
def test_the_template_mentions_every_key(key):
    table, mentioned = "", set()
    for row in template().split("\n"):
        if header := re.match(r"(?:# )?\[+([\w.]+)\]", row):
            table = header[1]
            mentioned.add(table)
        elif assignment := re.match(r"(?:# )?(\w+) = ", row):
            mentioned.add(f"{table}.{assignment[1]}")
    assert key in mentioned


@pytest.mark.parametrize(
    "key", [key for key in PLAIN if key not in ("test.record", "test.name") and not key.startswith("sample.layer.")]
)
def test_the_example_of_a_key_is_a_value_that_the_key_takes(case, key):
    facts = EVERY[key]
    value = facts.example if facts.example is not None else (facts.choices or ({"thickness": 3.3}.get(facts.name, 0.5),))[0]
    sets = [f"{key.replace('test.', 'test.parallel.', 1)}={json.dumps(value).replace('{', '{ ').replace(': ', ' = ')}"]
    beside = {
        "sample.length": ["sample.shape=block", "sample.width=14"],
        "sample.width": ["sample.shape=block", "sample.length=14"],
        "sample.prestretch": ["sample.shape=block", "sample.length=14", "sample.width=14", "test.perpendicular.angle=0"],
        "indenter.diameter": ["indenter.shape=cylinder"],
        "indenter.radius": ["indenter.shape=cylinder"],
        "indenter.half_angle": ["indenter.shape=cone", "indenter.tip_radius=0.05"],
        "indenter.tip_radius": ["indenter.shape=cone", "indenter.half_angle=70"],
        "material.poisson_ratio": ["material.model=neo_hookean", "material.parameters={mu=1}"],
        "material.energy": ["material.parameters={mu=1}"],
        "test.points": ["test.parallel.depth=0.3"],
    }
    relaxes = ["material.relaxation={ g = [0.3], tau = [2] }", "test.perpendicular.rate=0.1"]
    beside |= {
        f"material.relaxation.{name}": [*relaxes, "test.parallel.rate=0.1"] for name in ("base", "terms", "order", "g", "tau")
    }
    beside |= {"test.rate": relaxes, "test.ramp": relaxes, "test.hold": [*relaxes, "test.parallel.rate=0.1"]}
    beside["test.force"] = [*relaxes, "test.parallel.control=force", "test.parallel.depth=0.3", "test.parallel.ramp=1"]
    two = ["material.model=two_families", "material.parameters={mu=1,zeta=1,phi=1,second=1}", "sample.families=[40,-40]"]
    beside |= {key: two for key in EVERY if key.endswith((".families", ".family_dips"))}
    places = [(x, z) for x in range(-6, 7, 3) for z in range(-6, 7, 3) if x * x + z * z < 48]
    (case.parent / "fibres.csv").write_text("x_mm,z_mm,angle_deg\n" + "".join(f"{x},{z},{x + 20}\n" for x, z in places))
    own = "{c=1,k1=1,k2=1,dispersion=0,k1_second=1,dispersion_second=0}"
    beside["material.shared"] = ["material.model=holzapfel_own_families", f"material.parameters={own}", "sample.families=[40,-40]"]
    if key.removeprefix("test.") in OF_SPECIMENS:
        biaxial = 'kind = "biaxial"\nfibres = "along"\nloading = "tension"\narea = 100\nlength = 3.3\n'
        text = re.sub(r"^angle = 0.*\n(?:#  .*\n)*", biaxial, case.read_text(), count=1, flags=re.MULTILINE)
        case = case.with_name("specimen.toml")
        case.write_text(text, encoding="utf-8")
    if key in ("material.relaxation.g", "material.relaxation.tau"):
        sets = ["material.relaxation.g=[0.8, 0.5]", "material.relaxation.tau=[0.5, 5]"]
    if key in ("test.diameter", "test.plates"):
        disc = 'kind = "compression"\nfibres = "along"\nlength = 3.3\ndiameter = 8\nplates = "sliding"\n'
        text = (case.parent / "case.toml").read_text()
        text = re.sub(r"^angle = 0.*\n(?:#  .*\n)*", disc, text, count=1, flags=re.MULTILINE)
        case.write_text(text, encoding="utf-8")
    if key.startswith(("test.sample.", "test.indenter.")) and beside.get(key) is not two:
        own, of_case = key.removeprefix("test."), key.replace("test.", "test.parallel.", 1).rpartition(".")[0]
        texts = [text for text in beside.get(own, []) if not text.startswith("test.")]
        beside[key] = [f"{of_case}.{text.partition('.')[2]}" for text in texts]
    if key.startswith("test.field."):
        (case.parent / "curves" / "side.csv").write_text("x_mm,y_mm,z_mm,uz_um,sd_um\n0,1,7,5,1\n0,2,7,5,1\n0,3,7,5,1\n")
        beside[key], sets = [], [f"test.parallel.field={{ file = 'curves/side.csv', {facts.name} = {json.dumps(value)} }}"]
        sets = ["test.parallel.field=[{ file = 'curves/side.csv' }]"] if facts.name == "file" else sets
    if facts.kind == "table" and key != "fit.uncertain.fibre_angle":
        sets = [f"{key}={{mu=1.49}}"]
    read_case(case, [*beside.get(key, []), *sets])


def test_the_tables_behind_a_hash_can_be_opened(case, tmp_path):
    text = case.read_text()
    for name in ("fit.published", "fit.uncertain", "record"):
        begin = text.index(f"# [{name}]")
        block = text[begin : text.find("\n\n", begin)]
        text = text.replace(
            block, "\n".join(row.removeprefix("# ") if " = " in row or "[" in row[:4] else row for row in block.split("\n"))
        )
    opened = case.with_name("opened.toml")
    opened.write_text(text, encoding="utf-8")
    read = read_case(opened)
    assert read.fit.published == {"mu": 1.49}
    assert read.fit.uncertain.friction == 0.1
    assert (read.record.rate, read.record.force.gain) == (1000.0, 24.0)


@pytest.mark.parametrize("key", EVERY)
def test_the_reference_page_has_a_row_for_every_key(key):
    facts = EVERY[key]
    several = ("test", "test.field", "sample.layer")
    heading = f"## [[{facts.table}]]" if facts.table in several else f"## [{facts.table}]"
    table = reference_page().split(heading + "\n")[1].split("\n## ")[0]
    (row,) = [row for row in table.split("\n") if row.startswith(f"| `{facts.name}` |")]
    assert f"| {facts.unit} |" in row and row.endswith(f" {facts.meaning} |")
    assert all(str(choice) in row for choice in facts.choices)


@pytest.mark.parametrize("key", EVERY)
def test_the_schema_has_every_key_with_its_choices_and_meaning(key):
    facts, schema = EVERY[key], json_schema()
    models = {model.place: model.__name__ for model in TABLES} | {f.key: f.inner.__name__ for f in EVERY.values() if f.inner}
    definition = schema["$defs"][models[facts.table]]
    assert definition["additionalProperties"] is False
    said = definition["properties"][facts.name]
    assert said["description"] == facts.meaning
    assert (facts.name in definition.get("required", [])) == facts.required
    if facts.choices:
        assert tuple(said.get("enum", ())) == facts.choices


@pytest.mark.parametrize("path", CASES, ids=lambda path: path.parent.name)
def test_the_shipped_cases_follow_the_schema(path):
    jsonschema = pytest.importorskip("jsonschema")
    schema = json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.validate(tomllib.loads(path.read_text(encoding="utf-8")), schema)
    jsonschema.validate(tomllib.loads(template()), schema)
    wrong = tomllib.loads(template())
    wrong["sample"]["base"] = "glued"
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(wrong, schema)


def test_the_options_of_fit_are_the_choices_of_the_case():
    (method,) = [option for option in fit.params if option.name == "method"]
    assert tuple(method.type.choices) == choices("fit.method") == ("ga", "least_squares", "differential_evolution", "cma")


def test_the_meaning_of_mesh_size_is_that_of_the_mesh():
    meaning = EVERY["mesh.size"].meaning
    for name, far, edge in (("q1p0", "1 size", "0.15"), ("q2p1", "3 sizes", "0.126")):
        assert f"({name})" in meaning or f"element {name}" in meaning
        assert far in meaning and FAMILIES[name].far == float(far.split()[0])
        assert edge in meaning and FAMILIES[name].edge == float(edge)


def test_every_meaning_and_every_unit_is_told():
    assert all(facts.meaning and facts.kind for facts in EVERY.values())
    lengths = {"sample.thickness", "indenter.width", "mesh.size", "test.depth", "solver.max_step", "fit.uncertain.offset"}
    assert {EVERY[key].unit for key in lengths} == {"mm"}
    assert (EVERY["material.kappa"].unit, EVERY["record.rate"].unit, EVERY["fit.time_limit"].unit) == ("kPa", "Hz", "s")
