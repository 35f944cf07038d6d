"""What a line that is not TOML should be: the slips that people make, each with the line as it is right."""

import re
from collections.abc import Callable

KEY = r"(?P<key>[A-Za-z0-9_.-]+)"
NUMBER = r"[-+]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][-+]?\d+)?"
UNIT = r"[A-Za-zµμ%°][A-Za-z0-9µμ%°/^*.]*"
END = r"\s*(?:#.*)?$"
CURLY = str.maketrans("“”„«»‘’‚", '""""""' + '""')
Slip = Callable[[str], str | None]


def remedy(line: str) -> str | None:
    """What to write in place of a line that tomllib refuses; None where no slip is known."""
    return next((said for slip in SLIPS if (said := slip(line))), None)


def backslash_words(line: str) -> str | None:
    """The remedy for backslashes in a text, if there are any: TOML takes them for escapes, such as of a tab."""
    text = re.search(r'"([^"]*\\[^"]*)"', line)
    if text is None:
        return None
    slashes = text[1].replace("\\\\", "/").replace("\\", "/")
    return f"write paths with slashes, \"{slashes}\", or in single quotes, '{text[1]}'"


def not_printable(text: str) -> str:
    """What is wrong with a text that is empty or has characters that cannot be printed, such as those of escapes in a path."""
    escapes = {"\n": "n", "\t": "t", "\r": "r", "\b": "b", "\f": "f"}
    if not escapes.keys() & {*text} or not re.search(r"\.\w{1,5}$", text):  # no file's name
        return "must be printable text on one line"
    meant = "".join(f"/{escapes[letter]}" if letter in escapes else letter for letter in text).replace("\\", "/")
    return f'has a backslash, which in double quotes begins an escape; write "{meant}", or put the path in single quotes'


def _curly(line: str) -> str | None:
    right = line.translate(CURLY)
    return f"use straight quotes: {right}" if right != line else None


def _not_closed(line: str) -> str | None:
    bare = re.sub(r"\\.", "", line)
    if bare.count('"') % 2 and "'" not in bare:
        text = re.match(rf'\s*{KEY}\s*=\s*"(?P<text>[^"#]*?){END}', bare)
        return (
            f'close the quotes: {text["key"]} = "{text["text"].strip()}"' if text else "close the quotes, and no line break in them"
        )
    return None


def _colon(line: str) -> str | None:
    given = re.match(rf"\s*{KEY}\s*:\s*(?P<value>[^=]+?){END}", line)
    return f"write = and not a colon: {given['key']} = {_quoted(given['value'])}" if given else None


def _no_value(line: str) -> str | None:
    given = re.match(rf"\s*{KEY}\s*={END}", line)
    return f"give {given['key']} a value, or leave out the line" if given else None


def _comma(line: str) -> str | None:
    """A decimal comma, with or without a unit, or several of them in a table of a line."""
    given = re.match(rf"\s*{KEY}\s*=\s*(?P<number>[-+]?\d+,\d+)(?P<unit>\s*{UNIT})?{END}", line)
    if given:
        value = given["number"].replace(",", ".") + (given["unit"] or "").rstrip()
        return f"write a decimal point: {given['key']} = {_quoted(value)}"
    inner = re.search(r"=\s*[-+]?\d+,\d", line)
    if inner and "{" in line:
        right = re.sub(r"(=\s*[-+]?\d+),(\d)", r"\1.\2", line)
        return f"write decimal points: {right.strip()}"
    return None


def _unit(line: str) -> str | None:
    given = re.match(rf"\s*{KEY}\s*=\s*(?P<value>{NUMBER}\s*{UNIT}){END}", line)
    if given:
        return f'put a number with its unit in quotes: {given["key"]} = "{given["value"].strip()}"'
    right = re.sub(rf"(=\s*)({NUMBER} ?{UNIT})(\s*[,}}])", r'\1"\2"\3', line)
    return f"put numbers with their units in quotes: {right.strip()}" if right != line and "{" in line else None


def _number(line: str) -> str | None:
    given = re.match(rf"\s*{KEY}\s*=\s*(?P<sign>[-+]?)(?P<whole>\d*)\.(?P<part>\d*){END}", line)
    if given:
        return (
            f"write digits on both sides of the point: {given['key']} = {given['sign']}{given['whole'] or 0}.{given['part'] or 0}"
        )
    zeros = re.match(rf"\s*{KEY}\s*=\s*0+(?P<number>\d+(?:\.\d+)?){END}", line)
    return f"write the number without leading zeros: {zeros['key']} = {zeros['number']}" if zeros else None


def _word(line: str) -> str | None:
    """A text without quotes."""
    given = re.match(rf"\s*{KEY}\s*=\s*(?P<word>[^\W\d_][^\"'\[\]{{}}=#]*?|[\w./\\-]+\.\w+){END}", line)
    if given is None:
        return None
    word = given["word"].strip()
    if word.lower() in ("true", "false"):
        return f"write it in small letters: {given['key']} = {word.lower()}"
    if word.lower() in ("none", "null", "nan"):
        return f"leave out the line: a key that is not given has no value, and TOML has no {word}"
    return f"put text in quotes: {given['key']} = {_quoted(word)}"


def _semicolon(line: str) -> str | None:
    if "{" in line and ";" in line.partition("#")[0]:
        return f"part the values by commas: {line.partition('#')[0].replace(';', ',').strip()}"
    return None


def _heading(line: str) -> str | None:
    given = re.match(r"\s*(?P<open>\[\[?)\s*(?P<name>[A-Za-z_.]+)\s*(?P<close>\]{0,2})\s*(?:#.*)?$", line)
    if given and len(given["open"]) != len(given["close"]):
        return f"close the brackets: {given['open']}{given['name']}{']' * len(given['open'])}"
    return None


def _quoted(value: str) -> str:
    """A value as TOML writes it: a number as it is, everything else in quotes, and in single ones with backslashes."""
    value = value.strip()
    if re.fullmatch(r"[-+]?\d+(\.\d+)?([eE][-+]?\d+)?|true|false|[\"'\[{].*", value):
        return value
    return f"'{value}'" if "\\" in value else f'"{value}"'


SLIPS: tuple[Slip, ...] = (
    _curly, _not_closed, backslash_words, _heading, _colon, _no_value, _semicolon, _comma, _unit, _number, _word,
)  # fmt: skip
