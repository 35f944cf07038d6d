"""The result folder of a fit."""

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from indentfit.errors import ConvergenceError, OutputError
from indentfit.fem.simulate import Model
from indentfit.inference.result import FitResult
from indentfit.report.fields import write_fields
from indentfit.report.folder import case_facts, copy_case, result_folder, write_curves, write_json
from indentfit.report.html import write_report
from indentfit.report.plots import correlations, force_displacement, profiles
from indentfit.runs.forward import presses_of
from indentfit.runs.points import case_at, setup_of, split_point


def write_fit(result: FitResult, path: str | Path, fields: bool = True, overwrite: bool = False) -> None:
    """Write the result folder of a fit, whole or not at all.

    Parameters
    ----------
    result : FitResult of `fit`
    path : the new folder
    fields : with the stresses at the optimum, by one more run
    overwrite : replace an earlier result folder

    Raises
    ------
    OutputError
    """
    with result_folder(path, overwrite) as folder:
        fill_fit(folder, result, fields)


def fill_fit(folder: Path, result: FitResult, fields: bool, warn: Callable[[str], object] = warnings.warn) -> dict[str, Any]:
    """Write the files of a fit into a folder that exists; returns what its result.json holds."""
    if result.case is None:
        raise OutputError(f"{folder}: this result was read from a file, without its case; copy its folder instead")
    again = copy_case(result.case, folder)
    written = {**result.as_json(), "overrides": list(again), "case": case_facts(result.case)}
    write_json(folder / "result.json", written)
    write_curves(folder / "curves.csv", result.curves, result.measured)
    force_displacement(list(result.measured.items()), list(result.curves.items()), folder / "fit")
    if result.profiles:
        profiles(written["profiles"], written["parameters"], folder / "profiles")
    if result.correlation and len(result.free) > 1:
        correlations(result.free, written["correlation"], folder / "correlation")
    if fields and result.objective is not None:
        _write_stresses(folder / "fields", result, warn)
    write_report(folder)
    return written


def _write_stresses(folder: Path, result: FitResult, warn: Callable[[str], object]) -> None:
    """The stresses at the optimum, by one more run; a fit does not fail for want of them."""
    point = {name: parameter.value for name, parameter in result.parameters.items()}
    case, material = case_at(result.case, point), result.case.law(**split_point(result.case.law, point).parameters)
    model = Model(setup_of(case))
    try:
        simulation = model.simulate(presses_of(case, material))
    except ConvergenceError as error:
        warn(f"no stress pictures: {error}")
        return
    write_fields(folder, model, material, case.material.bulk_modulus(material.shear_modulus), simulation.tests)
