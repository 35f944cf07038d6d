"""Text of a file's bytes, in the encodings that instruments' programs write."""

from __future__ import annotations

import codecs
import re
from pathlib import Path

from indentfit.errors import RecordError

BYTE_ORDER_MARKS = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
CYRILLIC = (  # Russian, Ukrainian, Bulgarian
    "время", "перемещение", "сила", "нагрузка", "усилие", "деформация", "глубина", "час", "переміщення", "зусилля",
    "навантаження", "деформація", "глибина", "време", "преместване", "натоварване", "дълбочина",
)  # fmt: skip
TELLING = {  # words of headers, by which an encoding is told from others that decode the bytes too
    "cp932": ("時間", "変位", "荷重", "試験力", "ストローク", "秒"),
    "cp949": ("시간", "변위", "하중"),
    "cp1251": CYRILLIC,
    "cp866": CYRILLIC,  # of programs for DOS
    "koi8-u": CYRILLIC,
}
LOOKED_AT = 4000  # bytes


def decoded(raw: bytes, encoding: str | None = None, path: str | Path = "text") -> str:
    """Text of a file's bytes: by byte-order mark, as UTF-16 without one, as UTF-8, by its words, as GBK, or else as Latin-1.

    A letter beyond ASCII is two bytes above 127 in GBK, and one byte in Latin-1.

    Parameters
    ----------
    raw : bytes
    encoding : str or None
        The encoding, where it is known.
    path : path
        The file, for messages.

    Returns
    -------
    str

    Raises
    ------
    RecordError
        The given encoding is unknown, or the bytes are not text in it.
    """
    marked = next((name for mark, name in BYTE_ORDER_MARKS.items() if raw.startswith(mark)), None)
    for name in [encoding] if encoding else [marked] if marked else _likely(raw):
        try:
            return raw.decode(name)
        except LookupError:
            raise RecordError(
                f"{path}: record.encoding = {encoding!r} is not an encoding; try utf-8, utf-16, gbk or latin-1"
            ) from None
        except UnicodeDecodeError:
            continue
    raise RecordError(f"{path}: not text in {encoding or marked}; give record.encoding (utf-8, utf-16, gbk, latin-1)")


def _likely(raw: bytes) -> list[str]:
    """Encodings to try on bytes without a byte-order mark, in this order."""
    start = raw[:LOOKED_AT]
    if start and start.count(0) > 0.2 * len(start):
        return ["utf-16-le" if start[1:200:2].count(0) > start[0:200:2].count(0) else "utf-16-be"]
    pairs = all(len(run) % 2 == 0 for run in re.findall(rb"[\x81-\xfe]+", raw))
    return ["utf-8", *_by_words(start), *(["gb18030"] if pairs else []), "latin-1"]


def _by_words(start: bytes) -> list[str]:
    """Encodings in which the beginning of a file has at least two words of their headers."""
    texts = {name: start.decode(name, errors="ignore").casefold() for name in TELLING}
    return [name for name, words in TELLING.items() if sum(word in texts[name] for word in words) >= 2]
