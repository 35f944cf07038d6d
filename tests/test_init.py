"""`init` for one indenter and a user's own files: a case with the keys that are needed, which asks for what only the user knows."""

import json
import shutil
import tomllib

import numpy as np
import pytest
from click.testing import CliRunner
from fixtures.cases import CASES

from indentfit import indenters
from indentfit.case.keys import keys
from indentfit.cli import main
from indentfit.cli.init import SHAPES
from indentfit.curve import Curve, write_curve
from indentfit.experiment.measured import read_case
from indentfit.material import load

pytestmark = pytest.mark.quick

SIZES = {
    "sphere": ["indenter.radius=2"],
    "cylinder": ["indenter.diameter=2"],
    "cone": ["indenter.half_angle=70"],
    "strip": ["indenter.width=2", "indenter.length=20"],
    "wedge": ["indenter.half_angle=70", "indenter.length=20"],
}
SAMPLE = ["sample.diameter=14", "sample.thickness=3.3", "sample.base=bonded"]


def run(*words):
    return CliRunner().invoke(main, [str(word) for word in words])


def sets(texts):
    return [word for text in texts for word in ("--set", text)]


@pytest.fixture
def curve(tmp_path):
    """A curve of a flat punch of radius 1 mm on a half-space of shear modulus 2 kPa: F = 8 G a d."""
    depth = [0.02 * n for n in range(1, 11)]
    write_curve(tmp_path / "my.csv", Curve(depth, [16.0 * d for d in depth]))
    return tmp_path / "my.csv"


def test_every_shape_has_its_option():
    assert set(SHAPES) == set(indenters.SHAPES.names())


@pytest.mark.parametrize("shape", SIZES)
def test_a_case_with_its_sizes_is_valid_and_has_few_keys(shape, curve, tmp_path):
    told = [*SIZES[shape], *SAMPLE]
    done = run("init", tmp_path / "own", f"--{shape}", "--curve", curve, *sets(told))
    path = tmp_path / "own" / "case.toml"
    assert done.exit_code == 0 and done.stdout == f"{path}\n", done.output
    text = path.read_text()
    if shape in ("strip", "wedge"):
        assert "test.my.angle" in run("validate", path).stderr
        text = text.replace('angle = "?"', "angle = 0")
        path.write_text(text)
    case = read_case(path)
    assert case.indenter.geometry == indenters.SHAPES.make({"shape": shape, **numbers(SIZES[shape])})
    assert case.curves[0].force[-1] == pytest.approx(3.2)
    assert case.fit.uncertain.friction is not None  # it is called unknown
    assert len([line for line in text.splitlines() if " = " in line.partition("#")[0]]) < 25
    assert all("# " in line for line in text.splitlines() if " = " in line and not line.startswith("title"))


def test_a_curve_with_a_hold_makes_a_case_that_relaxes(tmp_path):
    """Its case was refused by `validate` until the user had written the table by hand."""
    time, depth = np.append(np.arange(11) / 10, [2, 4, 8, 16]), np.append(np.arange(11) / 100, [0.1] * 4)
    force = 20 * depth**1.5 * np.append(np.ones(11), [0.9, 0.8, 0.75, 0.74])
    write_curve(tmp_path / "held.csv", Curve(depth, force, time=time))
    words = sets([*SAMPLE, "indenter.radius=2", "indenter.friction=0"])
    done = run("init", tmp_path / "own", "--sphere", "--curve", tmp_path / "held.csv", *words)
    assert done.exit_code == 0, done.stderr
    case = tomllib.loads((tmp_path / "own" / "case.toml").read_text())
    assert case["material"]["relaxation"] == {"base": "long_term", "terms": 1}
    assert run("validate", tmp_path / "own" / "case.toml").exit_code == 0
    told = sets(["material.relaxation.g=[0.5]", "material.relaxation.tau=[2]"])
    assert run("init", tmp_path / "told", "--sphere", *told).exit_code == 0
    case = tomllib.loads((tmp_path / "told" / "case.toml").read_text())
    assert case["material"]["relaxation"] == {"base": "long_term", "g": [0.5], "tau": [2]}


def numbers(texts):
    given = {text.partition("=")[0].partition(".")[2]: float(text.partition("=")[2]) for text in texts}
    return {"diameter": 2 * given.pop("radius"), **given} if "radius" in given else given


