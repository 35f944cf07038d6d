"""`indentfit fit`: the parameters that the curves of a case ask for, and how well they are determined."""

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, get_args

import click

from indentfit.case.methods import SearchMethod
from indentfit.cli import clusters
from indentfit.cli.command import Command
from indentfit.cli.completion import keys
from indentfit.cli.progress import progress
from indentfit.cli.speech import say, warn
from indentfit.cli.stopping import stopping
from indentfit.cli.watch import beside
from indentfit.errors import CaseError, FitError

if TYPE_CHECKING:
    from indentfit.inference.per_sample import PerSample
    from indentfit.inference.population_fit import Population
    from indentfit.report.conduct import Place


@click.command(cls=Command, short_help="Find the parameters that its curves ask for.")
@click.argument("case", type=click.Path(), default="case.toml")
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", shell_complete=keys, help="Replace a key of the case.")
@click.option("--method", type=click.Choice(get_args(SearchMethod)), help="The same as --set fit.method=...")
@click.option("--direct", is_flag=True, help="Search on the forward model itself, without a surrogate.")
@click.option("--workers", type=int, metavar="N", help="Number of processes; the same as --set fit.workers=N")
@click.option("--seed", type=int, metavar="N", help="The same as --set fit.seed=N")
@click.option("-o", "--output", type=click.Path(), metavar="DIR", help="Result folder; by default CASEFOLDER-result.")
@click.option("--overwrite", is_flag=True, help="Replace an earlier result folder; its runs are used again.")
@click.option("--resume", is_flag=True, help="Go on with a fit that was stopped or killed; the result is the same.")
@click.option("--reuse", type=click.Path(), metavar="DIR", help="Use the runs of this result folder too, where they fit.")
@clusters.options
@click.option("--no-fields", is_flag=True, help="Leave out the stresses at the optimum: their VTU files and pictures.")
@click.option("--scan-weights", is_flag=True, help="Show what other weights of the two tests would find.")
@click.option("--posterior", is_flag=True, help="Draw samples of the posterior: posterior.nc for ArviZ, and a figure.")
@click.option("--live", is_flag=True, help="Show the fit as a page on this machine while it runs, as `indentfit watch` does.")
@click.option("--json", "as_json", is_flag=True, help="Print result.json.")
@click.option("--per-sample", is_flag=True, help="Fit each sample of replicates.csv (see process --case) on its own.")
@click.option(
    "--population", is_flag=True, help="Fit the samples of replicates.csv as one population: means, and spread between samples."
)
@click.option(
    "--group", metavar="COLUMN", help="With --population: column of replicates.csv (or manifest.csv) with each sample's group."
)
def command(
    case: str,
    overrides: tuple[str, ...],
    method: str | None,
    direct: bool,
    workers: int | None,
    seed: int | None,
    output: str | None,
    overwrite: bool,
    resume: bool,
    reuse: str | None,
    cluster: str | None,
    scheduler: str | None,
    no_fields: bool,
    scan_weights: bool,
    posterior: bool,
    live: bool,
    as_json: bool,
    per_sample: bool,
    population: bool,
    group: str | None,
) -> None:
    """Fit the free parameters of the case file CASE to its curves.

    The command writes a result folder and prints the parameters. It ends with 4 where the fit did not converge, or where the model
    cannot follow the curves (the error of a test is above 20 % of its largest force); the result is written all the same.

    Every run of the forward model is kept at once, in the folder .DIR.unfinished until the result is whole. Ctrl-C (or SIGTERM)
    finishes the running solves, then stops; a second Ctrl-C stops at once. --resume goes on from there.

    --population fits each sample of replicates.csv as --per-sample does, and then all as one population, without more runs: the
    mean of each parameter (of each group, with --group) and its spread between samples, which has no noise in it, the ratios of the
    groups' means, and each sample's values given all samples.

    Dask sends objects by pickle between its own processes: whoever reaches a scheduler can run code on its workers. Only the
    address given is used, and a local cluster listens on 127.0.0.1 alone. No file is ever read by pickle.
    """
    # imported when the command runs: --help and completion are quick without
    from indentfit.report.conduct import Place

    where = clusters.chosen(cluster, scheduler)
    flags = {name: "true" for name, given in (("direct", direct), ("posterior", posterior)) if given}
    options = {"method": method, **flags, "workers": workers, "seed": seed}
    overrides += tuple(f"fit.{key}={value}" for key, value in options.items() if value is not None)
    folder = Path(case).resolve().parent.name or "case"
    if group is not None and not population:
        raise click.UsageError("--group belongs to --population")
    if live and (population or per_sample):
        raise click.UsageError("--live shows the fit of one case; leave it out with --per-sample and --population")
    kind = "population" if population else "samples-result" if per_sample else "result"
    place = Place(output or f"{folder}-{kind}", overwrite, resume, reuse)
    if population or per_sample:
        groups = _groups(Path(case).parent, group) if population else None
        _fit_samples(case, overrides, place, where, as_json, groups)
    else:
        with beside(case, overrides, place.output) if live else contextlib.nullcontext():
            _fit(case, overrides, place, where, not no_fields, scan_weights, as_json)


