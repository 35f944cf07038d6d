"""Ctrl-C and SIGTERM during long work: the first signal lets the running solves finish, the second stops at once."""

import contextlib
import os
import signal
from collections.abc import Callable, Iterator

ASKED = b"\nthe running solves finish, then the command stops; a second signal stops at once\n"


@contextlib.contextmanager
def stopping() -> Iterator[Callable[[], int]]:
    """Context that gives a function stop(): the number of the signal that has asked to stop, 0 until then.

    The second signal raises KeyboardInterrupt. Outside of the main thread, signals are left alone.
    """
    asked: list[int] = []

    def ask(number: int, _: object) -> None:
        asked.append(number)
        if len(asked) > 1:
            raise KeyboardInterrupt
        with contextlib.suppress(OSError):
            os.write(2, ASKED)  # the handler takes no lock, because a signal may come between any two steps

    try:
        before = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    except ValueError:
        before = {}
    try:
        yield lambda: asked[0] if asked else 0
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)
