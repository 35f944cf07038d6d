"""The runs that another process has written to its ledger so far, read without its lock: to be shown, and for nothing else.

The reader must be a process of its own: a process that closes a file gives up its locks on it, also those of its other connections.
"""

from __future__ import annotations

import contextlib
import json
import sqlite3
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from indentfit.arrays import Array
from indentfit.runs import rows


@dataclass(frozen=True, eq=False)
class SeenRun:
    """A run of another process.

    Attributes
    ----------
    number : int
        Its row in the ledger.
    test : str
    inputs : dict
        What decides the run: "parameters", "depths" and changed inputs.
    depths, force : array (n,), mm and mN
        Empty where the run has no forces.
    seconds : float
    cause : str or None
        Why the run has no forces.
    """

    number: int
    test: str
    inputs: dict[str, Any]
    depths: Array
    force: Array
    seconds: float
    cause: str | None


def runs_so_far(path: Path, after: int = 0) -> list[SeenRun]:
    """The runs in a ledger with a row number above `after`, in their order; none where nothing can be read at this moment.

    Parameters
    ----------
    path : path of the ledger
    after : int
    """
    if not path.is_file():
        return []
    try:
        # immutable: no lock is asked for. A row that is being written fails to be read, or fails its checksum, and comes next time.
        uri = f"{path.resolve().as_uri()}?mode=ro&immutable=1"
        with contextlib.closing(sqlite3.connect(uri, uri=True, timeout=0, isolation_level=None)) as file:
            file.text_factory = bytes
            file.execute("PRAGMA trusted_schema = OFF")
            return list(_seen(rows.stored(file), after))
    except (sqlite3.Error, ValueError, OSError):
        return []


def _seen(stored: list[rows.Stored], after: int) -> Iterator[SeenRun]:
    for row in stored:
        if row.number <= after:
            continue
        run = row.run
        if run is None:
            return  # a half-written row, and perhaps those after it
        inputs = json.loads(row.row.inputs)
        depths, force = np.array(inputs.get("depths", []), dtype=float), np.zeros(0) if run.force is None else run.force
        force = force[: depths.size]  # displacements that were seen come behind the forces
        yield SeenRun(row.number, row.row.test.decode(), inputs, depths, force, run.seconds, run.cause)
