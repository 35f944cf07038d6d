"""A fit while it runs: the sets of parameters that its ledger holds so far, the best of them, and the text and pictures of a page.

Nothing here is needed for a result, and nothing of it enters one: errors are those of single runs, without a surrogate.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Case
from indentfit.curve import Curve
from indentfit.errors import CaseError
from indentfit.inverse.dense_curves import averaged
from indentfit.inverse.problem import InverseProblem, inverse_problem
from indentfit.inverse.sharp_edges import without_folds
from indentfit.report.digits import CurveScale
from indentfit.report.live_drawing import Line, drawing
from indentfit.report.typeset import symbol
from indentfit.runs.onlooking import SeenRun, runs_so_far

SHOWN = 12  # sets in the table


@dataclass(frozen=True, eq=False)
class SeenSet:
    """A set of parameters whose tests have all been run.

    Attributes
    ----------
    values : dict of name -> float
    forces : dict of test -> array (n,), mN
        At the displacements of the measured curve.
    objective : float, mN
        Equation (1), by which sets are ordered.
    error : float
        The largest of the tests' root mean square errors, over their largest forces.
    """

    values: dict[str, float]
    forces: dict[str, Array]
    objective: float
    error: float


@dataclass
class LiveFit:
    """The sets of a fit that runs in another process.

    Parameters
    ----------
    case : Case
    ledger : path
        The ledger in the unfinished folder of the fit.
    """

    case: Case
    ledger: Path
    started: float = field(default_factory=time.monotonic)
    runs: int = 0
    failed: int = 0
    sets: list[SeenSet] = field(default_factory=list)
    _last: int = 0
    _waiting: dict[str, dict[str, SeenRun]] = field(default_factory=dict)
    _problem: InverseProblem = field(init=False)

    def __post_init__(self) -> None:
        if self.case.relaxation is not None:
            raise CaseError(["material.relaxation: the live page shows no fit over time; leave out --live"])
        self.case = averaged(without_folds(self.case).case).case  # the points that are fitted
        self._problem = inverse_problem(self.case)

    def look(self) -> None:
        """Take in the runs that have been added since the last look."""
        for run in runs_so_far(self.ledger, self._last):
            self._last = run.number
            self.runs += 1
            if run.cause is not None or not run.force.size:
                self.failed += 1
                continue
            parameters = run.inputs.get("parameters", {})
            if run.test not in self.measured or not self._of_this_model(parameters):
                continue
            tests = self._waiting.setdefault(repr(sorted(parameters.items())), {})
            tests[run.test] = run
            if tests.keys() >= self.measured.keys():
                self._take(parameters, tests)
                tests.clear()

    @property
    def best(self) -> SeenSet | None:
        """The set of the least objective; None before the first."""
        return min(self.sets, key=lambda known: known.objective, default=None)

    @property
    def measured(self) -> dict[str, Curve]:
        """Test -> its measured curve, as far as it is fitted."""
        return {test.name: test.curve for test in self._problem.tests}

    def _of_this_model(self, parameters: Mapping[str, Any]) -> bool:
        """Whether a run is one of the mesh and the base of the fit."""
        return parameters.keys() <= self._problem.start.keys() | self.case.fit.uncertain.fitted.keys()

    def _take(self, parameters: Mapping[str, Any], tests: Mapping[str, SeenRun]) -> None:
        to_reference = 1 / self._problem.factor(parameters)
        forces = [to_reference * tests[test.name].force for test in self._problem.tests]
        candidate = self._problem.judge_best_scale({**self._problem.start, **parameters}, forces)
        pairs = list(zip(self._problem.tests, candidate.forces, strict=True))
        share = {
            test.name: float(np.sqrt(np.mean((force - test.curve.force) ** 2)) / np.abs(test.curve.force).max())
            for test, force in pairs
        }
        values = {name: float(candidate.parameters[name]) for name in self._problem.free}
        named = {test.name: force for test, force in pairs}
        self.sets.append(SeenSet(values, named, candidate.objective, max(share.values())))


# The page


def fragment(fit: LiveFit, ended: str = "") -> str:
    """The inner HTML of the page's main part.

    Parameters
    ----------
    fit : LiveFit
    ended : str
        A sentence for the reader once the fit has ended; empty while it runs.
    """
    best = fit.best
    parts = [f'<p class="lead" role="status">{escape(ended or _state(fit))}</p>']
    if best is not None:
        parts += [_curves(fit, best), _profiles(fit), _table(fit)]
    return "\n".join(parts)


def _state(fit: LiveFit) -> str:
    minutes = (time.monotonic() - fit.started) / 60
    failed = f", of which {fit.failed} gave no curve" if fit.failed else ""
    best = fit.best
    words = (
        "no set of parameters is complete yet"
        if best is None
        else f"{_counted(len(fit.sets), 'set')} of parameters so far; the best is off by {best.error:.2%} of the largest force"
    )
    return f"The fit runs. {_counted(fit.runs, 'run')} so far{failed}; {words}. This page has watched for {minutes:.1f} min."


def _counted(n: int, noun: str) -> str:
    return f"{n} {noun}{'' if n == 1 else 's'}"


def _curves(fit: LiveFit, best: SeenSet) -> str:
    figures = []
    for test, curve in fit.measured.items():
        scale = CurveScale.of([curve])
        x, force, model = (
            curve.displacement * scale.displacement.factor,
            *(values * scale.force.factor for values in (curve.force, best.forces[test])),
        )
        lines = [Line("measured", x, force, dots=True), Line("best set so far", x, model)]
        rest = [Line("best set less measured", x, model - force, dots=True)]
        figures.append(_figure(drawing(lines, scale.across, scale.up), f"{test}: measured curve and best set so far."))
        figures.append(
            _figure(drawing(rest, scale.across, f"Residual ({scale.force.symbol})", zero=True), f"{test}: its residuals.")
        )
    return f'<section><h2>Fit and residuals</h2><div class="figures">{"".join(figures)}</div></section>'


def _profiles(fit: LiveFit) -> str:
    """The errors of all sets over each parameter: their lower edge is the profile."""
    names = list(fit.sets[0].values)
    errors = np.array([known.error for known in fit.sets])
    figures = []
    for name in names:
        known_as = fit.case.law.parameters.get(name)
        unit = f" ({known_as.unit})" if known_as is not None and known_as.unit not in ("", "1") else ""
        values = np.array([known.values.get(name, np.nan) for known in fit.sets])
        line = Line("a set of parameters", values, 100 * errors, dots=True)
        figures.append(
            _figure(
                drawing([line], f"{symbol(name)}{unit}", "Error (% of the largest force)"),
                f"{symbol(name)}: each dot is a set that was run; their lower edge is the profile.",
            )
        )
    return f'<section><h2>Profiles as they come</h2><div class="figures">{"".join(figures)}</div></section>'


def _table(fit: LiveFit) -> str:
    """The best sets and their errors."""
    known = sorted(fit.sets, key=lambda seen: seen.objective)[:SHOWN]
    names = list(known[0].values)
    head = "".join(f'<th scope="col" class="number">{escape(symbol(word))}</th>' for word in (*names, "error, %"))
    rows = "".join(
        "<tr>" + "".join(f'<td class="number">{value:.4g}</td>' for value in (*seen.values.values(), 100 * seen.error)) + "</tr>"
        for seen in known
    )
    caption = f"The {len(known)} best of {_counted(len(fit.sets), 'set')}; the result is found with a surrogate of all runs."
    return (
        '<section><h2>Runs</h2><div class="scroll" role="region" tabindex="0" aria-label="Table: best sets">'
        f"<table><caption>{caption}</caption><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div></section>"
    )


def _figure(svg: str, caption: str) -> str:
    return f"<figure>{svg}<figcaption>{escape(caption)}</figcaption></figure>"
