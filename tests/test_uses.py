"""`validate` says what `fit` and the studies refuse before they solve anything."""

import json

import pytest
from click.testing import CliRunner
from fixtures.cases import CASES, FIBRES, straight_curve, tiny_case

from indentfit.case import refusals
from indentfit.cli import main
from indentfit.errors import CaseError
from indentfit.experiment.measured import read_case
from indentfit.fem.simulate import Model
from indentfit.inference.accepted import accepted
from indentfit.runs.points import setup_of
from indentfit.study.compare import plan_comparison
from indentfit.study.design import design
from indentfit.study.mesh_family import own_family
from indentfit.study.variations import plan_sweep

FIELD = [{"name": "press", "curve": "parallel.csv", "field": [{"file": "top.csv"}]}]
SHEARED = [{"name": "sheared", "kind": "shear", "fibres": "along", "strain": 0.1}]
GELS = [
    {
        "name": name,
        "thickness": 1.65,
        "model": "neo_hookean",
        "bulk_ratio": 1000.0,
        "parameters": {"mu": {"start": 1.0, "min": 0.5, "max": 2.0}},
    }
    for name in ("upper", "lower")
]
FIBROUS = {**FIBRES, "bulk_ratio": 1000.0}


def run(command, *words):
    return CliRunner().invoke(main, [command, *map(str, words)])


@pytest.mark.parametrize(
    "tables",
    [
        {"test": FIELD, "indenter": {"friction": "unknown"}, "fit": {"method": "ga"}},
        {"indenter": {"friction": 0.1}, "fit": {"uncertain": {"friction": {"values": [0.1, 0.3]}}}},
    ],
)
def test_inputs_that_a_fit_cannot_take_as_unknown_are_faults_of_the_case(tables, tmp_path):
    """Displacements beside unknown inputs under a search that weighs no squares; alternatives without a surrogate."""
    straight_curve(tmp_path / "parallel.csv", 2.0)
    (tmp_path / "top.csv").write_text("x_mm,y_mm,z_mm,uy_mm\n5,3.3,0,-0.01\n6,3.3,0,-0.005\n7,3.3,0,-0.002\n")
    path = tiny_case(tmp_path, **tables)
    with pytest.raises(CaseError) as refused:
        accepted(read_case(path))
    result = run("validate", path)
    assert result.exit_code == 2 and str(refused.value) in result.stderr
    facts = json.loads(run("validate", path, "--json").stdout)
    assert (facts["valid"], facts["faults"]) == (False, [str(refused.value)])


COMMANDS = {
    "fit": accepted,
    "compare": lambda case: plan_comparison(case, ["neo_hookean", "yeoh"], {}),
    "design": design,
    "sweep": lambda case: plan_sweep(case, ["material.bulk_ratio=500"]),
    "mesh-check": own_family,
}


@pytest.mark.parametrize(
    ("tables", "refusing"),
    [
        ({"test": [{"name": "press", "depth": 0.2}]}, {"fit", "compare"}),
        ({"material": {"parameters": {"mu": 1.0}}}, {"fit", "design"}),
        ({"sample": {"layer": GELS}, "material": None}, set()),
        ({"test": SHEARED, "material": FIBROUS, "indenter": None, "sample": None, "mesh": None}, set(COMMANDS)),
    ],
)
def test_validate_says_what_each_command_refuses(tables, refusing, tmp_path):
    """Each refuses with the words of `validate`, before it solves anything; the case itself is valid."""
    straight_curve(tmp_path / "parallel.csv", 2.0)
    path = tiny_case(tmp_path, **tables)
    case, result = read_case(path), run("validate", path)
    assert result.exit_code == 0 and set(refusals(case)) == refusing
    assert json.loads(run("validate", path, "--json").stdout)["refused"].keys() == refusing
    for name in refusing:
        with pytest.raises(CaseError) as refused:
            COMMANDS[name](case)
        for fault, said in zip(refused.value.faults, refusals(case)[name], strict=True):
            assert fault == f"{path}: {said}" and said in result.stdout


def test_a_fine_mesh_in_the_plane_is_solved_directly(monkeypatch):
    """One of 30,000 elements ended with a bug: the multigrid, which is of bricks, was chosen for it."""
    for name in ("LARGE", "LARGE_WITHOUT_PARDISO"):
        monkeypatch.setattr(f"indentfit.fem.linear.choice.{name}", 10)
    case = read_case(CASES / "hydrogel_sphere" / "case.toml", ["mesh.elements=60"])
    assert Model(setup_of(case.pieces[0])).solver.name != "pyamg"
