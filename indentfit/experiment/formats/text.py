"""Records in text files: columns of numbers with separators or of fixed width, as instruments' programs export them.

The separator, the decimal mark, the encoding and the rows of the header are recognised from the file; NumPy parses the numbers.
Lines of text between the numbers begin another table where they hold a header or are two or more; a lone line is left out.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Record
from indentfit.errors import RecordError
from indentfit.experiment.formats.encodings import decoded
from indentfit.experiment.formats.spelling import plain_numbers, plain_times, plain_units
from indentfit.experiment.formats.table import Table, joined_tables, long_tables
from indentfit.experiment.formats.words import is_stage

LINES_SEARCHED = 400  # the first row of numbers must be among them
LONGEST_NAME = 60  # letters of the name of a table
BINARY = 0.05  # share of zero bytes and control letters in the first bytes of a binary file
MISSING = (
    "", "nan", "na", "n/a", "null", "none", "#n/a", "#nv", "#value!", "#wert!", "#num!", "#zahl!", "#div/0!", "1.#qnan", "1.#ind",
)  # fmt: skip
MARKER = re.compile(
    r"<(?!/|end|data|info)([^<>]+)>$|\[([^\[\]]+)\]$"
    r"|#\s*segment:\s*(\w+)$|((?:test|segment|block|cycle|curve|specimen|prüfung|probe|sample|indent)\s*(?:no\.?|nr\.?|n)?\s*[:#]*\s*\d+)\b",
    re.I,
)
END = re.compile(r"\s*(?:<[^<>]*>|\[[^\[\]]*\]|end\b.*)\s*$", re.I)  # the end of a block, which nobody needs to be told of
LISTED = re.compile(r"\W*(?:sig(?:nal)?|col(?:umn)?|ch(?:annel)?)[ .#]*(\d{1,2})\s*[:=\t;,]\s*(.*\w.*)", re.IGNORECASE)
TOLD = re.compile(r"#\s*(columns|fancyNames|units):\s*(.*)$", re.IGNORECASE)
NAMED = re.compile(r'"([^"]*)"|(\S+)')
COMMENT = re.compile(r"^\s*(?:#+|%+|!+|//+)(?!\w*\d*$)")  # before a header, as programs write it
BEFORE_UNIT = re.compile(r"[^\[\](){}]*[\[({][^\[\](){}]*[\])}]")
GLUED = re.compile(r"^([^\W\d_][^\t;]*?)([-+]?\d+\.?\d*(?:[eE][-+]?\d+)?)$")
WAVES = re.compile(r"^WAVES(?:\s*/\w(?:=\S+)?)*\s+")
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?(nan|inf)", re.ASCII | re.IGNORECASE)
COMMA_NUMBER = re.compile(r"[-+]?(\d+(,\d+)?|,\d+)([eE][-+]?\d+)?", re.ASCII)
Form = tuple[str | None, re.Pattern[str]]  # the separator (None: blanks), and how a number is written
FORMS: list[Form] = [
    (separator, number)
    for separator in ("\t", ";", ",", "|", None)
    for number in (NUMBER, COMMA_NUMBER)
    if (separator, number) != (",", COMMA_NUMBER)
]


class TextFormat:
    """Text in columns. Every file that no other format recognises is read as text."""

    def reads(self, path: Path) -> bool:
        return True

    def tables(self, path: Path, settings: Record) -> list[Table]:
        raw = path.read_bytes()
        _refuse_binary(path, raw[:4000], settings.encoding)
        return text_tables(path, decoded(raw, settings.encoding, path), settings.skip_rows)


def _refuse_binary(path: Path, start: bytes, encoding: str | None) -> None:
    """Refuse bytes that are no text in any encoding, with what would read them."""
    control = sum(byte < 9 or 13 < byte < 27 for byte in start)
    zeros = start.count(0)
    utf = (
        encoding
        or start.startswith((b"\xff\xfe", b"\xfe\xff", b"\x00\x00\xfe\xff"))
        or (zeros > 0.2 * len(start) and control == zeros)
    )
    if start and control > BINARY * len(start) and not utf:
        raise RecordError(
            f"{path}: a binary file, not text; export it as text or CSV from the instrument's program, or, if it is of an atomic "
            "force microscope (JPK, Igor, Nanosurf, HDF5, NT-MDT), pip install 'indentfit[afm]'"
        )


@dataclass(frozen=True)
class _Lines:
    """The lines of a file, the form of their numbers, and the file for messages."""

    path: Path
    lines: list[str]
    form: Form


def text_tables(path: Path, text: str, skip_rows: int) -> list[Table]:
    """The `Table`s that a text holds, in their order.

    Parameters
    ----------
    path : path
        The file, for messages.
    text : str
    skip_rows : int
        Lines to skip.

    Returns
    -------
    list of Table

    Raises
    ------
    RecordError
        The text holds no table. The error's text is one line with the file and the remedy.
    """
    text, clock = plain_times(plain_numbers(text))
    lines = _plain_waves(text.splitlines())
    while lines and not lines[-1].strip():
        lines.pop()
    if not lines:
        raise RecordError(f"{path}: the file is empty; it needs columns of displacement and force")
    first, form = _begin(lines, skip_rows)
    if first is None:
        lines = plain_units(lines)
        first, form = _begin(lines, skip_rows)
    if first is None:
        raise RecordError(
            f"{path}: no rows of numbers within {LINES_SEARCHED} lines; export columns of text, or give record.skip_rows"
        )
    tables = [replace(table, clock=clock) for table in _tables(_Lines(path, lines, form), skip_rows, first)]
    return long_tables([part for table in joined_tables(tables) for part in table.side_by_side()])


def _plain_waves(lines: list[str]) -> list[str]:
    """The lines of an Igor text without its commands: WAVES and flags stand before the names, tabs before the numbers."""
    if not lines or lines[0].strip() != "IGOR":
        return lines
    return [WAVES.sub("", line.strip()) for line in lines if not line.startswith("X ")]


def _begin(lines: list[str], skip_rows: int) -> tuple[int | None, Form]:
    """Index of the first row of numbers, None where there is none, and the form of the numbers."""
    rows = _searched(lines, 0, skip_rows)
    fits = [(_first_numbers(rows, skip_rows, form), form) for form in FORMS]
    (first, _), form = min(fits, key=lambda fit: fit[0])  # the first of equals
    return (None if first == len(rows) else first), form


def _searched(lines: list[str], begin: int, skip: int = 0) -> list[str | None]:
    """The lines from `begin` on among which the first row of numbers is searched for; None for an empty line."""
    return [line if line.strip() else None for line in lines[begin : begin + skip + LINES_SEARCHED]]


def _first_numbers(rows: list[str | None], skip_rows: int, form: Form) -> tuple[int, int]:
    """Index of the first row of numbers, read in a form, and how many of its cells are not numbers.

    The index is the number of rows where none is a row of numbers.
    """
    separator, number = form
    kinds = [tuple(bool(number.fullmatch(cell)) for cell in _cells(row, separator)) for row in rows if row is not None]
    places = [n for n, row in enumerate(rows) if row is not None]
    for n, (place, kind) in enumerate(zip(places, kinds, strict=True)):
        following = kinds[n : n + 20]
        if place >= skip_rows and sum(kind) >= 2 and following.count(kind) >= 0.8 * len(following):
            return place, kind.count(False)
    return len(rows), 0


def _tables(file: _Lines, begin: int, first: int) -> Iterator[Table]:
    """The tables from line `begin` on, of which the first has its first numbers at index `first`."""
    above = tuple(file.lines[begin:first])
    while True:
        stop, after = _extent(file, first)
        own = tuple(file.lines[begin:first])
        yield _table(file, own, first, stop, above if begin == 0 else above + own)
        begin = stop
        if after is None:
            return
        first = after


def _extent(file: _Lines, first: int) -> tuple[int, int | None]:
    """Index after the last row of the table whose numbers begin at `first`, and of the first row of the next table, if any."""
    separator, number = file.form
    kind = tuple(bool(number.fullmatch(cell)) for cell in _cells(file.lines[first], separator))
    try:
        _parsed(_filled(file.lines[first:]), file.form, list(kind))
        return len(file.lines), None
    except ValueError:
        pass
    return _interrupted(file, first, kind)


def _filled(lines: list[str]) -> list[str]:
    return [line for line in lines if line.strip()]


def _interrupted(file: _Lines, first: int, kind: tuple[bool, ...]) -> tuple[int, int | None]:
    """`_extent` of a table whose rows are interrupted by lines of text."""
    place = first
    while place < len(file.lines):
        text = _text_from(file, place, kind)
        if text is None:
            place += 1
            continue
        begins_another = text - place > 1 or len(_cells(file.lines[place], file.form[0])) == len(kind) > 1
        if begins_another:
            rows = _searched(file.lines, place)
            next_first, _ = _first_numbers(rows, 0, file.form)
            return place, (place + next_first if next_first < len(rows) else None)
        place = text
    return len(file.lines), None


def _text_from(file: _Lines, place: int, kind: tuple[bool, ...]) -> int | None:
    """Index after the lines of text that begin at `place`; None where the line is a row of numbers, or empty."""
    line = file.lines[place]
    if not line.strip() or _is_row(line, file.form, kind):
        return None
    if _has_numbers(line, file.form) and not _text_follows(file, place, kind):
        return None  # a faulty row: what is wrong with it is said where the rows are read
    after = place
    while after < len(file.lines) and file.lines[after].strip() and not _is_row(file.lines[after], file.form, kind):
        after += 1
    return after


def _text_follows(file: _Lines, place: int, kind: tuple[bool, ...]) -> bool:
    following = file.lines[place + 1 : place + 2]
    return bool(following) and bool(following[0].strip()) and not _is_row(following[0], file.form, kind)


def _has_numbers(line: str, form: Form) -> bool:
    return any(form[1].fullmatch(cell) for cell in _cells(line, form[0]))


def _is_row(line: str, form: Form, kind: tuple[bool, ...]) -> bool:
    """Whether a line has a number, or nothing, in each column of numbers."""
    cells = _cells(line, form[0])
    if len(cells) != len(kind):
        return False
    numbers = [cell for cell, numeric in zip(cells, kind, strict=True) if numeric]
    held = [bool(form[1].fullmatch(cell)) for cell in numbers]
    return any(held) and all(good or cell.strip("-").lower() in MISSING for good, cell in zip(held, numbers, strict=True))


def _table(file: _Lines, above: tuple[str, ...], first: int, stop: int, context: tuple[str, ...]) -> Table:
    """The Table of lines whose numbers begin at index `first`; a last line that is cut off, and lone text, are left out."""
    separator, number = file.form
    body = file.lines[first:stop]
    kind = tuple(bool(number.fullmatch(cell)) for cell in _cells(body[0], separator))
    header, glued = _header(above, separator, len(kind))
    notes: tuple[str, ...] = ()
    filled = [n for n, line in enumerate(body) if line.strip()]
    last = body[filled[-1]]
    cut = _has_numbers(last, file.form) and len(_cells(last, separator)) < len(kind)
    if len(filled) > 1 and stop == len(file.lines) and cut:
        body = body[: filled[-1]]
        notes = ("the last line is cut off and was left out",)
    kept, lone = _without_lone_text(body, file.form, kind)
    values = _numbers(file.path, kept, file.form, first, kind)
    if glued is not None:
        values = np.vstack([glued, values])
    notes = (
        *notes,
        *(
            f"line {first + n + 1} ({line.strip()[:20]!r}) holds no numbers and was left out"
            for n, line in lone[:3]
            if not END.match(line)
        ),
    )
    texts = _stage_words(kept, header, separator, kind, 0 if glued is None else 1)
    return Table(header, values, first + 1, notes, _marker(above), texts, context)


def _header(above: tuple[str, ...], separator: str | None, width: int) -> tuple[list[list[str]], Array | None]:
    """The rows of text above a table, and the values of its first row where these are glued to the last row of text."""
    rows = [_names(COMMENT.sub("", row).strip(" "), separator, width) for row in above if row.strip()]
    if rows and len(rows[-1]) == 2 * width - 1 and (match := GLUED.match(rows[-1][width - 1])):
        names, values = [*rows[-1][: width - 1], match[1]], [match[2], *rows[-1][width:]]
        return [*rows[:-1], names], np.array([[float(cell) if NUMBER.fullmatch(cell) else np.nan for cell in values]])
    if told := _told(above, width):
        return [*rows, *told], None
    listed = _listed(above)
    return (rows if len(listed) != width or any(len(row) == width for row in rows[-2:]) else [*rows, listed]), None


def _names(row: str, separator: str | None, width: int) -> list[str]:
    """The cells of a row of text; names of several words between blanks are parted by two blanks, or by their units."""
    cells = _cells(row, separator)
    if separator is None and len(cells) != width:
        for parted in (re.split(r"\s{2,}", row.strip()), BEFORE_UNIT.findall(row)):
            if len(parted) == width:
                return [cell.strip() for cell in parted]
    return cells


def _told(above: tuple[str, ...], width: int) -> list[list[str]]:
    """The rows of names and units that lines such as `# columns: height vDeflection` and `# units: m N` tell; or nothing."""
    rows = {}
    for line in above:
        if match := TOLD.match(line.strip()):
            rows[match[1].casefold()] = [name or bare for name, bare in NAMED.findall(match[2])]
    names = rows.get("fancynames", rows.get("columns", []))
    return [row for row in (names, rows.get("units", [])) if len(row) == width] if len(names) == width else []


def _listed(above: tuple[str, ...]) -> list[str]:
    """The names of columns that lines of their own list, as `Sig1 <tab> Time (min)` or `# Column 2: Force (nN)`; or nothing."""
    named = {int(match[1]): match[2].strip().strip('"') for line in above if (match := LISTED.match(line.strip()))}
    return [named[n] for n in sorted(named)] if sorted(named) == list(range(1, len(named) + 1)) else []


def _marker(above: tuple[str, ...]) -> str:
    """The name of a table: that of the last line above it which marks a block, a test or a segment; empty where none does."""
    for line in reversed(above):
        match = MARKER.match(line.strip().strip('"'))
        if match:
            return next(group for group in match.groups() if group).strip()[:LONGEST_NAME]
    return ""


def _without_lone_text(body: list[str], form: Form, kind: tuple[bool, ...]) -> tuple[list[tuple[int, str]], list[tuple[int, str]]]:
    """The lines of a table with their indices, and the lone lines among them that hold no number at all."""
    filled = [(n, line) for n, line in enumerate(body) if line.strip()]
    lone = [
        (n, line) for n, line in filled if not line[:1].isdigit() and not _is_row(line, form, kind) and not _has_numbers(line, form)
    ]
    left_out = {n for n, _ in lone}
    return [(n, line) for n, line in filled if n not in left_out], lone


def _stage_words(
    body: list[tuple[int, str]], header: list[list[str]], separator: str | None, kind: tuple[bool, ...], glued: int
) -> dict[int, list[str]]:
    """Column -> its cells, for a column of words whose header names segments or stages."""
    names = next((row for row in reversed(header) if len(row) == len(kind)), [])
    places = [n for n, (name, numeric) in enumerate(zip(names, kind, strict=False)) if not numeric and is_stage(name)]
    cells = {place: [_cells(line, separator)[place] for _, line in body] for place in places}
    return {place: column[:1] * glued + column for place, column in cells.items()}


def _cells(row: str, separator: str | None) -> list[str]:
    return [cell.strip().strip('"').strip() for cell in row.strip(" \r\n").split(separator)]


def _numbers(path: Path, body: list[tuple[int, str]], form: Form, first: int, kind: tuple[bool, ...]) -> Array:
    """Values (rows, columns) of lines: by NumPy's parser, or line by line where cells are empty or hold no numbers."""
    separator, number = form
    try:
        return _parsed([line for _, line in body], form, list(kind))
    except ValueError:
        return np.array([_row(f"{path}: line {first + n + 1}", _cells(line, separator), number, list(kind)) for n, line in body])


