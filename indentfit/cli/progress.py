"""Progress on stderr: a bar with an estimate on a terminal, otherwise (or quiet, verbose, with a log) a line every ten seconds.

with progress("fit", total=240) as step:
    step(12, "objective 0.91 mN")
"""

import contextlib
import os
import sys
import time
from collections.abc import Callable, Iterator

from indentfit.cli.speech import Voice, voice

Step = Callable[..., None]  # called with (done, note)

FIRST_ESTIMATE = 0.05  # share of the work that is done before its end is estimated
INTERVAL, OFTEN = 10.0, 1.0  # seconds between two lines, usually and where the command is to be verbose


@contextlib.contextmanager
def progress(title: str, total: float) -> Iterator[Step]:
    """Context that gives a function step(done, note=""): how much of `total` is done, whole or not, and a remark."""
    if sys.stderr.isatty() and os.environ.get("TERM") != "dumb" and voice() == Voice():
        with _bar(title, total) as step:
            yield step
    else:
        yield _Lines(title, total).step


@contextlib.contextmanager
def _bar(title: str, total: float) -> Iterator[Step]:
    from rich import progress as parts
    from rich.console import Console

    columns = [
        parts.TextColumn("{task.description}", markup=False),
        parts.BarColumn(bar_width=20),
        parts.TextColumn("{task.fields[share]}", markup=False),
        parts.TimeElapsedColumn(),
        parts.TextColumn("{task.fields[note]}", markup=False),
    ]
    started = time.monotonic()
    # stdout holds the result: rich must not write there
    with parts.Progress(*columns, console=Console(stderr=True), transient=True, redirect_stdout=False) as bar:
        task = bar.add_task(title, total=None, share="", note="preparing")  # the bar moves to and fro until something is done

        def step(done: float, note: str = "") -> None:
            share = _share(done, total)
            left = _left(share, time.monotonic() - started)
            words = ", ".join(word for word in (note or "preparing" if not share else note, left) if word)
            bar.update(task, total=total if share else None, completed=done, share=f"{share:.0%}" if share else "", note=words)

        yield step


class _Lines:
    """A function that prints the progress of the work, at most once in INTERVAL seconds."""

    def __init__(self, title: str, total: float) -> None:
        self.title, self.total = title, total
        self.voice = voice()
        self.started = self.spoken = time.monotonic()

    def step(self, done: float, note: str = "") -> None:
        now = time.monotonic()
        if now - self.spoken < (min(INTERVAL, OFTEN) if self.voice.verbose else INTERVAL):
            return
        self.spoken = now
        share = _share(done, self.total)
        past = now - self.started
        left = _left(share, past)
        words = f"{share:.0%} after {_duration(past)}" if share else f"{note or 'preparing'} for {_duration(past)}"
        self.voice.say(f"{self.title}: {words}{left and f', {left}'}{f'; {note}' if note and share else ''}")


def _share(done: float, total: float) -> float:
    return min(max(done / total, 0.0), 1.0) if total else 1.0


def _left(share: float, past: float) -> str:
    """The time that is left, in words; nothing where too little is done to tell."""
    return f"about {_duration(past * (1 - share) / share)} left" if FIRST_ESTIMATE <= share < 1 else ""


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
