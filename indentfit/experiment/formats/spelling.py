"""Numbers with thousands' marks, decimal commas in quotes and times of a clock, spelled as plain numbers."""

from __future__ import annotations

import re

BEFORE, AFTER = r'(?<![^\t;"\n])[ ]*', r'(?=[ ]*(?:[\t;"\n]|$))'
POINTED = re.compile(rf"{BEFORE}([-+]?\d{{1,3}}(?:,\d{{3}})+\.\d+){AFTER}", re.M)  # 1,500.25
COMMAED = re.compile(rf"{BEFORE}([-+]?\d{{1,3}}(?:\.\d{{3}})+,\d+){AFTER}", re.M)  # 1.500,25
SPACED = re.compile(rf"{BEFORE}([-+]?\d{{1,3}}(?:[\u00a0\u2009\u202f'\u2019]\d{{3}})+(?:[.,]\d+)?){AFTER}", re.M)  # 1'500.25
QUOTED = re.compile(r'"([-+]?\d+(?:,\d+)+(?:[eE][-+]?\d+)?)"')  # "0,125" or "1,500" between commas
POINT = re.compile(r'(?<![\w.:/-])"?[-+]?\d*\.\d+(?:[eE][-+]?\d+)?"?(?=[\t;,\s]|$)')
CLOCK = re.compile(
    r"(?<![^\t;,\"\n])[ ]*(?:\d{4}-\d\d-\d\d[ T])?(?:(\d+):(\d\d):(\d\d(?:[.,]\d+)?)|(\d+):(\d\d\.\d+))(?=[ ]*(?:[\t;,\"\n]|$))",
    re.M,
)
CLOCKED = 0.5  # share of the lines that hold a time of the clock where the times of the samples are written so
LOOKED_AT = 200_000  # letters


def plain_numbers(text: str) -> str:
    """A text whose numbers have no thousands' marks, and no commas within quotes.

    A comma in quotes marks thousands where the text has decimal points, and decimals where it has none.
    """
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
    return CLOCK.sub(_seconds, text), True


def _without_commas(match: re.Match[str]) -> str:
    return match[0] if _is_a_line(match) else match[1].replace(",", "")


def _without_points(match: re.Match[str]) -> str:
    return match[0] if _is_a_line(match) else match[1].replace(".", "")


def _is_a_line(match: re.Match[str]) -> bool:
    """Whether a number is a whole line, which may be two columns: 1,500.25 is 1 and 500.25 between commas."""
    text, begin, end = match.string, match.start(), match.end()
    return text[begin - 1 : begin] in ("", "\n") and text[end : end + 1] in ("", "\n")


def _seconds(match: re.Match[str]) -> str:
    hours, minutes, seconds = (match[1] or "0", match[2], match[3]) if match[3] else ("0", match[4], match[5])
    return f"{3600 * int(hours) + 60 * int(minutes) + float(seconds.replace(',', '.')):.9g}"
