"""Tables of a file that ask for something by their keys alone, and have none."""

from collections.abc import Iterator, Mapping
from typing import Any

from indentfit.case.messages import Fault


def faults_of_empty_tables(tree: Mapping[str, Any]) -> Iterator[Fault]:
    """A fault where a file has a table that asks for something by its keys alone, and no key: the fit would go on without it."""
    if isinstance(fit := tree.get("fit"), dict) and fit.get("discrepancy") == {}:
        yield Fault(("fit", "discrepancy"), {}, 'the table states nothing; give scale = "unknown" or a number, or remove the table')
