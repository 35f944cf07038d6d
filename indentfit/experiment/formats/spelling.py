"""Numbers with thousands' marks, decimal commas in quotes and times of a clock, spelled as plain numbers."""

from __future__ import annotations

import re
from datetime import date
from itertools import zip_longest

from indentfit.experiment.formats.words import unit_in

BEFORE, AFTER = r'(?<![^\t;"\n])[ ]*', r'(?=[ ]*(?:[\t;"\n]|$))'
POINTED = re.compile(rf"{BEFORE}([-+]?\d{{1,3}}(?:,\d{{3}})+\.\d+){AFTER}", re.M)  # 1,500.25
COMMAED = re.compile(rf"{BEFORE}([-+]?\d{{1,3}}(?:\.\d{{3}})+,\d+){AFTER}", re.M)  # 1.500,25
SPACED = re.compile(rf"{BEFORE}([-+]?\d{{1,3}}(?:[\u00a0\u2009\u202f'\u2019]\d{{3}})+(?:[.,]\d+)?){AFTER}", re.M)  # 1'500.25
QUOTED = re.compile(r'"([-+]?\d+(?:,\d+)+(?:[eE][-+]?\d+)?)"')  # "0,125" or "1,500" between commas
FORTRAN = re.compile(r"(?<![\w.])([-+]?(?:\d+\.\d*|\.\d+))[dD]([-+]?\d{1,3})(?![\w.])")  # 0.125D+01
POINT = re.compile(r'(?<![\w.:/-])"?[-+]?\d*\.\d+(?:[eE][-+]?\d+)?"?(?=[\t;,\s]|$)')
CLOCK = re.compile(
    r"(?<![^\t;,\"\n])[ ]*(?:(\d{1,4})([-./])(\d\d?)\2(\d{1,4})[ T]+)?"
    r"(?:(\d+):(\d\d):(\d\d(?:[.,]\d+)?)|(\d+):(\d\d\.\d+))(?:[ ]*([AaPp])\.?[Mm]\.?|Z|[-+]\d\d:?\d\d)?"
    r"(?=[ ]*(?:[\t;,\"\n]|$))",
    re.M,
)
DECIMAL_COMMA, DECIMAL_POINT = (re.compile(rf"[;\t]\s*[-+]?\d*{mark}\d+\s*(?:[;\t\n]|$)", re.M) for mark in (",", r"\."))
ORDERS = ((0, 1, 2), (2, 1, 0), (2, 0, 1))  # places of year, month and day in a date
DAY, HALF = 86400, 43200  # s
MEASURED = re.compile(r"([-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][-+]?\d+)?)\s?([^\W\d_]{1,4})")
CLOCKED = 0.5  # share of the lines that hold a time of the clock where the times of the samples are written so
LOOKED_AT = 200_000  # letters


def plain_numbers(text: str) -> str:
    """A text whose numbers have no thousands' marks, and no commas within quotes.

    A comma in quotes marks thousands where the text has decimal points, and decimals where it has none.
    """
    text = FORTRAN.sub(r"\1e\2", text)
    text = SPACED.sub(lambda match: re.sub(r"[\u00a0\u2009\u202f'\u2019]", "", match[1]), text)
    if "," in text:
        text = POINTED.sub(_without_commas, text)
        text = COMMAED.sub(_without_points, text)
    if not QUOTED.search(text[:LOOKED_AT]):
        return text
    mark = "" if POINT.search(QUOTED.sub("", text[:LOOKED_AT])) else "."
    return QUOTED.sub(lambda match: match[1].replace(",", mark if match[1].count(",") == 1 else ""), text)


def plain_times(text: str) -> tuple[str, bool]:
    """A text with the times of the clock in seconds, and whether its samples have such times."""
    start = text[:LOOKED_AT]
    if ":" not in start or len(CLOCK.findall(start)) < CLOCKED * max(start.count("\n"), 1):
        return text, False
    commas = bool(DECIMAL_COMMA.search(start)) and not DECIMAL_POINT.search(start)
    return CLOCK.sub(_Clock(text, "," if commas else "."), text), True


def plain_units(lines: list[str]) -> list[str]:
    """Lines whose cells hold a number with its unit, as "0.123 N", with the numbers alone and a row of the units above them.

    The lines themselves, where they have no such cells, or where a column has several units.
    """
    for separator in ("\t", ";", ","):
        rows = [[cell.strip().strip('"').strip() for cell in line.split(separator)] for line in lines]
        units = [[_unit_of_cell(cell) for cell in row] for row in rows]
        held = [n for n, row in enumerate(units) if sum(unit is not None for unit in row) >= 2]
        if len(held) < CLOCKED * len(lines):
            continue
        columns = [{unit for unit in column if unit} for column in zip_longest(*(units[n] for n in held))]
        if any(len(names) > 1 for names in columns):
            return lines
        above = separator.join(next(iter(names), "") for names in columns)
        plain = [separator.join(_number_of_cell(cell) for cell in row) for row in rows]
        return [*lines[: held[0]], above, *plain[held[0] :]]
    return lines


def _unit_of_cell(cell: str) -> str | None:
    match = MEASURED.fullmatch(cell)
    return unit_in(match[2]) if match else None


def _number_of_cell(cell: str) -> str:
    match = MEASURED.fullmatch(cell)
    return match[1] if match and unit_in(match[2]) else cell


def _without_commas(match: re.Match[str]) -> str:
    return match[0] if _is_a_line(match) else match[1].replace(",", "")


def _without_points(match: re.Match[str]) -> str:
    return match[0] if _is_a_line(match) else match[1].replace(".", "")


def _is_a_line(match: re.Match[str]) -> bool:
    """Whether a number is a whole line, which may be two columns: 1,500.25 is 1 and 500.25 between commas."""
    text, begin, end = match.string, match.start(), match.end()
    return text[begin - 1 : begin] in ("", "\n") and text[end : end + 1] in ("", "\n")


class _Clock:
    """Times of a clock as seconds, from the first day on: past midnight they go on, by their dates or without.

    mark : the decimal mark of the other numbers of the file.
    """

    def __init__(self, text: str, mark: str) -> None:
        self.mark = mark
        dates = list(dict.fromkeys((match[1], match[3], match[4]) for match in CLOCK.finditer(text) if match[2]))
        orders = [days for order in ORDERS if (days := _days(dates, order)) is not None]
        # 3/4/2024 is of March or of April: of two orders that which makes the test the shorter is the right one
        self.days = min(orders, key=lambda days: max(days) - min(days)) if dates and orders else []
        self.day = dict(zip(dates, self.days, strict=False))
        self.past, self.last = 0, 0.0

    def __call__(self, match: re.Match[str]) -> str:
        """The text of the seconds of a match of CLOCK."""
        hours, minutes, seconds = (match[5], match[6], match[7]) if match[7] else ("0", match[8], match[9])
        hour = int(hours) % 12 + 12 * (match[10] in "Pp") if match[10] else int(hours)
        time = 3600 * hour + 60 * int(minutes) + float(seconds.replace(",", "."))
        day = self.day.get((match[1], match[3], match[4]))
        if day is None:
            self.past += time < self.last - HALF
            self.last = time
        days = self.past if day is None else day - self.days[0]
        return f"{DAY * days + time:.12g}".replace(".", self.mark)


def _days(dates: list[tuple[str, str, str]], order: tuple[int, int, int]) -> list[int] | None:
    """The numbers of the days of dates whose parts are year, month and day in an order; None where one is no date."""
    try:
        return [date(*(int(parts[place]) for place in order)).toordinal() for parts in dates]
    except ValueError:
        return None
