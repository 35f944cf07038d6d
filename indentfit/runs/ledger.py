"""The ledger: every run of the forward model, in one SQLite file, so that none is lost and none is paid for twice.

A run is found again by a hash of everything that decides its curve: sample, indenter, mesh, solver, the material with
its code, bulk modulus, angle, output depths, parameters, and the versions of what computes it. Measured forces, weights
and settings of the fit are not in it: another fit of the same mechanics finds the same runs.

How it is kept. A run takes seconds and a transaction milliseconds, so each run is committed alone, with the plain
rollback journal and synchronous = EXTRA: what was committed outlives kill -9 and a power cut, and the ledger stays one
file that works on network drives, where a write-ahead log's shared memory does not. The lock is held from opening to
closing and dies with its process, so two runs cannot write to one folder. Arrays are raw little-endian float64, the
rest is JSON or text; each row carries a checksum over all of its columns, and a row that fails it is never used.
"""

import contextlib
import copy
import hashlib
import importlib.metadata
import json
import platform
import sqlite3
import struct
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from indentfit.case import Uncertain
from indentfit.errors import LedgerError
from indentfit.fem.linear import LinearSolver

FILE_OF_JOURNAL = "{}-journal"  # SQLite's name for what it needs to undo a transaction
FORMAT = 1
APPLICATION = 0x696E6474  # "indt", in the file's header: tells it from other SQLite files
PACKAGES = ("indentfit", "numpy", "scipy", "scikit-fem", "numba", "sympy", "pypardiso", "mkl", "pyamg")
HOME = Path(__file__).parents[1]
TABLES = (
    "CREATE TABLE about (name TEXT, value TEXT, checksum TEXT)",
    "CREATE TABLE runs (id INTEGER PRIMARY KEY, hash TEXT, origin TEXT, test TEXT, inputs TEXT, names TEXT, force BLOB, "
    "sensitivities BLOB, facts TEXT, seconds REAL, cause TEXT, lost INTEGER, checksum TEXT)",
)
COLUMNS = ("hash", "origin", "test", "inputs", "names", "force", "sensitivities", "facts", "seconds", "cause", "lost")


@dataclass(frozen=True)
class Run:
    """One test at one set of parameters: its forces, mN, shape (n,), or the cause why there are none.

    sensitivities: name -> derivatives of the forces by it, shape (n,), of those that were asked for, else None.
    lost: the cause is the machine's (out of memory, killed, out of time) and not the mechanics'.
    """

    force: np.ndarray | None
    cause: str | None
    seconds: float
    facts: dict
    sensitivities: dict[str, np.ndarray] | None = None
    lost: bool = False

    def serves(self, names: Iterable[str]) -> bool:
        """Whether it says what a run with these sensitivities would: also where the mechanics failed without them."""
        return self.force is None or set(names) <= set(self.sensitivities or ())


class InUse(LedgerError):
    """Another process holds the ledger's lock."""


class Unreadable(LedgerError):
    """A ledger that is damaged, or of another format."""


class Inputs:
    """What decides the curves of a case: `origin` is the hash of all that its runs have in common."""

    def __init__(self, case):
        self.case = case
        self.common = {
            "format": FORMAT,
            "sample": case.sample.model_dump(mode="json"),
            "indenter": case.indenter.model_dump(mode="json"),
            "mesh": case.mesh.model_dump(mode="json"),
            "depth": max(float(case.outputs(test)[-1]) for test in case.tests),  # the mesh is made for it
            "solver": {**case.solver.model_dump(mode="json"), "linear": LinearSolver(case.solver.linear).name},
            "material": _material(case),
            "bulk_ratio": case.material.bulk_ratio,
            "kappa": case.material.kappa,
            "code": _code(),
            "versions": versions(),
        }
        self.origin = _sha(_json(self.common))

    def of(self, parameters, test):
        """The inputs of a run beyond the common ones: parameters (name -> value), of a test of the case."""
        depths = np.asarray(self.case.outputs(test), dtype=float).tolist()
        return {"parameters": dict(parameters), "angle": int(test.angle), "depths": depths}

    def hash(self, inputs):
        """SHA-256 of all that decides a run's curve."""
        return _sha(self.origin + _json(inputs))


@cache
def versions():
    """Versions of what computes a curve, None for what is not installed."""
    found: dict[str, str | None] = dict.fromkeys(PACKAGES)
    for name in PACKAGES:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            found[name] = importlib.metadata.version(name)
    return found | {"machine": platform.machine(), "system": platform.system()}


