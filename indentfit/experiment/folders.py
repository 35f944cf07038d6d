"""Folders of records: which of their files are taken for records."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from indentfit.errors import RecordError

BESIDE = frozenset({".gif", ".htm", ".html", ".jpeg", ".jpg", ".json", ".m", ".md", ".pdf", ".png", ".py", ".rst", ".svg", ".toml"})


def record_files(sources: Iterable[str | Path]) -> Iterator[str | Path]:
    """The sources, with a folder's files in the folder's place.

    The files of a folder are taken in the order of their names, without those of folders in it. Hidden files, settings, texts,
    programs and pictures are left out (suffixes in BESIDE), and what is left and is no record is named when it is read.

    Raises
    ------
    RecordError
        A folder has no file that may be a record.
    """
    for source in sources:
        if not Path(source).is_dir():
            yield source
            continue
        files = [file for file in sorted(Path(source).iterdir()) if file.is_file() and _may_be_record(file)]
        if not files:
            raise RecordError(f"{source}: a folder without files that may be records; name the files, or another folder")
        yield from files


def _may_be_record(file: Path) -> bool:
    return not file.name.startswith(".") and file.suffix.lower() not in BESIDE
