"""A case made of a set of replicates: the mean curve of each direction, and the table of the samples' own curves."""

import tomllib
from pathlib import Path

import numpy as np
import tomli_w

from indentfit.curve import write_curve
from indentfit.errors import OutputError
from indentfit.experiment.specimens import TABLE, write_specimens

NAMES = {0: "parallel", 90: "perpendicular"}
HEAD = """\
# Made by `indentfit process --case`: mean curves of {n} records, to their common depth. Thickness and diameter are the means of
# the manifest's; {origin}
#     indentfit fit case.toml                  the mean curves
#     indentfit fit case.toml --per-sample     each sample of replicates.csv on its own
"""


def write_case(folder, base, text, outcomes, curves, means, targets):
    """Write case.toml, replicates.csv and the mean curves into a folder.

    base: path of the case whose sample, indenter, material and so on are taken, or None; text: its TOML. curves: name of an Outcome
    -> its CSV, relative to the folder; targets: direction -> "mean", "linear" or "quadratic". Returns warnings, one line each.
    """
    try:
        tree = tomllib.loads(text)
    except ValueError as error:
        raise OutputError(f"{base}: not TOML ({error}); correct it") from None
    good = [one for one in outcomes if one.processed]
    warnings = list(_take_lengths(tree, good))
    model = tree.get("material", {}).get("model", "")
    if base and ".py:" in model:
        tree["material"]["model"] = str(Path(base).parent.resolve() / model)
    tree["title"] = "mean curves of raw records"
    tree.pop("record", None)
    tree["test"] = []
    for direction, mean in means.items():
        place = f"curves/mean_{direction}.csv"
        write_curve(folder / place, mean.target(targets.get(direction, "mean")))
        tree["test"].append({"name": NAMES[direction], "angle": direction, "curve": place})
    origin = f"everything else is that of {base}." if base else "everything else is `indentfit init`'s: SET IT TO YOUR EXPERIMENT."
    (folder / "case.toml").write_text(HEAD.format(n=len(good), origin=origin) + "\n" + tomli_w.dumps(tree), encoding="utf-8")
    rows = [(one.entry.sample, one.entry.direction, curves[one.name], one.entry.thickness, one.entry.diameter) for one in good]
    write_specimens(folder / TABLE, rows)
    return warnings


def _take_lengths(tree, good):
    """Put the samples' mean thickness and diameter into the tree; yields what they lack."""
    sample = tree.setdefault("sample", {})
    for key in ("thickness", "diameter"):
        lengths = [getattr(one.entry, key) for one in good if getattr(one.entry, key)]
        if key == "diameter" and sample.get("shape") != "disc":
            continue
        if len(lengths) == len(good):
            sample[key] = float(np.round(np.mean(lengths), 6))
        else:
            yield f"the manifest does not give every {key}; sample.{key} = {sample.get(key)} of the case is kept"
