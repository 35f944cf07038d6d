"""The next experiment: which further test would determine the worst parameter best, from Fisher's information.

The information of a test at given parameters is sum (dF/dtheta)^2 / sigma^2; the information of several tests adds up, and that of
displacements in a side view is counted in the same way. `further` makes the further tests. The parameters' ranges count as a weak,
uniform prior, so that every standard error is finite.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from indentfit.case import Case, require_designable
from indentfit.case.prior_tests import with_prior_tests
from indentfit.case.uses import require_case
from indentfit.inference.seen import seen_sentences
from indentfit.runs.pool import RunPool
from indentfit.runs.relaxing import elastic_case
from indentfit.study.further import TURN, Forces, FurtherTest, Known, Told, Values, forces_of, free_of, further_tests, turn_of
from indentfit.study.in_time import InTime
from indentfit.study.runs import Execution
from indentfit.study.views import SEEN, deviations_of_fields

NOISE = 0.01  # of the largest force, by default
BEST, PAIRS = 12, 10  # further tests that are paired, and pairs that are kept
RADIAN = 57.3  # the error of an angle is judged by degrees in a radian, not by its own size
AS_KNOWN = (
    "{names}: uncertain in this case, or left out, and taken as known here, at the value that a simulation takes: errors are at "
    "least these, and another test may be the best"
)


@dataclass(frozen=True)
class FurtherPair:
    """Two further tests, with the standard errors by both and the tests of the case together; `effort` and `solves` as those of a
    `FurtherTest`."""

    first: str
    second: str
    stderr: dict[str, float]
    effort: str = ""
    solves: int | None = None


@dataclass(frozen=True, repr=False, eq=False)
class Design:
    """Further tests, ranked by the standard error of the worst parameter.

    Parameters
    ----------
    parameters : dict of name -> value
        Parameters at which the information was computed.
    noise : float, mN
        Standard deviation of a force.
    stderr : dict of parameter -> standard error by the case's own tests
    worst : str
        The parameter whose standard error is largest, relative to its value.
    candidates : tuple of FurtherTest
        Further tests, the best for `worst` first, failed tests last.
    pairs : tuple of FurtherPair
        The best pairs of further tests.
    runs : int
        Number of runs of the forward model.
    case : Case or None
    remarks : tuple of str
        What the records of the case cannot see of a relaxation; empty where the material is elastic.
    view_noise : float or None, mm
        Standard deviation of a displacement in a side view; None in files of earlier versions.
    """

    FORMAT: ClassVar[str] = "indentfit.design/2"

    parameters: dict[str, float]
    noise: float
    stderr: dict[str, float]
    worst: str
    candidates: tuple[FurtherTest, ...]
    runs: int
    case: Case | None = None
    remarks: tuple[str, ...] = ()
    pairs: tuple[FurtherPair, ...] = ()
    view_noise: float | None = None

    def as_json(self) -> dict[str, Any]:
        """The stable keys of design.json, under the tag `format`."""
        return {
            "format": self.FORMAT,
            "parameters": self.parameters,
            "noise_mN": self.noise,
            **({"view_noise_mm": self.view_noise} if self.view_noise is not None else {}),
            "stderr": self.stderr,
            "worst": self.worst,
            "candidates": [asdict(test) for test in self.candidates],
            "pairs": [asdict(pair) for pair in self.pairs],
            "runs": self.runs,
            **({"remarks": list(self.remarks)} if self.remarks else {}),
        }

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> Design:
        """The design that design.json holds, in the form of this version or of 0.1."""
        tests = tuple(FurtherTest(**test) for test in value["candidates"])
        remarks, pairs = tuple(value.get("remarks", ())), tuple(FurtherPair(**pair) for pair in value.get("pairs", ()))
        known = value["parameters"], value["noise_mN"], value["stderr"], value["worst"], tests, value["runs"]
        return cls(*known, remarks=remarks, pairs=pairs, view_noise=value.get("view_noise_mm"))

    def summary(self) -> str:
        """The design in words, as the command prints it."""
        from indentfit.report.study_text import design_lines

        return "\n".join(design_lines(self))

    def plot(self, path: str | Path | None = None) -> Any:
        """The matplotlib Figure of the candidates; saved as SVG and PNG where a path is given."""
        from indentfit.report.plots import designs

        return designs(self, path)

    def write(self, folder: str | Path, overwrite: bool = False) -> None:
        """Write the result folder. Raises OutputError where the folder exists already, or cannot be written."""
        from indentfit.report.study_folder import write_design

        write_design(self, folder, overwrite)

    def __repr__(self) -> str:
        best = next((test for test in self.candidates if test.stderr), None)
        end = f"; best: {best.whole_words}" if best else ""
        return f"Design(worst parameter {self.worst}{end})"

    def _repr_html_(self) -> str:
        from indentfit.report.study_text import design_rows, html_table

        return html_table(repr(self), design_rows(self))


def design(
    case: Case,
    parameters: Values | None = None,
    noise: float | None = None,
    execution: Execution | None = None,
    view_noise: float | None = None,
) -> Design:
    """Which further test would determine the worst free parameter of a case best.

    Parameters
    ----------
    case : Case
    parameters : mapping of name to value
        Parameters at which the information is computed; by default the start values.
    noise : float, mN
        Standard deviation of a force; by default 1 % of the largest force of the case's tests. Stresses of tests of other kinds
        have the same share of their largest. Standard deviations that a curve or [fit.prior] states are taken instead.
    execution : Execution
        Progress, workers and cluster of the runs.
    view_noise : float, mm
        Standard deviation of a displacement in a side view; by default 1.5 % of the largest depth of the case's tests.

    Returns
    -------
    Design

    Raises
    ------
    CaseError
        No parameter of the case is free.
    DesignError
        The case's own tests have no derivatives.
    """
    require_case(case)
    require_designable(case)
    case = with_prior_tests(case)
    deepest = max(float(case.outputs(test)[-1]) for test in case.indentations)
    given, execution = dict(parameters or case.start_values()), execution or Execution()
    remarks = tuple(seen_sentences(case, case.relaxation.at(given).numbers)) if case.relaxation else ()
    in_time, elastic = InTime.of(case, given), elastic_case(case)
    given = {**{name: bounds.start for name, bounds in turn_of(elastic).items()}, **given}
    values = {name: value for name, value in given.items() if name in case.law.parameters or name in turn_of(elastic)}
    if in_time is not None and TURN in case.fit.uncertain.fitted:
        remarks = (*remarks, "the angle of the fibres, which the fit finds, is taken as known here: errors may be larger")
    if doubtful := [name for name in case.fit.uncertain.given if name != "mesh"]:
        remarks = (*remarks, AS_KNOWN.format(names=", ".join(doubtful)))
    forces, runs = _own(elastic, values, execution)
    own = forces.curves if in_time is None else in_time.own(forces.curves)
    pressed = [test.kind == "indentation" for test in case.tests]
    largest = max(float(known.forces.max()) for known, press in zip(own, pressed, strict=True) if press)
    noise = noise or NOISE * largest
    sizes = [largest if press else float(np.abs(known.forces).max()) for known, press in zip(own, pressed, strict=True)]
    rows = zip(case.curves, sizes, strict=True)
    stated = [noise / largest * size if curve is None or curve.sd is None else curve.sd for curve, size in rows]
    ranges = {**free_of(elastic), **(in_time.relaxation.free if in_time else {})}
    prior = np.diag([12 / (bounds.max - bounds.min) ** 2 for bounds in ranges.values()])
    information = prior + sum(known.information(sd) for known, sd in zip(own, stated, strict=True))
    pairs_of_fields = zip(forces.fields, deviations_of_fields(elastic), strict=True)
    information = information + sum(known.information(sd) for known, sd in pairs_of_fields)
    known = Known(values, tuple(ranges), information, noise, noise / largest, view_noise or SEEN * deepest)
    told, used = further_tests(elastic, in_time, known, execution)
    now, whole = known.stderr(np.zeros_like(prior)), {**values, **(in_time.values if in_time else {})}
    worst = max(now, key=lambda name: now[name] / (RADIAN if name == TURN else abs(whole[name]) or ranges[name].max))
    tests = sorted((_judged(known, further) for further in told), key=lambda test: test.stderr[worst] if test.stderr else np.inf)
    pairs = _pairs(known, told, worst)
    return Design(whole, noise, now, worst, tuple(tests), runs + used, case, remarks, pairs, known.view_noise)


def _judged(known: Known, further: Told) -> FurtherTest:
    if further.information is None:
        return further.test
    return replace(further.test, stderr=known.stderr(further.information))


def _pairs(known: Known, told: Sequence[Told], worst: str) -> tuple[FurtherPair, ...]:
    """The best pairs among the best further tests; the best of each change, angle and kind is paired, not each of its depths."""
    best: dict[tuple[str, float | None], tuple[float, Told]] = {}
    for further in told:
        if further.information is not None:
            error, key = known.stderr(further.information)[worst], (further.test.change, further.test.angle)
            if key not in best or error < best[key][0]:
                best[key] = (error, further)
    chosen = [further for _, further in sorted(best.values(), key=lambda pair: pair[0])][:BEST]
    pairs = [
        _pair(a.test, b.test, known.stderr(a.information + b.information))
        for a, b in itertools.combinations(chosen, 2)
        if a.information is not None and b.information is not None
    ]
    return tuple(sorted(pairs, key=lambda pair: pair.stderr[worst])[:PAIRS])


def _pair(a: FurtherTest, b: FurtherTest, stderr: dict[str, float]) -> FurtherPair:
    efforts = dict.fromkeys(test.effort for test in (a, b))  # two tests by one rig need it once
    return FurtherPair(a.whole_words, b.whole_words, stderr, "; ".join(efforts), (a.solves or 0) + (b.solves or 0))


def _own(case: Case, parameters: Values, execution: Execution) -> tuple[Forces, int]:
    """The curves and fields of the case's own tests with their derivatives, and the number of runs."""
    with RunPool(case, execution.workers, None, execution.cluster, execution.stop) as pool:
        return forces_of(case, pool, parameters), pool.runs
