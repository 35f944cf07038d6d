"""Inputs that a case gives as exact, and what the parameters would be at plausible other values of them.

A run at the optimum with another value of an input tells how the curves change, relative to their forces. The parameters are then
fitted again on the surrogate, whose curves carry this change: nothing is linear in the parameters or in the input. A shift of the
contact point, another gain of the force and a misfit of the law need no run. The runs are those of a coarser mesh, beside one of
the same mesh at the case's values: the changes differ from those of the case's mesh by 0.1 to 0.5 % of the force, and by more at
the first depths only.

The law is taken as known too. The other law is by STIFFENS too soft at the largest depth of each test, and right at small strains
(`inference.discrepancy`): a curve that hardly bends does not show such a misfit.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Case
from indentfit.digits import quantity, sizes
from indentfit.elastic import bulk_ratio, poisson_ratio
from indentfit.fem.mesh_error import FEWER
from indentfit.fem.meshing import count, resized
from indentfit.inference.discrepancy import places
from indentfit.inference.estimate import estimate
from indentfit.inference.inputs import Solution
from indentfit.inference.posterior import Shift
from indentfit.inference.result import ParameterEstimate
from indentfit.inference.shares import WhatIf
from indentfit.inference.verdicts import kind_of
from indentfit.inverse.derivatives import evaluate_at_reference
from indentfit.inverse.problem import InverseProblem
from indentfit.inverse.surrogate import Surrogate
from indentfit.inverse.wide import OTHER_BASE, key_of_size
from indentfit.runs.mechanics import WIDER
from indentfit.runs.points import setup_of

LATE = 0.03  # of the largest depth: a plausible error of the contact point
THINNER = 0.95
SLIPPERY, ROUGH = 0.2, 0.5  # friction coefficients, one of which is tried
SOFT, STIFF = 50.0, 1000.0  # bulk over shear moduli, one of which is tried
NEIGHBOUR, NEARLY = 0.1, 0.47  # of Poisson's ratio: a plausible error, and the ratio from which a sample is nearly incompressible
STRONGER = 1.05  # of forces, by the gain of the load cell
WIDER_BY = 1.02  # of the indenter's size
STIFFENS = 0.05  # of the force at the largest depth, beside the law
NAMED = 3  # inputs at most in the sentence that warns of them; all are in the list of what is taken as known
WITHOUT_RUNS = ("offset", "force", "law")
COARSER = 2.0  # elements of the runs, over those of the case's mesh
Again = Callable[[list[Array]], dict[str, float]]


def taken_as_known(case: Case) -> tuple[WhatIf, ...]:
    """The inputs that a case gives as exact, each with a plausible other value."""
    return tuple(known for known in _inputs(case) if getattr(case.fit.uncertain, known.input, None) is None)


def what_ifs(solution: Solution, again: Again, ran: bool) -> tuple[WhatIf, ...]:
    """The inputs of `taken_as_known`, with the parameters at their other values.

    Parameters
    ----------
    solution : Solution
    again : function
        From measured curves to the free parameters that fit them best.
    ran : bool
        Whether other inputs than the contact point are tried, by runs.

    Returns
    -------
    tuple of WhatIf
        A value at which the mechanics failed has no parameters.
    """
    case, known = solution.case, taken_as_known(solution.case)
    problem, best = solution.problem, solution.best
    changes = [_change(case, tried) for tried in known if tried.input not in WITHOUT_RUNS] if ran else []
    mesh = _coarser(case)
    points = [{**best.parameters, **change, **mesh} for change in ({}, *changes)] if changes else []
    here, *there = evaluate_at_reference(problem, solution.model, points) if points else [None]
    runs = iter(there)
    answers = []
    for tried in known:
        if tried.input == "offset":
            moved = _moved(solution, LATE * _deepest(case))
        elif tried.input == "law":
            moved = [1 + STIFFENS * x**power for x, power in places(case, problem.tests)]
        elif tried.input == "force":
            moved = [np.full_like(f, 1.0 if t.moves else 1 / STRONGER) for t, f in zip(problem.tests, best.forces, strict=True)]
        elif (run := next(runs, None)) and run.forces is not None and here and here.forces is not None:
            moved = _changes(problem, *(problem.scaled(best.parameters, forces) for forces in (run.forces, here.forces)))
        else:
            answers.append(tried)
            continue
        answers.append(replace(tried, parameters=again(_without(problem, moved))))
    return tuple(answers)


def fitted_again(solution: Solution, surrogate: Surrogate) -> Again:
    """The function from curves to the free parameters that have the least squares on a surrogate."""
    problem, start = solution.problem, solution.problem.units(solution.best.parameters)

    def again(curves: list[Array]) -> dict[str, float]:
        values = problem.parameters(estimate(problem, surrogate, solution.known.weights, start, targets=curves)[0])
        return {name: values[name] for name in problem.free}

    return again


def warnings_of(known: tuple[WhatIf, ...], estimates: Mapping[str, ParameterEstimate]) -> Iterator[str]:
    """A sentence on the inputs whose other values move determined parameters out of their intervals."""
    moved = [(tried, ", ".join(_moved_out(tried, estimates))) for tried in known]
    telling = [(tried, values) for tried, values in moved if values]
    if len(telling) == 1:
        tried, values = telling[0]
        yield (
            f"taken as known is {tried.input} {tried.taken}, and the intervals hold only if it is right: with {tried.other} "
            f"the fit would give {values}, outside of the interval"
        )
    elif telling:
        named = sorted(telling, key=lambda each: _how_far(each[0], estimates), reverse=True)[:NAMED]
        shown = [each for each in telling if each in named]  # in the order of the inputs
        taken = ", ".join(dict.fromkeys(f"{tried.input} {tried.taken}" for tried, _ in shown))
        others = "; ".join(f"{values} with {tried.input} {tried.other}" for tried, values in shown)
        left = len({tried.input for tried, _ in telling} - {tried.input for tried, _ in shown})
        more = f"; {left} more input{'s' * (left > 1)} would do so, listed below" if left else ""
        yield (
            f"taken as known are {taken}, and the intervals hold only if they are right: the fit would give {others}, "
            f"outside of the intervals{more}"
        )


def _moved_out(tried: WhatIf, estimates: Mapping[str, ParameterEstimate]) -> list[str]:
    return [f"{name} {value:.3g}" for name, value in (tried.parameters or {}).items() if _left(estimates.get(name), value)]


def _how_far(tried: WhatIf, estimates: Mapping[str, ParameterEstimate]) -> float:
    """How far the other value of an input moves a determined parameter out of its interval, in units of the interval's width."""
    outside = [0.0]
    for name, value in (tried.parameters or {}).items():
        known = estimates.get(name)
        if known is not None and known.interval is not None and _left(known, value):
            low, high = known.interval
            outside.append(max(low - value, value - high) / max(high - low, 1e-300))
    return max(outside)


