"""The result folders of a sweep, a mesh-check, a design and a simulation."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from indentfit.case import Case
from indentfit.errors import OutputError
from indentfit.report import mesh_check as mesh_check_report
from indentfit.report import sweep as sweep_report
from indentfit.report.fields import FieldChoice, write_fields
from indentfit.report.folder import copy_case, result_folder, stamped, write_curves, write_json
from indentfit.report.html import write_report
from indentfit.report.plots import designs
from indentfit.report.schema import case_json
from indentfit.report.solved import Solved
from indentfit.report.time_curves import depth_over_time, force_over_time, write_time_curves
from indentfit.runs.simulated import SimulatedCase
from indentfit.study.mesh_check import MeshCheck
from indentfit.study.sweep import Sweep

if TYPE_CHECKING:  # other studies need none of its inference, half a second of imports
    from indentfit.study.design import Design


def write_study(study: Sweep | MeshCheck, path: str | Path, overwrite: bool = False) -> None:
    """Write the result folder of a sweep or a mesh-check, whole or not at all. Raises OutputError."""
    with result_folder(path, overwrite) as folder:
        fill_study(folder, study)


def fill_study(folder: Path, study: Sweep | MeshCheck) -> dict[str, Any]:
    """Write the files of a study into a folder that exists; returns what its result.json holds."""
    case = _case_of(study, folder)
    again = copy_case(case, folder)
    written = stamped({**study.as_json(), "overrides": list(again), "case": case_json(case)})
    write_json(folder / "result.json", written)
    if isinstance(study, Sweep):
        sweep_report.write_tables(folder, study)
        sweep_report.draw(folder, study)
    else:
        mesh_check_report.write_tables(folder, study)
        mesh_check_report.draw(folder, study)
    write_report(folder)
    return written


def write_design(design: "Design", path: str | Path, overwrite: bool = False) -> None:
    """Write the result folder of a design, whole or not at all. Raises OutputError."""
    case = _case_of(design, Path(path))
    with result_folder(path, overwrite) as folder:
        again = copy_case(case, folder)
        origin = {"case_hash": case.hash, "overrides": list(again), "case": case_json(case)}
        write_json(folder / "design.json", stamped({**design.as_json(), **origin}))
        designs(design, folder / "design")
        write_report(folder)


def write_simulation(simulated: SimulatedCase, path: str | Path, choice: FieldChoice | None, overwrite: bool = False) -> None:
    """Write the result folder of a simulation, whole or not at all: simulation.json, curves.csv, the figure, the case, and the
    fields that are chosen.

    Raises
    ------
    OutputError
    """
    case = simulated.case
    with result_folder(path, overwrite) as folder:
        again = copy_case(case, folder)
        told = stamped({**simulated.as_json(), "overrides": list(again), "case": case_json(case)})
        write_json(folder / "simulation.json", told)
        write_curves(folder / "curves.csv", simulated.curves)
        simulated.plot(folder / "force_displacement")
        if over_time := simulated.in_time:
            write_time_curves(folder / "time_curves.csv", over_time)
            pressed = {name: curve for name, curve in over_time.items() if not curve.creeps}
            if pressed:
                force_over_time(pressed, folder / "force_time")
            if creep := {name: curve for name, curve in over_time.items() if curve.creeps}:
                depth_over_time(creep, folder / "displacement_time")
        if choice is not None and simulated.model is not None:
            kappa = case.material.bulk_moduli(simulated.material)
            indented = [test for test in simulated.tests if test.kind == "indentation"]
            write_fields(folder / "fields", Solved(simulated.model, simulated.material, kappa, indented), choice)
        write_report(folder)


def _case_of(result: "Sweep | MeshCheck | Design", place: Path) -> Case:
    if result.case is None:
        raise OutputError(f"{place}: this result was read from a file, without its case; copy its folder instead")
    return result.case
