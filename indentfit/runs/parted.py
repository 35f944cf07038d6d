"""The forward model of a case with measured displacements: a run brings forces and displacements in a row, which is parted."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Case
from indentfit.runs.forward import Evaluation, ForwardModel, Report
from indentfit.runs.mechanics import sizes_of_fields
from indentfit.runs.run import Point


@dataclass(frozen=True, eq=False)
class Parted:
    """A ForwardModel whose curves are those of all tests, and then those of their fields, in the order of `with_field_tests`.

    Parameters
    ----------
    model : ForwardModel
        Its curves hold the forces of a test, and behind them the displacements of its fields.
    ends : tuple of arrays
        For each test the places where its row is cut.
    """

    model: ForwardModel
    ends: tuple[Array, ...]

    @classmethod
    def of(cls, model: ForwardModel, case: Case) -> "ForwardModel":
        """The parted model of a case; the model itself where no test has a field."""
        if not any(test.field for test in case.tests):
            return model
        sizes = [[case.outputs(test).size, *sizes_of_fields(case, test)] for test in case.tests]
        return cls(model, tuple(np.cumsum(row)[:-1] for row in sizes))

    @property
    def runs(self) -> int:
        return self.model.runs

    @property
    def failures(self) -> Sequence[Evaluation]:
        return self.model.failures

    def differentiable(self) -> frozenset[str]:
        return self.model.differentiable()

    def evaluate(
        self, points: Sequence[Point], report: Report | None = None, sensitivities: Collection[str] = ()
    ) -> list[Evaluation]:
        """Evaluations of points, parted."""
        return [self._parted(known) for known in self.model.evaluate(points, report, sensitivities)]

    def _parted(self, known: Evaluation) -> Evaluation:
        if known.forces is None:
            return known
        forces = self._in_order([np.split(row, ends) for row, ends in zip(known.forces, self.ends, strict=True)])
        if known.sensitivities is None:
            return replace(known, forces=forces)
        parts: list[list[dict[str, Array]]] = []
        for given, ends in zip(known.sensitivities, self.ends, strict=True):
            cut = {name: np.split(row, ends) for name, row in given.items()}
            parts.append([{name: rows[n] for name, rows in cut.items()} for n in range(ends.size + 1)])
        return replace(known, forces=forces, sensitivities=self._in_order(parts))

    @staticmethod
    def _in_order(parts: Sequence[Sequence[Any]]) -> tuple[Any, ...]:
        """The first part of each test, and then the others."""
        return (*(part[0] for part in parts), *(other for part in parts for other in part[1:]))
