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
from scipy.stats import truncnorm

from indentfit.arrays import Array
from indentfit.case import Case, Range, require_designable
from indentfit.case.prior_tests import with_prior_tests
from indentfit.case.uses import require_case
from indentfit.inference.seen import seen_sentences
from indentfit.runs.pool import RunPool
from indentfit.runs.relaxing import elastic_case
from indentfit.study.further import (
    TURN,
    Forces,
    FurtherTest,
    Known,
    Told,
    Values,
    evidence_of,
    forces_at,
    free_of,
    further_tests,
    turn_of,
)
from indentfit.study.in_time import Curves, InTime
from indentfit.study.promised import NORMAL, Evidence
from indentfit.study.runs import Execution
from indentfit.study.views import SEEN, deviations_of_fields

NOISE = 0.01  # of the largest force, by default
BEST, PAIRS = 12, 10  # further tests that are paired, and pairs that are kept
QUANTILES = (0.05, 0.5, 0.95)  # of what an estimate leaves open
NEAR = 0.1  # of a parameter's value: an estimate that is known so well leaves nothing open
RADIAN = 57.3  # the error of an angle is judged by degrees in a radian, not by its own size
AS_KNOWN = (
    "{names}: uncertain in this case, or left out, and taken as known here, at the value that a simulation takes: errors are at "
    "least these, and another test may be the best"
)


@dataclass(frozen=True)
class FurtherPair:
    """Two further tests, with the errors by both and the tests of the case together; the rest as in a `FurtherTest`."""

    first: str
    second: str
    stderr: dict[str, float]
    effort: str = ""
    solves: int | None = None
    half_width: dict[str, float] | None = None
    between: dict[str, tuple[float, float]] | None = None
    unsolved: int = 0


@dataclass(frozen=True, repr=False, eq=False)
class Design:
    """Further tests, ranked by the 95 % interval of the worst parameter that a fit is expected to state.

    Parameters
    ----------
    parameters : dict of name -> value
        Parameters at which the information was computed.
    noise : float, mN
        Standard deviation of a force.
    stderr : dict of parameter -> standard error by the case's own tests
        By Fisher's information: with the noise known, and each curve weighed by it.
    worst : str
        The parameter whose interval is widest, relative to its value.
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
    half_width : dict of parameter -> half width, or None
        Half width of the 95 % interval that a fit of the case's own tests is expected to state; None in files of earlier versions.
    between : dict of parameter -> (least, largest), or None
        Half widths between which 90 % of such fits are expected to state theirs; None where the design is not at an estimate that
        leaves much open.
    unsolved : int
        Number of the values that the estimate leaves open at which the case's own tests have no solution.
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
    half_width: dict[str, float] | None = None
    between: dict[str, tuple[float, float]] | None = None
    unsolved: int = 0

    def as_json(self) -> dict[str, Any]:
        """The stable keys of design.json, under the tag `format`."""
        return {
            "format": self.FORMAT,
            "parameters": self.parameters,
            "noise_mN": self.noise,
            **({"view_noise_mm": self.view_noise} if self.view_noise is not None else {}),
            "stderr": self.stderr,
            **({"half_width": self.half_width} if self.half_width else {}),
            **({"between": self.between} if self.between else {}),
            **({"unsolved": self.unsolved} if self.unsolved else {}),
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
        seen, wide, between = value.get("view_noise_mm"), value.get("half_width"), value.get("between")
        promised = {"half_width": wide, "between": between, "unsolved": value.get("unsolved", 0)}
        return cls(*known, remarks=remarks, pairs=pairs, view_noise=seen, **promised)

    def widths(self, judged: Design | FurtherTest | FurtherPair | None = None) -> dict[str, float] | None:
        """Half widths of the 95 % intervals by a further test, by a pair, or by the tests of the case; in files of earlier versions
        those of the standard errors."""
        of = judged if judged is not None else self
        return of.half_width or ({name: NORMAL * error for name, error in of.stderr.items()} if of.stderr else None)

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
    estimated: bool = False,
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
    estimated : bool
        Whether the parameters are what a fit of the case's tests gave. Intervals are then the median over values that these tests
        leave open, and the span of 90 % of single fits is told: four times as many runs where they leave much open.

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
    forces, runs = _own(elastic, [values], execution)
    first = forces[0]
    assert first is not None  # or there were a DesignError
    own = first.curves if in_time is None else in_time.own(first.curves)
    pressed = [test.kind == "indentation" for test in case.tests]
    largest = max(float(known.forces.max()) for known, press in zip(own, pressed, strict=True) if press)
    noise = noise or NOISE * largest
    ranges = {**free_of(elastic), **(in_time.relaxation.free if in_time else {})}
    prior = np.diag([12 / (bounds.max - bounds.min) ** 2 for bounds in ranges.values()])
    at_first = _evidence(case, own, noise / largest, largest, first.fields)
    places: list[Values] = [values]
    if estimated and in_time is None:
        places += _open(values, ranges, np.asarray(np.linalg.inv(prior + sum(each.information for each in at_first))))
        others, used = _own(elastic, places[1:], execution)
        forces, runs = [first, *others], runs + used
    rows = tuple(
        _evidence(case, there.curves if in_time is None else own, noise / largest, largest, there.fields) if there else ()
        for there in forces
    )
    squares = case.fit.method == "least_squares"
    known = Known(tuple(places), tuple(ranges), prior, rows, squares, noise, noise / largest, view_noise or SEEN * deepest)
    told, used = further_tests(elastic, in_time, known, execution)
    promised, whole = known.promised(), {**values, **(in_time.values if in_time else {})}
    now = promised.half_width
    worst = max(now, key=lambda name: now[name] / (RADIAN if name == TURN else abs(whole[name]) or ranges[name].max))
    tests = sorted(
        (_judged(known, further) for further in told), key=lambda test: test.half_width[worst] if test.half_width else np.inf
    )
    pairs = _pairs(known, told, worst)
    return Design(
        parameters=whole,
        noise=noise,
        stderr=known.stderr(),
        worst=worst,
        candidates=tuple(tests),
        runs=runs + used,
        case=case,
        remarks=remarks,
        pairs=pairs,
        view_noise=known.view_noise,
        **promised._asdict(),
    )


def _evidence(case: Case, curves: Sequence[Curves], share: float, largest: float, fields: Sequence[Curves]) -> tuple[Evidence, ...]:
    """What the case's own tests tell: `share` of the largest force is the noise where a curve states none."""
    usual = float(np.mean([test.weight or 0.0 for test in case.tests])) or 1.0
    rows = []
    for test, measured, known in zip(case.tests, case.curves, curves, strict=True):
        pressed = test.kind == "indentation"
        size = largest if pressed else float(np.abs(known.forces).max())
        stated = measured is not None and measured.sd is not None
        sd = measured.sd if measured is not None and measured.sd is not None else share * size
        rows.append(evidence_of(known, sd, (test.weight or 0.0) / usual, pressed, not stated))
    pairs = zip(fields, deviations_of_fields(elastic_case(case)), strict=True)
    return (*rows, *(Evidence(known.information(sd)) for known, sd in pairs))


