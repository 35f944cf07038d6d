"""Setups that have the same mesh: the model of one serves the others."""

import copy
from dataclasses import replace

from indentfit.fem.contact import ContactFace
from indentfit.fem.equations import Equations
from indentfit.fem.setup import Setup
from indentfit.fem.simulate import Model
from indentfit.fem.symmetry import held_motions

OF_A_RUN = {"penalty": 1.0, "max_step": None, "tolerance": 1e-3}  # keys of the solver on which no mesh and no factor depends


def served_by(model: Model, setup: Setup) -> Model | None:
    """A model of a setup that has the mesh and the linear solvers of another model.

    Parameters
    ----------
    model : Model
        It must not run at the same time as the new one.
    setup : Setup

    Returns
    -------
    Model or None
        None where more differs than the coefficient of friction, the angle of the fibres, and the solver's penalty, longest step
        and tolerance, or where these change the mesh or the motions that are held.
    """
    if setup == model.setup:
        return model
    if _meshed(setup) != _meshed(model.setup):
        return None
    sample, held = setup.sample, [held_motions(known.part, known.indenter, known.sample) for known in (setup, model.setup)]
    if held[0] != held[1]:
        return None
    other = copy.copy(model)
    other.setup, other.contact = setup, ContactFace(model.contact.points, setup.indenter, sample.thickness)
    other.equations = Equations(model.body, other.contact, model.fixed)
    return other


def _meshed(setup: Setup) -> Setup:
    """The setup without what neither mesh nor equations depend on."""
    friction = setup.indenter.friction if setup.indenter.friction == "stick" else 1.0
    sample, indenter = setup.sample.with_key("fibre_angle", 0.0), setup.indenter.with_key("friction", friction)
    block = None if setup.block is None else (setup.block[0].with_key("fibre_angle", 0.0), setup.block[1])
    solver = setup.solver.model_copy(update=OF_A_RUN)
    return replace(setup, sample=sample, indenter=indenter, block=block, solver=solver)
