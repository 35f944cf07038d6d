"""The tables of a TOML file, or the line that is no TOML with what it should be."""

import re
import tomllib
from pathlib import Path

from indentfit.case.messages import printable, short
from indentfit.case.overrides import Tree
from indentfit.case.slips import remedy
from indentfit.errors import CaseError


def tree_of(path: Path) -> Tree:
    """The tables of a TOML file, or CaseError with the line that is not TOML."""
    text = _text(path)
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise CaseError(f"{path}: nested too deep; a case file has tables and numbers only") from None
    except ValueError as error:
        number, content = _place(str(error), text)
        reason = str(error).split(" (at ")[0]
        wrong = f"not TOML ({short(reason)}); {remedy(text.split(chr(10))[number - 1]) or 'correct it'}"
        if re.match(r"Cannot (overwrite|declare|mutate)|Duplicate", reason):
            wrong = "this key or table is given twice; keep one of them"
        raise CaseError(printable(f"{path}: line {number}: {content}: {wrong}")) from None


def _text(path: Path) -> str:
    try:
        _require_file(path)
        return path.read_bytes().decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        number = error.object[: error.start].count(b"\n") + 1
        raise CaseError(f"{path}: line {number}: not UTF-8 text; save the file as UTF-8") from None
    except (OSError, ValueError) as error:
        raise CaseError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from None


def _require_file(path: Path) -> None:
    if path.is_dir():
        inside = path / "case.toml"
        raise CaseError(f"{path}: a folder; name the case file in it" + (f", {inside}" if inside.exists() else ""))
    if not path.exists():
        raise CaseError(f"{path}: no such file; `indentfit init DIR` writes a case to start from")
    if not path.is_file():
        raise CaseError(f"{path}: not a file; name a case file")


def _place(message: str, text: str) -> tuple[int, str]:
    """Number and text of the line that a message of tomllib is about."""
    rows = text.split("\n")
    at = re.search(r"at line (\d+)", message)
    number = int(at[1]) if at else max(n for n, row in enumerate(rows, 1) if row.strip() or n == 1)
    return number, short(rows[number - 1].strip())
