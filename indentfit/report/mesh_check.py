"""The tables and figures of a mesh-check's result folder, from what its result.json holds."""

import numpy as np

from . import study_plots
from .sweep import table

UNITS = {"force": "Force at the last\ndisplacement (mN)", "stiffness": "Stiffness (mN/mm)"}
FACTS = (
    "asked",
    "elements",
    "dofs",
    "h",
    "newton_iterations",
    "factorizations",
    "loose_steps",
    "tries",
    "cpu_seconds",
    "setup_seconds",
    "memory",
)


def write_tables(folder, result):
    """meshes.csv and changes.csv of a mesh-check."""
    names = list(result["tests"])
    header = [*(name.replace("memory", "peak_memory_bytes") for name in FACTS), *(f"force_mN:{name}" for name in names)]
    header += [*(f"rmse_mN:{name}" for name in names), "objective_mN", "cause"]
    rows = []
    for one in result["meshes"]:
        forces = [force[-1] for force in one["forces"]] if one["forces"] else [""] * len(names)
        misfits = [(one["rmse_mN"] or {}).get(name, "") for name in names]
        objective = "" if one["objective_mN"] is None else one["objective_mN"]
        rows.append([*(one[name] for name in FACTS), *forces, *misfits, objective, one["cause"] or ""])
    table(folder / "meshes.csv", header, rows)
    if result["changes"]:
        rows = [
            [c["key"], c["value"], *((c["changes"] or {}).get(name, "") for name in names), c["cause"] or ""]
            for c in result["changes"]
        ]
        table(folder / "changes.csv", ["key", "value", *(f"change_of_force:{name}" for name in names), "cause"], rows)


def draw(folder, result):
    """Save the figures."""
    convergence_figure(result["quantities"], folder / "convergence")
    cost_figure(result, folder / "cost")


def convergence_figure(quantities, path=None):
    """Values on the meshes with the fitted approach to zero size; None where fewer than two meshes were computed."""
    families = []
    for one in quantities:
        if len(one["h"]) < 2:
            continue
        h, approach = np.linspace(0, 1.05 * max(one["h"]), 200), one["approach"]
        curve = None
        if approach:
            terms = zip(approach["coefficients"], approach["exponents"], strict=True)
            curve = np.column_stack([h, approach["value"] + sum(c * h**p for c, p in terms)])
        families.append((one["test"], UNITS[one["kind"]], one["h"], one["values"], curve, one["band"]))
    return study_plots.mesh_convergence(families, path) if families else None


def cost_figure(result, path=None):
    """Misfit, or force where nothing was measured, and processor time on each mesh; None for fewer than two meshes."""
    computed = [one for one in result["meshes"] if one["forces"]]
    if len(computed) < 2:
        return None
    h, seconds = np.array([one["h"] for one in computed]), [one["cpu_seconds"] for one in computed]
    if misfits := computed[0]["rmse_mN"]:
        series = {name: [one["rmse_mN"][name] for one in computed] for name in misfits}
        return study_plots.error_and_cost(h, ("RMSE against the\nmeasured curve (mN)", series), seconds, path)
    series = {name: [one["forces"][n][-1] for one in computed] for n, name in enumerate(result["tests"])}
    return study_plots.error_and_cost(h, (UNITS["force"], series), seconds, path)
