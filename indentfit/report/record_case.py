"""A case made of a set of replicates: the mean curve of each direction, and the table of the samples' own curves."""

from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from indentfit.curve import write_curve
from indentfit.experiment.mean_case import MeanCase
from indentfit.experiment.outcomes import Usable, usable
from indentfit.experiment.process_result import ProcessResult
from indentfit.experiment.specimens import TABLE, write_specimens
from indentfit.report.records import curve_files

NAMES = {0: "parallel", 90: "perpendicular"}
HEAD = """\
# Made by `indentfit process --case`: mean curves of {n} records, to their common depth. Thickness and diameter are means of the
# manifest; {origin}
#     indentfit fit case.toml                  fits the mean curves
#     indentfit fit case.toml --per-sample     fits each sample of replicates.csv on its own
"""
Tree = dict[str, Any]


def write_case(folder: Path, result: ProcessResult, case: MeanCase) -> list[str]:
    """Write case.toml, replicates.csv and the mean curves into a folder that holds the curves of the records.

    Returns
    -------
    list of str
        Warnings: lengths that the manifest does not give.
    """
    good = usable(result.outcomes)
    tree = deepcopy(dict(case.tree))
    warnings = list(_take_lengths(tree, good))
    _keep_the_plugin(tree, case.base)
    tree["title"] = "mean curves of raw records"
    tree.pop("record", None)
    directed = any(outcome.entry.direction is not None for outcome in good)
    tree["test"] = [_write_test(folder, result, direction, case) | _angle(direction, directed) for direction in result.means]
    origin = f"everything else is from {case.base}." if case.base else "everything else is a template: SET IT TO YOUR EXPERIMENT."
    (folder / "case.toml").write_text(HEAD.format(n=len(good), origin=origin) + "\n" + tomli_w.dumps(tree), encoding="utf-8")
    files = curve_files(result)
    entries = [outcome.entry for outcome in good if outcome.entry.group is not None]
    rows = [(entry.sample, entry.direction, files[entry.name], entry.thickness, entry.diameter) for entry in entries]
    write_specimens(folder / TABLE, rows, [entry.others for entry in entries])
    return warnings


def _take_lengths(tree: Tree, good: list[Usable]) -> Iterator[str]:
    """Put the samples' mean thickness and diameter into the tree; yields a warning for each length that some samples lack."""
    sample = tree.setdefault("sample", {})
    for key in ("thickness", "diameter"):
        lengths = [getattr(outcome.entry, key) for outcome in good if getattr(outcome.entry, key)]
        if key == "diameter" and sample.get("shape") != "disc":
            continue
        if len(lengths) == len(good):
            sample[key] = float(np.round(np.mean(lengths), 6))
        else:
            yield f"the manifest does not give every {key}; the case keeps sample.{key} = {sample.get(key)}"


def _keep_the_plugin(tree: Tree, base: Path | None) -> None:
    """Name a plugin of the base case by its whole path: the new case lies in another folder."""
    model = tree.get("material", {}).get("model", "")
    if base and ".py:" in model:
        tree["material"]["model"] = str(base.parent.resolve() / model)


def _write_test(folder: Path, result: ProcessResult, direction: int, case: MeanCase) -> Tree:
    """Write the curve of a direction; returns the [[test]] table that names the curve."""
    place = f"curves/mean_{direction}.csv"
    write_curve(folder / place, result.means[direction].target(case.targets.get(direction, "mean")))
    return {"name": NAMES[direction], "curve": place}


def _angle(direction: int, directed: bool) -> Tree:
    """Name and angle of the test of a direction; a test without angle where the manifest has no directions, so that a material with
    fibres is refused."""
    return {"name": NAMES[direction], "angle": direction} if directed else {"name": "press"}