class Ledger:
    """The runs of a case, and of `others` like it, in a file, locked from opening to `close`; to be used in a `with` block.

    resume: the file must be of this very case, as far as its search goes, and of these versions; all of its runs are taken,
    also those that failed for reasons of the machine. Else those are dropped, to be tried again, and the file becomes this
    case's; one that cannot be read is begun anew. `remarks` are lines for the user. Raises LedgerError, one line, wherever the
    file cannot be used or written.
    """

    def __init__(self, path, case, resume=False, others=()):
        self.path, self.case, self.inputs = Path(path), case, Inputs(case)
        self.origins = {self.inputs.origin.encode(), *(Inputs(other).origin.encode() for other in others)}
        self.remarks: list[str] = []
        self._file: Any = None
        try:
            self._open(resume)
        except Unreadable as error:
            if resume:
                raise
            self.remarks.append(f"{str(error).partition('; ')[0]}; its runs are not used")
            for name in (FILE_OF_JOURNAL.format(self.path.name), self.path.name):
                self.path.with_name(name).unlink(missing_ok=True)
            self._open(resume)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def __len__(self):
        """The number of runs that this case, and the others, can use."""
        return sum(len(runs) for runs in self._runs.values())

    @property
    def has_own(self):
        """Whether it holds runs that are in no other ledger."""
        return bool(self._own)

    def of(self, case):
        """The same file for another case, one of the `others`: its runs are found and added in place of this one's."""
        other = copy.copy(self)
        other.case, other.inputs = case, Inputs(case)
        return other

    def close(self):
        """Let go of the file. What was added is in it already."""
        if self._file is not None:
            with contextlib.suppress(sqlite3.Error):
                self._file.close()
        self._file = None

    def find(self, parameters, test, names=()):
        """The Run of a test of the case at parameters (name -> value) that has the sensitivities `names`, or None.

        The earliest that serves: so a resumed fit, which knows later runs from the start, takes the same ones.
        """
        runs = self._runs.get(self.inputs.hash(self.inputs.of(parameters, test)), ())
        return next((run for run in runs if run.serves(names)), None)

    def add(self, parameters, test, run):
        """Write a Run, safely, before anything else happens."""
        inputs = self.inputs.of(parameters, test)
        row = _row(self.inputs.hash(inputs), self.inputs.origin, test.name, inputs, run)
        if not self.path.exists():  # SQLite would go on writing to a file that nobody can find
            raise LedgerError(f"{self.path}: was removed while it was in use; give the command again")
        with _said(self.path), _transaction(self._file):
            _insert(self._file, row)
        self._runs.setdefault(row[0].decode(), []).append(run)
        self._own.append(row[0])

    def take_over(self, path):
        """Add the runs of another ledger that this case can use, and that it has not; returns how many.

        Left behind are those that failed for reasons of the machine. Raises LedgerError.
        """
        rows = [(columns, _run(columns, checksum)) for _, columns, checksum in _rows_of(path)]
        damaged = sum(run is None for _, run in rows)
        if damaged:
            self.remarks.append(f"{path}: {damaged} damaged runs are not used")
        known = set(self._runs)
        taken = [
            (columns, run) for columns, run in rows
            if run and not run.lost and columns[1] in self.origins and columns[0].decode() not in known
        ]  # fmt: skip
        with _said(self.path), _transaction(self._file):
            for columns, run in taken:
                _insert(self._file, columns)
                self._runs.setdefault(columns[0].decode(), []).append(run)
        return len(taken)

    def _open(self, resume):
        self._runs: dict[str, list[Run]] = {}
        self._own: list[bytes] = []
        try:
            with _said(self.path):
                self._file = _locked(self.path)
                self._begin(resume)
        except BaseException:
            self.close()
            raise

    def _begin(self, resume):
        """Check the file, or begin it, and read its runs."""
        empty = not self._file.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
        with _transaction(self._file):
            if empty:
                if resume:
                    self.remarks.append(f"{self.path}: holds no run yet; the fit starts from its beginning")
                _create(self._file)
            else:
                _refuse_other_format(self._file, self.path)
                _refuse_damage(self._file, self.path)
                if resume:
                    _refuse_other_case(_about(self._file, self.path), self._own_facts(), self.path)
            self._read(keep_lost=resume)
            self._own += [one.encode() for one in self._runs]
            if empty or not resume:
                self._write_about()

    def _read(self, keep_lost):
        damaged = 0
        for number, columns, checksum in _rows(self._file):
            run = _run(columns, checksum)
            damaged += run is None
            if run is None or (run.lost and not keep_lost):
                self._file.execute("DELETE FROM runs WHERE id = ?", (number,))
            elif columns[1] in self.origins:
                self._runs.setdefault(columns[0].decode(), []).append(run)
        if damaged:
            self.remarks.append(f"{self.path}: {damaged} damaged runs were thrown away; they are run again if needed")

    def _own_facts(self):
        facts = {"case": _searched(self.case).hash, "origin": self.inputs.origin, "title": self.case.title}
        return facts | {"versions": _json(versions() | {"code": _code()})}

    def _write_about(self):
        self._file.execute("DELETE FROM about")
        for name, value in self._own_facts().items():
            row = (name.encode(), value.encode())
            self._file.execute("INSERT INTO about VALUES (CAST(? AS TEXT), CAST(? AS TEXT), ?)", (*row, _checksum(row)))


