"""The simulated tests of a case: curves and facts, with their case, material and model."""

import html
import importlib.metadata
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Case
from indentfit.case.in_time import motion_of
from indentfit.case.laws import isotropic_moduli
from indentfit.curve import Curve
from indentfit.fem.result import Simulation, TimeCurve
from indentfit.fem.simulate import Model
from indentfit.material import Material
from indentfit.motion import Motion
from indentfit.runs.closed_form import ClosedForm, closed_forms


@dataclass(frozen=True, eq=False, repr=False)
class SimulatedCase(Simulation):
    """A Simulation of all tests of a case.

    Parameters
    ----------
    tests, mesh, solver : as of Simulation
    case : Case
    material : Material
        The material with the parameters of the simulation.
    model : Model or None
        That of the first indentation; None where no test is one.
    """

    FORMAT: ClassVar[str] = "indentfit.simulation/2"

    case: Case
    material: Material
    model: Model | None

    @property
    def curves(self) -> dict[str, Curve]:
        """Simulated curves by the names of their tests."""
        return {test.name: test.curve for test in self.tests}

    @property
    def measured(self) -> dict[str, Curve]:
        """Measured curves by the names of their tests; tests without a measured curve are left out, and those whose rig held the
        force: they have depths over time (`in_time`)."""
        pairs = zip(self.case.tests, self.case.curves, strict=True)
        return {test.name: curve for test, curve in pairs if curve is not None and test.control != "force"}

    @property
    def misfits(self) -> dict[str, float]:
        """Root mean square of simulated minus measured forces over the largest measured force, by the names of the tests."""
        off = {name: _misfit(curve.loading, self.curves[name]) for name, curve in self.measured.items() if name in self.curves}
        return {name: share for name, share in off.items() if math.isfinite(share)}

    @property
    def creep_misfits(self) -> dict[str, float]:
        """Root mean square of simulated minus measured depths over the largest measured depth, by the names of the tests whose rig
        held the force."""
        known, triples = self.in_time, zip(self.case.tests, self.case.curves, strict=True)
        measured = {test.name: motion_of(test, curve) for test, curve in triples if curve is not None and test.control == "force"}
        return {name: _creep_misfit(*given, known[name]) for name, given in measured.items() if given is not None and name in known}

    @property
    def in_time(self) -> dict[str, TimeCurve]:
        """Forces over time by the names of their tests, where the material relaxes."""
        return {test.name: test.in_time for test in self.tests if test.in_time is not None}

    @property
    def moduli(self) -> dict[str, float]:
        """E (kPa), nu, and mu or G (kPa) where no parameter is the shear modulus, of a material without fibres."""
        return isotropic_moduli(self.case.material, self.case.law, self.material.values)

    @property
    def closed_forms(self) -> dict[str, ClosedForm]:
        """Moduli of the simulated curves by closed forms, by the names of their tests, where the indenter has one."""
        return closed_forms(self.case, self.curves, self.material.shear_modulus)

    def as_json(self) -> dict[str, Any]:
        """The stable keys of simulation.json and of `simulate --json`, under the tag `format`."""
        return {
            "format": self.FORMAT,
            "indentfit": importlib.metadata.version("indentfit"),
            "title": self.case.title,
            "case_hash": self.case.hash,
            "parameters": self.material.values,
            **super().as_json(),
            "moduli": self.moduli,
            "closed_forms": {name: form.as_json() for name, form in self.closed_forms.items()},
            **self._beside(),
        }

    def _beside(self) -> dict[str, Any]:
        """The measured curves and how far the simulation is from them, where the case names curves."""
        curves = {name: curve.loading for name, curve in self.measured.items()}
        points = {
            name: dict(zip(curve.shown.header, (curve.displacement.tolist(), curve.force.tolist()), strict=True))
            for name, curve in curves.items()
        }
        creep = {"creep_misfits": self.creep_misfits} if self.creep_misfits else {}
        return ({"measured": points, "misfits": self.misfits} if points else {}) | creep

    def summary(self) -> str:
        """The simulation in words, as the command prints it."""
        from indentfit.report.text import simulation_lines

        return "\n".join(simulation_lines(self, self.case, self.material))

    def plot(self, path: str | Path | None = None) -> Any:
        """The matplotlib Figure of simulated and measured curves; saved as SVG and PNG where a path is given."""
        from indentfit.report.plots import force_displacement

        return force_displacement(list(self.measured.items()), list(self.curves.items()), path, self.case.synthetic)

    def write(self, folder: str | Path, fields: bool = False, overwrite: bool = False) -> None:
        """Write the result folder.

        Parameters
        ----------
        folder : path
            The new folder.
        fields : bool
            Whether stresses and displacements at the last depth of each test are written, as VTU files and pictures.
        overwrite : bool
            Whether an earlier result folder is replaced.

        Raises
        ------
        OutputError
            The folder exists already, or cannot be written.
        """
        from indentfit.report.fields import FieldChoice
        from indentfit.report.study_folder import write_simulation

        write_simulation(self, folder, FieldChoice() if fields else None, overwrite)

    def __repr__(self) -> str:
        ends = ", ".join(
            f"{name} {curve.force[-1]:.4g} {curve.shown.up_unit} at {curve.shown.at(curve.displacement[-1])}"
            for name, curve in self.curves.items()
        )
        return f"SimulatedCase({self.case.title!r}: {ends})"

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(self.summary())}</pre>"


def _creep_misfit(motion: Motion, times: Array, simulated: TimeCurve) -> float:
    """The misfit of depths over time, as far as the simulation goes."""
    reached = times <= simulated.time[-1] * (1 + 1e-9)
    depth = np.interp(times[reached], np.append(0.0, simulated.time), np.append(0.0, simulated.displacement))
    off = depth - np.interp(times[reached], motion.time, motion.depth)
    return float(np.sqrt(np.mean(off**2)) / motion.deepest)


def _misfit(measured: Curve, simulated: Curve) -> float:
    """Root mean square of the difference over the largest measured force, down to where the simulation goes."""
    reached = measured.displacement <= simulated.displacement[-1] * (1 + 1e-9)
    if not reached.any():
        return math.nan
    depth = np.concatenate([[0.0], simulated.displacement])
    force = np.interp(measured.displacement[reached], depth, np.concatenate([[0.0], simulated.force]))
    off = force - measured.force[reached]
    return float(np.sqrt(np.mean(off**2)) / np.abs(measured.force).max())
