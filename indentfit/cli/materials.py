"""`indentfit materials`: the installed materials, one of them in words, or its conformance checks."""

import inspect
import json
from typing import TYPE_CHECKING, Any

import click

from indentfit.cli.command import Command
from indentfit.cli.completion import laws
from indentfit.errors import MaterialError

if TYPE_CHECKING:
    from indentfit.material import Material, Parameter


@click.command(cls=Command, short_help="List, describe or check materials.")
@click.argument("words", nargs=-1, metavar="[NAME | check NAME]", shell_complete=laws)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def command(words: tuple[str, ...], as_json: bool) -> None:
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


def _list(as_json: bool) -> None:
    from indentfit.material import installed  # imported here, because --help shall not wait for NumPy

    laws = installed()
    if as_json:
        rows = {
            name: {"error": str(law)} if isinstance(law, MaterialError) else {"parameters": list(law.parameters)}
            for name, law in laws.items()
        }
        click.echo(json.dumps(rows, indent=2))
        return
    width = max(map(len, laws), default=0)
    for name, law in laws.items():
        if isinstance(law, MaterialError):
            click.echo(f"{name:<{width}}  BROKEN: {law}")
        else:
            click.echo(f"{name:<{width}}  {', '.join(law.parameters)}: {_doc(law).splitlines()[0]}")


def _describe(name: str, as_json: bool) -> None:
    from indentfit.material import load  # NumPy is slow to import, for --help

    kind = load(name)
    if as_json:
        rows = {parameter: _row(known) for parameter, known in kind.parameters.items()}
        click.echo(json.dumps({"material": name, "equation": _doc(kind), "parameters": rows}, indent=2))
        return
    click.echo(f"{name}\n\n{_doc(kind)}\n")
    width = max(map(len, kind.parameters), default=0)
    for parameter, known in kind.parameters.items():
        scale = "; the energy is proportional to it" if known.scale else ""
        click.echo(f"  {parameter:<{width}}  {known.unit:<4} {_bounds(known):<16} {known.meaning}{scale}")


def _row(parameter: "Parameter") -> dict[str, Any]:
    return {
        "unit": parameter.unit,
        "min": parameter.min,
        "max": parameter.max,
        "meaning": parameter.meaning,
        "scale": parameter.scale,
    }


def _check(name: str, as_json: bool) -> None:
    from indentfit.material import check as conformance
    from indentfit.material import load

    checks = conformance(load(name))
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


def _doc(kind: "type[Material]") -> str:
    return inspect.getdoc(kind) or "(no equation in its docstring)"


def _bounds(parameter: "Parameter") -> str:
    low, high = parameter.min, parameter.max
    return " and ".join(
        text for text in (f">= {low:g}" if low is not None else "", f"<= {high:g}" if high is not None else "") if text
    )
