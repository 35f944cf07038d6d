"""Files of atomic force microscopes (JPK, Igor, Nanosurf, HDF5, NT-MDT, AFM Workshop), read by afmformats (extra `afm`).

afmformats is under the MIT licence; its dependency igor2 is under the LGPL.
"""

from __future__ import annotations

import importlib
import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Record
from indentfit.errors import RecordError
from indentfit.experiment.formats.table import Table

ENDINGS = (".jpk-force", ".jpk-force-map", ".jpk-qi-data", ".jpk-qi-series", ".ibw", ".nid", ".h5", ".ntmdt", ".mdt", ".jpk")
COLUMNS = {
    "time": "time (s)",
    "height (measured)": "height (measured) (m)",
    "height (piezo)": "height (piezo) (m)",
    "force": "force (N)",
}


class ForceCurve(Protocol):
    """What afmformats gives of one curve: its columns, its metadata, and the values of a column."""

    columns: Sequence[str]
    metadata: Any

    def __getitem__(self, column: str) -> Array: ...


class AfmFormat:
    """Binary files of atomic force microscopes, recognised by the suffix of the file's name; a force map holds many curves."""

    def reads(self, path: Path) -> bool:
        return path.name.lower().endswith(ENDINGS)

    def tables(self, path: Path, settings: Record) -> list[Table]:
        try:
            afmformats = importlib.import_module("afmformats")
        except ImportError:
            raise RecordError(
                f"{path}: a binary file of an atomic force microscope; pip install 'indentfit[afm]', or export it as text"
            ) from None
        logging.getLogger("afmformats").addHandler(logging.NullHandler())  # what it cannot read is said in one line, here
        try:
            curves = sorted(afmformats.load_data(path, **_told(settings)), key=_place_in_map)
            return [_table(path, curve, n, len(curves)) for n, curve in enumerate(curves, start=1)]
        except (KeyboardInterrupt, SystemExit, GeneratorExit, RecordError):
            raise
        except BaseException as error:  # MissingMetaDataError of afmformats is no Exception
            reason = " ".join(f"{type(error).__name__}: {error}".split())[:200]
            hint = "give record.stiffness, or export it as text" if "spring constant" in reason else "export it as text"
            raise RecordError(f"{path}: afmformats cannot read it ({reason}); {hint}") from None


def _place_in_map(curve: ForceCurve) -> int:
    """The number that the instrument gave to a curve of a map: some files list curve 10 before curve 2. 0 where it gave none."""
    number = curve.metadata.get("enum") if hasattr(curve.metadata, "get") else None
    return int(number) if number is not None else 0


def _told(settings: Record) -> dict[str, Any]:
    """What the settings state in place of a file's metadata: the spring constant, N/m."""
    return {"meta_override": {"spring constant": settings.stiffness}} if settings.stiffness else {}


def _table(path: Path, curve: ForceCurve, number: int, count: int) -> Table:
    """The Table of one curve: time, one height and force, and its segments."""
    names = [name for name in ("time", "height (measured)", "height (piezo)", "force") if name in curve.columns]
    if "height (measured)" in names and "height (piezo)" in names:
        names.remove("height (piezo)")
    if "force" not in names or not any(name.startswith("height") for name in names):
        raise RecordError(f"{path}: curve {number} has no height and force, but {', '.join(curve.columns)}; export it as text")
    values = np.column_stack([np.asarray(curve[name], dtype=float) for name in names])
    header, texts = [COLUMNS[name] for name in names], {}
    if "segment" in curve.columns:
        values = np.column_stack([values, np.full(len(values), np.nan)])
        texts = {len(header): ["retract" if segment else "approach" for segment in np.asarray(curve["segment"])]}
        header.append("segment")
    stiffness = curve.metadata.get("spring constant") if hasattr(curve.metadata, "get") else None
    above = (f'"spring constant": {stiffness}',) if stiffness else ()
    return Table([header], values, 1, name=f"curve {number}" if count > 1 else "", texts=texts, above=above)
