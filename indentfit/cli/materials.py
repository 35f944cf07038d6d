"""`indentfit materials`: the installed materials, one of them in words, or its conformance checks."""

import inspect
import json

import click

from .. import material
from ..errors import MaterialError


@click.command(short_help="List, describe or check materials.")
@click.argument("words", nargs=-1, metavar="[NAME | check NAME]")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def command(words, as_json):
    """List the materials; with NAME, describe one; with check NAME, hold it to the conformance kit.

    NAME is that of an installed material, or file.py:Class, whose code is then run. A failed check ends with 2.
    """
    if not words:
        _list(as_json)
    elif len(words) == 1 and words != ("check",):
        _describe(words[0], as_json)
    elif len(words) == 2 and words[0] == "check":
        _check(words[1], as_json)
    else:
        raise click.UsageError("give nothing, NAME, or check NAME")


def _list(as_json):
    found = material.installed()
    if as_json:
        rows = {
            name: {"error": str(one)} if isinstance(one, MaterialError) else {"parameters": list(one.parameters)}
            for name, one in found.items()
        }
        click.echo(json.dumps(rows, indent=2))
        return
    width = max(map(len, found), default=0)
    for name, one in found.items():
        if isinstance(one, MaterialError):
            click.echo(f"{name:<{width}}  BROKEN: {one}")
        else:
            click.echo(f"{name:<{width}}  {', '.join(one.parameters)}: {_doc(one).splitlines()[0]}")


def _describe(name, as_json):
    kind = material.load(name)
    rows = {
        name: {"unit": one.unit, "min": one.min, "max": one.max, "meaning": one.meaning, "scale": one.scale}
        for name, one in kind.parameters.items()
    }
    if as_json:
        click.echo(json.dumps({"material": name, "equation": _doc(kind), "parameters": rows}, indent=2))
        return
    click.echo(f"{name}\n\n{_doc(kind)}\n")
    width = max(map(len, rows), default=0)
    for parameter, row in rows.items():
        scale = "; the energy is proportional to it" if row["scale"] else ""
        click.echo(f"  {parameter:<{width}}  {row['unit']:<4} {_bounds(row):<16} {row['meaning']}{scale}")


def _check(name, as_json):
    checks = material.check(material.load(name))
    if as_json:
        rows = [{"name": check.name, "ok": check.ok, "detail": check.detail} for check in checks]
        click.echo(json.dumps({"material": name, "ok": all(check.ok for check in checks), "checks": rows}, indent=2))
    else:
        width = max(len(check.name) for check in checks)
        for check in checks:
            click.echo(f"{'ok  ' if check.ok else 'FAIL'}  {check.name:<{width}}  {check.detail}")
    failed = [check.name for check in checks if not check.ok]
    if failed:
        raise MaterialError(f"{name}: {len(failed)} of {len(checks)} checks failed: {', '.join(failed)}")


def _doc(kind):
    return inspect.getdoc(kind) or "(no equation in its docstring)"


def _bounds(row):
    low, high = row["min"], row["max"]
    return " and ".join(
        text for text in (f">= {low:g}" if low is not None else "", f"<= {high:g}" if high is not None else "") if text
    )
