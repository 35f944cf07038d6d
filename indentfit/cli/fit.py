"""`indentfit fit`: the parameters that the curves of a case ask for, and how well they are determined."""

from pathlib import Path

import click

from indentfit.case import require_fittable
from indentfit.case.keys import choices
from indentfit.experiment.measured import read_case

from ..errors import FitError, OutputError
from ..inference.fit import fit
from ..report.folder import (
    LEDGER,
    clear,
    clear_all_but,
    json_text,
    lasting_folder,
    ledgers,
    refuse_existing,
    unfinished,
    write_json,
)
from ..runs.ledger import refuse_in_use
from . import clusters
from .ledgers import opened, saying_what_is_kept
from .progress import progress
from .stopping import stopping


@click.command(short_help="Find the parameters that its curves ask for.")
@click.argument("case", type=click.Path())
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Replace a key of the case.")
@click.option("--method", type=click.Choice(choices("fit.method")), help="The same as --set fit.method=...")
@click.option("--direct", is_flag=True, help="Search on the forward model itself, without a surrogate.")
@click.option("--workers", type=int, metavar="N", help="Processes; the same as --set fit.workers=N")
@click.option("--seed", type=int, metavar="N", help="The same as --set fit.seed=N")
@click.option("-o", "--output", type=click.Path(), metavar="DIR", help="Result folder; by default CASEFOLDER-result.")
@click.option("--overwrite", is_flag=True, help="Replace an earlier result folder; its runs are used again.")
@click.option("--resume", is_flag=True, help="Go on with a fit that was stopped or killed; the result is the same.")
@click.option("--reuse", type=click.Path(), metavar="DIR", help="Use the runs of this result folder too, where they fit.")
@clusters.options
@click.option("--no-fields", is_flag=True, help="Leave out the stresses at the optimum: their VTU files and pictures.")
@click.option("--scan-weights", is_flag=True, help="Show what other weights of the two tests would find.")
@click.option("--json", "as_json", is_flag=True, help="Print result.json.")
@click.option("--per-sample", is_flag=True, help="Fit each sample of replicates.csv (see process --case) on its own.")
def command(
    case,
    overrides,
    method,
    direct,
    workers,
    seed,
    output,
    overwrite,
    resume,
    reuse,
    cluster,
    scheduler,
    no_fields,
    scan_weights,
    as_json,
    per_sample,
):
    """Fit the free parameters of the case file CASE to its curves.

    Writes a result folder and prints the parameters. Ends with 4 where the fit did not converge; its result is written.

    Every run of the forward model is kept at once, in the folder .DIR.unfinished until the result is whole. Ctrl-C (or
    SIGTERM) lets the runs at work end, and stops; once more stops now; --resume goes on.

    Dask sends objects by pickle between its own processes: whoever reaches a scheduler can run code on its workers.
    Only the address given is used, and a local cluster listens on 127.0.0.1 alone. No file is ever read by pickle.
    """
    where = clusters.chosen(cluster, scheduler)
    options = {"method": method, "direct": "true" if direct else None, "workers": workers, "seed": seed}
    overrides += tuple(f"fit.{key}={value}" for key, value in options.items() if value is not None)
    if per_sample:
        _fit_samples(case, overrides, output, overwrite, resume, reuse, where, as_json)
        return
    read = read_case(case, overrides)
    require_fittable(read)
    output = output or f"{read.path.resolve().parent.name or 'case'}-result"
    target = refuse_existing(output, overwrite)
    _refuse_unfinished(output, resume, overwrite, samples=False)
    for warning in read.warnings():
        click.echo(f"warning: {warning}", err=True)
    with stopping() as stop, lasting_folder(output, overwrite) as folder, opened(folder, read, resume, [target], reuse) as ledger:
        clear(folder)
        with saying_what_is_kept(ledger), progress("fit", total=1) as step:
            result = fit(read, step, ledger=ledger, cluster=where, stop=stop)
        written = _fill(folder, result, not no_fields)
    click.echo(json_text(written) if as_json else f"{result.summary(scan_weights)}\nwritten   {output}")
    if not result.success:
        raise FitError(f"the fit did not converge: {result.message}; its result is in {output}")


