"""The result folder of a fit."""

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from indentfit.axes import MOTION
from indentfit.curve import Curve
from indentfit.errors import OutputError
from indentfit.inference.result import FitResult
from indentfit.report.displacement_files import FILE as DISPLACEMENTS
from indentfit.report.displacement_files import fields_of, write_displacements
from indentfit.report.fit_fields import FitFields
from indentfit.report.folder import copy_case, result_folder, stamped, write_curves, write_json
from indentfit.report.html import write_report
from indentfit.report.law_plot import law_misfits
from indentfit.report.plots import correlations, force_displacement, profiles
from indentfit.report.posterior_files import corner, write_netcdf
from indentfit.report.schema import case_json
from indentfit.report.time_curves import fit_over_time
from indentfit.runs.copied import in_copy


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
        fill_fit(folder, result, FitFields(folder / "fields") if fields else None)


def fill_fit(
    folder: Path, result: FitResult, fields: FitFields | None, warn: Callable[[str], object] = warnings.warn
) -> dict[str, Any]:
    """Write the files of a fit into a folder that exists; returns what its result.json holds.

    Parameters
    ----------
    folder : Path
    result : FitResult of `fit`
    fields : FitFields or None
        The stresses at the optimum, which may be begun already.
    warn : function
        Called with the text of a warning.

    Raises
    ------
    OutputError
    """
    if result.case is None:
        raise OutputError(f"{folder}: this result was read from a file, without its case; copy its folder instead")
    if fields is not None:
        fields.of(result)
    pictures = in_copy(_draw, folder, result)  # the report has its own
    written = _fill(folder, result)
    if fields is not None and (said := fields.ended()):
        warn(said)
    write_report(folder)
    pictures()
    return written


def _fill(folder: Path, result: FitResult) -> dict[str, Any]:
    """Write all files but the stresses, the pictures of curves and parameters, and the report."""
    assert result.case is not None  # `fill_fit` refuses it
    again = copy_case(result.whole_case or result.case, folder)
    seen = fields_of(result)
    displacements = {"displacements": {known.test: known.as_json() for known in seen}} if seen else {}
    written = stamped({**result.as_json(), **displacements, "overrides": list(again), "case": case_json(result.case)})
    write_json(folder / "result.json", written)
    write_curves(folder / "curves.csv", *_of_force(result))
    if seen:
        write_displacements(folder / DISPLACEMENTS, seen)
    if result.samples is not None:
        write_netcdf(result.samples, result.measured, folder / "posterior.nc")
        corner(result.samples, folder / "posterior")
    return written


def _draw(folder: Path, result: FitResult) -> None:
    """Draw the pictures of the curves and of the parameters."""
    assert result.case is not None  # `fill_fit` refuses it
    curves, measured = _of_force(result)
    force_displacement(list(measured.items()), list(curves.items()), folder / "fit", result.case.synthetic)
    if any(curve.time is not None for curve in curves.values()):
        fit_over_time(list(measured.items()), list(curves.items()), folder / "force_time")
    if result.profiles:
        profiles(result, folder / "profiles")
    if result.law_misfit is not None:
        law_misfits(result, folder / "law_misfit")
    if result.correlation and len(result.free) > 1:
        correlations(result.free, result.correlation, folder / "correlation")


def _of_force(result: FitResult) -> tuple[dict[str, Curve], dict[str, Curve]]:
    """The fitted and the measured curves of a result, without those of tests whose rig held the force."""
    fitted, measured = (
        {name: curve for name, curve in known.items() if curve.shown != MOTION} for known in (result.curves, result.measured)
    )
    return fitted, measured
