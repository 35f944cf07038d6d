"""Curves of raw records, kept in the user's cache folder: a case is checked again without SciPy, whose import takes a second.

A kept curve never answers for another input. Its name is the hash of all that the curve follows from: the bytes of the record and
of the presets beside it, the settings, the source of the whole package, and the versions of the libraries. The folder is
$INDENTFIT_CACHE (empty: nothing is kept), or `indentfit` in the system's place for caches.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import platform
import sys
from collections.abc import Callable, Iterator
from dataclasses import fields
from importlib.metadata import PackageNotFoundError, entry_points, version
from pathlib import Path

import numpy as np
from pydantic import BaseModel

from indentfit.case import Record
from indentfit.curve import Curve
from indentfit.errors import CurveError

FOLDER = "INDENTFIT_CACHE"
HOME = Path(__file__).parents[1]
PRESETS, OTHERS_PRESETS = "*.preset.toml", "indentfit.formats"  # as formats.presets has them, which imports all of the formats
LIBRARIES = ("numpy", "scipy", "python-calamine", "afmformats")  # that read and process records
MOST = 1000  # curves that are kept; beyond these the oldest go
Place = Path | None


def kept_curve(file: Path, settings: Record, process: Callable[[], Curve], timed: bool = False) -> Curve:
    """The curve of a raw record: the kept one, or that of `process`, which is then kept.

    Parameters
    ----------
    file : path of the record
    settings : Record
    process : function without arguments
        Reads and processes the record.
    timed : bool
        Whether the curve has times.

    Returns
    -------
    Curve

    Raises
    ------
    RecordError
        As `process` does; nothing is kept of a record that cannot be used.
    """
    place = _place(file, settings, timed)
    curve = _read(place) if place else None
    if curve is None:
        curve = process()
        if place and place == _place(file, settings, timed):  # the file has not changed in the meantime
            _write(place, curve)
    return curve


def _place(file: Path, settings: Record, timed: bool) -> Place:
    """The file of a kept curve; None where nothing is kept, or an input cannot be read."""
    folder = _folder()
    if folder is None or entry_points(group=OTHERS_PRESETS):  # whose presets are made by code of others
        return None
    digest = hashlib.sha256()
    try:
        for part in (*_inputs(file, settings), repr(timed).encode()):
            digest.update(hashlib.sha256(part).digest())
    except OSError:
        return None
    return folder / f"{digest.hexdigest()}.json"


def _folder() -> Place:
    given = os.environ.get(FOLDER)
    if given is not None:
        return Path(given) / "curves" if given else None
    with contextlib.suppress(RuntimeError):  # a user without a home
        return _of_system() / "indentfit" / "curves"
    return None


def _of_system() -> Path:
    """The system's place for caches."""
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


def _inputs(file: Path, settings: Record) -> Iterator[bytes]:
    """All that the curve of a record follows from. Raises OSError where one of these cannot be read."""
    yield file.name.encode()  # the ending tells the format
    yield file.read_bytes()
    named = [file.parent / settings.preset] if settings.preset and settings.preset.endswith(".toml") else []
    for preset in (*sorted(file.parent.glob(PRESETS)), *named):
        yield preset.name.encode()
        yield preset.read_bytes()
    yield repr(_stated(settings)).encode()
    yield _software()


def _stated(value: object) -> object:
    """The keys of a table that are set, with their values, also in inner tables: a preset gives only the others."""
    if isinstance(value, BaseModel):
        return [(key, key in value.model_fields_set, _stated(inner)) for key, inner in sorted(value)]
    return value


def _software() -> bytes:
    """The hash of the package's source, and the versions of Python and of the libraries."""
    digest = hashlib.sha256(repr((sys.version, platform.machine(), [_version(name) for name in LIBRARIES])).encode())
    files = sorted(path for ending in ("py", "toml") for path in HOME.rglob(f"*.{ending}"))
    if not files:
        raise FileNotFoundError(HOME)  # a package without sources cannot say what it computes
    for path in files:
        digest.update(path.relative_to(HOME).as_posix().encode() + hashlib.sha256(path.read_bytes()).digest())
    return digest.digest()


def _version(library: str) -> str:
    with contextlib.suppress(PackageNotFoundError):
        return version(library)
    return ""


def _read(place: Path) -> Curve | None:
    """The curve of a file; None where the file is not there or is damaged."""
    try:
        tree = json.loads(place.read_text(encoding="utf-8"))
        body = json.dumps(tree["curve"])
        if hashlib.sha256(body.encode()).hexdigest() != tree["hash"]:
            return None
        return Curve(**{**tree["curve"], "notes": tuple(tree["curve"]["notes"])})
    except (OSError, ValueError, TypeError, KeyError, CurveError):
        return None


def _write(place: Path, curve: Curve) -> None:
    """Write a curve, in one step; without a word where the folder cannot be written."""
    body = {field.name: _plain(getattr(curve, field.name)) for field in fields(curve)}
    tree = {"curve": body, "hash": hashlib.sha256(json.dumps(body).encode()).hexdigest()}
    part = place.with_suffix(f".{os.getpid()}")
    with contextlib.suppress(OSError):
        place.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        part.write_text(json.dumps(tree), encoding="utf-8")
        os.replace(part, place)
        _remove_oldest(place.parent)


def _plain(value: object) -> object:
    """The value of a curve's field as JSON takes it."""
    return value.tolist() if isinstance(value, np.ndarray) else value


def _remove_oldest(folder: Path) -> None:
    files = sorted(folder.glob("*.json"), key=lambda path: path.stat().st_mtime)
    for path in files[: max(len(files) - MOST, 0)]:
        path.unlink(missing_ok=True)