def test_what_only_the_user_knows_is_asked_for(curve, tmp_path):
    done = run("init", tmp_path / "own", "--sphere", "--curve", curve)
    assert done.exit_code == 0
    asked = ["sample.diameter", "sample.thickness", "sample.base", "indenter.radius"]
    assert ", ".join(asked) in done.stderr
    done = run("validate", tmp_path / "own" / "case.toml")
    assert done.exit_code == 2
    assert [line.partition(" = ")[0].rpartition(" ")[2] for line in done.stderr.splitlines()] == asked
    assert all('= "?": put your value in: ' in line for line in done.stderr.splitlines())
    assert "radius, instead of the diameter, mm" in done.stderr


@pytest.mark.parametrize(
    ("shape", "told", "absent"),
    [
        ("cylinder", "indenter.radius=1", "indenter.diameter"),
        ("sphere", "indenter.diameter=4", "indenter.radius"),
        ("sphere", "material.bulk_ratio=20", "material.poisson_ratio"),
        ("sphere", "material.kappa=20000", "material.poisson_ratio"),
    ],
)
def test_another_form_of_a_key_stands_in_its_place(shape, told, absent, curve, tmp_path):
    sizes = SIZES[shape] if told.startswith("material") else []
    done = run("init", tmp_path / "own", f"--{shape}", "--curve", curve, *sets([told, *sizes, *SAMPLE]))
    assert done.exit_code == 0 and absent not in done.stderr, done.output
    table, key = absent.split(".")
    assert key not in tomllib.loads((tmp_path / "own" / "case.toml").read_text())[table]
    assert run("validate", tmp_path / "own" / "case.toml").exit_code == 0


def test_the_search_starts_near_the_curve_s_stiffness(curve, tmp_path):
    run("init", tmp_path / "own", "--cylinder", "--curve", curve, *sets([*SIZES["cylinder"], *SAMPLE]))
    bounds = read_case(tmp_path / "own" / "case.toml").free["mu"]
    assert bounds.start == pytest.approx(2.0, rel=0.05)
    assert bounds.min < 0.1 and bounds.max > 50


def test_a_law_by_name_has_its_parameters_with_their_meaning(curve, tmp_path):
    done = run("init", tmp_path / "own", "--sphere", "--curve", curve, "--material", "ogden", *sets([*SIZES["sphere"], *SAMPLE]))
    assert done.exit_code == 0
    assert list(read_case(tmp_path / "own" / "case.toml").free) == ["mu", "alpha"]
    assert f"# kPa: {load('ogden').parameters['mu'].meaning}" in (tmp_path / "own" / "case.toml").read_text()
    done = run("init", tmp_path / "other", "--sphere", "--material", "ogdn")
    assert done.exit_code == 2 and "did you mean 'ogden'" in done.stderr
    assert not (tmp_path / "other").exists()


def test_two_curves_along_and_across(curve, tmp_path):
    shutil.copy(curve, tmp_path / "other.csv")
    done = run("init", tmp_path / "own", "--strip", "--curve", curve, "--curve", tmp_path / "other.csv")
    assert done.exit_code == 0 and "test.angle" in done.stderr
    tree = tomllib.loads((tmp_path / "own" / "case.toml").read_text())
    assert [test["curve"] for test in tree["test"]] == ["my.csv", "other.csv"]
    assert tree["material"]["model"] == "transversely_isotropic"


def test_a_raw_record_is_named_as_such(tmp_path):
    record = CASES / "rig_records" / "records" / "S1_parallel.csv"
    done = run("init", tmp_path / "own", "--strip", "--record", record, *sets([*SIZES["strip"], *SAMPLE]))
    assert done.exit_code == 0
    text = (tmp_path / "own" / "case.toml").read_text()
    assert 'record = "S1_parallel.csv"' in text and "\n[record]" in text
    assert (tmp_path / "own" / "S1_parallel.csv").is_file()


def test_words_that_init_does_not_understand(curve, tmp_path):
    for words, said in (
        (["--curve", curve], "name the indenter too: --sphere"),
        (["--sphere", "--curve", tmp_path / "none.csv"], "no such file"),
        (["--sphere", "--record", tmp_path / "none.csv"], "no such file"),
        (["--sphere", "--curve", curve, "--record", curve], "another file is called my.csv too"),
        (["--sphere", "--set", "indenter.radus=2"], "did you mean indenter.radius?"),
        (["--sphere", "--set", "indenter.radius"], "write KEY=VALUE"),
    ):
        done = run("init", tmp_path / "own", *words)
        assert done.exit_code == 2 and said in done.stderr, done.output
        assert not (tmp_path / "own").exists()


