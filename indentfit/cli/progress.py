"""Progress on stderr: a bar with an estimate on a terminal, otherwise (or verbose, with a log) a line every four seconds.

with progress("fit", total=240) as step:
    step(12, "objective 0.91 mN")

A thread repeats what the command last said of its work, with the time that this part has taken, so that no work is silent, however
long one part of it is. On a terminal `waiting` does the same for what a command does before its bar is there and behind it.
"""

import contextlib
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from indentfit.cli.speech import Voice, voice

if TYPE_CHECKING:
    from rich.progress import Task
    from rich.text import Text

Step = Callable[..., None]  # called with (done, note)

FIRST_ESTIMATE = 0.05  # share of the work that is done before its end is estimated
INTERVAL, OFTEN = 4.0, 1.0  # seconds between two lines, usually and where the command is to be verbose
TICK = 0.5  # seconds between two looks of the thread
LONG = 5.0  # seconds from which on the time of a part is said

_waiting: list["_Lines"] = []  # of the running command, on a terminal


@contextlib.contextmanager
def progress(title: str, total: float) -> Iterator[Step]:
    """Context that gives a function step(done, note=""): how much of `total` is done, whole or not, and a remark."""
    with _nothing_else():
        if _on_terminal() and voice() == Voice():
            with _bar(title, total) as step:
                yield step
        else:
            lines = _Lines(title, total)
            with _ticking(lines.tick):
                yield lines.step


@contextlib.contextmanager
def waiting(title: str) -> Iterator[None]:
    """Context in which a terminal is told every few seconds that a command is at work, while it shows no other progress."""
    if not _on_terminal():
        yield
        return
    lines = _Lines(title, total=1)
    _waiting.append(lines)
    try:
        with _ticking(lines.tick):
            yield
    finally:
        _waiting.remove(lines)


@contextlib.contextmanager
def _nothing_else() -> Iterator[None]:
    """Context in which `waiting` is silent, because the work itself has a bar or lines."""
    for lines in _waiting:
        lines.silent = True
    try:
        yield
    finally:
        for lines in _waiting:
            lines.silent = False
            lines.begin("finishing")


@contextlib.contextmanager
def _ticking(tick: Callable[[], None]) -> Iterator[None]:
    """Context in which a thread calls a function, again and again."""
    over = threading.Event()

    def repeat() -> None:
        while not over.wait(TICK):
            tick()

    thread = threading.Thread(target=repeat, name="indentfit-progress", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def _on_terminal() -> bool:
    return sys.stderr.isatty() and os.environ.get("TERM") != "dumb"


@contextlib.contextmanager
def _bar(title: str, total: float) -> Iterator[Step]:
    from rich import progress as parts
    from rich.console import Console
    from rich.text import Text

    class Words(parts.ProgressColumn):
        """What is being done, for how long, and what is left: written anew each time that the bar is drawn."""

        def render(self, task: "Task") -> "Text":
            return Text(words.now(time.monotonic()))

    words = _Words(time.monotonic())
    columns = [
        parts.TextColumn("{task.description}", markup=False),
        parts.BarColumn(bar_width=20),
        parts.TextColumn("{task.fields[share]}", markup=False),
        parts.TimeElapsedColumn(),
        Words(),
    ]
    # stdout holds the result: rich must not write there
    with parts.Progress(*columns, console=Console(stderr=True), transient=True, redirect_stdout=False) as bar:
        task = bar.add_task(title, total=None, share="")  # the bar moves to and fro until something is done

        def step(done: float, note: str = "") -> None:
            share = _share(done, total)
            words.step(share, note, time.monotonic())
            bar.update(task, total=total if share else None, completed=done, share=f"{share:.0%}" if share else "")

        yield step


class _Words:
    """What the work is at, in words, with the time that this part has taken where it is long."""

    def __init__(self, now: float) -> None:
        self.started = self.since = now
        self.share, self.note = 0.0, ""

    def step(self, share: float, note: str, now: float) -> None:
        self.share = share
        if note != self.note:
            self.note, self.since = note, now

    def part(self, now: float) -> str:
        """The remark and its time, such as "exploring 7 of 18 for 12 s"."""
        note, past = self.note or ("" if self.share else "preparing"), now - self.since
        return f"{note} for {_duration(past)}" if note and past >= LONG else note

    def now(self, now: float) -> str:
        """The part and what is left, for a bar, which shows the time itself."""
        return ", ".join(word for word in (self.part(now), _left(self.share, now - self.started)) if word)


class _Lines:
    """Says the progress of the work in lines, at most once in INTERVAL seconds; `tick` repeats the last state."""

    def __init__(self, title: str, total: float) -> None:
        self.title, self.total = title, total
        self.voice = voice()
        self.silent = False
        self.lock = threading.Lock()
        self.spoken = time.monotonic()
        self.words = _Words(self.spoken)

    def step(self, done: float, note: str = "") -> None:
        now = time.monotonic()
        with self.lock:
            self.words.step(_share(done, self.total), note, now)
            self._speak(now)

    def begin(self, note: str) -> None:
        """Begin a part of the work, without a word about it yet."""
        with self.lock:
            self.spoken = time.monotonic()
            self.words = _Words(self.spoken)
            self.words.note = note

    def tick(self) -> None:
        now = time.monotonic()
        with self.lock:
            if not self.silent:
                self._speak(now)

    def _speak(self, now: float) -> None:
        if now - self.spoken < (min(INTERVAL, OFTEN) if self.voice.verbose else INTERVAL):
            return
        self.spoken = now
        words = self.words
        part, past = words.part(now), _duration(now - words.started)
        if not words.share:
            self.voice.say(f"{self.title}: {part or 'preparing'}{'' if ' for ' in part else f' for {past}'}")
            return
        left = _left(words.share, now - words.started)
        self.voice.say(f"{self.title}: {words.share:.0%} after {past}{left and f', {left}'}{part and f'; {part}'}")


def _share(done: float, total: float) -> float:
    return min(max(done / total, 0.0), 1.0) if total else 1.0


def _left(share: float, past: float) -> str:
    """The time that is left, in words; nothing where too little is done to tell."""
    return f"about {_duration(past * (1 - share) / share)} left" if FIRST_ESTIMATE <= share < 1 else ""


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
