"""The inverse problem widened by uncertain inputs: each input with a prior is a coordinate beside the free parameters.

Friction, the bulk ratio, the thickness and the indenter's size change the solution: they are coordinates of the surrogate. The
contact point of each test shifts its curve along the depth, and the gain of the load cell multiplies the curve, so these two need
no run.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from indentfit.case import Case, Range
from indentfit.case.faults import SIZES
from indentfit.case.priors import Prior
from indentfit.case.search import LEAST_INPUT
from indentfit.inverse.problem import InverseProblem
from indentfit.runs.points import KEYS, UNITS

OF_CURVES = ("offset", "force")  # inputs of a single test; they need no run
SOLVED = ("friction", "bulk_ratio", "thickness", "size")  # inputs that change the solution
DIFFERENTIABLE = ("friction", "bulk_ratio")  # inputs by which the mechanics can differentiate
STICKS = 0.4  # friction coefficient from which most of a contact sticks, and the force grows no more
OTHER_BASE = {"sliding": "bonded", "bonded": "sliding"}
MOST = 7  # largest number of coordinates of a surrogate


@dataclass(frozen=True)
class UncertainInput:
    """One coordinate that is an uncertain input.

    Parameters
    ----------
    name : str
        Name of the input in [fit.uncertain].
    point : str
        Its name in points of the forward model; empty where it needs no run.
    test : int or None
        Number of the test to which it belongs.
    prior : Prior
    value : float
        The value that the case gives.
    low, high : float
        Values between which it is looked for.
    unit : str
    """

    name: str
    point: str
    test: int | None
    prior: Prior
    value: float
    low: float
    high: float
    unit: str = "1"

    @cached_property
    def ends(self) -> tuple[float, float]:
        """The coordinates of `low` and `high`."""
        return self.prior.coordinate(self.low), self.prior.coordinate(self.high)

    def unit_of(self, value: float) -> float:
        """A value in units of the range of the coordinate, 0..1."""
        low, high = self.ends
        return (self.prior.coordinate(value) - low) / (high - low)

    def value_at(self, unit: float) -> float:
        """The inverse of `unit_of`."""
        low, high = self.ends
        at = low + unit * (high - low)
        return math.exp(at) if self.logarithmic else at

    @cached_property
    def logarithmic(self) -> bool:
        """Whether the coordinate is the logarithm of the input."""
        return self.prior.logarithmic


def uncertain_inputs(case: Case) -> tuple[UncertainInput, ...]:
    """The inputs of a case that have a prior, those that change the solution first."""
    return (*_solved(case), *_of_curves(case))


def alternatives(case: Case) -> list[tuple[str, dict[str, Any], float]]:
    """Name, changes of the case, and probability of each combination of the values of the inputs that are known as alternatives:
    the base, and those whose prior is a list. That of the case itself, if it is one of them, is the first."""
    known: list[tuple[str, dict[str, Any], float]] = [("", {}, 1.0)]
    for name, key, own, values in _listed(case):
        known = [
            (
                f"{before}{', ' if before else ''}{name} = {value}",
                {**changes, **({} if value == own else {key: value})},
                share * odds,
            )
            for before, changes, share in known
            for value, odds in values
        ]
    return sorted(known, key=_changed)


def _changed(alternative: tuple[str, dict[str, Any], float]) -> int:
    return len(alternative[1])


def listed_inputs(case: Case) -> list[tuple[str, str, Any]]:
    """Name, key and own value of each input that is known as alternatives."""
    return [(name, key, own) for name, key, own, _ in _listed(case)]


def _listed(case: Case) -> Iterator[tuple[str, str, Any, list[tuple[Any, float]]]]:
    """Name, key and own value of each input that is known as alternatives, with the values and their probabilities."""
    odds = case.fit.uncertain.base
    if odds:
        base = case.sample.base
        yield "base", "sample.base", base, [(base, 1 - odds), (OTHER_BASE[base], odds)]
    for name in SOLVED:
        prior = getattr(case.fit.uncertain, name)
        if isinstance(prior, Prior) and prior.values is not None and _point(case, name):
            key = KEYS.get(_point(case, name), _point(case, name))
            yield name, key, _value(case, _point(case, name)), [(value, 1 / len(prior.values)) for value in prior.values]


def widened_problem(problem: InverseProblem, inputs: tuple[UncertainInput, ...]) -> InverseProblem:
    """The problem whose free parameters are those of `problem` and the inputs that change the solution."""
    solved = [known for known in inputs if known.point]
    starts = {known.point: min(max(known.value, known.low), known.high) for known in solved}
    free = {known.point: Range(start=starts[known.point], min=known.low, max=known.high) for known in solved}
    differences = tuple(known.point for known in solved if known.name not in DIFFERENTIABLE)
    relaxing = problem.kernel.free if problem.kernel is not None else ()  # these stay the last of the searched parameters
    own = {name: bounds for name, bounds in problem.free.items() if name not in relaxing}
    return replace(
        problem,
        start={**problem.start, **starts},
        free={**own, **free, **{name: problem.free[name] for name in relaxing}},
        differences=(*problem.differences, *differences),
        warps={known.point: _warp(known) for known in solved},
    )


def _warp(known: UncertainInput) -> float:
    """The beta with which the force is most nearly proportional to an input."""
    if known.name == "bulk_ratio":
        return min(-(known.high / known.low - 1), -1.0)
    share = (STICKS - known.low) / (known.high - known.low)
    return -share if known.name == "friction" and known.low < STICKS / 2 and share < 0.95 else 0.0


def prior_of(case: Case, name: str, value: float) -> Prior | None:
    """The prior of an input of a case: a number states the standard deviation about the value."""
    stated = getattr(case.fit.uncertain, name)
    if isinstance(stated, Prior):
        return stated
    return Prior.about(value, stated) if isinstance(stated, float) and stated else None


def of_records(case: Case) -> tuple[float | None, ...]:
    """The standard deviation of each test's contact point by its own record, mm; None where a test has no record, and for all tests
    of a case that says something of the offset itself."""
    if case.fit.uncertain.offset is not None:
        return (None,) * len(case.tests)
    return tuple(None if curve is None else curve.contact for curve in case.curves)


def with_offset_of_records(case: Case) -> Case:
    """The case that states the largest of these as fit.uncertain.offset."""
    known = [offset for offset in of_records(case) if offset]
    if not known:
        return case
    uncertain = case.fit.uncertain.model_copy(update={"offset": max(known)})
    return case.model_copy(update={"fit": case.fit.model_copy(update={"uncertain": uncertain})})


def _solved(case: Case) -> Iterator[UncertainInput]:
    for name in SOLVED:
        point = _point(case, name)
        if not point:  # a cone or wedge without a shaft has no size
            continue
        if not case.indentations and KEYS.get(point, point).partition(".")[0] in ("", "sample", "indenter"):
            continue
        value = _value(case, point)
        prior = prior_of(case, name, value) if isinstance(value, float) else None
        if prior is not None and prior.values is None:
            low, high = prior.bounds(LEAST_INPUT[name])
            yield UncertainInput(name, point, None, prior, value, low, high, UNITS.get(name, "mm"))


def _of_curves(case: Case) -> Iterator[UncertainInput]:
    for name in OF_CURVES:
        stated = prior_of(case, name, 0.0)
        for n, offset in enumerate(of_records(case)):
            prior = Prior.about(0.0, offset) if stated is None and name == "offset" and offset else stated
            kind = case.tests[n].kind
            if prior is None or (name == "offset" and kind != "indentation") or kind == "field":
                continue
            yield UncertainInput(name, "", n, prior, 0.0, *prior.bounds(), "mm" if name == "offset" else "1")


def _point(case: Case, name: str) -> str:
    """The name of an input in points of the forward model."""
    if name != "size":
        return name
    return f"indenter.{key}" if (key := key_of_size(case)) else ""


def key_of_size(case: Case) -> str:
    """The key of [indenter] that is its size; empty for a cone or wedge without a shaft."""
    return next((key for key in SIZES if getattr(case.indenter, key, None) is not None), "")


def _value(case: Case, point: str) -> float:
    table, key = KEYS.get(point, point).split(".")
    value: float = getattr(getattr(case, table), key)
    return value
