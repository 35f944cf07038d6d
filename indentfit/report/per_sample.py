"""The fits of a set of samples in numbers: as text, as a table, as JSON."""

import csv
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from indentfit.inference.per_sample import ParameterSpread, SampleFit
from indentfit.report.study_text import aligned

FORMAT = "indentfit.per_sample/2"


def per_sample_json(fits: Sequence[SampleFit], folders: Sequence[str], spread: Mapping[str, ParameterSpread]) -> dict[str, Any]:
    """What per_sample.json holds; folders: the names of the samples' own result folders."""
    samples = [_sample_json(fitted, folder) for fitted, folder in zip(fits, folders, strict=True)]
    return {"format": FORMAT, "samples": samples, "spread": {name: over.as_json() for name, over in spread.items()}}


def _sample_json(fitted: SampleFit, folder: str) -> dict[str, Any]:
    if fitted.result is None or fitted.case is None:
        return {"sample": fitted.sample, "problem": fitted.problem}
    result, sample = fitted.result, fitted.case.sample
    return {
        "sample": fitted.sample,
        "folder": folder,
        "success": result.success,
        "parameters": result.as_json()["parameters"],
        "objective": result.objective,
        "thickness_mm": sample.thickness,
        "diameter_mm": sample.diameter,
    }


def write_samples_table(path: Path, fits: Sequence[SampleFit]) -> None:
    """Write a row for each sample as CSV."""
    with open(path, "w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(_rows(fits))


def sample_lines(fits: Sequence[SampleFit], spread: Mapping[str, ParameterSpread]) -> Iterator[str]:
    """The fits of samples and the spread of their parameters in words, line by line."""
    yield from aligned([[_short(cell) for cell in row] for row in _rows(fits)])
    yield ""
    for name, over in spread.items():
        unit = f" {over.unit}" if over.unit not in ("", "1") else ""
        sd = "" if over.sd is None else f" +- {over.sd:.3g} (SD)"
        yield f"{name:<9} {over.mean:.4g}{sd}{unit}, {over.min:.4g} to {over.max:.4g}, n = {over.n}"


def _rows(fits: Sequence[SampleFit]) -> Iterator[list[Any]]:
    """A header and a row for each sample: parameters and errors, objective."""
    free = next((fitted.result.free for fitted in fits if fitted.result), ())
    yield ["sample", *(cell for name in free for cell in (name, f"{name}_stderr")), "objective_mN", "success"]
    for fitted in fits:
        if fitted.result is None:
            yield [fitted.sample, *[""] * (2 * len(free) + 1), fitted.problem]
            continue
        known = (fitted.result.parameters[name] for name in free)
        values = [cell for estimate in known for cell in (estimate.value, estimate.stderr)]
        yield [fitted.sample, *values, fitted.result.objective, fitted.result.success]


def _short(cell: Any) -> str:
    return "unknown" if cell is None else f"{cell:.4g}" if isinstance(cell, float) else str(cell)
