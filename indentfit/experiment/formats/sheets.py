"""The rows of a workbook's sheet, read in a process of its own.

A few kilobytes of a workbook can demand any amount of memory (a zip bomb, a cell in the last row and column, repeated rows), and
the parser ends its process where memory runs out. The parser therefore runs in a small process with limits; the end of that process
is reported as a RecordError.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from collections.abc import Sequence
from datetime import date, time, timedelta
from pathlib import Path

from indentfit.errors import RecordError

MEMORY, SECONDS, UNPACKED = 2 << 30, 60, 500_000_000
PROCESSOR = 8  # seconds of the processor; 100,000 rows take a fifth of one
HOME = Path(__file__).parents[3]
EVERY = -1  # in place of the number of a sheet
REMEDY = "export the record as CSV"
Cell = str | int | float | bool
ParsedCell = Cell | date | time | timedelta  # of the parser; the last three become text


def sheet_rows(path: Path, sheet: str | int | None = None) -> list[list[Cell]]:
    """The rows of a sheet, all of one width: numbers, truth values and text ("" where a cell is empty).

    Parameters
    ----------
    path : path
    sheet : str, int or None
        Name of the sheet, or its number from 1; None is the first sheet.

    Returns
    -------
    list of rows

    Raises
    ------
    RecordError
        The file is not a workbook, has no such sheet, or needs more than `MEMORY` bytes, or `PROCESSOR` or `SECONDS` seconds.
    """
    return next(iter(_answer(path, sheet).values()))


def every_sheet(path: Path) -> dict[str, list[list[Cell]]]:
    """Name of each sheet of a workbook -> its rows, as `sheet_rows` gives them; RecordError as there."""
    return _answer(path, EVERY)


def _answer(path: Path, sheet: str | int | None) -> dict[str, list[list[Cell]]]:
    """Name -> rows of the sheets that are asked for."""
    finished = _parsed_elsewhere(path, sheet)
    if finished.returncode:
        limits = f"{MEMORY >> 30} GB and {PROCESSOR} s"
        raise RecordError(f"{path}: cannot be read within {limits}, so the workbook is damaged or extraordinary; {REMEDY}")
    answer = json.loads(finished.stdout)
    if "problem" in answer:
        raise RecordError(f"{path}: {answer['problem']}")
    return answer["sheets"]


def _parsed_elsewhere(path: Path, sheet: str | int | None) -> subprocess.CompletedProcess[bytes]:
    """The ended process that parsed the sheet; its output is JSON."""
    command = [sys.executable, "-P", "-m", __name__, os.path.abspath(path), json.dumps(sheet)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, [str(HOME), os.environ.get("PYTHONPATH")]))}
    try:
        return subprocess.run(command, capture_output=True, timeout=SECONDS, env=environment)
    except subprocess.TimeoutExpired:
        raise RecordError(f"{path}: not read within {SECONDS} s, so the workbook is no ordinary one; {REMEDY}") from None
    except OSError as error:
        raise RecordError(f"{path}: no process can be started to read it ({error.strerror or error}); {REMEDY}") from error


# What follows runs in the process of its own


def _main(path: str, sheet: str) -> None:
    _limit_memory()
    answer: dict[str, dict[str, Sequence[Sequence[ParsedCell]]] | str]
    try:
        answer = {"sheets": _sheets(path, json.loads(sheet))}
    except RecordError as error:
        answer = {"problem": " ".join(str(error).split())}
    sys.stdout.buffer.write(json.dumps(answer, default=str).encode())


def _limit_memory() -> None:
    try:
        import resource
    except ImportError:  # Windows
        return
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (PROCESSOR, PROCESSOR))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _sheets(path: str, sheet: str | int | None) -> dict[str, Sequence[Sequence[ParsedCell]]]:
    """Name -> rows of the sheets by python-calamine; RecordError where there are none."""
    try:
        from python_calamine import CalamineError, CalamineWorkbook
    except ImportError:
        raise RecordError(f"workbooks need another package; pip install 'indentfit[xlsx]', or {REMEDY}") from None
    _refuse_bomb(path)
    try:
        book = CalamineWorkbook.from_path(path)
        names = book.sheet_names if sheet == EVERY else [_sheet_name(book.sheet_names, sheet)]
        return {name: book.get_sheet_by_name(name).to_python(skip_empty_area=False) for name in names}
    except (CalamineError, OSError) as error:
        raise RecordError(f"not a workbook that can be read ({str(error)[:200]}); {REMEDY}") from None


def _sheet_name(names: list[str], sheet: str | int | None) -> str:
    """The name of the sheet that is asked for, of those that the workbook has."""
    if isinstance(sheet, str) and sheet not in names:
        raise RecordError(f"record.sheet = {sheet!r}: no such sheet; the workbook has {', '.join(names)[:200]}")
    if isinstance(sheet, int) and not 1 <= sheet <= len(names):
        raise RecordError(f"record.sheet = {sheet}: the workbook has {len(names)} sheets, counted from 1")
    if not names:
        raise RecordError(f"the workbook has no sheet; {REMEDY}")
    return sheet if isinstance(sheet, str) else names[(sheet or 1) - 1]


def _refuse_bomb(path: str) -> None:
    """Refuse at once a file that the limits would stop only after a minute; a file that understates its size meets the limits."""
    try:
        with zipfile.ZipFile(path) as file:
            size = sum(member.file_size for member in file.infolist())
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError):
        return  # not a zip: the parser says what is wrong
    if size > UNPACKED:
        raise RecordError(f"{size / 1e9:.1f} GB unpacked, so the workbook is no ordinary one; {REMEDY}")


if __name__ == "__main__":
    _main(*sys.argv[1:])
