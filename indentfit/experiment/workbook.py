"""The sheet of a workbook, read in a process of its own.

A few kilobytes of a workbook can ask for any amount of memory (a zip bomb, a cell in the last row and column, repeated rows),
and the parser ends its process when there is not enough. So that process is a small one with limits, and its end an error like
any other.
"""

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

from indentfit.errors import RecordError

MEMORY, SECONDS, UNPACKED = 2 << 30, 60, 500_000_000
PROCESSOR = 8  # seconds of the processor; 100,000 rows take a fifth of one
HOME = Path(__file__).parents[2]
REMEDY = "export the record as CSV"


def sheet_rows(path, sheet=None):
    """Rows of a sheet (name, number from 1, or None: the first), all of one width: numbers, truth values and text.

    Raises RecordError where the file is no workbook, has no such sheet, or asks for more than `MEMORY` bytes or `SECONDS`.
    """
    command = [sys.executable, "-P", "-m", __name__, os.path.abspath(path), json.dumps(sheet)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, [str(HOME), os.environ.get("PYTHONPATH")]))}
    try:
        done = subprocess.run(command, capture_output=True, timeout=SECONDS, env=environment)
    except subprocess.TimeoutExpired:
        raise RecordError(f"{path}: not read within {SECONDS} s, no usual workbook; {REMEDY}") from None
    except OSError as error:
        raise RecordError(f"{path}: no process can be started to read it ({error.strerror or error}); {REMEDY}") from error
    if done.returncode:
        within = f"{MEMORY >> 30} GB and {PROCESSOR} s"
        raise RecordError(f"{path}: cannot be read within {within}, no usual workbook, or damaged; {REMEDY}")
    said = json.loads(done.stdout)
    if "problem" in said:
        raise RecordError(f"{path}: {said['problem']}")
    return said["rows"]


# In the process of its own


def _main(path, sheet):
    _limit_memory()
    try:
        said = {"rows": _rows(path, json.loads(sheet))}
    except RecordError as error:
        said = {"problem": " ".join(str(error).split())}
    sys.stdout.buffer.write(json.dumps(said, default=str).encode())


def _limit_memory():
    try:
        import resource
    except ImportError:  # Windows
        return
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (PROCESSOR, PROCESSOR))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _rows(path, sheet):
    try:
        from python_calamine import CalamineError, CalamineWorkbook
    except ImportError:
        raise RecordError(f"workbooks need another package; pip install 'indentfit[xlsx]', or {REMEDY}") from None
    _refuse_bomb(path)
    try:
        book = CalamineWorkbook.from_path(path)
        names = book.sheet_names
        if isinstance(sheet, str) and sheet not in names:
            raise RecordError(f"record.sheet = {sheet!r}: no such sheet; it has {', '.join(names)[:200]}")
        if isinstance(sheet, int) and not 1 <= sheet <= len(names):
            raise RecordError(f"record.sheet = {sheet}: it has {len(names)} sheets, counted from 1")
        if not names:
            raise RecordError(f"a workbook without a sheet; {REMEDY}")
        name = sheet if isinstance(sheet, str) else names[(sheet or 1) - 1]
        return book.get_sheet_by_name(name).to_python(skip_empty_area=False)
    except (CalamineError, OSError) as error:
        raise RecordError(f"not a workbook that can be read ({str(error)[:200]}); {REMEDY}") from None


def _refuse_bomb(path):
    """Say at once what would else end after a minute. Sizes that lie are found out by the limits."""
    try:
        with zipfile.ZipFile(path) as file:
            size = sum(member.file_size for member in file.infolist())
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError):
        return  # no zip: for the parser to tell
    if size > UNPACKED:
        raise RecordError(f"{size / 1e9:.1f} GB unpacked, no usual workbook; {REMEDY}")


if __name__ == "__main__":
    _main(*sys.argv[1:])
