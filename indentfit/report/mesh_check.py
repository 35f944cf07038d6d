"""The tables and figures of a mesh-check's result folder."""

import numpy as np

from . import study_plots
from .sweep import table

UNITS = {"force": "Force at the last\ndisplacement (mN)", "stiffness": "Stiffness (mN/mm)"}


def write_tables(folder, result):
    """meshes.csv and changes.csv of a study.mesh_check.MeshCheck."""
    names = list(result.tests)
    header = ["asked", "elements", "dofs", "h_mm", "newton_iterations", "factorizations", "cpu_s", "setup_s", "peak_memory_MB"]
    header += [f"force_mN:{name}" for name in names] + [f"rmse_mN:{name}" for name in names] + ["objective_mN", "cause"]
    rows = []
    for (asked, one), errors, objective in zip(result.meshes, result.rmse, result.objective, strict=True):
        facts = [one.h, one.newton_iterations, one.factorizations, one.cpu_seconds, one.setup_seconds, one.memory / 1e6]
        forces = [float(force[-1]) for force in one.forces] if one.forces else [""] * len(names)
        misfits = [(errors or {}).get(name, "") for name in names]
        objective = "" if objective is None else objective
        rows.append([asked, one.elements, one.dofs, *facts, *forces, *misfits, objective, one.cause or ""])
    table(folder / "meshes.csv", header, rows)
    if result.changes:
        rows = [[c.key, c.value, *((c.changes or {}).get(name, "") for name in names), c.cause or ""] for c in result.changes]
        table(folder / "changes.csv", ["key", "value", *(f"change_of_force:{name}" for name in names), "cause"], rows)


def draw(folder, result):
    """The figures. Returns [(file name, caption)]."""
    drawn = []
    families = []
    for one in result.quantities:
        if one.h.size < 2:
            continue
        h = np.linspace(0, 1.05 * one.h.max(), 200)
        curve = one.approach and np.column_stack([h, one.approach.at(h)])
        families.append((one.test, UNITS[one.kind], one.h, one.values, curve, one.band))
    if families:
        study_plots.mesh_convergence(families, folder / "convergence")
        drawn.append(("convergence", "Force and stiffness against element size, the fitted approach to zero size, and its band."))
    computed = [(one, errors) for (_, one), errors in zip(result.meshes, result.rmse, strict=True) if one.forces is not None]
    if len(computed) > 1:
        h, seconds = np.array([one.h for one, _ in computed]), [one.cpu_seconds for one, _ in computed]
        if computed[0][1]:
            series = {name: [errors[name] for _, errors in computed] for name in computed[0][1]}
            study_plots.error_and_cost(h, ("RMSE against the measured curve (mN)", series), seconds, folder / "cost")
        else:
            series = {name: [float(one.forces[n][-1]) for one, _ in computed] for n, name in enumerate(result.tests)}
            study_plots.error_and_cost(h, ("Force at the last displacement (mN)", series), seconds, folder / "cost")
        drawn.append(("cost", "What is computed on each mesh, and the processor time that it takes."))
    return drawn
