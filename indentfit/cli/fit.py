"""`indentfit fit`: the parameters that the curves of a case ask for, and how well they are determined."""

from pathlib import Path

import click

from ..case import read_case, require_fittable
from ..errors import ConvergenceError, FitError
from ..fem.simulate import Model
from ..inverse.fit import fit
from ..report.folder import case_facts, copy_case, json_text, refuse_existing, result_folder, write_curves, write_json
from .progress import progress


@click.command(short_help="Find the parameters that its curves ask for.")
@click.argument("case", type=click.Path())
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Replace a key of the case.")
@click.option("--method", type=click.Choice(["ga", "least_squares"]), help="The same as --set fit.method=...")
@click.option("--workers", type=int, metavar="N", help="Processes; the same as --set fit.workers=N")
@click.option("--seed", type=int, metavar="N", help="The same as --set fit.seed=N")
@click.option("-o", "--output", type=click.Path(), metavar="DIR", help="Result folder; by default CASEFOLDER-result.")
@click.option("--overwrite", is_flag=True, help="Replace an earlier result folder.")
@click.option("--no-fields", is_flag=True, help="Leave out the stresses at the optimum: their VTU files and pictures.")
@click.option("--json", "as_json", is_flag=True, help="Print result.json.")
def command(case, overrides, method, workers, seed, output, overwrite, no_fields, as_json):
    """Fit the free parameters of the case file CASE to its curves.

    Writes a result folder and prints the parameters. Ends with 4 where the fit did not converge; its result is written.
    """
    options = {"method": method, "workers": workers, "seed": seed}
    overrides += tuple(f"fit.{key}={value}" for key, value in options.items() if value is not None)
    read = read_case(case, overrides)
    require_fittable(read)
    output = output or f"{read.path.resolve().parent.name or 'case'}-result"
    refuse_existing(output, overwrite)
    for warning in read.warnings():
        click.echo(f"warning: {warning}", err=True)
    with progress("fit", total=1) as step:
        result = fit(read, step)
    written = _write(output, overwrite, read, result, not no_fields)
    click.echo(json_text(written) if as_json else "\n".join([*_lines(read, result), f"written   {output}"]))
    if not result.success:
        raise FitError(f"the fit did not converge: {result.message}; its result is in {output}")


def _write(path, overwrite, case, result, fields):
    """The result folder; returns what its result.json holds."""
    from ..report.html import write_report
    from ..report.plots import force_displacement  # matplotlib is slow to import

    measured = {test.name: curve for test, curve in zip(case.tests, case.curves, strict=True)}
    with result_folder(path, overwrite) as folder:
        again = copy_case(case, folder)
        written = {**result.as_json(), "overrides": list(again), "case": case_facts(case)}
        write_json(folder / "result.json", written)
        write_curves(folder / "curves.csv", result.curves, measured)
        force_displacement(list(measured.items()), list(result.curves.items()), Path(folder) / "fit")
        if fields and result.objective is not None:
            _write_fields(Path(folder) / "fields", case, result)
        write_report(folder)
    return written


def _write_fields(folder, case, result):
    """The stresses at the optimum, by one more run; a fit does not fail for want of them."""
    from ..report.fields import write_fields

    material = case.material_class(**{name: one["value"] for name, one in result.parameters.items()})
    model = Model(case)
    try:
        simulation = model.simulate(material, case)
    except ConvergenceError as error:
        click.echo(f"warning: no stress pictures: {error}", err=True)
        return
    write_fields(folder, model, material, case.material.bulk_modulus(material.shear_modulus), simulation.tests)


def _lines(case, result):
    """The result in words, line by line."""
    yield from _table(result.parameters)
    yield ""
    if result.objective is not None:
        parts = ", ".join(f"{name} {value:.4g}" for name, value in result.rmse.items())
        yield f"objective {result.objective:.5g} mN, equation (1): weighted sum of the tests' RMSEs ({parts} mN)"
        yield f"squares   {result.sum_of_squares:.5g} mN^2: weighted sum of the squared RMSEs"
    if result.singular_values and len(result.free) > 1:
        values = " : ".join(f"{value:.3g}" for value in result.singular_values)
        weakest = ", ".join(f"{name} {x:+.2f}" for name, x in zip(result.free, result.directions[-1], strict=True))
        yield f"singular  {values} mN; the curves say least about {weakest} (relative)"
    yield f"search    {result.message}"
    failed = f", {len(result.failures)} of them failed" if result.failures else ""
    yield (
        f"work      {result.nfev} sets of parameters{failed}, {result.runs} runs, "
        f"{result.solver['workers']} workers, {result.seconds:.1f} s"
    )
    mesh, penalty = result.mesh, result.solver["penalty_error"]
    exact = f"; contact penalty takes {penalty:.2%} of the force" if penalty is not None else ""
    yield f"mesh      {mesh['elements']:,} elements, {mesh['dofs']:,} degrees of freedom{exact}"
    for note in result.notes:
        yield f"note      {note}"


def _table(parameters):
    rows = [["parameter", "value", "std. error", "95 % interval", "", "verdict"]]
    for name, one in parameters.items():
        unit = "" if one["unit"] in ("", "1") else one["unit"]
        if one["fixed"]:
            rows.append([name, f"{one['value']:.6g}", "", "", unit, "fixed"])
            continue
        error = "unknown" if one["stderr"] is None else f"{one['stderr']:.2g}"
        interval = "unknown" if one["interval"] is None else " to ".join(f"{x:.4g}" for x in one["interval"])
        rows.append([name, f"{one['value']:.6g}", error, interval, unit, one["verdict"]])
    widths = [max(len(row[n]) for row in rows) for n in range(6)]
    for row in rows:
        yield "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip()