def _left(known: ParameterEstimate | None, value: float) -> bool:
    if known is None or known.interval is None or kind_of(known) != "determined":
        return False
    return not known.interval[0] <= value <= known.interval[1]


def _inputs(case: Case) -> Iterator[WhatIf]:
    if case.indentations:
        yield from _of_indentations(case)
    else:
        yield from _of_bulk_ratio(case)
    yield WhatIf("force", "as measured", f"{STRONGER - 1:.0%} larger")
    if case.indentations:
        yield WhatIf("offset", "0 mm", f"{quantity(LATE * _deepest(case), 'mm', 3)}")
    if case.fit.discrepancy.stated is None and case.relaxation is None and all(test.kind != "field" for test in case.tests):
        deepest = "depth" if case.indentations else "strain"
        yield WhatIf("law", case.material.model or "as typed", f"{STIFFENS:.0%} too soft at the largest {deepest}")


def _of_indentations(case: Case) -> Iterator[WhatIf]:
    """The inputs that change the solution."""
    friction, thickness, size = case.indenter.friction, case.sample.thickness, key_of_size(case)
    slips = friction == "stick" or float(friction) > (SLIPPERY + ROUGH) / 2
    if case.shares("indenter", "friction"):
        yield WhatIf("friction", str(friction), f"{SLIPPERY if slips else ROUGH:g}")
    if case.shares("sample", "base"):
        yield WhatIf("base", case.sample.base, OTHER_BASE[case.sample.base])
    yield from _of_bulk_ratio(case)
    if case.shares("sample", "thickness"):
        yield WhatIf("thickness", sizes(thickness), f"{THINNER * thickness:.4g} mm")
    if size and case.shares("indenter", size):
        own = getattr(case.indenter, size)
        yield WhatIf("size", f"{size} {sizes(own)}", f"{size} {sizes(WIDER_BY * own)}")


