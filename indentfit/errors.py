"""The errors that indentfit raises, each class with the exit code of the command line, and the suggestion that ends a message."""

import difflib
from collections.abc import Iterable
from typing import Any


class IndentfitError(Exception):
    """Root of every error that indentfit raises on purpose; its text is one line for the user.

    Attributes
    ----------
    part : object
        The part of the result that was there before the error: of a simulation its curves so far. None where there is none.
    """

    exit_code = 1
    part: Any = None


class InputError(IndentfitError):
    """The user's input is wrong; the text names file, key, value and remedy."""

    exit_code = 2


class CaseError(InputError):
    """A case that cannot be used.

    Attributes
    ----------
    faults : tuple of str
        One line for each fault.
    """

    def __init__(self, faults: str | Iterable[str]) -> None:
        self.faults = [faults] if isinstance(faults, str) else list(faults)
        super().__init__("\n".join(self.faults))


class CurveError(InputError):
    """A force-displacement curve that cannot be used."""


class RecordError(InputError):
    """A raw record, or a manifest of them, that cannot be used."""


class MaterialError(InputError):
    """A material that cannot be found, loaded, parsed or given its parameters."""


class MeshError(InputError):
    """A sample and an indenter that cannot be meshed as asked."""


class OutputError(InputError):
    """A result folder that cannot be written, or must not be overwritten."""


class LedgerError(InputError):
    """A ledger that cannot be used: damaged, in use by another run, of another case or version, or its disk is full."""


class WorkerError(InputError):
    """No process could be started, here or in the cluster, to run the forward model."""


class Stopped(IndentfitError):
    """A signal stopped a long command, as the user asked; `number` is the signal's number."""

    def __init__(self, text: str, number: int = 2) -> None:
        self.number, self.exit_code = number, 128 + number
        super().__init__(text)


class ConvergenceError(IndentfitError):
    """The mechanics did not converge.

    Attributes
    ----------
    cause : str
        The likely reason, in words.
    displacement : float, mm
        Displacement of the indenter that could not be reached.
    step, iteration : int
        Where the solver stopped.
    """

    exit_code = 3

    def __init__(self, cause: str, displacement: float = float("nan"), step: int = 0, iteration: int = 0) -> None:
        self.cause, self.displacement, self.step, self.iteration = cause, displacement, step, iteration
        super().__init__(f"no equilibrium at {displacement:.4g} mm (step {step}, iteration {iteration}): {cause}")

    def __reduce__(self) -> tuple[type, tuple[str, float, int, int]]:
        return type(self), (self.cause, self.displacement, self.step, self.iteration)


class NoStateError(ConvergenceError):
    """A law has no homogeneous state at a strain; `cause` says where and why."""

    def __init__(self, cause: str) -> None:
        super().__init__(cause)
        self.args = (cause,)

    def __reduce__(self) -> tuple[type["NoStateError"], tuple[str]]:  # type: ignore[override]
        return type(self), (self.cause,)


class OutOfTime(IndentfitError):
    """A run took longer than its limit.

    Attributes
    ----------
    limit : float, s
        Processor time that the run was given.
    cause : str
        How far the run came, or why its first try had failed; empty where nothing is known.
    """

    exit_code = 3

    def __init__(self, limit: float, cause: str = "") -> None:
        self.limit, self.cause = limit, cause
        super().__init__(f"not solved within {limit:g} s of processor time" + (f": {cause}" if cause else ""))

    def __reduce__(self) -> tuple[type["OutOfTime"], tuple[float, str]]:
        return type(self), (self.limit, self.cause)


class FitError(IndentfitError):
    """The fit stopped before it converged; its result is still written."""

    exit_code = 4


class DesignError(IndentfitError):
    """The mechanics failed at a point that the design of an experiment needs."""

    exit_code = 3


def suggestion(word: object, known: Iterable[object], quoted: bool = False) -> str:
    """The end of a message, "; did you mean X?", with the known word that is nearest to the given one; empty where none is near."""
    near = difflib.get_close_matches(str(word), [str(name) for name in known], n=1)
    return f"; did you mean {repr(near[0]) if quoted else near[0]}?" if near else ""