def _open(values: Values, ranges: Mapping[str, Range], covar: Array) -> list[Values]:
    """Values that an estimate leaves open: at QUANTILES of a normal density within the ranges, along the direction that is known
    worst; none where the estimate is known to NEAR."""
    names, widths = list(ranges), np.array([bounds.max - bounds.min for bounds in ranges.values()])
    variances, directions = np.linalg.eigh(covar / np.outer(widths, widths))
    sd, along = float(np.sqrt(variances[-1])), widths * directions[:, -1]
    at = np.array([values[name] for name in names])
    if np.max(sd * np.abs(along) / np.maximum(np.abs(at), 1e-12)) < NEAR:
        return []
    low, high = (np.array([getattr(bounds, end) for bounds in ranges.values()]) for end in ("min", "max"))
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.sort(np.array([(low - at) / along, (high - at) / along]), axis=0)
    least, most = float(np.nanmax(ends[0])), float(np.nanmin(ends[1]))
    steps = truncnorm.ppf(QUANTILES, least / sd, most / sd, scale=sd)
    return [{**values, **dict(zip(names, np.clip(at + step * along, low, high).tolist(), strict=True))} for step in steps]


def _judged(known: Known, further: Told) -> FurtherTest:
    if further.evidence is None:
        return further.test
    return replace(further.test, stderr=known.stderr(further.evidence), **known.promised(further.evidence)._asdict())


def _pairs(known: Known, told: Sequence[Told], worst: str) -> tuple[FurtherPair, ...]:
    """The best pairs among the best further tests; the best of each change, angle and kind is paired, not each of its depths."""
    best: dict[tuple[str, float | None], tuple[float, Told]] = {}
    for further in told:
        if further.evidence is not None:
            width, key = known.promised(further.evidence).half_width[worst], (further.test.change, further.test.angle)
            if key not in best or width < best[key][0]:
                best[key] = (width, further)
    chosen = [further for _, further in sorted(best.values(), key=lambda pair: pair[0])][:BEST]
    pairs = [_pair(known, a, b) for a, b in itertools.combinations(chosen, 2)]
    return tuple(sorted(pairs, key=lambda pair: pair.half_width[worst] if pair.half_width else np.inf)[:PAIRS])


def _pair(known: Known, a: Told, b: Told) -> FurtherPair:
    efforts = "; ".join(dict.fromkeys(told.test.effort for told in (a, b)))  # two tests by one rig need it once
    evidence = tuple(
        first + other if first and other else () for first, other in zip(a.evidence or (), b.evidence or (), strict=True)
    )
    words, solves = (a.test.whole_words, b.test.whole_words), (a.test.solves or 0) + (b.test.solves or 0)
    return FurtherPair(*words, known.stderr(evidence), efforts, solves, **known.promised(evidence)._asdict())


def _own(case: Case, places: Sequence[Values], execution: Execution) -> tuple[list[Forces | None], int]:
    """The curves and fields of the case's own tests with their derivatives at each place, and the number of runs."""
    if not places:
        return [], 0
    with RunPool(case, execution.workers, None, execution.cluster, execution.stop) as pool:
        return forces_at(case, pool, places), pool.runs
