"""Solved tests: VTU files of their fields, and what pictures show of them. Nothing is drawn here: matplotlib is not loaded."""

import importlib.metadata
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from indentfit.case import Case
from indentfit.case.laws import has_fibres
from indentfit.errors import ConvergenceError
from indentfit.fem.equilibrium import Equilibrium
from indentfit.fem.fields import Fields, recover
from indentfit.fem.result import TestResult
from indentfit.fem.simulate import Model
from indentfit.fibre_map import FibreMap
from indentfit.fibres import fibre_of
from indentfit.material import Material, laws_of
from indentfit.report.mirror import whole
from indentfit.report.shown import Shown
from indentfit.report.vtu import Origin, file_names, write_vtu
from indentfit.runs.pieces import pieces_of, together
from indentfit.runs.points import case_at


@dataclass(frozen=True)
class Solved:
    """Simulated tests with their model, their material and its bulk modulus, kPa, or that of each layer."""

    model: Model
    material: Material
    kappa: float | tuple[float, ...]
    tests: Sequence[TestResult]

    def fields(self, test: TestResult, mirror: bool, equilibrium: Equilibrium | None = None) -> Fields:
        """Fields of a test at one of its equilibria, by default the last; mirror: of the whole sample."""
        fields = recover(self.model, test, self.material, self.kappa, equilibrium)
        return whole(fields) if mirror else fields

    def origin(self, test: TestResult, equilibrium: Equilibrium | None = None) -> Origin:
        """What the fields of a test were computed from, for their file."""
        law, values = type(self.material), self.material.values
        numbers = {
            name + ("" if known.unit in ("", "1") else f"_{known.unit}"): float(values[name])
            for name, known in law.parameters.items()
        }
        kappas = (
            {"kappa_kPa": self.kappa}
            if not isinstance(self.kappa, tuple)
            else {f"{name}.kappa_kPa": kappa for name, kappa in zip(laws_of(law), self.kappa, strict=True)}
        )
        numbers |= {**kappas, "depth_mm": (equilibrium or test.last).depth}
        texts = {"test": test.name, "material": law.__name__, "indentfit": importlib.metadata.version("indentfit")}
        if not has_fibres(law):
            return Origin(numbers, texts)
        numbers |= {"angle_deg": float(test.angle), "dip_deg": float(test.dip)}
        families = () if isinstance(test.families, FibreMap) else test.families or ()
        for name, (angle, dip) in zip(("first", "second"), families, strict=False):
            numbers |= {f"{name}_family_angle_deg": float(angle), f"{name}_family_dip_deg": float(dip)}
        return Origin(numbers, texts, fibre_of(test.angle, test.dip, test.families))

    def shown(self, test: TestResult, fields: Fields, mirror: bool) -> Shown:
        """A test as pictures show it; a whole sample would be hidden by the indenter, which is left out there."""
        model = test.model or self.model
        indenter = None if mirror else model.setup.indenter.geometry
        fibre = fibre_of(test.angle, test.dip, test.families) if has_fibres(type(self.material)) else None
        return Shown(
            test.name, test.angle, fields, indenter, float(test.displacement[-1]), fibre, test.dip, not mirror, test.families
        )

    def written(self, folder: Path, vtu: bool = True, mirror: bool = False) -> list[Shown]:
        """What pictures show of each test; writes the fields into the folder as VTU files."""
        shown = []
        for test, name in zip(self.tests, self.names, strict=True):
            fields = self.fields(test, mirror)
            shown.append(self.shown(test, fields, mirror))
            if vtu:
                write_vtu(folder / f"{name}.vtu", fields, self.origin(test))
        return shown

    @property
    def names(self) -> list[str]:
        """The tests' names as those of files."""
        return file_names([test.name for test in self.tests])


def stresses_at(folder: Path, case: Case, point: dict[str, Any], refined: float | None) -> list[Shown] | str:
    """Run a case at a point, and write the stresses there into a new folder, as VTU files.

    Parameters
    ----------
    folder : Path
    case : Case
    point : dict of name -> value
        Parameters and changed inputs.
    refined : float or None
        Factor on the fineness of the case's mesh, that of the finest mesh of the fit.

    Returns
    -------
    list of Shown, or str
        What pictures show of each test, or why there are no stresses, in words.
    """
    there, material = case_at(case, point), case.law(**{name: point[name] for name in case.law.parameters})
    pieces = [piece.refined(refined) if refined else piece for piece in pieces_of(there)]
    try:
        for piece in pieces:
            piece.solve(material)
    except ConvergenceError as error:
        return f"no stress pictures: {error}"
    kappa = there.material.bulk_moduli(material)
    simulation = together(there, pieces)
    assert simulation is not None  # every piece is solved
    folder.mkdir()
    return Solved(pieces[0].model, material, kappa, simulation.tests).written(folder)