def _of_bulk_ratio(case: Case) -> Iterator[WhatIf]:
    """The bulk ratio with another value, or of a sample that is far from incompressible with a smaller and a larger one."""
    ratio = case.material.bulk_over_shear
    if ratio is None:
        return
    own = poisson_ratio(ratio)
    others = [SOFT if ratio > 2 * SOFT else STIFF]
    if own < NEARLY:
        others = [bulk_ratio(max(own - NEIGHBOUR, 0.0)), bulk_ratio(min(own + NEIGHBOUR, poisson_ratio(SOFT)))]
    taken = _with_poisson_ratio(case, ratio)
    for other in others:
        if (tried := _with_poisson_ratio(case, other)) != taken:  # a ratio of 0 has no smaller neighbour
            yield WhatIf("bulk_ratio", taken, tried)


def _with_poisson_ratio(case: Case, ratio: float) -> str:
    """A bulk ratio in words, with Poisson's ratio where the case states that."""
    words = f"{ratio:g}"
    return words if case.material.poisson_ratio is None else f"{words} (Poisson's ratio {poisson_ratio(ratio):.4g})"


def _coarser(case: Case) -> dict[str, float]:
    """The change of a point that a coarser mesh is; none where the case's mesh is the coarsest."""
    setups = [setup_of(piece) for piece in case.pieces]
    fewer = all(count(resized(setup, COARSER)) <= FEWER * count(setup) for setup in setups)
    return {WIDER: COARSER} if fewer else {}


def _deepest(case: Case) -> float:
    """The largest depth of the indentations, mm."""
    return max(float(case.outputs(test)[-1]) for test in case.indentations)


def _change(case: Case, tried: WhatIf) -> dict[str, Any]:
    """The change of a point that an input's other value is."""
    if tried.input == "base":
        return {"sample.base": tried.other}
    if tried.input == "thickness":
        return {"sample.thickness": THINNER * case.sample.thickness}
    if tried.input == "size":
        size = key_of_size(case)
        return {f"indenter.{size}": WIDER_BY * getattr(case.indenter, size)}
    return {
        {"friction": "indenter.friction", "bulk_ratio": "material.bulk_ratio"}[tried.input]: float(tried.other.partition(" ")[0])
    }


def _moved(solution: Solution, offset: float) -> list[Array]:
    """Relative change of the fitted curves by a later contact, which tests without an indenter do not have."""
    kernel, best = solution.problem.kernel, solution.best
    if kernel is not None:
        elastic = evaluate_at_reference(solution.problem, solution.model, [best.parameters])[0].run.forces or ()
        later = [Shift.of(depth).by(offset)[0] @ force for depth, force in zip(kernel.depths, elastic, strict=True)]
        both = (kernel.forces(forces, best.parameters) for forces in (later, elastic))
        pairs = zip(*both, strict=True)
        return [_ratio(late, here) for late, here in pairs]
    triples = zip(solution.case.tests, solution.problem.tests, solution.best.forces, strict=True)
    return [
        _ratio(Shift.of(target.curve.displacement).by(offset)[0] @ force, force)
        if test.kind == "indentation"
        else (-offset / _deepest(solution.case) * force if target.moves else np.ones_like(force))
        for test, target, force in triples
    ]


def _changes(problem: InverseProblem, there: Sequence[Array], here: Sequence[Array]) -> list[Array]:
    """Relative changes of curves; those of displacements, which may vanish, are absolute."""
    triples = zip(problem.tests, there, here, strict=True)
    return [moved - known if test.moves else _ratio(moved, known) for test, moved, known in triples]


def _ratio(moved: Array, here: Array) -> Array:
    """Forces over others; 1 where there is no force, as before contact and at a displacement of 0."""
    return np.divide(moved, here, out=np.ones_like(here), where=here != 0)


def _without(problem: InverseProblem, moved: list[Array]) -> list[Array]:
    """The measured curves without a change, as `_changes` gives it."""
    pairs = zip(problem.tests, moved, strict=True)
    return [test.curve.force - change if test.moves else test.curve.force / np.maximum(change, 1e-3) for test, change in pairs]
