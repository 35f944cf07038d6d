"""Where a long command writes, and how it talks: what a command knows before it imports anything that solves."""

from collections.abc import Callable
from dataclasses import dataclass

Say = Callable[[str], object]
"""Called with a line for the user, such as "warning: ..."."""


@dataclass(frozen=True)
class Place:
    """The place to which a long command writes.

    Parameters
    ----------
    output : str
        The result folder.
    overwrite : bool
        Whether an earlier result is replaced; its runs are used again.
    resume : bool
        Whether a command that was stopped or killed is continued.
    reuse : str or None
        Another result folder whose runs are used too.
    """

    output: str
    overwrite: bool = False
    resume: bool = False
    reuse: str | None = None


@dataclass(frozen=True)
class Conduct:
    """The surroundings of a long command: functions that receive its progress (share done, note), stop it and print its lines, and
    the cluster of its runs ("local", the address of a Dask scheduler, or None for this machine)."""

    progress: Callable[..., object]
    stop: Callable[[], int]
    say: Say
    cluster: str | None = None
