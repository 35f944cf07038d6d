"""`indentfit process`: raw records of a rig to curves, stiffnesses and their statistics."""

import importlib.metadata
from pathlib import Path

import click

from indentfit.case import read_record_table
from indentfit.cli.progress import progress
from indentfit.curve import write_curve
from indentfit.errors import RecordError

SIDECAR = "record.toml"
FORMAT = "indentfit.records/1"


@click.command(short_help="Turn raw records into curves and stiffnesses.")
@click.argument("raw", nargs=-1, type=click.Path())
@click.option("-m", "--manifest", type=click.Path(), help="CSV: sample, direction, file, thickness, diameter.")
@click.option(
    "--record", "table", type=click.Path(), metavar="TOML", help=f"Its [record] table; by default {SIDECAR} beside the records."
)
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Replace a key: record.rate=1000.")
@click.option("--thickness", type=click.FloatRange(min=0, min_open=True), metavar="MM", help="Of the samples RAW, for strains.")
@click.option("-o", "--output", type=click.Path(), metavar="DIR", help="Result folder; by default NAME-processed.")
@click.option("--overwrite", is_flag=True, help="Replace an earlier result folder.")
@click.option("--case", "as_case", is_flag=True, help="Write a case of the mean curves, too (needs a manifest).")
@click.option("--base", type=click.Path(), metavar="CASE", help="Case to take the experiment and the material from, for --case.")
@click.option("--target", multiple=True, metavar="DIR=KIND", help="For --case: mean, linear or quadratic, such as 90=quadratic.")
@click.option("--figures/--no-figures", default=True, help="Draw a figure of each record.")
@click.option("--json", "as_json", is_flag=True, help="Print summary.json.")
def command(raw, manifest, table, overrides, thickness, output, overwrite, as_case, base, target, figures, as_json):
    """Turn the raw records RAW, or those of a manifest, into curves, stiffnesses and statistics.

    A record that cannot be used is named and left out; ends with 2 where none can be used.
    """
    from indentfit.experiment.manifest import process_all
    from indentfit.report.folder import json_text, refuse_existing

    if bool(raw) == bool(manifest):
        raise click.UsageError("give the records RAW, or --manifest FILE")
    if (base or target) and not as_case:
        raise click.UsageError(f"{'--base' if base else '--target'} needs --case")
    if as_case and not manifest:
        raise click.UsageError("--case needs --manifest, which tells samples and directions")
    targets = dict(map(_target, target))
    if manifest and thickness:
        raise click.UsageError("--thickness belongs to RAW; a manifest has a column of its own")
    first = Path(manifest or raw[0])
    output = output or f"{first.stem or 'records'}-processed"
    settings = read_record_table(_table_file(table, first), overrides)
    text = _base_text(base) if as_case else None
    refuse_existing(output, overwrite)
    entries = _entries(raw, manifest, thickness)
    with progress("process", total=len(entries)) as step:
        outcomes = process_all(entries, settings, step)
    _require_one(outcomes)
    written, lines = _write(output, overwrite, outcomes, settings, figures, (base, text, targets) if as_case else None)
    click.echo(json_text(written) if as_json else "\n".join([*lines, f"written     {output}"]))


def _table_file(table, first):
    """The file with the [record] table: as told, or the sidecar of the records, or none."""
    beside = first.parent / SIDECAR
    if table is None and beside.is_file():
        click.echo(f"reading as {beside} says", err=True)
        return beside
    return table


def _target(text):
    from indentfit.experiment.manifest import DIRECTIONS

    direction, _, kind = text.partition("=")
    if direction not in DIRECTIONS or kind not in ("mean", "linear", "quadratic"):
        raise click.UsageError(f"--target {text}: write 0 or 90, =, and mean, linear or quadratic")
    return DIRECTIONS[direction], kind


def _base_text(base):
    from indentfit.case.template import template

    if base is None:
        return template()
    try:
        return Path(base).read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        raise RecordError(f"{base}: cannot be read ({getattr(error, 'strerror', None) or error}); name a case file") from None


