"""`indentfit process`: raw records of a rig to curves, stiffnesses and their statistics."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from indentfit.cli.command import Command
from indentfit.cli.completion import keys
from indentfit.cli.progress import progress
from indentfit.errors import RecordError

if TYPE_CHECKING:
    from indentfit.case import Record
    from indentfit.experiment.process_result import ProcessResult

SIDECAR = "record.toml"
FILE_CASE = ("sample", "indenter", "material", "mesh", "fit", "solver")  # tables of a case that --set may give with RAW and --case


@click.command(cls=Command, short_help="Turn raw records into curves and stiffnesses.")
@click.argument("raw", nargs=-1, type=click.Path())
@click.option("-m", "--manifest", type=click.Path(), help="CSV: sample, direction, file, thickness, diameter.")
@click.option(
    "--record",
    "table",
    type=click.Path(),
    metavar="TOML",
    help=f"File with the table [record] that says how to read the records; by default {SIDECAR} beside them.",
)
@click.option(
    "--set", "overrides", multiple=True, metavar="KEY=VALUE", shell_complete=keys, help="Replace a key, such as record.rate=1000."
)
@click.option(
    "--thickness", type=click.FloatRange(min=0, min_open=True), metavar="MM", help="Thickness of the samples, for strains."
)
@click.option("-o", "--output", type=click.Path(), metavar="DIR", help="Result folder; by default NAME-processed.")
@click.option("--overwrite", is_flag=True, help="Replace an earlier result folder.")
@click.option(
    "--case",
    "as_case",
    is_flag=True,
    help="Also write a case that fit runs, of RAW or of a manifest.",
)
@click.option("--base", type=click.Path(), metavar="CASE", help="For --case: the case file to take everything else from.")
@click.option(
    "--target",
    multiple=True,
    metavar="DIR=KIND",
    help="For --case: mean, linear or quadratic, such as 90=quadratic.",
)
@click.option(
    "--figures/--no-figures",
    default=None,
    help="Draw a figure of each record; by default, of the 12 poorest where there are more.",
)
@click.option("--list", "listed", is_flag=True, help="List tables, tests, cycles and segments of the files RAW, and do no more.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON: what summary.json holds.")
def command(
    raw: tuple[str, ...],
    manifest: str | None,
    table: str | None,
    overrides: tuple[str, ...],
    thickness: float | None,
    output: str | None,
    overwrite: bool,
    as_case: bool,
    base: str | None,
    target: tuple[str, ...],
    figures: bool | None,
    as_json: bool,
    listed: bool,
) -> None:
    """Turn the raw records RAW, or those of a manifest, into curves, stiffnesses and statistics.

    RAW are files; a folder stands for the files in it.
    A record that cannot be used is named on stderr and left out. The command ends with exit code 2 where no record can be used.
    """
    # imported when the command runs: --help and completion are quick without
    from indentfit.case import read_record_table
    from indentfit.experiment.file_case import FileCase
    from indentfit.experiment.folders import record_files
    from indentfit.experiment.mean_case import MeanCase
    from indentfit.report.folder import json_text, refuse_existing, stamped
    from indentfit.report.record_folder import Listener, drawn_names, write_process

    if listed and not raw:
        raise click.UsageError("--list needs the records RAW")
    if bool(raw) == bool(manifest):
        raise click.UsageError("give the records RAW, or --manifest FILE")
    if (base or target) and not as_case:
        raise click.UsageError(f"{'--base' if base else '--target'} needs --case")
    if (base or target) and not manifest:
        raise click.UsageError(f"{'--base' if base else '--target'} needs --manifest, which tells samples and directions")
    told = [text for text in overrides if as_case and not manifest and text.partition(".")[0] in FILE_CASE]
    targets = dict(map(_target, target))
    if manifest and thickness:
        raise click.UsageError("--thickness belongs to RAW; a manifest has a column of its own")
    first = Path(manifest or raw[0])
    output = output or f"{first.stem or 'records'}-processed"
    settings = read_record_table(_table_file(table, first), [text for text in overrides if text not in told])
    files = tuple(map(str, record_files(raw)))
    if listed:
        _list(files, settings)
        return
    case: MeanCase | FileCase | None = None
    if as_case and manifest:
        case = MeanCase.read(base, targets)
    elif as_case:
        case = FileCase.of(told)
        settings = case.reading(settings)
    refuse_existing(output, overwrite)
    result = _processed(files, manifest, thickness, settings)
    drawn = len(drawn_names(result, figures))
    with progress("draw", total=drawn) as step:
        write_process(result, output, figures, overwrite, case, Listener(_warn, step))
    click.echo(json_text(stamped(result.as_json())) if as_json else f"{result.summary()}\nwritten     {output}")
    if figures is None and drawn < len(result.records) and not as_json:
        click.echo(f"figures     of the {drawn} poorest of {len(result.records)} records; --figures draws all")
    if as_case and not as_json:
        click.echo(f"next        indentfit fit {output}/case.toml")


def _table_file(table: str | None, first: Path) -> str | Path | None:
    """The file with the table [record]: the one that is named, or the sidecar of the records, or none."""
    if table is not None:
        return table
    for folder in (first, first.parent) if first.is_dir() else (first.parent,):
        beside = folder / SIDECAR
        if beside.is_file():
            click.echo(f"reading as {beside} says", err=True)
            return beside
    return None


def _list(raw: tuple[str, ...], settings: Record) -> None:
    """Print what the files hold."""
    from indentfit.experiment.contents import contents
    from indentfit.report.contents import contents_lines

    for file in raw:
        click.echo("\n".join(contents_lines(file, contents(file, settings))))


def _target(text: str) -> tuple[int, str]:
    from indentfit.experiment.manifest import DIRECTIONS
    from indentfit.experiment.mean_case import KINDS

    direction, _, kind = text.partition("=")
    if direction not in DIRECTIONS or kind not in KINDS:
        raise click.UsageError(f"--target {text}: write 0 or 90, =, and mean, linear or quadratic")
    return DIRECTIONS[direction], kind


def _processed(raw: tuple[str, ...], manifest: str | None, thickness: float | None, settings: Record) -> ProcessResult:
    """The processed records. The function says on stderr which records are left out, and which deserve a look."""
    from indentfit.experiment.process import entries_of, process

    try:
        entries = entries_of(raw, manifest, thickness, settings)  # a file may hold many records
        with progress("process", total=len(entries)) as step:
            result = process(entries, settings=settings, progress=step)
    except RecordError as error:
        *others, last = str(error).splitlines()
        for line in others:
            click.echo(f"error: {line}", err=True)
        raise RecordError(last) from None
    for outcome in result.outcomes:
        if outcome.problem:
            click.echo(f"warning: left out: {outcome.problem}", err=True)
    for note in result.notes:
        _warn(note)
    return result


def _warn(text: str) -> None:
    click.echo(f"warning: {text}", err=True)