def _fit_samples(path, overrides, output, overwrite, resume, reuse, cluster, as_json):
    """Fit each sample of the table beside the case; a result folder with a folder and a ledger for each of them."""
    from ..experiment.specimens import TABLE, read_specimens
    from ..inference.per_sample import PerSample, sample_cases
    from ..report.html import write_report
    from ..report.per_sample import write_samples_table
    from ..report.vtu import file_names

    cases = sample_cases(path, read_specimens(Path(path).parent / TABLE), overrides)
    output = output or f"{Path(path).resolve().parent.name or 'case'}-samples-result"
    target = refuse_existing(output, overwrite)
    _refuse_unfinished(output, resume, overwrite, samples=True)
    for warning in cases[0][1].warnings():
        click.echo(f"warning: {warning}", err=True)
    named = dict(zip(file_names([name for name, _ in cases]), cases, strict=True))
    with stopping() as stop, lasting_folder(output, overwrite) as folder:
        clear_all_but(folder, named)
        fits = _fits(folder, named, resume, target, reuse, cluster, stop)
        result = PerSample.of(fits, list(named))
        write_json(folder / "per_sample.json", result.as_json())
        write_samples_table(folder / "per_sample.csv", result)
        write_report(folder)
    click.echo(json_text(result.as_json()) if as_json else f"{result.summary()}\nwritten   {output}")
    if failed := [one.sample for one in fits if not (one.result and one.result.success)]:
        raise FitError(f"the fit of {', '.join(failed)} did not converge; the results are in {output}")


def _fits(folder, named, resume, target, reuse, cluster, stop):
    """The SampleFit of each (sample, Case), by the name of its folder, written there; one that was finished before a stop costs
    no run, and is the same."""
    from ..inference.per_sample import fit_sample

    fits = []
    with progress("fit", total=1) as step:
        for n, (name, (sample, case)) in enumerate(named.items()):
            place = folder / name
            place.mkdir(exist_ok=True)
            of_sample = lambda share, note="", n=n, sample=sample: step((n + share) / len(named), f"{sample} {note}")  # noqa: E731
            others = Path(reuse) / name if reuse and (Path(reuse) / name).is_dir() else reuse
            with opened(place, case, resume and (place / LEDGER).exists(), [target / name], others) as ledger:
                clear(place)
                with saying_what_is_kept(ledger):
                    fits.append(fit_sample(sample, case, of_sample, ledger, cluster, stop))
            if fits[-1].result:
                _fill(place, fits[-1].result, False)
    return fits


def _refuse_unfinished(output, resume, overwrite, samples):
    """Raise an error where an earlier fit is still going on, or was stopped and is neither resumed nor replaced; samples: whether
    this is a fit of samples, which only such a one can resume."""
    place = unfinished(output)
    found = ledgers(place)
    for ledger in found:
        refuse_in_use(ledger)
    if found and not overwrite:
        if not resume:
            remedy = "add --resume to go on with it, or --overwrite to start anew"
            raise OutputError(f"{output}: an unfinished fit lies in {place}; {remedy}")
        if samples != (place / LEDGER not in found):
            kind, remedy = ("one case", "leave out --per-sample") if samples else ("samples", "add --per-sample")
            raise OutputError(f"{output}: the unfinished fit in {place} is of {kind}; {remedy}, or choose another folder")


def _fill(folder, result, fields):
    """Fill the result folder; returns what its result.json holds."""
    from indentfit.report.fit_folder import fill_fit  # matplotlib is slow to import

    return fill_fit(folder, result, fields, lambda said: click.echo(f"warning: {said}", err=True))