def refuse_in_use(path):
    """Raise LedgerError where another process holds the lock of a ledger."""
    path = Path(path)
    try:
        with _said(path):
            _locked(path).close()
    except InUse:
        raise
    except LedgerError:
        pass  # whatever else is wrong with it is said when it is opened


def _searched(case):
    """The case without what is asked only once its search has ended: a fit that is resumed may ask more, or less."""
    uncertain = Uncertain(**case.fit.uncertain.fitted)
    ended = case.fit.model_copy(update={"uncertain": uncertain, "published": {}, "profiles": True})
    return case.model_copy(update={"fit": ended})


# What decides a curve


def _material(case):
    """The material: its energy as typed, or its name and the code of its class and of those it builds on."""
    if case.material.energy is not None:
        return {"energy": case.material.energy, "parameters": list(case.material_class.parameters)}
    kind = case.material_class
    files = [getattr(sys.modules.get(base.__module__), "__file__", None) for base in kind.__mro__[:-1]]
    code = [_sha(Path(file).read_bytes()) for file in files if file]
    return {"class": kind.__qualname__, "parameters": list(kind.parameters), "code": code}


@cache
def _code():
    """Hash of the mechanics' own code: a version number does not change while one works on it."""
    files = [
        *sorted((HOME / "fem").rglob("*.py")),
        HOME / "material.py",
        *(HOME / "runs" / f"{name}.py" for name in ("bench", "points")),
    ]
    return _sha(b"".join(file.relative_to(HOME).as_posix().encode() + b"\0" + file.read_bytes() for file in files))


def _sha(content):
    return hashlib.sha256(content.encode() if isinstance(content, str) else content).hexdigest()


def _json(value):
    return json.dumps(value, sort_keys=True, separators=(",", ":"), default=lambda one: one.tolist())


# The file


def _locked(path):
    """A connection that holds the file's lock until it is closed."""
    file = sqlite3.connect(path, timeout=0, isolation_level=None)
    try:
        file.text_factory = bytes  # a flipped bit need not be UTF-8
        file.execute("PRAGMA trusted_schema = OFF")
        file.execute("PRAGMA locking_mode = EXCLUSIVE")
        file.execute("BEGIN EXCLUSIVE")
        file.execute("COMMIT")
        file.execute("PRAGMA journal_mode = DELETE")
        file.execute("PRAGMA synchronous = EXTRA")
        if not path.exists():
            raise LedgerError(f"{path}: was taken away by another run that has just ended; look at its result")
    except BaseException:
        file.close()
        raise
    return file


def _rows_of(path):
    """The rows of a ledger that is only read."""
    path = Path(path)
    if not path.is_file():
        raise LedgerError(f"{path}: no such ledger; name a result folder of `indentfit fit`, `sweep` or `mesh-check`")
    uri = f"{path.resolve().as_uri()}?mode=ro"
    with _said(path), contextlib.closing(sqlite3.connect(uri, uri=True, timeout=0, isolation_level=None)) as file:
        file.text_factory = bytes
        file.execute("PRAGMA trusted_schema = OFF")
        _refuse_other_format(file, path)
        _refuse_damage(file, path)
        return _rows(file)


def _create(file):
    for table in TABLES:
        file.execute(table)
    file.execute(f"PRAGMA application_id = {APPLICATION}")
    file.execute(f"PRAGMA user_version = {FORMAT}")


@contextlib.contextmanager
def _transaction(file):
    file.execute("BEGIN IMMEDIATE")
    try:
        yield
        file.execute("COMMIT")
    except BaseException:
        with contextlib.suppress(sqlite3.Error):
            file.execute("ROLLBACK")
        raise


def _refuse_other_format(file, path):
    if file.execute("PRAGMA application_id").fetchone()[0] != APPLICATION:
        raise Unreadable(f"{path}: not a ledger of indentfit, or damaged; {_remedy(path)}")
    found = file.execute("PRAGMA user_version").fetchone()[0]
    if found != FORMAT:
        raise Unreadable(
            f"{path}: a ledger of format {found}; this indentfit reads format {FORMAT}: use the version that wrote it, "
            f"or {_remedy(path)}"
        )


def _refuse_damage(file, path):
    tables = sorted(sql or b"" for (sql,) in file.execute("SELECT sql FROM sqlite_master"))
    if tables != sorted(table.encode() for table in TABLES):  # nor views or triggers, which could do anything
        raise Unreadable(f"{path}: damaged (its tables are not those of a ledger); {_remedy(path)}")
    said = file.execute("PRAGMA quick_check(1)").fetchone()[0].decode("utf-8", "replace")
    if said != "ok":
        raise Unreadable(f"{path}: damaged ({said.splitlines()[-1]}); {_remedy(path)}")


