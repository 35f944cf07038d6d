"""Rows of the ledger's tables: a run as columns and back, with a checksum over all of them.

Arrays are raw little-endian float64; all other columns are JSON or text. A row that fails its checksum is never used.
"""

import hashlib
import json
import sqlite3
import struct
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from indentfit.arrays import Array
from indentfit.runs.key import as_json
from indentfit.runs.run import Run

TABLES = (
    "CREATE TABLE about (name TEXT, value TEXT, checksum TEXT)",
    "CREATE TABLE runs (id INTEGER PRIMARY KEY, hash TEXT, origin TEXT, test TEXT, inputs TEXT, names TEXT, force BLOB, "
    "sensitivities BLOB, facts TEXT, seconds REAL, cause TEXT, lost INTEGER, checksum TEXT)",
)
COLUMNS = ("hash", "origin", "test", "inputs", "names", "force", "sensitivities", "facts", "seconds", "cause", "lost")
NO_TEXT = ("force", "sensitivities", "seconds", "lost")  # columns that are not stored as text


class Row(NamedTuple):
    """The columns of one run in SQLite; text is read as bytes, because damaged text need not be UTF-8."""

    hash: bytes
    origin: bytes
    test: bytes
    inputs: bytes
    names: bytes
    force: bytes | None
    sensitivities: bytes | None
    facts: bytes
    seconds: float
    cause: bytes | None
    lost: int


class Stored(NamedTuple):
    """One row of the file: its number, its columns, and the checksum that was written with them."""

    number: int
    row: Row
    checksum: bytes

    @property
    def run(self) -> Run | None:
        """The Run of the row; None where the row fails its checksum."""
        return _run(self.row) if self.checksum == checksum(self.row).encode() else None


def stored(file: sqlite3.Connection) -> list[Stored]:
    """All rows in the order of their writing."""
    rows = file.execute(f"SELECT id, {', '.join(COLUMNS)}, checksum FROM runs ORDER BY id").fetchall()
    return [Stored(number, Row(*columns), written) for number, *columns, written in rows]


def row_of(key: str, origin: str, test: str, inputs: Mapping[str, Any], run: Run) -> Row:
    """The columns of a run of a test; `key` is the hash of the run's inputs."""
    names, given = sorted(run.sensitivities or ()), run.sensitivities
    return Row(
        hash=key.encode(),
        origin=origin.encode(),
        test=test.encode(),
        inputs=as_json(inputs).encode(),
        names=as_json(names).encode(),
        force=None if run.force is None else _bytes(run.force),
        sensitivities=None if given is None else b"".join(_bytes(given[name]) for name in names),
        facts=as_json(run.facts).encode(),
        seconds=float(run.seconds),
        cause=None if run.cause is None else run.cause.encode("utf-8", "replace"),
        lost=int(run.lost),
    )


def insert(file: sqlite3.Connection, row: Row) -> None:
    """Write a row with its checksum."""
    places = ", ".join("?" if name in NO_TEXT else "CAST(? AS TEXT)" for name in COLUMNS)
    file.execute(f"INSERT INTO runs ({', '.join(COLUMNS)}, checksum) VALUES ({places}, ?)", (*row, checksum(row)))


def checksum(columns: Sequence[Any]) -> str:
    """SHA-256 of values with their types and lengths, so that no two rows give the same text."""
    digest = hashlib.sha256()
    for value in columns:
        if isinstance(value, float):
            part = b"F" + struct.pack("<d", value)
        else:
            part = b"B" + value if isinstance(value, bytes) else repr(value).encode()
        digest.update(len(part).to_bytes(8, "little") + part)
    return digest.hexdigest()


def _run(row: Row) -> Run:
    force = None if row.force is None else _numbers(row.force)
    cause = None if row.cause is None else row.cause.decode()
    return Run(force, cause, row.seconds, json.loads(row.facts), _derivatives(row), bool(row.lost))


def _derivatives(row: Row) -> dict[str, Array] | None:
    if row.sensitivities is None:
        return None
    names = json.loads(row.names)
    return dict(zip(names, _numbers(row.sensitivities).reshape(len(names), -1) if names else (), strict=True))


def _bytes(array: Array) -> bytes:
    return np.ascontiguousarray(array, dtype="<f8").tobytes()


def _numbers(blob: bytes) -> Array:
    return np.frombuffer(blob, dtype="<f8").astype(float)
