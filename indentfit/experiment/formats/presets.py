"""Presets: small files that say how the records of an instrument are recognised and read.

A preset is a TOML file:

    name = "Biomomentum Mach-1"
    match = ["<Mach-1"]             # texts that the beginning of the instrument's files holds, all of them
    any = ["<DATA>", "<divider>"]   # texts of which it holds at least one
    skip = ["Find Contact"]         # names of tables that are no records of a sample
    [record]                        # keys of the table [record], used where the case does not set them
    displacement = { column = "Position (z)" }

A lab's own preset is a file NAME.preset.toml beside its records, or a file in a folder that a package offers as an entry point of
the group `indentfit.formats` (a path, or a function that gives one).
"""

from __future__ import annotations

import functools
import importlib.metadata
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from indentfit.case import Record
from indentfit.errors import CaseError, RecordError

GROUP = "indentfit.formats"
ENDING = ".preset.toml"
OWN = Path(__file__).parent / "presets"
KEYS = {"name", "match", "any", "skip", "record"}
LOOKED_AT = 6000  # letters of a file in which the texts of `match` are searched for


@dataclass(frozen=True)
class Preset:
    """How the records of an instrument are recognised and read.

    Attributes
    ----------
    name : str
    match : tuple of str
        Texts that the beginning of a file holds, all of them, whatever their capitals.
    any : tuple of str
        Texts of which it holds at least one.
    skip : tuple of str
        Names of tables that are no records.
    record : Record
        The [record] table, of which the keys that the preset sets count.
    """

    name: str
    match: tuple[str, ...]
    any: tuple[str, ...]
    skip: tuple[str, ...]
    record: Record

    def recognises(self, start: str) -> bool:
        """Whether the beginning of a file is of this instrument."""
        begin = start.casefold()
        every = all(text.casefold() in begin for text in self.match)
        some = not self.any or any(text.casefold() in begin for text in self.any)
        return bool(self.match or self.any) and every and some

    def applied(self, settings: Record) -> Record:
        """The settings, with the preset's keys where the settings have none."""
        keys = {key: getattr(self.record, key) for key in self.record.model_fields_set - settings.model_fields_set}
        for channel in ("displacement", "force", "time"):
            if {channel} <= self.record.model_fields_set & settings.model_fields_set:
                own, given = getattr(self.record, channel), getattr(settings, channel)
                more = {key: getattr(own, key) for key in own.model_fields_set - given.model_fields_set}
                keys[channel] = given.model_copy(update=more)
        return settings.model_copy(update=keys)


def preset_of(path: Path, start: str, settings: Record) -> Preset | None:
    """The preset of a file: that which `record.preset` names, or the first that recognises the file; None where there is none.

    Parameters
    ----------
    path : path of the record
    start : str
        Text at the beginning of the file.
    settings : Record

    Returns
    -------
    Preset or None

    Raises
    ------
    RecordError
        The preset that is named does not exist, or a preset has faults.
    """
    beside = [read_preset(file) for file in sorted(path.parent.glob(f"*{ENDING}"))]
    presets = [*beside, *installed_presets()]
    if settings.preset is None:
        return next((preset for preset in presets if preset.recognises(start)), None)
    if settings.preset.endswith(".toml"):
        return read_preset(path.parent / settings.preset)
    for preset in presets:
        if settings.preset.casefold() in preset.name.casefold():
            return preset
    names = ", ".join(preset.name for preset in presets)
    raise RecordError(f"{path}: record.preset = {settings.preset!r}: no such preset; the presets are {names}")


@functools.cache
def installed_presets() -> tuple[Preset, ...]:
    """The presets of other packages, and indentfit's own."""
    return tuple(read_preset(file) for folder in (*_offered(), OWN) for file in _files(folder))


def read_preset(path: Path) -> Preset:
    """The preset in a file; RecordError where the file cannot be read or has faults."""
    try:
        tree = tomllib.loads(path.read_text(encoding="utf-8-sig"))
        wrong = sorted(set(tree) - KEYS)
        if wrong or not isinstance(tree.get("name"), str):
            raise ValueError(f"unknown key {wrong[0]}" if wrong else "no name")
        return Preset(tree["name"], _texts(tree, "match"), _texts(tree, "any"), _texts(tree, "skip"), Record(**_table(tree)))
    except (OSError, ValueError, CaseError) as error:
        reason = " ".join((getattr(error, "strerror", None) or str(error)).split())
        raise RecordError(f"{path}: no preset ({reason}); it needs name, match or any, and a table [record]") from None


def _texts(tree: dict[str, Any], key: str) -> tuple[str, ...]:
    texts = tree.get(key, [])
    if not isinstance(texts, list) or not all(isinstance(text, str) for text in texts):
        raise ValueError(f"{key} must be a list of texts")
    return tuple(texts)


def _table(tree: dict[str, Any]) -> dict[str, Any]:
    table = tree.get("record", {})
    if not isinstance(table, dict):
        raise ValueError("record must be a table")
    return table


def _files(folder: Path) -> list[Path]:
    return [folder] if folder.is_file() else sorted(folder.glob(f"*{ENDING}"))


def _offered() -> Iterator[Path]:
    """The files and folders that other packages offer."""
    for entry in importlib.metadata.entry_points(group=GROUP):
        place = entry.load()
        yield Path(place() if callable(place) else place)
