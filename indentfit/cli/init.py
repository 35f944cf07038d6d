"""`indentfit init`: a commented case with curves, to be changed into one's own."""

from pathlib import Path

import click
import numpy as np

from indentfit.case.template import template
from indentfit.curve import Curve, write_curve
from indentfit.errors import OutputError

STIFFNESS = {"parallel": 72.9, "perpendicular": 170.5}  # mN/mm, means of Feng et al. 2017


@click.command(short_help="Write a commented case to start from.")
@click.argument("folder", metavar="DIR", type=click.Path())
def command(folder: str) -> None:
    """Write case.toml and example curves into DIR, which must be new or empty."""
    place = Path(folder)
    _require_free(place)
    try:
        (place / "curves").mkdir(parents=True, exist_ok=True)
        (place / "case.toml").write_text(template(), encoding="utf-8", newline="\n")
    except OSError as error:
        raise OutputError(f"{place}: cannot be written ({error.strerror}); choose another folder") from error
    displacement = np.round(0.33 * np.arange(1, 26) / 25, 6)
    for name, stiffness in STIFFNESS.items():
        write_curve(place / "curves" / f"{name}.csv", Curve(displacement, np.round(stiffness * displacement, 6)))
    click.echo(place / "case.toml")
    click.echo("the curves are straight lines, an example only: put yours in their place", err=True)


def _require_free(folder: Path) -> None:
    """Refuse a folder with something in it: nothing is ever overwritten."""
    try:
        if folder.exists() and not folder.is_dir():
            raise OutputError(f"{folder}: a file has that name; choose another folder")
        if folder.is_dir() and any(folder.iterdir()):
            raise OutputError(f"{folder}: the folder exists and is not empty; choose another one")
    except (OSError, ValueError) as error:
        raise OutputError(f"{folder}: cannot be used ({error}); choose another folder") from error
