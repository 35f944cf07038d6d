"""What a case can be used for: a case that can be simulated may lack what a fit, a design or a comparison needs.

Each command asks here before it does anything, and `validate` asks for all of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from pathlib import Path

from indentfit.case.faults import faults_of_fit, faults_of_freedom
from indentfit.case.messages import MISSING, Fault, line
from indentfit.case.priors import Prior
from indentfit.case.whole import Case
from indentfit.errors import CaseError

LEARNING = ("ga", "differential_evolution", "cma")  # searches that learn a surrogate
IN_TIME = (
    "laws are compared on loading curves, with a relaxation that is known; give g and tau as numbers, and curves without times "
    "with test.rate; or remove the table"
)


def require_case(case: object) -> None:
    """Raise CaseError where a Python caller gives something else in place of a Case, such as the path of its file."""
    if isinstance(case, Case):
        return
    shown = repr(case) if isinstance(case, str | Path) else f"a {type(case).__name__}"
    raise CaseError([f"{shown[:200]} is no Case; indentfit.read_case(PATH) reads a case file, indentfit.Case(...) makes one"])


def require_fittable(case: Case) -> None:
    """Raise CaseError unless the case has a free parameter, every test has a curve, and at least one test has a weight."""
    _require(case, _of_fit(case))


def require_comparable(case: Case) -> None:
    """Raise CaseError unless laws can be compared on the curves of the case; the law of the case needs no free parameter."""
    _require(case, _of_comparison(case))


def require_designable(case: Case) -> None:
    """Raise CaseError unless the next experiment can be designed: forces of indentations, and a free parameter."""
    _require(case, _of_design(case))


def require_indentations(case: Case, what: str) -> None:
    """Raise CaseError unless a test of the case is an indentation; `what` is told of, such as "a sweep"."""
    _require(case, _of_indentations(case, what))


def require_known_motions(case: Case, what: str) -> None:
    """Raise CaseError where the motion of a test follows from a force that is held, and no curve tells it; `what` is told of, such
    as "a sweep"."""
    _require(case, _of_motions(case, what))


def refusals(case: Case) -> dict[str, tuple[str, ...]]:
    """Command -> one line for each reason why it refuses a case; commands that accept it are left out.

    Parameters
    ----------
    case : Case

    Returns
    -------
    dict of str -> tuple of str
        `fit`, `compare`, `design`, `sweep` and `mesh-check`.
    """
    faults = {
        "fit": _of_fit(case),
        "compare": _of_comparison(case),
        "design": _of_design(case),
        "sweep": chain(_of_indentations(case, "a sweep"), _of_motions(case, "a sweep")),
        "mesh-check": _of_indentations(case, "a mesh-check"),
    }
    said = {name: tuple(line(None, fault) for fault in known) for name, known in faults.items()}
    return {name: lines for name, lines in said.items() if lines}


def asks_for_more(case: Case) -> bool:
    """Whether a fit may refuse the case for reasons that only its problem shows, such as inputs that it cannot take as unknown."""
    uncertain = case.fit.uncertain
    lists = any(isinstance(getattr(uncertain, name), Prior) and getattr(uncertain, name).values for name in uncertain.given)
    fields = any(test.field for test in case.tests)
    unknown = any(name != "mesh" for name in uncertain.given)
    plain = case.fit.method not in LEARNING or case.fit.direct or not case.fit.profiles
    in_time = case.relaxation is not None and unknown and plain
    return (
        bool(lists)
        or fields
        or in_time
        or case.fit.discrepancy.stated is not None
        or bool(case.fit.posterior)
        or _has_own_mesh(case)
    )


def _has_own_mesh(case: Case) -> bool:
    return case.mesh.size is not None or case.mesh.symmetry != "auto"


def _require(case: Case, faults: Iterator[Fault]) -> None:
    if known := list(faults):
        raise CaseError([line(case.path, fault) for fault in known])


def _of_fit(case: Case) -> Iterator[Fault]:
    relaxing = case.relaxation.free if case.relaxation is not None else {}
    return faults_of_fit(case.free | relaxing, case.tests, case.curves)


def _of_comparison(case: Case) -> Iterator[Fault]:
    if case.fit.prior.given:
        text = "laws are compared by curves alone; remove it, or give the moduli as curves of tests"
        yield Fault(("fit", "prior"), MISSING, text)
    yield from _of_discrepancy(case, "laws are compared by what they leave of the curves; remove the table for it")
    yield from _of_fields(case, "laws are compared by force curves alone; take the fields out of the case")
    relaxation = case.relaxation
    if relaxation is not None and (relaxation.free or any(curve and curve.time is not None for curve in case.curves)):
        yield Fault(("material", "relaxation"), MISSING, IN_TIME)
    yield from (fault for fault in faults_of_fit({}, case.tests, case.curves) if fault not in faults_of_freedom({}))


def _of_design(case: Case) -> Iterator[Fault]:
    yield from faults_of_freedom(case.free)
    yield from _of_indentations(case, "design")
    yield from _of_motions(case, "design")
    yield from _of_discrepancy(case, "design knows no misfit of the law; remove the table for it")
    if case.relaxation is not None:
        yield from _of_fields(case, "design knows displacements of elastic materials only; take the fields out of the case for it")


def _of_discrepancy(case: Case, text: str) -> Iterator[Fault]:
    if (scale := case.fit.discrepancy.stated) is not None:
        yield Fault(("fit", "discrepancy", "scale"), scale, text)


def _of_fields(case: Case, text: str) -> Iterator[Fault]:
    for test in case.tests:
        if test.field:
            yield Fault(("test", test.name, "field"), MISSING, text)


def _of_indentations(case: Case, what: str) -> Iterator[Fault]:
    if case.tests and not case.indentations:
        test = case.tests[0]
        yield Fault(("test", test.name, "kind"), test.kind, f"{what} knows indentations only; leave this test out for it")


def _of_motions(case: Case, what: str) -> Iterator[Fault]:
    for test, curve in zip(case.tests, case.curves, strict=True):
        if test.control == "force" and curve is None:
            text = f"{what} does not know creep under a held force, which `simulate` shows; control the displacement for it"
            yield Fault(("test", test.name, "control"), test.control, text)
