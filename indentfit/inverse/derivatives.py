"""Derivatives of the curves by the free parameters: exact where the mechanics gives them, else by differences.

Exact sensitivities come with a run of the forward model. Where a run has none, one-sided differences of further runs replace them.
The derivative by the scale parameter is F / scale, and needs no run.
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
    """Derivatives do not exist, because runs near the point failed; the text is the cause."""


def evaluate_at_reference(
    problem: InverseProblem, model: ForwardModel, points: Sequence[Mapping[str, Any]], report: Report | None = None
) -> list[Evaluation]:
    """Evaluations of points at the problem's reference scale.

    The evaluations include all sensitivities that the model can give, because later steps need them as derivatives.

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
    """Whether runs may give all derivatives, as far as this is known before the first run."""
    return len(_asked_for(problem, model)) == len(problem.searched)


def brings_sensitivities(problem: InverseProblem, model: ForwardModel, x: Array) -> bool:
    """Whether the run at x (units of the ranges) gives all derivatives."""
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
        Neither sensitivities nor differences exist.
    """
    return derivatives_at(problem, model, problem.parameters(x), report)[0]


def derivatives_at(
    problem: InverseProblem, model: ForwardModel, point: Mapping[str, Any], report: Report | None = None
) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """Derivatives as `curve_derivatives` gives them, and the curves, at a point that may name keys of the case too."""
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
    """The cause of the last failed evaluation."""
    return (model.failures[-1].cause or "") if model.failures else "cause unknown"


def given_by(problem: InverseProblem, evaluation: Evaluation) -> list[str]:
    """The searched parameters for which an evaluation has finite sensitivities of all tests."""
    by_test = evaluation.sensitivities or ()
    return [name for name in _exact(problem) if by_test and all(_known(given, name) for given in by_test)]


def _exact(problem: InverseProblem) -> tuple[str, ...]:
    """The searched parameters by which the mechanics can be differentiated."""
    return tuple(name for name in problem.searched if name not in problem.differences)


def _asked_for(problem: InverseProblem, model: ForwardModel) -> tuple[str, ...]:
    """Those of the parameters of `_exact` whose sensitivities this model can give."""
    able = model.differentiable()
    return tuple(name for name in _exact(problem) if name in able)


def _known(sensitivities: Mapping[str, Array] | None, name: str) -> bool:
    """Whether a run has this sensitivity; NaN stands for a requested sensitivity that does not exist."""
    return sensitivities is not None and name in sensitivities and bool(np.isfinite(sensitivities[name]).all())


def _of_scale(problem: InverseProblem, forces: Sequence[Array]) -> Columns:
    if not problem.scale:
        return {}
    factor = problem.range(problem.scale) / problem.reference
    return {problem.scale: tuple(factor * force for force in forces)}


def _of_sensitivities(problem: InverseProblem, point: Mapping[str, Any], here: Evaluation) -> Columns:
    return {
        name: problem.scaled(point, [np.asarray(given[name]) * problem.per_unit(name, point) for given in here.sensitivities or ()])
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