def _fit(
    path: str, overrides: tuple[str, ...], place: "Place", cluster: str | None, fields: bool, scan_weights: bool, as_json: bool
) -> None:
    from indentfit.case import require_fittable
    from indentfit.experiment.measured import read_case
    from indentfit.report.conduct import Conduct
    from indentfit.report.folder import json_text, refuse_existing
    from indentfit.runs.start import prepare_for

    case = read_case(path, overrides)
    require_fittable(case)
    refuse_existing(place.output, place.overwrite)
    prepare_for(case, cluster)  # the server imports what workers need while this process imports what the fit needs
    from indentfit.report.lasting_fit import fit_in_folder, refuse_unfinished

    refuse_unfinished(place, samples=False)
    warn(case.warnings())
    with stopping() as stop, progress("fit", total=1) as step:
        result, written = fit_in_folder(case, place, Conduct(step, stop, say, cluster), fields)
    click.echo(json_text(written) if as_json else f"{result.summary(scan_weights)}\nwritten   {place.output}")
    if not result.success:
        said = result.message if result.no_fit else f"the fit did not converge: {result.message}"
        raise FitError(f"{said}; its result is in {place.output}")


def _groups(folder: Path, column: str | None) -> dict[str, str]:
    """The group of each sample, by a column of replicates.csv or else of manifest.csv; empty without a column."""
    from indentfit.errors import RecordError
    from indentfit.experiment.specimens import TABLE, read_groups

    if column is None:
        return {}
    try:
        return read_groups(folder / TABLE, column)
    except RecordError:
        if not (folder / "manifest.csv").is_file():
            raise
        return read_groups(folder / "manifest.csv", column)


def _fit_samples(
    path: str, overrides: tuple[str, ...], place: "Place", cluster: str | None, as_json: bool, groups: dict[str, str] | None
) -> None:
    """Fit each sample of the table beside the case; as one population where groups are given."""
    from indentfit.experiment.specimens import TABLE, read_specimens
    from indentfit.inference.per_sample import sample_cases
    from indentfit.inference.population_fit import require_positive
    from indentfit.report.conduct import Conduct
    from indentfit.report.folder import json_text, refuse_existing
    from indentfit.report.lasting_fit import fit_population_in_folder, fit_samples_in_folder, refuse_unfinished
    from indentfit.report.vtu import file_names
    from indentfit.runs.start import prepare_for

    cases = sample_cases(path, read_specimens(Path(path).parent / TABLE), overrides)
    refuse_existing(place.output, place.overwrite)
    refuse_unfinished(place, samples=True)
    prepare_for(cases[0][1], cluster, points=True)
    warn(cases[0][1].warnings())
    named = dict(zip(file_names([name for name, _ in cases]), cases, strict=True))
    if groups is not None:
        require_positive(cases[0][1])
        if missing := [name for name, _ in cases if groups and name not in groups]:
            raise CaseError([f"{path}: sample {missing[0]} has no group; add its row to the table of groups"])
    result: PerSample | Population
    with stopping() as stop, progress("fit", total=1) as step:
        conduct = Conduct(step, stop, say, cluster)
        if groups is None:
            result = singles = fit_samples_in_folder(named, place, conduct)
        else:
            result = fit_population_in_folder(named, place, conduct, groups)
            singles = result.per_sample
    click.echo(json_text(result.as_json()) if as_json else f"{result.summary()}\nwritten   {place.output}")
    if failed := [summary.sample for summary in singles.samples if not summary.success]:
        raise FitError(f"the fit of {', '.join(failed)} did not converge; the results are in {place.output}")