def test_the_schema_beside_the_case_is_that_of_the_command(curve, tmp_path):
    run("init", tmp_path / "own", "--sphere", "--curve", curve)
    assert (tmp_path / "own" / "case.toml").read_text().startswith("#:schema ./case.schema.json\n")
    known = json.loads((tmp_path / "own" / "case.schema.json").read_text())
    assert known == json.loads(run("schema").stdout)
    assert {"sample", "indenter", "material", "test"} <= set(known["properties"])


def test_commands_take_the_case_of_the_working_folder(curve, tmp_path, monkeypatch):
    run("init", tmp_path / "own", "--sphere", "--curve", curve, *sets([*SIZES["sphere"], *SAMPLE]))
    monkeypatch.chdir(tmp_path / "own")
    assert run("validate").stdout.startswith("case.toml: valid")
    monkeypatch.chdir(tmp_path)
    done = run("validate")
    assert done.exit_code == 2 and "case.toml: no such file; `indentfit init DIR` writes a case to start from" in done.stderr


PLAIN = [facts.key for facts in keys() if facts.table in ("sample", "indenter", "mesh", "solver") and facts.key != "sample.layer"]


@pytest.mark.parametrize("key", PLAIN)
def test_every_plain_key_can_be_told(key, tmp_path):
    done = run("init", tmp_path / "own", "--sphere", "--set", f"{key}=3")
    assert done.exit_code == 0
    table, _, name = key.partition(".")
    assert tomllib.loads((tmp_path / "own" / "case.toml").read_text())[table][name] == 3


def test_values_of_a_test_are_written_and_what_has_no_place_is_refused(tmp_path):
    """`--set test.depth` was dropped without a word."""
    done = run("init", tmp_path / "own", "--sphere", *sets(["test.depth=0.4", "test.points=7"]))
    (test,) = tomllib.loads((tmp_path / "own" / "case.toml").read_text())["test"]
    assert (done.exit_code, test["depth"], test["points"]) == (0, 0.4, 7)
    for key in ("record.rate", "test.sample.thickness"):
        done = run("init", tmp_path / "other", "--sphere", "--set", f"{key}=1")
        assert done.exit_code == 2 and f"--set {key}: it has no place here" in done.stderr
        assert not (tmp_path / "other").exists()


# Layers


def test_layers_have_their_own_laws_and_values(curve, tmp_path):
    told = [
        "indenter.radius=2",
        "sample.diameter=14",
        "sample.thickness=6",
        "sample.base=bonded",
        "skin.thickness=1",
        "fat.thickness=5",
    ]
    more = ["skin.interface=sliding", "skin.mu=20", "fat.bulk_ratio=500"]
    done = run("init", tmp_path / "own", "--sphere", "--curve", curve, "--layer", "skin", "--layer", "fat=yeoh", *sets(told + more))
    assert done.exit_code == 0, done.output
    case = read_case(tmp_path / "own" / "case.toml")
    assert [(layer.name, layer.thickness, layer.model) for layer in case.sample.layer] == [
        ("skin", 1, "neo_hookean"),
        ("fat", 5, "yeoh"),
    ]
    skin, fat = case.sample.layer
    assert (skin.interface, skin.parameters["mu"], fat.bulk_ratio, fat.poisson_ratio) == ("sliding", 20, 500, None)
    assert set(case.free) == {"fat.c10", "fat.c20", "fat.c30"}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--set", "sample.layer=[{name='a', thickness=1}]"], "name the layers by --layer NAME"),
        (["--layer", "a", "--layer", "a"], "--layer a: twice"),
        (["--layer", "sample"], "a table of a case has that name"),
        (["--layer", "1a"], "a layer's name is a letter"),
        (["--layer", "a", "--layer", "b=nothing"], "nothing"),
        (["--layer", "a", "--set", "a.mi=2"], "it has no place here"),
        (["--layer", "a", "--set", "material.model=yeoh", "--set", "material.bulk_ratio=9"], "it has no place here"),
    ],
)
def test_layers_that_no_case_can_have_are_refused_in_one_line(words, said, tmp_path):
    done = run("init", tmp_path / "own", "--sphere", *words)
    assert done.exit_code == 2 and len(done.stderr.splitlines()) == 1 and said in done.stderr, done.output
    assert not (tmp_path / "own").exists()
