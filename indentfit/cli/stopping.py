"""Ctrl-C and SIGTERM during long work: the first asks it to stop once what it is at is done, the second stops it now."""

import contextlib
import os
import signal

ASKED = b"\nstopping as soon as the runs at work are done; once more to stop now\n"


@contextlib.contextmanager
def stopping():
    """Context that gives a function stop(): the number of the signal that has asked to stop, 0 until then.

    The second signal raises KeyboardInterrupt. Outside of the main thread, signals are left alone.
    """
    asked: list[int] = []

    def ask(number, _):
        asked.append(number)
        if len(asked) > 1:
            raise KeyboardInterrupt
        with contextlib.suppress(OSError):
            os.write(2, ASKED)  # nothing that holds a lock: the signal comes between any two steps

    try:
        before = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    except ValueError:
        before = {}
    try:
        yield lambda: asked[0] if asked else 0
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)
