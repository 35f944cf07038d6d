"""What `indentfit fit --per-sample` does: a fit for each sample of replicates.csv, and the table of their parameters."""

import csv
from pathlib import Path

import click

from ..errors import FitError, RecordError
from ..experiment.samples import TABLE, read_samples
from ..inverse.per_sample import fit_each, parameter_spread, sample_cases
from ..report.folder import json_text, refuse_existing, result_folder, write_json
from .progress import progress

FORMAT = "indentfit.per_sample/1"


def run(path, overrides, output, overwrite, as_json, write_result):
    """Fit each sample of the table beside the case; write_result(folder, case, result) writes one fit's files into a folder."""
    from ..report.vtu import file_names

    cases = sample_cases(path, read_samples(Path(path).parent / TABLE), overrides)
    if not cases:
        raise RecordError(f"{Path(path).parent / TABLE}: no samples")
    output = output or f"{Path(path).resolve().parent.name or 'case'}-samples-result"
    refuse_existing(output, overwrite)
    for warning in cases[0][1].warnings():
        click.echo(f"warning: {warning}", err=True)
    names = file_names([name for name, _ in cases])
    fits = []
    with result_folder(output, overwrite) as folder:
        with progress("fit", total=1) as step:
            for one, name in zip(fit_each(cases, step), names, strict=True):
                fits.append(one)
                if one.result:
                    (folder / name).mkdir()
                    write_result(folder / name, one.case, one.result)
        spread = parameter_spread(fits)
        written = {
            "format": FORMAT,
            "samples": [_facts(one, name) for one, name in zip(fits, names, strict=True)],
            "spread": spread,
        }
        write_json(folder / "per_sample.json", written)
        _write_table(folder / "per_sample.csv", fits)
    click.echo(json_text(written) if as_json else "\n".join([*_lines(fits, spread), f"written   {output}"]))
    failed = [one.sample for one in fits if not (one.result and one.result.success)]
    if failed:
        raise FitError(f"the fit of {', '.join(failed)} did not converge; the results are in {output}")


def _facts(one, folder):
    if one.result is None:
        return {"sample": one.sample, "problem": one.problem}
    result = one.result
    return {
        "sample": one.sample,
        "folder": folder,
        "success": result.success,
        "parameters": result.parameters,
        "objective": result.objective,
        "thickness_mm": one.case.sample.thickness,
        "diameter_mm": one.case.sample.diameter,
    }


def _rows(fits):
    """A header and a row for each sample: parameters and errors, objective."""
    free = next((one.result.free for one in fits if one.result), [])
    yield ["sample", *(cell for name in free for cell in (name, f"{name}_stderr")), "objective_mN", "success"]
    for one in fits:
        if one.result is None:
            yield [one.sample, *[""] * (2 * len(free) + 1), one.problem]
            continue
        values = [cell for name in free for cell in (one.result.parameters[name][key] for key in ("value", "stderr"))]
        yield [one.sample, *values, one.result.objective, one.result.success]


def _write_table(path, fits):
    with open(path, "w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(_rows(fits))


def _lines(fits, spread):
    rows = [[_short(cell) for cell in row] for row in _rows(fits)]
    widths = [max(len(row[n]) for row in rows) for n in range(len(rows[0]))]
    for row in rows:
        yield "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip()
    yield ""
    for name, one in spread.items():
        unit = f" {one['unit']}" if one["unit"] not in ("", "1") else ""
        sd = "" if one["sd"] is None else f" +- {one['sd']:.3g} (SD)"
        yield f"{name:<9} {one['mean']:.4g}{sd}{unit}, {one['min']:.4g} to {one['max']:.4g}, n = {one['n']}"


def _short(cell):
    return "unknown" if cell is None else f"{cell:.4g}" if isinstance(cell, float) else str(cell)
