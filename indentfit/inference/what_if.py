"""Inputs that a case gives as exact, and what the parameters would be at plausible other values of them.

A run at the optimum with another value of an input tells how the curves change, relative to their forces. The parameters are then
fitted again on the surrogate, whose curves carry this change: nothing is linear in the parameters or in the input. A shift of the
contact point needs no run.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Case
from indentfit.digits import quantity, sizes
from indentfit.inference.estimate import estimate
from indentfit.inference.inputs import Solution
from indentfit.inference.posterior import Shift
from indentfit.inference.result import ParameterEstimate
from indentfit.inference.shares import WhatIf
from indentfit.inference.verdicts import kind_of
from indentfit.inverse.derivatives import evaluate_at_reference
from indentfit.inverse.problem import InverseProblem
from indentfit.inverse.surrogate import Surrogate
from indentfit.inverse.wide import OTHER_BASE

LATE = 0.03  # of the largest depth: a plausible error of the contact point
THINNER = 0.95
SLIPPERY, ROUGH = 0.2, 0.5  # friction coefficients, one of which is tried
SOFT, STIFF = 50.0, 1000.0  # bulk over shear moduli, one of which is tried


def taken_as_known(case: Case) -> tuple[WhatIf, ...]:
    """The inputs that a case gives as exact, each with a plausible other value."""
    return tuple(known for known in _inputs(case) if getattr(case.fit.uncertain, known.input) is None)


def what_ifs(solution: Solution, surrogate: Surrogate) -> tuple[WhatIf, ...]:
    """The inputs of `taken_as_known`, with the parameters at their other values.

    Parameters
    ----------
    solution : Solution
    surrogate : Surrogate

    Returns
    -------
    tuple of WhatIf
        A value at which the mechanics failed has no parameters.
    """
    case, known = solution.case, taken_as_known(solution.case)
    problem, best = solution.problem, solution.best
    points = [{**best.parameters, **_change(case, tried)} for tried in known if tried.input != "offset"]
    runs = iter(evaluate_at_reference(problem, solution.model, points)) if case.fit.what_if else iter(())
    answers = []
    for tried in known:
        if tried.input == "offset":
            moved = _moved(solution, LATE * _deepest(case))
        elif (run := next(runs, None)) is not None and run.forces is not None:
            moved = _changes(problem, problem.scaled(best.parameters, run.forces), best.forces)
        else:
            answers.append(tried)
            continue
        answers.append(replace(tried, parameters=_again(solution, surrogate, moved)))
    return tuple(answers)


def warnings_of(known: tuple[WhatIf, ...], estimates: Mapping[str, ParameterEstimate]) -> Iterator[str]:
    """A sentence for each input whose other value moves a determined parameter out of its interval."""
    for tried in known:
        moved = [f"{name} {value:.3g}" for name, value in (tried.parameters or {}).items() if _left(estimates.get(name), value)]
        if moved:
            yield (
                f"{tried.input} {tried.taken} is taken as known, and the intervals hold only if it is right: with {tried.other} "
                f"the fit would give {', '.join(moved)}, outside of the interval"
            )


def _left(known: ParameterEstimate | None, value: float) -> bool:
    if known is None or known.interval is None or kind_of(known) != "determined":
        return False
    return not known.interval[0] <= value <= known.interval[1]


def _inputs(case: Case) -> Iterator[WhatIf]:
    ratio = case.material.bulk_over_shear
    if ratio is not None:
        known = WhatIf("bulk_ratio", f"{ratio:g}", f"{SOFT if ratio > 2 * SOFT else STIFF:g}")
    if not case.indentations:
        yield from (known,) if ratio is not None else ()
        return
    friction, thickness = case.indenter.friction, case.sample.thickness
    slips = friction == "stick" or float(friction) > (SLIPPERY + ROUGH) / 2
    if case.shares("indenter", "friction"):
        yield WhatIf("friction", str(friction), f"{SLIPPERY if slips else ROUGH:g}")
    if case.shares("sample", "base"):
        yield WhatIf("base", case.sample.base, OTHER_BASE[case.sample.base])
    if ratio is not None:
        yield known
    if case.shares("sample", "thickness"):
        yield WhatIf("thickness", sizes(thickness), f"{THINNER * thickness:.4g} mm")
    yield WhatIf("offset", "0 mm", f"{quantity(LATE * _deepest(case), 'mm', 3)}")


def _deepest(case: Case) -> float:
    """The largest depth of the indentations, mm."""
    return max(float(case.outputs(test)[-1]) for test in case.indentations)


def _change(case: Case, tried: WhatIf) -> dict[str, Any]:
    """The change of a point that an input's other value is."""
    if tried.input == "base":
        return {"sample.base": tried.other}
    if tried.input == "thickness":
        return {"sample.thickness": THINNER * case.sample.thickness}
    return {{"friction": "indenter.friction", "bulk_ratio": "material.bulk_ratio"}[tried.input]: float(tried.other)}


def _moved(solution: Solution, offset: float) -> list[Array]:
    """Relative change of the fitted curves by a later contact, which tests without an indenter do not have."""
    kernel, best = solution.problem.kernel, solution.best
    if kernel is not None:
        elastic = evaluate_at_reference(solution.problem, solution.model, [best.parameters])[0].run.forces or ()
        later = [Shift.of(depth).by(offset)[0] @ force for depth, force in zip(kernel.depths, elastic, strict=True)]
        both = (kernel.forces(forces, best.parameters) for forces in (later, elastic))
        pairs = zip(*both, strict=True)
        return [np.divide(late, here, out=np.ones_like(here), where=here != 0) for late, here in pairs]  # 0 out of contact
    triples = zip(solution.case.tests, solution.problem.tests, solution.best.forces, strict=True)
    return [
        Shift.of(target.curve.displacement).by(offset)[0] @ force / force
        if test.kind == "indentation"
        else (-offset / _deepest(solution.case) * force if target.moves else np.ones_like(force))
        for test, target, force in triples
    ]


def _changes(problem: InverseProblem, there: Sequence[Array], here: Sequence[Array]) -> list[Array]:
    """Relative changes of curves; those of displacements, which may vanish, are absolute."""
    triples = zip(problem.tests, there, here, strict=True)
    return [moved - known if test.moves else moved / known for test, moved, known in triples]


def _again(solution: Solution, surrogate: Surrogate, moved: list[Array]) -> dict[str, float]:
    """The free parameters that fit best where all curves carry a change, as `_changes` gives it."""
    problem, start = solution.problem, solution.problem.units(solution.best.parameters)
    targets = [
        test.curve.force - change if test.moves else test.curve.force / np.maximum(change, 1e-3)
        for test, change in zip(problem.tests, moved, strict=True)
    ]
    values = problem.parameters(estimate(problem, surrogate, solution.known.weights, start, targets=targets)[0])
    return {name: values[name] for name in problem.free}
