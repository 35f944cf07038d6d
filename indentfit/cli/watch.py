"""`indentfit watch`: a local page of a fit that runs in another terminal."""

import contextlib
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from indentfit.cli.command import Command
from indentfit.cli.completion import keys
from indentfit.cli.speech import say

LOOKS = 0.5  # seconds between two looks at the folder
FAREWELL = 5.0  # seconds for which the page tells that the fit has ended


@click.command(cls=Command, short_help="Show a running fit as a page on this machine.")
@click.argument("case", type=click.Path(), default="case.toml")
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", shell_complete=keys, help="Replace a key, as the fit does.")
@click.option("-o", "--output", type=click.Path(), metavar="DIR", help="Result folder of the fit; by default CASEFOLDER-result.")
@click.option("--port", type=click.IntRange(0, 65535), default=0, metavar="N", help="Port of the page; by default any free one.")
@click.option("--child", is_flag=True, hidden=True, help="End with the standard input: for fit --live.")
def command(case: str, overrides: tuple[str, ...], output: str | None, port: int, child: bool) -> None:
    """Show the fit of the case file CASE, which runs in another terminal, as a page on this machine.

    The page shows the measured curves with the best set of parameters so far, the residuals, the runs, and profiles as they come.
    It is served on 127.0.0.1 alone, from the ledger of the fit, which it only reads. It ends with the fit. `fit --live` starts it
    beside the fit.
    """
    from indentfit.experiment.measured import read_case
    from indentfit.report.folder import LEDGER, unfinished
    from indentfit.report.live import LiveFit, fragment
    from indentfit.report.live_server import served

    known = read_case(case, overrides)
    place = output or f"{Path(case).resolve().parent.name or 'case'}-result"
    fit = LiveFit(known, unfinished(place) / LEDGER)
    ended: list[str] = []

    def now() -> str:
        fit.look()
        return fragment(fit, ended[0] if ended else "")

    with served(known.title or Path(case).name, now, port) as address:
        click.echo(address) if child else say(f"watching  {address}  (Ctrl-C ends the page, not the fit)", always=True)
        sys.stdout.flush()
        over = threading.Event()
        if child:
            threading.Thread(target=_read_out, args=(over,), daemon=True).start()
        _wait(fit.ledger, over)
        ended.append(f"The fit has ended after {fit.runs} runs. Its report: {place}/report.html")
        if not child:
            time.sleep(FAREWELL)


@contextlib.contextmanager
def beside(case: str, overrides: tuple[str, ...], output: str) -> Iterator[None]:
    """Context in which a process of its own shows the page of a fit; what goes wrong with the page never stops the fit."""
    changes = [part for change in overrides for part in ("--set", change)]
    refuses = ["--no-plugins"] if click.get_current_context().find_root().params.get("no_plugins") else []
    words = [sys.executable, "-P", "-m", "indentfit", *refuses, "watch", case, "-o", output, "--child", *changes]
    pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    try:
        page = subprocess.Popen(words, text=True, start_new_session=True, **pipes)  # Ctrl-C is the fit's
    except OSError as error:
        say(f"warning: no page: {error}", always=True)
        yield
        return
    threading.Thread(target=_tell, args=(page,), daemon=True).start()
    try:
        yield
    finally:
        assert page.stdin is not None and page.stdout is not None
        page.stdin.close()
        try:
            page.wait(FAREWELL)
        except subprocess.TimeoutExpired:
            page.kill()
            page.wait()


def _tell(page: "subprocess.Popen[str]") -> None:
    """Say the address of the page once it is known."""
    with contextlib.suppress(ValueError, OSError):
        address = page.stdout.readline().strip() if page.stdout else ""
        click.echo(
            f"live      {address}" if address else "warning: the page of --live could not be shown; the fit goes on", err=True
        )


def _read_out(over: threading.Event) -> None:
    """Set the event when the standard input ends, with the process that has started this one."""
    sys.stdin.read()
    over.set()


def _wait(ledger: Path, over: threading.Event) -> None:
    """Wait until the fit, once begun, has moved its ledger, or the command that started this one has ended."""
    seen = False
    while not over.wait(LOOKS):
        there = ledger.exists()
        if seen and not there:
            return
        seen = seen or there
