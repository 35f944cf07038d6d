"""`indentfit simulate`: the curves of a case at given parameters, and its stress fields."""

import importlib.metadata

import click

from indentfit.experiment.measured import read_case

from ..fem.simulate import Model
from ..report.folder import case_facts, copy_case, json_text, refuse_existing, result_folder, write_curves, write_json
from ..report.text import simulation_lines
from ..runs.forward import presses_of
from ..runs.points import setup_of
from .progress import progress


@click.command(short_help="Compute the curves of a case, and its stresses.")
@click.argument("case", type=click.Path())
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Replace a key of the case.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@click.option("-o", "--output", type=click.Path(), metavar="DIR", help="Write a result folder.")
@click.option("--overwrite", is_flag=True, help="Replace an earlier result folder.")
@click.option("--vtu", is_flag=True, help="Write the fields at the last displacement, too (needs -o).")
@click.option("--series", is_flag=True, help="The same at every step, as a series for ParaView (needs -o).")
@click.option("--whole", is_flag=True, help="Fields of the whole sample, mirrored from the quarter that is computed (needs -o).")
def command(case, overrides, as_json, output, overwrite, vtu, series, whole):
    """Compute the force-displacement curves of the case file CASE.

    A parameter that the case leaves free has its start value; another one by --set material.NAME.start=VALUE.
    """
    needing = {"--vtu": vtu, "--series": series, "--whole": whole, "--overwrite": overwrite}
    if output is None and any(needing.values()):
        raise click.UsageError(f"{next(name for name, given in needing.items() if given)} needs -o DIR")
    read = read_case(case, overrides)
    if output is not None:
        refuse_existing(output, overwrite)
    for warning in read.warnings():
        click.echo(f"warning: {warning}", err=True)
    material = read.law(**read.start_values())
    model = Model(setup_of(read))
    simulation = _simulated(model, material, read)
    if output is not None:
        _write(output, overwrite, read, model, material, simulation, (vtu, series, whole))
    if as_json:
        click.echo(json_text(simulation.as_json()))
        return
    click.echo("\n".join(simulation_lines(simulation, read, material)))
    if output is not None:
        click.echo(f"written   {output}")


def _simulated(model, material, case):
    """The Simulation, with its progress on stderr."""
    order = {test.name: n for n, test in enumerate(case.tests)}
    with progress("simulate", total=len(case.tests)) as step:
        return model.simulate(presses_of(case, material), lambda name, share: step(order[name] + share, name))


def _write(path, overwrite, case, model, material, simulation, fields):
    """The result folder: simulation.json, curves.csv, the figure, the case, and asked, the fields."""
    from ..report.html import write_report
    from ..report.plots import force_displacement  # matplotlib is slow to import

    simulated = {test.name: test.curve for test in simulation.tests}
    measured = [(test.name, curve) for test, curve in zip(case.tests, case.curves, strict=True) if curve is not None]
    with result_folder(path, overwrite) as folder:
        again = copy_case(case, folder)
        write_json(folder / "simulation.json", {**_origin(case, material, again), **simulation.as_json(), "case": case_facts(case)})
        write_curves(folder / "curves.csv", simulated)
        force_displacement(measured, list(simulated.items()), folder / "force_displacement")
        if any(fields):
            from ..report.fields import write_fields

            kappa = case.material.bulk_modulus(material.shear_modulus)
            _, series, whole = fields
            write_fields(folder / "fields", model, material, kappa, simulation.tests, series=series, mirror=whole)
        write_report(folder)


def _origin(case, material, overrides):
    """What the result is of: enough to get it again."""
    return {
        "format": "indentfit.simulation/1",
        "indentfit": importlib.metadata.version("indentfit"),
        "title": case.title,
        "case_hash": case.hash,
        "overrides": list(overrides),
        "parameters": {name: getattr(material, name) for name in type(material).parameters},
    }
