"""The result folder: written under a temporary name, renamed when whole, never overwritten unasked."""

import contextlib
import csv
import datetime
import hashlib
import importlib.metadata
import json
import math
import os
import shlex
import shutil
import uuid
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from indentfit.case import Case, write_case
from indentfit.case.prior_tests import is_prior_test
from indentfit.curve import Curve
from indentfit.errors import OutputError
from indentfit.fibre_map import FibreMap

PathLike = str | Path

# names by which a result folder is recognised
RESULTS = ("result.json", "simulation.json", "summary.json", "per_sample.json", "design.json")
LEDGER = "ledger.sqlite"
FILES = (*RESULTS, LEDGER, "case.toml", "curves.csv", "report.html", "run_again.txt", "fields")
FIGURES = (".svg", ".png")
COLUMNS = ("displacement_mm", "force_mN", "measured_force_mN", "strain", "stress_kPa", "measured_stress_kPa")  # of curves.csv


@contextlib.contextmanager
def result_folder(path: PathLike, overwrite: bool = False) -> Iterator[Path]:
    """Context that gives a temporary folder beside `path`, and renames it to `path` when the block ends well.

    When the block fails, the temporary folder is removed and `path` stays unchanged. Raises OutputError where the folder cannot be
    written, exists, or (with overwrite) is not a result folder.
    """
    target = refuse_existing(path, overwrite)
    temporary = _beside(target, "partial")
    try:
        temporary.mkdir()
        yield temporary
        refuse_existing(path, overwrite)  # another program may have made the folder meanwhile
        _put_in_place(temporary, target)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error}); choose another folder") from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


@contextlib.contextmanager
def lasting_folder(path: PathLike, overwrite: bool = False) -> Iterator[Path]:
    """Like `result_folder`, for a long run: where the block fails, the ledger stays in a folder beside `path`.

    The context gives the folder `unfinished(path)`, new or from an earlier run. When the block fails, this folder is removed only
    if it holds neither a ledger nor a subfolder. The block must take the ledger's
    lock before it changes anything else in the folder.
    """
    target = refuse_existing(path, overwrite)
    place = unfinished(target)
    try:
        place.mkdir(exist_ok=True)
        yield place
        refuse_existing(path, overwrite)
        _put_in_place(place, target)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error}); choose another folder") from error
    finally:
        if not ledgers(place):
            shutil.rmtree(place, ignore_errors=True)


def unfinished(path: PathLike) -> Path:
    """The folder beside `path` that holds the files of a long run until its result is whole."""
    target = Path(path).resolve()
    name = target.name if len(target.name) <= 60 else f"{target.name[:40]}-{_short_hash(target.name)}"
    return target.with_name(f".{name}.unfinished")


def ledgers(place: PathLike) -> list[Path]:
    """The ledgers of a long run in its unfinished folder: its own, or those of its samples."""
    return [ledger for ledger in (Path(place) / LEDGER, *sorted(Path(place).glob(f"*/{LEDGER}"))) if ledger.exists()]


def clear(folder: PathLike) -> None:
    """Remove all files of an earlier run from its unfinished folder, except the ledger."""
    clear_all_but(folder, [file.name for file in Path(folder).glob(f"{LEDGER}*") if not file.is_dir()])


def clear_all_but(folder: PathLike, names: Collection[str]) -> None:
    """Remove everything from a run's unfinished folder, except files and folders with these names."""
    for inner in Path(folder).iterdir():
        if inner.name in names:
            continue
        if inner.is_dir() and not inner.is_symlink():
            shutil.rmtree(inner)
        else:
            inner.unlink()