def _refuse_other_case(found, own, path):
    if found["case"] != own["case"]:
        title = f" ({found['title']!r})" if found["title"] != own["title"] else ", or this case has been changed since"
        raise LedgerError(f"{path}: belongs to another case{title}; {_remedy(path)}")
    if found["origin"] != own["origin"]:
        changed = ", ".join(_changes(json.loads(found["versions"]), json.loads(own["versions"]))) or "the material's code"
        raise LedgerError(f"{path}: was written with another {changed}; install that again, or {_remedy(path)}")


def _changes(found, own):
    for name in sorted(own):
        if found.get(name) != own[name]:
            yield "state of indentfit's code" if name == "code" else f"{name} ({found.get(name)}, now {own[name]})"


def _remedy(path):
    return f"remove the folder {path.parent} and begin anew" if path.parent.name.endswith(".unfinished") else "leave out --reuse"


def _about(file, path):
    found = {}
    for name, value, checksum in file.execute("SELECT name, value, checksum FROM about"):
        if checksum != _checksum((name, value)).encode():
            raise LedgerError(f"{path}: damaged (its first lines fail their checksum); {_remedy(path)}")
        found[name.decode()] = value.decode()
    if not {"case", "origin", "title", "versions"} <= set(found):
        raise LedgerError(f"{path}: damaged (it does not say of which case it is); {_remedy(path)}")
    return found


# Rows


def _rows(file):
    """(id, columns, checksum) of each run in the order of their writing, read before anything is deleted."""
    rows = file.execute(f"SELECT id, {', '.join(COLUMNS)}, checksum FROM runs ORDER BY id").fetchall()
    return [(number, columns, checksum) for number, *columns, checksum in rows]


def _row(hash_, origin, test, inputs, run):
    """The columns of a Run; text as bytes, as it is read again."""
    names = sorted(run.sensitivities or ())
    return (
        hash_.encode(),
        origin.encode(),
        test.encode(),
        _json(inputs).encode(),
        _json(names).encode(),
        None if run.force is None else _bytes(run.force),
        b"".join(_bytes(run.sensitivities[name]) for name in names) if run.sensitivities is not None else None,
        _json(run.facts).encode(),
        float(run.seconds),
        None if run.cause is None else run.cause.encode("utf-8", "replace"),
        int(run.lost),
    )


def _insert(file, columns):
    places = ", ".join("?" if name in ("force", "sensitivities", "seconds", "lost") else "CAST(? AS TEXT)" for name in COLUMNS)
    file.execute(f"INSERT INTO runs ({', '.join(COLUMNS)}, checksum) VALUES ({places}, ?)", (*columns, _checksum(columns)))


def _run(columns, checksum):
    """The Run of a row, None where the row is not what was written."""
    if checksum != _checksum(columns).encode():
        return None
    *_, names, force, sensitivities, facts, seconds, cause, lost = columns
    forces, derivatives = _numbers(force), None
    if sensitivities is not None:
        names = json.loads(names)
        derivatives = dict(zip(names, _numbers(sensitivities).reshape(len(names), -1) if names else (), strict=True))
    return Run(forces, None if cause is None else cause.decode(), seconds, json.loads(facts), derivatives, bool(lost))


def _bytes(array):
    return np.ascontiguousarray(array, dtype="<f8").tobytes()


def _numbers(blob):
    return None if blob is None else np.frombuffer(blob, dtype="<f8").astype(float)


def _checksum(columns):
    """SHA-256 of values with their kinds and lengths, so that no two rows have the same text."""
    digest = hashlib.sha256()
    for value in columns:
        if isinstance(value, float):
            part = b"F" + struct.pack("<d", value)
        else:
            part = b"B" + value if isinstance(value, bytes) else repr(value).encode()
        digest.update(len(part).to_bytes(8, "little") + part)
    return digest.hexdigest()


# Errors


@contextlib.contextmanager
def _said(path):
    """SQLite's errors as LedgerErrors that say what to do."""
    try:
        yield
    except sqlite3.Error as error:
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF
        raise _in_words(error, code, path) from error


def _in_words(error, code, path):
    if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
        return InUse(f"{path}: in use by another run; wait until it has ended, or choose another folder")
    if code == sqlite3.SQLITE_FULL:
        return LedgerError(f"{path}: the disk is full; make room, then go on with --resume")
    if code in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB):
        return Unreadable(f"{path}: damaged ({error}); {_remedy(path)}")
    return LedgerError(f"{path}: cannot be used ({error}); choose another folder")
