"""The tables and figures of a MeshCheck."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from indentfit.arrays import Array
from indentfit.digits import Scale
from indentfit.report import study_plots
from indentfit.report.sweep import table
from indentfit.study.mesh_check import MeshCheck, MeshResult, Quantity

AXES = {"force": "Force at the last\ndisplacement ({unit})", "stiffness": "Stiffness ({unit})"}
UNITS = {"force": "mN", "stiffness": "mN/mm"}
FACTS = (
    "elements", "dofs", "h", "newton_iterations", "factorizations", "loose_steps", "tries", "cpu_seconds", "setup_seconds",
    "memory",
)  # fmt: skip


def write_tables(folder: Path, check: MeshCheck) -> None:
    """meshes.csv and changes.csv of a mesh-check."""
    names = list(check.tests)
    header = ["asked", *(name.replace("memory", "peak_memory_bytes") for name in FACTS), *(f"force_mN:{name}" for name in names)]
    header += [*(f"rmse_mN:{name}" for name in names), "objective_mN", "cause"]
    table(folder / "meshes.csv", header, [_mesh_row(mesh, names) for mesh in check.meshes])
    if check.changes:
        rows = [
            [change.key, change.value, *((change.changes or {}).get(name, "") for name in names), change.cause or ""]
            for change in check.changes
        ]
        table(folder / "changes.csv", ["key", "value", *(f"change_of_force:{name}" for name in names), "cause"], rows)


def draw(folder: Path, check: MeshCheck) -> None:
    """Save the figures."""
    convergence_figure(check.quantities, folder / "convergence")
    cost_figure(check, folder / "cost")


def convergence_figure(quantities: Sequence[Quantity], path: str | Path | None = None) -> Figure | None:
    """Values on the meshes with the fitted approach to zero size; None where fewer than two meshes were computed."""
    families = []
    for quantity in quantities:
        if quantity.h.size < 2:
            continue
        h = np.linspace(0, 1.05 * quantity.h.max(), 200)
        curve = None if quantity.approach is None else np.column_stack([h, quantity.approach.at(h)])
        families.append(_family(quantity, curve))
    return study_plots.mesh_convergence(families, path) if families else None


def _family(quantity: Quantity, curve: Array | None) -> study_plots.Family:
    """A quantity for its panel, in the unit that suits its size."""
    scale = Scale.of([float(value) for value in quantity.values], UNITS[quantity.kind])
    band = quantity.band and (scale.factor * quantity.band[0], scale.factor * quantity.band[1])
    scaled = None if curve is None else np.column_stack([curve[:, 0], scale.factor * curve[:, 1]])
    label = AXES[quantity.kind].format(unit=scale.symbol)
    return quantity.test, label, quantity.h, scale.factor * quantity.values, scaled, band


def cost_figure(check: MeshCheck, path: str | Path | None = None) -> Figure | None:
    """Misfit, or force where nothing was measured, and processor time on each mesh; None for fewer than two meshes."""
    computed = [(mesh, mesh.measured.forces) for mesh in check.meshes if mesh.measured.forces is not None]
    if len(computed) < 2:
        return None
    h, seconds = np.array([mesh.measured.h for mesh, _ in computed]), [mesh.measured.cpu_seconds for mesh, _ in computed]
    if misfits := computed[0][0].rmse:
        series = {name: [(mesh.rmse or {})[name] for mesh, _ in computed] for name in misfits}
        return study_plots.error_and_cost(h, _scaled("RMSE against the\nmeasured curve ({unit})", series), seconds, path)
    series = {name: [float(forces[n][-1]) for _, forces in computed] for n, name in enumerate(check.tests)}
    return study_plots.error_and_cost(h, _scaled(AXES["force"], series), seconds, path)


def _scaled(label: str, series: dict[str, list[float]]) -> tuple[str, dict[str, list[float]]]:
    """Forces by name in the unit that suits their size, with the axis's label in that unit."""
    scale = Scale.of((value for values in series.values() for value in values), "mN")
    return label.format(unit=scale.symbol), {name: [scale.factor * value for value in values] for name, values in series.items()}


def _mesh_row(mesh: MeshResult, names: Sequence[str]) -> list[Any]:
    facts = mesh.measured.as_json()
    forces = [""] * len(names) if mesh.measured.forces is None else [float(force[-1]) for force in mesh.measured.forces]
    misfits = [(mesh.rmse or {}).get(name, "") for name in names]
    objective = "" if mesh.objective is None else mesh.objective
    return [mesh.asked, *(facts[name] for name in FACTS), *forces, *misfits, objective, mesh.measured.cause or ""]
