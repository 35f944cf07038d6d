"""How far a fit stays from its curves, and the likely reason where it does not follow them at all.

Gross misfit is no fit: where the root mean square error of a test is above GROSS of the test's largest force, no parameter has a
meaning, and the reason lies mostly with the data: units, a preload, adhesion, or a curve that bends the other way than the law.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Case
from indentfit.case.doubts import CurveDoubt, doubts
from indentfit.inference.agreement import CurveMisfit
from indentfit.inverse.objective import Target, rmse
from indentfit.inverse.problem import Candidate, InverseProblem
from indentfit.runs.forward import Evaluation

GROSS = 0.2  # RMSE of a test over its largest force
UNITS = {  # factor between the measured forces and mN -> the unit that the forces may have
    1e3: "newtons",
    1e6: "kilonewtons",
    9.80665: "grams-force",
    9806.65: "kilograms-force",
    1e-3: "micronewtons",
    1e-6: "nanonewtons",
    1 / 9.80665: "units of a force that was multiplied by 9.81",
}
ALIKE = 1.5  # largest ratio of the factors of tests that agree on a scale
LEFT = 3.0  # factor by which a test may miss the others' scale after its units are mended; less where the unit's factor is small
FAR, TIMES = 5.0, 3.0  # standard deviations of displacements that are not followed; a factor that may be a unit
BENT = 0.05  # share of the force at half the depth, from a straight line, from which a curve counts as bent
MESSAGE = "the model cannot follow the curves: the root mean square error is {worst} the largest force of {test}; {reason}"
UNEXPLAINED = "another law, wider bounds, {more}or the signs and units of the curve's columns may be the remedy"
OF_FIBRES = "another direction of the fibres (fit.uncertain.fibre_angle finds it from tests at three angles), "
CONSTANT = 1e-3  # of the largest force: standard deviation of a measured force that counts as held, of which R2 would tell nothing


def misfits(problem: InverseProblem, best: Candidate) -> dict[str, CurveMisfit]:
    """The relative misfit of each test at a Candidate.

    Parameters
    ----------
    problem : InverseProblem
    best : Candidate

    Returns
    -------
    dict of test -> CurveMisfit
    """
    return {test.name: _misfit(test, force) for test, force in zip(problem.tests, best.forces, strict=True)}


def no_fit(problem: InverseProblem, best: Candidate, runs: Sequence[Evaluation], fibres: bool = False) -> str | None:
    """Why a Candidate is no fit, in a sentence or two; None where its misfit is not gross.

    Parameters
    ----------
    problem : InverseProblem
    best : Candidate
    runs : sequence of Evaluation
        All runs of the search at the case's own inputs: a scale without bounds is tried on their curves.
    fibres : bool
        Whether the law has fibres whose direction is taken as known.

    Returns
    -------
    str or None
    """
    sizes = {test.name: _misfit(test, force).relative for test, force in _weighted(problem, best.forces) if not test.moves}
    if moved := [*_moved_otherwise(problem, best)]:
        return "; ".join(moved)
    worst = max(sizes, key=lambda name: sizes[name]) if sizes else ""
    if not sizes or sizes[worst] <= GROSS:
        return None
    units = [*_units(problem, runs)] or [*_units_of_one_test(problem, runs)]
    reasons = [*units, *_recording(problem), *_bend(problem, best)] or [UNEXPLAINED.format(more=OF_FIBRES if fibres else "")]
    size = f"{sizes[worst]:.0%} of" if sizes[worst] < 1 else f"{sizes[worst]:.2g} times"
    return MESSAGE.format(worst=size, test=worst, reason="; ".join(reasons))


def recording(case: Case) -> Iterator[CurveDoubt]:
    """What the curves of a case show of a preload or of adhesion.

    Parameters
    ----------
    case : Case
        Where it fits the contact point (fit.uncertain.offset, more than a standard deviation), that stands for a preload.

    Yields
    ------
    CurveDoubt
    """
    fitted = not isinstance(case.fit.uncertain.offset, int | float | None)
    for test, curve in zip(case.tests, case.curves, strict=True):
        if curve is not None and test.kind == "indentation":
            known = doubts(test.name, curve.loading, test.record is not None)
            yield from (doubt for doubt in known if not (fitted and doubt.is_preload))


def _misfit(test: Target, force: Array) -> CurveMisfit:
    measured = test.curve.force
    about_mean = float(np.sum((measured - measured.mean()) ** 2))
    largest = float(np.abs(measured).max())
    varies = about_mean > measured.size * (CONSTANT * largest) ** 2
    r2 = 1 - float(np.sum((force - measured) ** 2)) / about_mean if varies else None
    return CurveMisfit(rmse(test, force) / largest, r2)


def _moved_otherwise(problem: InverseProblem, best: Candidate) -> Iterator[str]:
    """Measured displacements that the sample does not follow, with the likely reason: a sign, or a unit."""
    for test, force in _weighted(problem, best.forces):
        measured, trust = test.curve.force, test.curve.trust
        left, noise = rmse(test, force), test.curve.stated_noise
        size = float(np.sqrt(np.mean((trust * measured) ** 2)))
        if not test.moves or left <= max(GROSS * size, FAR * noise):
            continue
        scale = float((trust * measured) @ (trust * force)) / max(float(np.sum((trust * force) ** 2)), 1e-300)
        rest = float(np.sqrt(np.mean((trust * (measured - scale * force)) ** 2)))
        said = f"{test.name}: the model cannot follow the displacements: their residuals are {left / noise:.2g} standard deviations"
        alike = rest < 0.5 * size  # of one shape
        if alike and scale < 0:
            yield f"{said}; with the opposite sign they would be followed: check the direction that counts positive"
        elif alike and not 1 / TIMES < scale < TIMES:
            yield f"{said}; {1 / scale:.3g} times as large they would be followed: check their unit"
        else:
            yield f"{said}; check where the points are counted from, the signs of the components, and the base"


def _weighted(problem: InverseProblem, forces: Sequence[Array]) -> list[tuple[Target, Array]]:
    return [(test, force) for test, force in zip(problem.tests, forces, strict=True) if test.weight]


def _of_forces(problem: InverseProblem, forces: Sequence[Array]) -> list[tuple[Target, Array]]:
    return [pair for pair in _weighted(problem, forces) if not pair[0].moves]


def _units(problem: InverseProblem, runs: Sequence[Evaluation]) -> Iterator[str]:
    """The unit whose factor brings the best scale without bounds back into the bounds, nearest to the start."""
    factor = _free_factor(problem, runs)
    low, high = problem.factor_bounds() if problem.scale else (0.5, 2.0)
    if factor is None or low <= factor <= high:
        return
    start = problem.start[problem.scale] / problem.reference if problem.scale else 1.0
    fitting = sorted((abs(np.log(factor * unit / start)), unit) for unit in UNITS if low <= factor * unit <= high)
    if fitting:
        unit = fitting[0][1]
        value = f" at {problem.scale} = {factor * unit * problem.reference:.3g}" if problem.scale else ""
        times = f"multiplied by {unit:.4g}" if unit >= 1 else f"divided by {1 / unit:.4g}"
        yield (
            f"the forces {times} would be followed{value}: they may be in {UNITS[unit]}; check the units in the curve's header "
            f"({_said_already(unit)})"
        )
    elif problem.scale:
        yield f"{problem.scale} = {factor * problem.reference:.3g} would follow, outside its bounds; check the units, or the bounds"
    else:
        yield f"forces of {1 / factor:.3g} times the measured ones would be followed; check the units"


def _units_of_one_test(problem: InverseProblem, runs: Sequence[Evaluation]) -> Iterator[str]:
    """The unit whose factor brings one test to the scale on which all others agree."""
    factors = _factors_of_tests(problem, runs)
    low, high = problem.factor_bounds() if problem.scale else (0.5, 2.0)
    suspects = []
    for name, factor in factors.items():
        others = [known for other, known in factors.items() if other != name]
        if not others or max(others) > ALIKE * min(others):
            continue
        middle = float(np.exp(np.mean(np.log(others))))
        unit = min(UNITS, key=lambda unit: abs(np.log(factor * unit / middle)))
        if abs(np.log(factor * unit / middle)) < min(np.log(LEFT), 0.2 * abs(np.log(unit))):
            suspects.append((not low <= middle <= high, list(UNITS).index(unit), name, unit))
    if suspects:
        _, _, name, unit = min(suspects)
        times = f"multiplied by {unit:.4g}" if unit >= 1 else f"divided by {1 / unit:.4g}"
        others_words = ", ".join(other for other in factors if other != name)
        yield (
            f"the forces of {name} {times} would be near those that {others_words} asks for: they may be in {UNITS[unit]}; check "
            f"the units in the header of the curve of {name} ({_said_already(unit)})"
        )


def _said_already(unit: float) -> str:
    return f"where it says {UNITS[unit]} already, the numbers are off by this factor"


def _factors_of_tests(problem: InverseProblem, runs: Sequence[Evaluation]) -> dict[str, float]:
    """The factor of each test with which the curves of one run follow the measured ones best; empty where those of no run do."""
    best: dict[str, float] = {}
    least = GROSS
    for run in runs:
        pairs = _of_forces(problem, run.forces) if run.forces is not None else []
        factors = {test.name: float(force @ test.curve.force) / max(float(force @ force), 1e-300) for test, force in pairs}
        left = max((_misfit(test, factors[test.name] * force).relative for test, force in pairs), default=np.inf)
        if left < least and min(factors.values()) > 0:
            best, least = factors, left
    return best


def _free_factor(problem: InverseProblem, runs: Sequence[Evaluation]) -> float | None:
    """The factor, without bounds, with which the curves of a run follow the measured ones; None where those of no run do."""
    best, least = None, GROSS
    for run in runs:
        if run.forces is None:
            continue
        pairs = _of_forces(problem, run.forces)
        curves, weights = np.concatenate([force for _, force in pairs]), _inverse_sizes(pairs)
        measured = np.concatenate([test.curve.force for test, _ in pairs])
        size = float(np.sum((weights * curves) ** 2))
        factor = float(np.sum(weights**2 * curves * measured)) / size if size else 0.0
        left = max(_misfit(test, factor * force).relative for test, force in pairs)
        if factor > 0 and left < least:
            best, least = factor, left
    return best


def _inverse_sizes(pairs: Sequence[tuple[Target, Array]]) -> Array:
    return np.concatenate([np.full(force.size, 1 / np.abs(test.curve.force).max()) for test, force in pairs])


def _recording(problem: InverseProblem) -> Iterator[str]:
    for test in problem.tests:
        yield from map(str, doubts(test.name, test.curve.loading) if not test.moves else ())


def _bend(problem: InverseProblem, best: Candidate) -> Iterator[str]:
    """Tests whose measured curve softens where the simulated curve stiffens, or the other way round."""
    for test, force in _weighted(problem, best.forces):
        if test.moves:
            continue
        measured, simulated = (_of_line(test.curve.displacement, known) for known in (test.curve.force, force))
        if min(abs(measured), abs(simulated)) > BENT and measured * simulated < 0:
            words = "softens where the law stiffens" if measured > 0 else "stiffens where the law softens"
            yield (
                f"{test.name}: the measured curve {words} (opposite curvature): slip, damage, a load cell at its end, or exchanged "
                "columns may be the reason"
            )


def _of_line(displacement: Array, force: Array) -> float:
    """Force at half the depth over the last force, above that of a straight line: positive for a curve that softens."""
    return float(np.interp(displacement[-1] / 2, displacement, force) / force[-1] - 0.5) if force[-1] else 0.0
