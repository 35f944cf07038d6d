"""The stresses at the optimum of a fit: VTU files and pictures, made by a process of their own while the fit goes on."""

import contextlib
import math
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from indentfit.case import Case
from indentfit.inference.result import FitResult
from indentfit.runs.isolated import Died, beside

_Work = tuple[Case, dict[str, Any], float | None]  # a case, the point at which it is run, and the factor on its mesh
DIGITS = 1e-9  # relative difference of parameters that their writing makes


class FitFields:
    """The stresses at the optimum, in a folder; a context that ends with its process.

    Parameters
    ----------
    folder : Path
        The new folder of the fields.
    apart : bool
        Whether a second process makes them.
    """

    def __init__(self, folder: Path, apart: bool = False) -> None:
        self.folder, self._apart = folder, apart
        self._begun: _Work | None = None
        self._value: Callable[[], str | None] = lambda: None
        self._process = contextlib.ExitStack()

    def __enter__(self) -> "FitFields":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._process.__exit__(kind or _Discarded, error or _Discarded(), trace)  # a process that nobody waits for is ended

    def begin(self, case: Case, point: Mapping[str, Any], refined: float | None = None) -> None:
        """Begin with the stresses of a case at its optimum; those at an earlier optimum are given up where this is another one.

        Parameters
        ----------
        case : Case
        point : mapping of name -> value
            Parameters and changed inputs.
        refined : float or None
            Factor on the fineness of the case's mesh.
        """
        work = case, dict(point), refined
        if not case.indentations or (self._begun is not None and _same(work, self._begun)):
            return
        self.__exit__(None, None, None)
        self._begun, self._process = work, contextlib.ExitStack()
        if self._apart:
            self._value = self._process.enter_context(beside(draw_stresses, self.folder, *work))
        else:
            self._value = lambda: draw_stresses(self.folder, *work)

    def of(self, result: FitResult) -> None:
        """Begin with the stresses at the optimum of a result, if they are not begun; none where it has no optimum."""
        if result.objective is not None and result.case is not None:
            point = {name: parameter.value for name, parameter in result.parameters.items()} | result.uncertain.at
            self.begin(result.case, point, result.refined)

    def ended(self) -> str | None:
        """Wait for the stresses; returns why there are none, in words, since a fit does not fail for want of them."""
        try:
            return self._value()
        except Died as error:
            return f"no stress pictures: {error}"


def _same(work: _Work, begun: _Work) -> bool:
    """Whether two pieces of work have the same result."""
    (case, point, refined), (other, there, other_refined) = work, begun
    if case is not other or refined != other_refined or point.keys() != there.keys():
        return False
    return all(
        value == there[name] if isinstance(value, str) else math.isclose(value, there[name], rel_tol=DIGITS)
        for name, value in point.items()
    )


class _Discarded(Exception):
    """The optimum has moved, or the fit has failed."""


def draw_stresses(folder: Path, case: Case, point: dict[str, Any], refined: float | None) -> str | None:
    """Run a case at a point, and fill a new folder with its stresses, in place of an earlier one.

    Parameters
    ----------
    folder, case, point, refined
        As of `stresses_at`.

    Returns
    -------
    str or None
        Why there are no stresses, in words.
    """
    from indentfit.report.fields import write_pictures  # mostly in a process of its own: that of the fit needs none of it
    from indentfit.report.solved import stresses_at

    shutil.rmtree(folder, ignore_errors=True)
    shown = stresses_at(folder, case, point, refined)
    if isinstance(shown, str):
        return shown
    write_pictures(folder, shown)
    return None
