"""Derivatives of the curves by the free parameters: exact where the mechanics gives them, else by differences.

The forward model's own sensitivities come with a run; where they are not to be had, one-sided differences are run on
the workers. The scale parameter's derivative is F / scale, and costs nothing.
"""

import inspect

import numpy as np

STEP = 1e-2  # of a parameter's range, for differences: wide enough for curves that are smooth to 1e-4 of their force


class Underivable(Exception):
    """No derivatives: runs near the point failed. Holds the cause."""


def evaluate_at_reference(problem, pool, points, report=None):
    """Evaluations of points (name -> value) at the problem's reference scale, asked to bring their sensitivities.

    Whoever needs a derivative afterwards finds it there: `sensitivities` is a tuple over the tests of name -> (n,),
    mN per unit of the parameter, or None.
    """
    return asked(pool, [problem.at_reference(point) for point in points], report, _exact(problem))


def asked(pool, points, report=None, sensitivities=()):
    """The pool's evaluations, with these sensitivities where the pool knows what they are."""
    if sensitivities and _knows_sensitivities(pool):
        return pool.evaluate(points, report, sensitivities=sensitivities)
    return pool.evaluate(points, report)


def may_bring_sensitivities(problem, pool):
    """Whether runs can be hoped to bring all derivatives: what is known before the first one."""
    return _knows_sensitivities(pool) and len(_exact(problem)) == len(problem.searched)


def brings_sensitivities(problem, pool, x):
    """Whether derivatives at x (units of the ranges) come with the run there."""
    here = evaluate_at_reference(problem, pool, [problem.parameters(x)])[0]
    return len(given_by(problem, here)) == len(problem.searched)


def curve_derivatives(problem, pool, x, report=None):
    """Derivatives of the curves at x (units of the ranges, (n_free,)): an array (n, n_free) for each test, mN per range.

    Raises Underivable where neither sensitivities nor differences can be had.
    """
    return derivatives_of(problem, pool, problem.parameters(x), report)[0]


def derivatives_of(problem, pool, point, report=None):
    """Derivatives as above, and the curves, at a point (name -> value), which may name keys of the case too (see `setting`)."""
    here = evaluate_at_reference(problem, pool, [point])[0]
    if here.forces is None:
        raise Underivable(f"no derivative where the mechanics failed: {here.cause}")
    forces = problem.scaled(point, here.forces)
    columns = _of_scale(problem, here)
    columns |= _of_sensitivities(problem, point, here)
    left = [name for name in problem.free if name not in columns]
    if left:
        columns |= _by_differences(problem, pool, point, left, forces, report)
    stacked = (np.column_stack([columns[name][test] for name in problem.free]) for test in range(len(problem.tests)))
    return tuple(stacked), forces


def last_cause(pool):
    """Why the last failed evaluation failed."""
    return pool.failures[-1].cause if pool.failures else "cause unknown"


def _knows_sensitivities(pool):
    pool = getattr(pool, "pool", pool)  # one that only watches another knows what that knows
    return "sensitivities" in inspect.signature(pool.evaluate).parameters


def _exact(problem):
    """The searched parameters that the model has sensitivities of."""
    return tuple(name for name in problem.searched if name not in problem.differences)


def given_by(problem, evaluation):
    """Those of them that an evaluation brought for all of its tests."""
    given = getattr(evaluation, "sensitivities", None) or ()
    return [name for name in _exact(problem) if given and all(_known(one, name) for one in given)]


def _known(sensitivities, name):
    """Whether a run brought this one; NaN says that it was asked for and not to be had."""
    return sensitivities is not None and name in sensitivities and bool(np.isfinite(sensitivities[name]).all())


def _of_scale(problem, here):
    if not problem.scale:
        return {}
    factor = problem.range(problem.scale) / problem.reference
    return {problem.scale: tuple(factor * force for force in here.forces)}


def _of_sensitivities(problem, at, here):
    return {
        name: problem.scaled(at, [np.asarray(one[name]) * problem.range(name) for one in here.sensitivities])
        for name in given_by(problem, here)
    }


def _by_differences(problem, pool, at, left, forces, report):
    """One-sided differences; backwards, then with shorter steps, where a run fails."""
    columns, names, x = {}, list(problem.free), problem.units(at)
    for step in (STEP, -STEP, STEP / 10, -STEP / 10):
        steps = {name: step if 0 <= x[names.index(name)] + step <= 1 else -step for name in left}
        points = [{**at, **problem.parameters(x + steps[name] * np.eye(len(names))[names.index(name)])} for name in left]
        evaluations = pool.evaluate([problem.at_reference(point) for point in points], report)
        for name, point, evaluation in zip(left, points, evaluations, strict=True):
            if evaluation.forces:
                there = problem.scaled(point, evaluation.forces)
                columns[name] = tuple((b - a) / steps[name] for a, b in zip(forces, there, strict=True))
        left = [name for name in left if name not in columns]
        if not left:
            return columns
    raise Underivable(f"no derivative by {', '.join(left)}: {last_cause(pool)}")
