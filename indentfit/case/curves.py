"""Names of files for the measured curves that a case holds in memory."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from indentfit.case.tables import Test
from indentfit.curve import Curve

RESERVED = {"con", "prn", "aux", "nul", *(f"{port}{n}" for port in ("com", "lpt") for n in range(1, 10))}  # on Windows


def curve_files(tests: Sequence[Any]) -> tuple[list[Any], list[Curve | None]]:
    """Separate tests from the curves that they hold in memory.

    Parameters
    ----------
    tests : sequence of Test, or of their tables as dictionaries
        An item of another type is returned unchanged, and is refused later.

    Returns
    -------
    tests : list
        The tests, each with the name of a file in place of its `Curve`.
    curves : list of Curve or None
    """
    named, curves, taken = [], [], set[str]()
    for test in tests:
        curve = test.curve if isinstance(test, Test) else test.get("curve") if isinstance(test, dict) else None
        curves.append(curve if isinstance(curve, Curve) else None)
        if isinstance(curve, Curve):
            place = file_for(test.name if isinstance(test, Test) else test.get("name"), taken)
            test = test.model_copy(update={"curve": place}) if isinstance(test, Test) else {**test, "curve": place}
        named.append(test)
    return named, curves


def file_for(name: object, taken: set[str]) -> str:
    """A file for the curve of a test, with a name that is safe on every system and not in `taken`, to which it is added."""
    stem = re.sub(r"[^A-Za-z0-9._-]+", "-", str(name)).strip("-.") or "test"
    if stem.split(".")[0].lower() in RESERVED:
        stem = f"test-{stem}"
    number, choice = 1, stem
    while choice.lower() in taken:
        number += 1
        choice = f"{stem}-{number}"
    taken.add(choice.lower())
    return f"curves/{choice}.csv"