def _parsed(body: list[str], form: Form, kind: list[bool]) -> Array:
    """Values of lines whose cells in columns of `kind` True are all numbers; ValueError where they are not."""
    separator, number = form
    text = "\n".join(body).replace('"', "")
    if number is COMMA_NUMBER:
        text = text.replace(",", ".")
    columns = np.flatnonzero(kind)
    numbers = np.loadtxt(io.StringIO(text), delimiter=separator, usecols=columns.tolist(), ndmin=2, comments=None)
    values = np.full((len(numbers), len(kind)), np.nan)
    values[:, columns] = numbers
    return values


def _row(where: str, cells: list[str], number: re.Pattern[str], kind: list[bool]) -> list[float]:
    """The values of one line; RecordError where it is too short or long, or holds a word among its numbers."""
    if len(cells) != len(kind):
        raise RecordError(f"{where}: {len(cells)} columns, the first row of numbers has {len(kind)}; correct or remove the line")
    wrong = [cell for cell, numeric in zip(cells, kind, strict=True) if numeric and cell and not number.fullmatch(cell)]
    wrong = [cell for cell in wrong if cell.strip("-").lower() not in MISSING]
    if wrong:
        raise RecordError(f"{where}: {wrong[0][:40]!r} is not a number; correct or remove the line")
    return [
        float(cell.replace(",", ".")) if numeric and number.fullmatch(cell) else np.nan
        for cell, numeric in zip(cells, kind, strict=True)
    ]
