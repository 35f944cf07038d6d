"""A function call in a copy of a command's process, so that the second core does not wait for the first.

A copy needs no imports and gets its arguments for nothing. It is safe where the process forks on Linux, has numerical libraries of
one thread, and the function neither prints nor runs the mechanics: only a command that has prepared its server (runs/start.py)
makes copies. Elsewhere the function is called when its value is asked for. A copy that nobody waits for ends with the command.
"""

import functools
import multiprocessing
import os
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from indentfit.machine import cores
from indentfit.runs.isolated import begin_as_child
from indentfit.runs.start import is_prepared

Returned = TypeVar("Returned")


def in_copy(function: Callable[..., Returned], *arguments: Any) -> Callable[[], Returned]:
    """Begin with function(*arguments) in a copy of this process.

    Parameters
    ----------
    function : function
        Its value can be pickled.
    arguments : any

    Returns
    -------
    function
        It waits for the value and gives it, or raises what the function raises. Where the copy was lost, the function is called
        once more.
    """
    if not is_prepared() or cores() < 2:
        return functools.partial(function, *arguments)
    copies = multiprocessing.get_context("fork")
    ours, theirs = copies.Pipe(duplex=False)
    copy = copies.Process(target=_answer, args=(ours, theirs, function, arguments), daemon=True)
    try:
        copy.start()
    except OSError:  # too many processes, or no memory for one more
        return functools.partial(function, *arguments)
    theirs.close()

    def value() -> Returned:
        try:
            with ours:
                returned, error = ours.recv()
        except (EOFError, OSError):
            return function(*arguments)
        finally:
            copy.join()
        if error is not None:
            raise error
        return returned

    return value


def _answer(parents: Connection, pipe: Connection, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    """In the copy: send the value, or the error, and end without the endings that the parent's libraries have registered."""
    parents.close()  # a copy that reads its own pipe would wait for ever where nobody else does
    begin_as_child()
    try:
        try:
            pipe.send((function(*arguments), None))
        except Exception as error:
            pipe.send((None, error))
    finally:
        os._exit(0)
