"""The forward model against curves of another code and discretisation (../shared/references, NGSolve)."""

import json

import numpy as np
import pytest
from fixtures.cases import SHARED

FILES = sorted((SHARED / "references").glob("*.json"))
pytestmark = pytest.mark.skipif(not FILES, reason="../shared/references is not here")


def error(run, file, *overrides):
    """Largest force difference over the largest force, and what is allowed on top of the model's own share."""
    reference = json.loads(file.read_text())
    material, depths = reference["inputs"]["material"], reference["displacement_mm"][1:]
    result = run(
        f"material.parameters={{mu={material['mu']},zeta={material['zeta']},phi={material['phi']}}}",
        f"indenter.friction={reference['inputs']['indenter']['friction']}",
        *overrides,
        angle=reference["inputs"]["angle"],
        depths=depths,
    )
    force = np.array(reference["force_mN"][1:])
    return np.abs(result.force - force).max() / force.max(), reference["error_percent"] / 100, result


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_the_default_mesh_is_within_about_one_percent(run, file):
    """1.04 % in an isotropic sample, less than 1 % with fibres."""
    difference, _, result = error(run, file)
    assert difference < (0.011 if file.stem.startswith("iso") else 0.01)
    assert abs(result.facts.penalty_error) < 0.005


@pytest.mark.campaign
@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_a_finer_mesh_is_within_half_a_percent(run, file):
    difference, own, _ = error(run, file, "mesh.elements=480")
    assert difference < 0.005 + own


def test_the_papers_brick_is_within_its_known_error_of_the_reference(run):
    """Q1-P0 overestimates: about 3 % at 1,500 bricks (physics.md 3: its error falls like h)."""
    file = SHARED / "references" / "opt_0deg_f0.5.json"
    difference, own, _ = error(run, file, "solver.element=q1p0")
    assert difference < 0.015 + own