def _entries(raw, manifest, thickness):
    from indentfit.experiment.manifest import Entry, read_manifest

    if manifest:
        return read_manifest(manifest)
    names = [Path(one).name for one in raw]
    labels = [Path(one).stem if names.count(Path(one).name) == 1 else str(one) for one in raw]
    return [Entry(label, None, Path(one), thickness) for label, one in zip(labels, raw, strict=True)]


def _require_one(outcomes):
    """Say on stderr what failed; RecordError, with every line, where nothing is left."""
    failed = [one.problem for one in outcomes if one.problem]
    if len(failed) == len(outcomes):
        for line in failed[:-1]:
            click.echo(f"error: {line}", err=True)
        raise RecordError(failed[-1])
    for line in failed:
        click.echo(f"warning: left out: {line}", err=True)
    for one in outcomes:
        for note in one.processed.notes if one.processed else ():
            click.echo(f"warning: {one.name}: {note}", err=True)


def _write(path, overwrite, outcomes, settings, figures, case):
    """The result folder. Returns what its summary.json holds, and the result in words."""
    from indentfit.experiment.replicates import mean_curves, statistics
    from indentfit.report import records
    from indentfit.report.folder import result_folder, write_json
    from indentfit.report.record_case import write_case

    found = statistics(outcomes)
    means, outlying = mean_curves(outcomes, settings.points), records.outlier_names(found)
    words = list(records.statistics_lines(found))
    with result_folder(path, overwrite) as folder:
        curves = _write_curves(folder, outcomes)
        records.write_stiffness(folder / "stiffness.csv", outcomes, settings.strains, outlying)
        if means:
            records.write_means(folder / "mean_curves.csv", means)
        if case:
            for warning in write_case(folder, case[0], case[1], outcomes, curves, means, case[2]):
                click.echo(f"warning: {warning}", err=True)
        if figures:
            _draw(folder, outcomes, found, means, outlying, [*records.relaxation_lines(outcomes), *words])
        written = {
            "format": FORMAT,
            "indentfit": importlib.metadata.version("indentfit"),
            "record": settings.model_dump(mode="json"),
            "records": [records.record_facts(one) | {"curve": curves.get(one.name)} for one in outcomes],
            **records.statistics_facts(found, means),
        }
        write_json(folder / "summary.json", written)
    return written, [*records.record_lines(outcomes, outlying), *records.relaxation_lines(outcomes), *words]


def _write_curves(folder, outcomes):
    """The curve of each record as CSV; returns name -> file."""
    (folder / "curves").mkdir()
    good = [one for one in outcomes if one.processed]
    curves = {}
    for one, name in zip(good, _file_names(good), strict=True):
        curves[one.name] = f"curves/{name}.csv"
        write_curve(folder / curves[one.name], one.processed.curve)
    return curves


def _file_names(outcomes):
    from indentfit.report.vtu import file_names

    return file_names([one.name.replace("°", "").replace(" ", "_") for one in outcomes])


def _draw(folder, outcomes, found, means, outlying, words):
    from indentfit.report.plots import save
    from indentfit.report.record_figures import record_figure, replicate_figure
    from indentfit.report.record_page import write_page

    (folder / "figures").mkdir()
    good = [one for one in outcomes if one.processed]
    pictures = []
    with progress("draw", total=len(good)) as step:
        for n, (one, name) in enumerate(zip(good, _file_names(good), strict=True)):
            pictures.append((one.name, record_figure(one)))
            save(pictures[-1][1], folder / "figures" / f"{name}.svg")
            step(n + 1, one.name)
    replicates = replicate_figure(outcomes, found, means) if found.stiffness else None
    if replicates:
        save(replicates, folder / "figures" / "replicates.svg")
    version = importlib.metadata.version("indentfit")
    write_page(folder / "report.html", "Processed records", outcomes, words, outlying, replicates, pictures, version)
