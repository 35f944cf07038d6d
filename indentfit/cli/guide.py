"""`indentfit guide`: the documentation, offline: opened in a browser, written as a site, or one page printed."""

import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import click

from indentfit.cli.command import Command
from indentfit.cli.speech import say


@click.command(cls=Command, short_help="Open the guide, or print a page of it.")
@click.argument("page", required=False, metavar="[PAGE]")
@click.option("-o", "--output", type=click.Path(), metavar="DIR", help="Write the guide as a site into DIR, and open nothing.")
@click.option(
    "--cases", type=click.Path(exists=True, file_okay=False), metavar="DIR",
    help="With -o: run the examples of the tutorials first, on the folder `cases` of the source, for the pictures (5 CPU minutes).",
)  # fmt: skip
@click.option("--list", "listed", is_flag=True, help="Print the names of all pages.")
def command(page: str | None, output: str | None, cases: str | None, listed: bool) -> None:
    """Open the guide to indentfit in a browser. It is part of the installation and needs no network.

    With PAGE, the page is printed as Markdown text. Where no browser can be opened, the command prints where the site lies.
    """
    # imported when the command runs: --help and completion are quick without
    from indentfit.cli.reference import commands_page
    from indentfit.report.guide import chapters, page_text, write_site
    from indentfit.report.guide_parts import generated_parts

    if listed:
        for entry in (entry for chapter in chapters() for entry in chapter.entries):
            click.echo(f"{entry.name:<20} {entry.title}")
        return
    generated = {**generated_parts(), "commands": commands_page()}
    if page is not None:
        click.echo(page_text(page.removesuffix(".md"), generated))
        return
    if cases and not output:
        raise click.UsageError("--cases needs -o DIR, the folder of the site")
    first = write_site(output or _own_place(), generated, _pictures(cases) if cases else {}).resolve()
    click.echo(first)
    if output is None and not _opened(first):
        say("no browser could be opened: open this file, or print a page with `indentfit guide PAGE` (--list names them)")


def _pictures(cases: str) -> dict[str, Any]:
    """Run the examples of the tutorials; returns the pictures that their pages show."""
    from indentfit.report.guide_examples import TUTORIALS, pictures_of, run_page

    pictures: dict[str, Any] = {}
    for page in TUTORIALS:
        with tempfile.TemporaryDirectory() as folder:
            seconds = sum(ran.seconds for ran in run_page(page, Path(cases), Path(folder)))
            say(f"{page}: its examples ran in {seconds:.0f} CPU seconds")
            pictures |= pictures_of(page, Path(folder))
    return pictures


def _own_place() -> Path:
    """The folder of the user's cache where the site is written before it is opened."""
    cache = os.environ.get("INDENTFIT_CACHE") or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(cache) / "indentfit-guide"


def _opened(page: Path) -> bool:
    """Whether a browser shows the page; none is asked for where nobody sits at a terminal."""
    import webbrowser

    return sys.stdout.isatty() and webbrowser.open(page.as_uri())
