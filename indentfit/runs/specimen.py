"""Tests without an indenter, in the place of a model of finite elements: homogeneous states give curves and sensitivities."""

import functools
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from indentfit.case.specimen import BondedDisc, Specimen, axes_of
from indentfit.fem.controls import Report
from indentfit.fem.deadline import NEVER, Deadline
from indentfit.fem.facts import SolveFacts
from indentfit.fem.result import TestResult
from indentfit.fem.setup import Press
from indentfit.material import Material, Stresses, blamed

if TYPE_CHECKING:
    from indentfit.case import Case, Test


@dataclass(frozen=True)
class SpecimenModel:
    """A specimen, ready to be run with many materials."""

    specimen: Specimen

    def run(self, press: Press, progress: Report | None = None, deadline: Deadline | None = None) -> TestResult:
        """The TestResult of one test: forces with exact sensitivities; friction and offset do nothing.

        Parameters
        ----------
        press : Press
            Its depths are displacements of the specimen; its angle has no meaning.
        progress : Report
        deadline : Deadline

        Returns
        -------
        TestResult

        Raises
        ------
        NoStateError
            There is no state at one of the displacements.
        MaterialError
            The code of a plugin's material fails.
        InputError
            A name among the sensitivities is unknown.
        """
        (deadline or NEVER).check()
        started, specimen = time.perf_counter(), self.specimen
        with blamed(type(press.material)):
            solved = _solved(specimen, press)
        if progress is not None:
            progress(1.0)
        slopes = {name: specimen.area * row for name, row in solved.sensitivities.items()}
        facts = SolveFacts(steps=len(press.depths), wall_seconds=time.perf_counter() - started)
        return TestResult(press.name, press.angle, press.depths, specimen.area * solved.stress, facts, slopes)


def _solved(specimen: Specimen, press: Press) -> Stresses:
    """Stresses, kPa, with their sensitivities, at the displacements of a press."""
    state, strains = specimen.state, specimen.strains(press.depths)
    if isinstance(state, BondedDisc):
        from indentfit.fem.compression import pressed_disc  # finite elements, which other states need none of

        return pressed_disc(press.material, press.kappas[0], state.diameter, state.height, strains, press.sensitivities)
    return state.solve(press.material, press.kappas[0], strains, press.sensitivities)


def simulated_specimens(case: "Case", material: Material, progress: Callable[..., None] | None = None) -> Iterator[TestResult]:
    """The TestResult of each test of a case that needs no indenter, on a material."""
    kappa = case.material.bulk_moduli(material)
    for test in case.tests:
        specimen = case.specimen_of(test)
        if specimen is not None:
            press = Press(material, kappa, 0, case.outputs(test), test.name)
            report = functools.partial(progress, test.name) if progress else None
            yield _named(SpecimenModel(specimen).run(press, report), test)


def _named(result: TestResult, test: "Test") -> TestResult:
    """A result that knows what its curve shows."""
    return replace(result, axes=axes_of(test), kind=test.kind, fibres=test.fibres)
