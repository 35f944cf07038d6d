"""What a file holds, to choose from: its tables or sheets, the tests in them, their loading cycles and segments."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from indentfit.arrays import Array, Ints
from indentfit.case import Record
from indentfit.errors import RecordError
from indentfit.experiment.formats.columns import records
from indentfit.experiment.loading import filtered, noise_of
from indentfit.experiment.reading import WORKBOOK, tables_of
from indentfit.experiment.record import RawRecord
from indentfit.experiment.selection import loading_cycles

MOVES = 0.3  # of the mean velocity, from which on the stage moves
RESTS = 0.03  # share of the travel that a segment at rest may cover
SHORTEST = 0.02  # share of the samples of a segment
SMOOTH = 0.01  # share of the samples that the filter covers


@dataclass(frozen=True)
class Segment:
    """A part of a record: its name (for `record.segment`), rows from 1, times s, direction, velocity mm/s and largest force mN."""

    name: str
    rows: tuple[int, int]
    times: tuple[float, float]
    direction: str
    velocity: float
    peak: float


@dataclass(frozen=True)
class Content:
    """A table of a file, or a test in it: number (for `record.block`), name, rows; what was taken, or why it is no record."""

    number: int
    name: str
    rows: int
    taken: str = ""
    problem: str = ""
    cycles: int = 0
    timed: bool = True
    segments: tuple[Segment, ...] = ()


def contents(path: str | Path, settings: Record | None = None) -> list[Content]:
    """The `Content`s of a file, in its order: each table, and each test of a table that holds several.

    Parameters
    ----------
    path : path
    settings : Record

    Returns
    -------
    list of Content

    Raises
    ------
    RecordError
        The file cannot be read.
    """
    path, settings = Path(path), settings or Record()
    every = {"block": "all", "sheets": "all"} if WORKBOOK.reads(path) else {"block": "all"}
    tables, settings, _ = tables_of(path, settings.model_copy(update=every))
    listed: list[Content] = []
    for n, table in enumerate(tables, start=1):
        try:
            tests = records(path, table, settings)
        except RecordError as error:
            listed.append(Content(n, table.name, len(table.values), problem=str(error).removeprefix(f"{path}: ")))
            continue
        listed += [_content(n, table.name, test) for test in tests]
    return listed


def _content(number: int, name: str, record: RawRecord) -> Content:
    cycles = len(loading_cycles(record))
    return Content(number, name, record.time.size, record.taken, "", cycles, record.timed, tuple(_segments(record)))


def _segments(record: RawRecord) -> Iterator[Segment]:
    """The segments of the file's own column, or those that the motion shows."""
    stages = np.asarray(record.stages, dtype=object) if record.stages is not None else None
    if stages is not None and len(set(stages.tolist())) > 1:
        edges = [0, *(np.flatnonzero(stages[1:] != stages[:-1]) + 1).tolist(), stages.size]
        names = [str(stages[begin]) for begin in edges[:-1]]
    else:
        edges = _turns(record.displacement)
        names = []
    velocities = [_velocity(record, begin, end) for begin, end in pairwise(edges)]
    rests = RESTS * float(np.ptp(record.displacement))
    for n, ((begin, end), velocity) in enumerate(zip(pairwise(edges), velocities, strict=True)):
        moved = abs(float(record.displacement[end - 1] - record.displacement[begin]))
        direction = "hold" if moved < rests else "approach" if velocity > 0 else "retract"
        name = names[n] if names else direction
        times = (float(record.time[begin]), float(record.time[end - 1]))
        yield Segment(name, (begin + 1, end), times, direction, velocity, float(record.force[begin:end].max()))


def _velocity(record: RawRecord, begin: int, end: int) -> float:
    duration = float(record.time[end - 1] - record.time[begin])
    return float(record.displacement[end - 1] - record.displacement[begin]) / duration if duration > 0 else 0.0


def _turns(displacement: Array) -> list[int]:
    """Edges of the segments in which the stage goes forward, rests or goes back."""
    size = displacement.size
    if size < 20:
        return [0, size]
    length = max(5.0, SMOOTH * size)
    velocity = np.gradient(filtered(displacement, length))
    least = max(MOVES * float(np.mean(np.abs(velocity))), 3 * noise_of(displacement) / length**1.5)
    state = np.sign(velocity) * (np.abs(velocity) > least)
    edges: Ints = np.flatnonzero(np.diff(state)) + 1
    bounds = [0, *edges.tolist(), size]
    kept = [begin for begin, end in pairwise(bounds) if end - begin >= SHORTEST * size]
    merged = [begin for n, begin in enumerate(kept) if n == 0 or state[begin] != state[kept[n - 1]]]
    return [0, *merged[1:], size]