def refuse_existing(path: PathLike, overwrite: bool = False) -> Path:
    """Raise OutputError unless a result folder can be written at `path`; to be called before a long computation.

    With overwrite, an earlier result folder and an empty folder may be replaced, and nothing else. Returns the
    folder's absolute path, symbolic links followed.
    """
    try:
        target = Path(path).resolve()
        if os.path.lexists(target):
            _refuse_what_is_there(path, target, overwrite)
        target.lstat()  # FileNotFoundError, unless the name itself is wrong
    except FileNotFoundError:
        pass
    except (OSError, ValueError, RuntimeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise OutputError(f"{path}: cannot be used ({reason}); choose another folder") from error
    if not target.parent.is_dir():
        raise OutputError(f"{path}: there is no folder {target.parent}; create it, or choose another folder")
    if not os.access(target.parent, os.W_OK | os.X_OK):
        raise OutputError(f"{path}: {target.parent} is read-only; choose another folder")
    return target


def stamped(value: Mapping[str, Any]) -> dict[str, Any]:
    """A result for its JSON file, with the day on which it is written, and with indentfit's version where it has no versions."""
    versions = value.get("versions") or {"indentfit": importlib.metadata.version("indentfit")}
    return {**value, "versions": versions, "written": datetime.date.today().isoformat()}


def write_json(path: PathLike, value: Any) -> None:
    """Write a value as JSON."""
    Path(path).write_text(json_text(value) + "\n", encoding="utf-8")


def json_text(value: Any) -> str:
    """A value as strict JSON: NumPy numbers and arrays become plain numbers and lists, NaN and infinity become null."""
    return json.dumps(_plain(value), indent=2, allow_nan=False, ensure_ascii=False)


def write_curves(path: PathLike, simulated: Mapping[str, Curve], measured: Mapping[str, Curve] | None = None) -> None:
    """Write curves (name -> Curve) as one CSV with the columns test, displacement_mm, force_mN, and time_s where curves have times;
    strains and stresses have columns strain and stress_kPa.

    measured: name -> Curve with the same displacements, or None; its forces make another column, measured_force_mN.
    """
    used = {column for curve in simulated.values() for column in curve.shown.header}
    heads = [head for head in COLUMNS if head.removeprefix("measured_") in used and (measured or head in used)]
    heads += ["time_s"] if any(curve.time is not None for curve in simulated.values()) else []
    with open(path, "w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["test", *heads])
        for name, curve in simulated.items():
            (across, up), given = curve.shown.header, (measured or {}).get(name)
            known = {across: curve.displacement, up: curve.force, "time_s": curve.time}
            known |= {f"measured_{up}": given.force} if given is not None else {}
            cells = {head: [""] * curve.force.size if (values := known.get(head)) is None else values.tolist() for head in heads}
            table.writerows([name, *row] for row in zip(*cells.values(), strict=True))


def copy_case(case: Case, folder: PathLike) -> tuple[str, ...]:
    """Copy the case file, verbatim, as case.toml, with the curves and the plugin it names, to be run again.

    A file that the case names by a path inside of its own folder keeps that path; one from elsewhere goes to curves/ or
    plugins/. Returns the overrides (KEY=VALUE) with which the copy is the case that was run: those of this run, then
    the new places of such files. Where there are any, run_again.txt says so. A case that was made from values is written instead.
    """
    folder = Path(folder)
    if case.path is None:
        write_case(case, folder)
        return ()
    places = _places([name for _, name, _, _ in _files_named(case)])
    moved = []
    for key, name, room, ending in _files_named(case):
        if name not in places:
            places[name] = _free_place(f"{room}/{PurePath(name).name}", places)
        if places[name] != _inside(name):
            moved.append(f"{key}={json.dumps(places[name] + ending, ensure_ascii=False)}")
    for name, place in {**places, case.path.name: "case.toml"}.items():
        (folder / place).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(case.path.parent / name, folder / place)
    overrides = (*case.overrides, *moved)
    if overrides:
        (folder / "run_again.txt").write_text(_run_again(overrides), encoding="utf-8")
    return overrides


def _files_named(case: Case) -> Iterator[tuple[str, str, str, str]]:
    """Key, file name, folder for it, and what the key holds after the name, of each file that the case names."""
    for test in case.tests:
        if isinstance(test.curve, str) and test.kind != "field" and not (case.path and is_prior_test(test)):
            yield f"test.{test.name}.curve", test.curve, "curves", ""
        for n, field in enumerate(test.field if test.kind == "indentation" else ()):
            yield f"test.{test.name}.field.{n}.file", field.points.file, "curves", ""
        if test.record is not None:
            yield f"test.{test.name}.record", test.record, "records", ""
    samples: list[tuple[str, Any]] = [("sample", case.sample), *((f"test.{test.name}.sample", test.sample) for test in case.tests)]
    for key, sample in samples:
        if sample is not None and isinstance(sample.directions, FibreMap):
            yield f"{key}.directions", sample.directions.file, "curves", ""
    models = {f"{layer.name}.model": layer.model for layer in case.sample.layer} or {"material.model": case.material.model}
    for key, model in models.items():
        file, colon, kind = (model or "").rpartition(":")
        if colon and file.endswith(".py"):
            yield key, file, "plugins", f":{kind}"


def _places(names: Sequence[str]) -> dict[str, str]:
    """File name -> its place in the result folder, for those that can keep their place."""
    return {name: place for name in names if (place := _inside(name))}


def _inside(name: str) -> str | None:
    """A path relative to a folder; None where the path leads out of the folder or to one of the result's own files."""
    path = PurePath(name)
    if path.is_absolute() or ".." in path.parts or path.parts[0].lower() in FILES:
        return None
    return None if len(path.parts) == 1 and path.suffix.lower() in FIGURES else path.as_posix()


def _free_place(place: str, places: Mapping[str, str]) -> str:
    path, taken = PurePath(place), {other.lower() for other in places.values()}
    choices = (path.with_stem(path.stem + (f"-{n}" if n > 1 else "")) for n in range(1, len(taken) + 2))
    return next(choice.as_posix() for choice in choices if choice.as_posix().lower() not in taken)


def _run_again(overrides: Sequence[str]) -> str:
    options = " ".join(f"--set {shlex.quote(override)}" for override in overrides)
    return (
        "case.toml is a verbatim copy. The case that was run had keys set on the command line, or files from outside\n"
        "of its folder, which are now in curves/ or plugins/. To run it again, from this folder:\n\n"
        f"indentfit COMMAND case.toml {options}\n"
    )


def _refuse_what_is_there(path: PathLike, target: Path, overwrite: bool) -> None:
    if not target.is_dir():
        raise OutputError(f"{path}: a file has that name; choose another folder")
    if not overwrite:
        raise OutputError(f"{path}: the folder exists; choose another one, or add --overwrite to replace it")
    if any(target.iterdir()) and not any((target / name).is_file() for name in RESULTS):
        raise OutputError(f"{path}: not a result folder of indentfit, so it is not overwritten; choose another folder")


def _beside(target: Path, what: str) -> Path:
    return target.with_name(f".{target.name[:60]}.{uuid.uuid4().hex[:8]}.{what}")


def _short_hash(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "surrogateescape")).hexdigest()[:12]


def _put_in_place(temporary: Path, target: Path) -> None:
    """Rename `temporary` to `target`; an old target is moved aside first, and back again if the renaming fails."""
    if not target.exists():
        temporary.rename(target)
        return
    aside = _beside(target, "old")
    target.rename(aside)
    try:
        temporary.rename(target)
    except OSError:
        aside.rename(target)
        raise
    shutil.rmtree(aside, ignore_errors=True)


def _plain(value: Any) -> Any:
    """A value as dictionaries, lists, numbers, strings and None, in place of NumPy's types and paths."""
    if isinstance(value, dict):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return str(value) if isinstance(value, PurePath) else value
