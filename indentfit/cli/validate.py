"""`indentfit validate`: every input error at once, before any solve, or else what the case says."""

import json
from collections.abc import Iterator
from typing import Any

import click

from indentfit.case import Case, Mesh, Range
from indentfit.errors import CaseError
from indentfit.experiment.measured import read_case


@click.command(short_help="Show every error of a case, or what it says.")
@click.argument("case", type=click.Path())
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Replace a key of the case.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def command(case: str, overrides: tuple[str, ...], as_json: bool) -> None:
    """Check the case file CASE and the curves it names.

    Prints what it says; with errors, prints each of them on a line and ends with 2.
    """
    try:
        read = read_case(case, overrides)
    except CaseError as error:
        if as_json:
            click.echo(json.dumps({"case": case, "valid": False, "faults": error.faults}, indent=2))
        raise
    if as_json:
        click.echo(json.dumps({"case": case, "valid": True, **_facts(read)}, indent=2))
        return
    click.echo("\n".join(_summary(read)))
    for warning in read.warnings():
        click.echo(f"warning: {warning}", err=True)


def _facts(case: Case) -> dict[str, Any]:
    """The case as JSON holds it."""
    sections = case.model_dump(mode="json", exclude={"path", "overrides", "curves", "tests"})
    tests = [{**test.model_dump(mode="json"), "n": len(case.outputs(test))} for test in case.tests]
    return {"hash": case.hash, **sections, "tests": tests, "free": list(case.free), "warnings": case.warnings()}


def _summary(case: Case) -> Iterator[str]:
    """The case in words, line by line."""
    sample, indenter = case.sample, case.indenter
    yield f"{case.path}: valid" + (f", {case.title}" if case.title else "")
    yield f"  sample    {sample.geometry.words()}, thickness {sample.thickness:g} mm, {sample.base} base"
    friction = "sticking" if indenter.friction == "stick" else f"friction {indenter.friction:g}"
    yield f"  indenter  {indenter.geometry.words()}, {friction}"
    yield f"  mesh      {_mesh(case.mesh)}"
    part = case.material
    bulk = f"kappa = {part.kappa:g} kPa" if part.bulk_ratio is None else f"kappa = {part.bulk_ratio:g} x shear modulus"
    yield f"  material  {part.model or part.energy}, {bulk}"
    for name, parameter in case.law.parameters.items():
        yield f"    {name:<8}{_value(part.parameters[name], parameter.unit)}"
    for test in case.tests:
        displacements = case.outputs(test)
        source = test.curve or test.record or "no curve"
        yield (
            f"  test      {test.name}: {test.angle} degrees, {len(displacements)} points to "
            f"{displacements[-1]:g} mm, weight {test.weight:g}, {source}"
        )
    free = ", ".join(case.free) or "none"
    yield f"  fit       {case.fit.method}, seed {case.fit.seed}; free parameters: {free}"


def _mesh(mesh: Mesh) -> str:
    if mesh.default:
        return "default"
    return f"elements of {mesh.size:g} mm" if mesh.size else f"about {mesh.elements} elements"


def _value(value: float | Range, unit: str) -> str:
    unit = f" {unit}" if unit not in ("", "1") else ""
    if isinstance(value, Range):
        return f"{value.min:g} to {value.max:g}{unit}, from {value.start:g}"
    return f"{value:g}{unit}, fixed"
