"""The fits of a set of samples in numbers: as text, as a table, as JSON."""

import csv


def sample_facts(one, folder):
    """One SampleFit as per_sample.json holds it; folder: of its files."""
    if one.result is None:
        return {"sample": one.sample, "problem": one.problem}
    result = one.result
    return {
        "sample": one.sample,
        "folder": folder,
        "success": result.success,
        "parameters": result.as_json()["parameters"],
        "objective": result.objective,
        "thickness_mm": one.case.sample.thickness,
        "diameter_mm": one.case.sample.diameter,
    }


def _rows(fits):
    """A header and a row for each sample: parameters and errors, objective."""
    free: list[str] = next((one.result.free for one in fits if one.result), [])
    yield ["sample", *(cell for name in free for cell in (name, f"{name}_stderr")), "objective_mN", "success"]
    for one in fits:
        if one.result is None:
            yield [one.sample, *[""] * (2 * len(free) + 1), one.problem]
            continue
        values = [cell for name in free for cell in (one.result.parameters[name].value, one.result.parameters[name].stderr)]
        yield [one.sample, *values, one.result.objective, one.result.success]


def write_samples_table(path, fits):
    """Write a row for each sample as CSV."""
    with open(path, "w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(_rows(fits))


def sample_lines(fits, spread):
    """SampleFits and the spread of their parameters in words, line by line."""
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
