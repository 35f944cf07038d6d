"""The fits of a set of samples in numbers: as text, as a table, as a figure."""

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from indentfit.inference.per_sample import PerSample, SampleSummary
from indentfit.report.study_text import aligned


def sample_lines(result: PerSample) -> Iterator[str]:
    """The fits of samples and the spread of their parameters in words, line by line."""
    yield from aligned([[_short(cell) for cell in row] for row in _rows(result)])
    yield ""
    for name, over in result.spread.items():
        yield f"{name:<9} {over}, {over.min:.4g} to {over.max:.4g}, n = {over.n}"


def write_samples_table(path: Path, result: PerSample) -> None:
    """Write a row for each sample as CSV."""
    with open(path, "w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(_rows(result))


def _rows(result: PerSample) -> Iterator[list[Any]]:
    """A header and a row for each sample: parameters with their standard errors, objective."""
    yield ["sample", *(cell for name in result.free for cell in (name, f"{name}_stderr")), "objective_mN", "success"]
    for summary in result.samples:
        if summary.problem is not None:
            yield [summary.sample, *[""] * (2 * len(result.free) + 1), summary.problem]
            continue
        known = (summary.parameters[name] for name in result.free)
        cells = [cell for estimate in known for cell in (estimate.value, estimate.stderr)]
        yield [summary.sample, *cells, summary.objective, summary.success]


def _short(cell: Any) -> str:
    return "unknown" if cell is None else f"{cell:.4g}" if isinstance(cell, float) else str(cell)


def samples_figure(result: PerSample, path: str | Path | None = None) -> Any:
    """The matplotlib Figure of each free parameter: a mark with its standard error for each sample, and the mean over the fits that
    converged as a line. Saves path.svg and path.png where a path is given."""
    from indentfit.report import sample_plots  # imported here, because matplotlib is slow and the functions above do not need it

    fitted = [summary for summary in result.samples if summary.problem is None]
    panels = [_panel(name, fitted, result) for name in result.free]
    return sample_plots.parameters_of_samples([summary.sample for summary in fitted], panels, path)


def _panel(name: str, fitted: list[SampleSummary], result: PerSample) -> Any:
    from indentfit.report.sample_plots import ParameterPanel

    known = [summary.parameters[name] for summary in fitted]
    unit = "" if known[0].unit in ("", "1") else f" ({known[0].unit})"
    return ParameterPanel(
        label=f"{name}{unit}",
        values=np.array([estimate.value for estimate in known]),
        errors=np.array([np.nan if estimate.total is None else estimate.total for estimate in known]),
        converged=np.array([summary.success for summary in fitted]),
        mean=result.spread[name].mean if name in result.spread else None,
    )
