"""Derivatives of the curves by the free parameters: exact where the mechanics gives them, else by differences.

Exact sensitivities come with a run of the forward model. Where they cannot be had, one-sided differences of further runs take
their place. The derivative by the scale parameter is F / scale, and costs nothing.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from indentfit.arrays import Array
from indentfit.inverse.problem import InverseProblem
from indentfit.runs.forward import Evaluation, ForwardModel, Report

STEP = 1e-2  # of a parameter's range, for differences: wide enough for curves that are smooth to 1e-4 of their force
Columns = dict[str, tuple[Array, ...]]  # name -> derivatives of the curves of all tests, mN per range


class Underivable(Exception):
    """No derivatives: runs near the point failed. Holds the cause."""


def evaluate_at_reference(
    problem: InverseProblem, model: ForwardModel, points: Sequence[Mapping[str, Any]], report: Report | None = None
) -> list[Evaluation]:
    """Evaluations of points at the problem's reference scale.

    The model is asked for all sensitivities that it can bring, so that whoever needs a derivative later finds it there.

    Parameters
    ----------
    problem : InverseProblem
    model : ForwardModel
    points : sequence of dict, name -> value
    report : called with (runs done, runs asked for)

    Returns
    -------
    list of Evaluation
    """
    return model.evaluate([problem.at_reference(point) for point in points], report, _asked_for(problem, model))


def may_bring_sensitivities(problem: InverseProblem, model: ForwardModel) -> bool:
    """Whether runs can be hoped to bring all derivatives: what is known before the first run."""
    return len(_asked_for(problem, model)) == len(problem.searched)


def brings_sensitivities(problem: InverseProblem, model: ForwardModel, x: Array) -> bool:
    """Whether derivatives at x (units of the ranges) come with the run there."""
    here = evaluate_at_reference(problem, model, [problem.parameters(x)])[0]
    return len(given_by(problem, here)) == len(problem.searched)


def curve_derivatives(problem: InverseProblem, model: ForwardModel, x: Array, report: Report | None = None) -> tuple[Array, ...]:
    """Derivatives of the curves by the free parameters.

    Parameters
    ----------
    problem : InverseProblem
    model : ForwardModel
    x : array (n_free,), units of the ranges
    report : called with (runs done, runs asked for)

    Returns
    -------
    tuple of arrays (n, n_free), mN per range of a parameter, one for each test

    Raises
    ------
    Underivable
        Neither sensitivities nor differences can be had.
    """
    return derivatives_at(problem, model, problem.parameters(x), report)[0]


def derivatives_at(
    problem: InverseProblem, model: ForwardModel, point: Mapping[str, Any], report: Report | None = None
) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """Derivatives as of `curve_derivatives`, and the curves, at a point that may name keys of the case too."""
    here = evaluate_at_reference(problem, model, [point])[0]
    if here.forces is None:
        raise Underivable(f"no derivative where the mechanics failed: {here.cause}")
    forces = problem.scaled(point, here.forces)
    columns = _of_scale(problem, here.forces) | _of_sensitivities(problem, point, here)
    left = [name for name in problem.free if name not in columns]
    if left:
        columns |= _by_differences(problem, model, point, left, forces, report)
    stacked = (np.column_stack([columns[name][test] for name in problem.free]) for test in range(len(problem.tests)))
    return tuple(stacked), forces


def last_cause(model: ForwardModel) -> str:
    """Why the last failed evaluation failed."""
    return (model.failures[-1].cause or "") if model.failures else "cause unknown"


def given_by(problem: InverseProblem, evaluation: Evaluation) -> list[str]:
    """The searched parameters that an evaluation brought finite sensitivities of, for all of its tests."""
    by_test = evaluation.sensitivities or ()
    return [name for name in _exact(problem) if by_test and all(_known(given, name) for given in by_test)]


def _exact(problem: InverseProblem) -> tuple[str, ...]:
    """The searched parameters that the mechanics can be differentiated by."""
    return tuple(name for name in problem.searched if name not in problem.differences)


def _asked_for(problem: InverseProblem, model: ForwardModel) -> tuple[str, ...]:
    """Those of them that this model can bring."""
    able = model.differentiable()
    return tuple(name for name in _exact(problem) if name in able)


def _known(sensitivities: Mapping[str, Array] | None, name: str) -> bool:
    """Whether a run brought this sensitivity; NaN says that it was asked for and could not be had."""
    return sensitivities is not None and name in sensitivities and bool(np.isfinite(sensitivities[name]).all())


def _of_scale(problem: InverseProblem, forces: Sequence[Array]) -> Columns:
    if not problem.scale:
        return {}
    factor = problem.range(problem.scale) / problem.reference
    return {problem.scale: tuple(factor * force for force in forces)}


def _of_sensitivities(problem: InverseProblem, point: Mapping[str, Any], here: Evaluation) -> Columns:
    return {
        name: problem.scaled(point, [np.asarray(given[name]) * problem.range(name) for given in here.sensitivities or ()])
        for name in given_by(problem, here)
    }


def _by_differences(
    problem: InverseProblem,
    model: ForwardModel,
    point: Mapping[str, Any],
    left: list[str],
    forces: tuple[Array, ...],
    report: Report | None,
) -> Columns:
    """One-sided differences; backwards, then with shorter steps, where a run fails."""
    columns: Columns = {}
    names, x = list(problem.free), problem.units(point)
    for step in (STEP, -STEP, STEP / 10, -STEP / 10):
        steps = {name: step if 0 <= x[names.index(name)] + step <= 1 else -step for name in left}
        points = [{**point, **problem.parameters(x + steps[name] * np.eye(len(names))[names.index(name)])} for name in left]
        evaluations = model.evaluate([problem.at_reference(there) for there in points], report)
        for name, there, evaluation in zip(left, points, evaluations, strict=True):
            if evaluation.forces:
                ahead = problem.scaled(there, evaluation.forces)
                columns[name] = tuple((b - a) / steps[name] for a, b in zip(forces, ahead, strict=True))
        left = [name for name in left if name not in columns]
        if not left:
            return columns
    raise Underivable(f"no derivative by {', '.join(left)}: {last_cause(model)}")
