"""`indentfit init`: a commented case, with every key or for one indenter and the user's own files, to be changed into one's own."""

from pathlib import Path
from typing import Any

import click

from indentfit.cli.command import Command
from indentfit.cli.completion import keys, laws
from indentfit.cli.speech import say

SHAPES = {
    "sphere": "a sphere",
    "cylinder": "a flat round punch",
    "cone": "a cone, sharp or blunt",
    "strip": "a flat bar, for tissue with fibres",
    "wedge": "a bar with a wedge",
}


def _options_of_shapes(command: Any) -> Any:
    """One option for each shape of an indenter: --sphere, --cylinder, ..."""
    for shape, words in reversed(SHAPES.items()):
        command = click.option(f"--{shape}", "indenter", flag_value=shape, help=f"The indenter is {words}.")(command)
    return command


@click.command(cls=Command, short_help="Write a commented case to start from.")
@click.argument("folder", metavar="DIR", type=click.Path())
@_options_of_shapes
@click.option(
    "--curve",
    "curves",
    multiple=True,
    metavar="FILE",
    type=click.Path(),
    help="CSV file of displacement and force; may be repeated.",
)
@click.option(
    "--record", "records", multiple=True, metavar="FILE", type=click.Path(), help="The instrument's own file; may be repeated."
)
@click.option("--material", metavar="NAME", shell_complete=laws, help="A law, as `indentfit materials` lists them.")
@click.option(
    "--layer",
    "layers",
    multiple=True,
    metavar="NAME[=LAW]",
    help="A layer of the sample, with a law of its own; from the top one, twice or more.",
)
@click.option(
    "--set",
    "told",
    multiple=True,
    metavar="KEY=VALUE",
    shell_complete=keys,
    help="A value that you know, such as sample.thickness=5",
)
def command(
    folder: str,
    indenter: str | None,
    curves: tuple[str, ...],
    records: tuple[str, ...],
    material: str | None,
    layers: tuple[str, ...],
    told: tuple[str, ...],
) -> None:
    """Write case.toml into DIR, which must be new or empty.

    With an indenter (--sphere, ...) the case has the keys that this test needs, and "?" where only you know the value. Your files
    are copied into DIR. Without an indenter the case has every key, and example curves.

    Examples: indentfit init gel --sphere --curve my.csv --set indenter.radius=2;
    indentfit init arm --sphere --layer skin --layer fat --set skin.thickness=1.5
    """
    if indenter is None and (curves or records or material or layers or told):
        raise click.UsageError(f"name the indenter too: {', '.join(f'--{shape}' for shape in SHAPES)}")
    # imported when the command runs: --help and completion are quick without
    from indentfit.report.template_folder import Asked, write_own_case, write_template

    if indenter is None:
        click.echo(write_template(folder))
        say("the curves are straight lines, an example only: put yours in their place")
        return
    laws_of_layers = [(name.strip(), law.strip() or None) for name, _, law in (text.partition("=") for text in layers)]
    asked = Asked(indenter, tuple(map(Path, curves)), tuple(map(Path, records)), material, _told(told), laws_of_layers)
    path, unanswered = write_own_case(folder, asked)
    click.echo(path)
    if unanswered:
        say(f'put your values in place of "?" in {path}: {", ".join(unanswered)}')
    say(f"then: indentfit validate {path}")


def _told(texts: tuple[str, ...]) -> dict[str, Any]:
    """Keys and values of KEY=VALUE, each value as TOML writes it, or text."""
    import tomllib

    told: dict[str, Any] = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not equals or not key.strip():
            raise click.UsageError(f"--set {text}: write KEY=VALUE, such as sample.thickness=5")
        try:
            told[key.strip()] = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            told[key.strip()] = value.strip()
    return told
