"""Registries of shapes: classes of indenters and of samples by name, each with the keys of the case that it takes."""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import MISSING, fields
from importlib.metadata import entry_points
from typing import Any, Generic, TypeVar

from indentfit.errors import InputError

Shape = TypeVar("Shape")
Registered = TypeVar("Registered")


class Registry(Generic[Shape]):
    """Shapes of one kind by name.

    A shape is a frozen dataclass with a class attribute `name`. Its fields are the keys of the case's table that the shape takes,
    under the same names; a field without a default is a key that the shape needs.

    Parameters
    ----------
    kind : str
        What the shapes are shapes of, for messages.
    group : str
        Entry-point group in which other packages register shapes. The group is read only when a name is asked for that is
        not registered, so that a package that cannot be loaded harms only the cases that ask for its shape.
    """

    def __init__(self, kind: str, group: str) -> None:
        self.kind, self.group = kind, group
        self.known: dict[str, type[Shape]] = {}

    def register(self, shape: type[Registered]) -> type[Registered]:
        """Make a shape known by its `name`; returns it, so that a class can be decorated."""
        self.known[shape.name] = shape  # type: ignore[attr-defined,assignment]
        return shape

    def names(self) -> tuple[str, ...]:
        """Names of the shapes that are registered so far."""
        return tuple(self.known)

    def find(self, name: str) -> type[Shape] | None:
        """The shape of this name, None where there is none.

        Raises
        ------
        InputError
            Where a package offers the shape but cannot be loaded.
        """
        if name not in self.known:
            for entry in entry_points(group=self.group, name=name):
                self.known[name] = self._load(entry)
        return self.known.get(name)

    def find_or_none(self, name: object) -> type[Shape] | None:
        """The shape of this name, None also where what should be a name is something else or cannot be loaded."""
        with suppress(InputError):
            return self.find(name) if isinstance(name, str) else None
        return None

    def _load(self, entry: Any) -> type[Shape]:
        try:
            return entry.load()
        except Exception as error:  # whatever the code of others raises
            raise InputError(f"the package that offers the {self.kind} {entry.name!r} cannot be loaded: {error}") from None

    def make(self, values: Mapping[str, Any]) -> Shape | None:
        """The shape that a table's keys describe; other keys than its own are left out.

        Parameters
        ----------
        values : key -> value, "shape" among them

        Returns
        -------
        Shape or None
            None where the shape is not known, or a key that it takes has no value.
        """
        shape = self.find_or_none(values.get("shape"))
        if shape is None:
            return None
        own = {key: values[key] for key in keys_of(shape) if key in values}
        complete = needed_by(shape) <= own.keys() and all(value is not None for value in own.values())
        return shape(**own) if complete else None

    def disagreements(self, name: str | None, values: Mapping[str, Any], defaults: Mapping[str, Any]) -> Iterator[tuple[str, bool]]:
        """Keys of a table that do not go with a shape: (key, True where it is missing and False where it is too much).

        Parameters
        ----------
        name : of the shape; nothing is wrong with the keys of an unknown one
        values : the keys that are given; one that is not right alone is None
        defaults : key -> default of the table
        """
        shape = self.find_or_none(name)
        if shape is None:
            return
        for key in sorted(self.all_keys()):
            if key in needed_by(shape) and key not in values:
                yield key, True
            elif key not in keys_of(shape) and key in values and _says_something(values[key], defaults.get(key)):
                yield key, False

    def all_keys(self) -> set[str]:
        """Keys that any registered shape takes."""
        return {key for shape in self.known.values() for key in keys_of(shape)}


def _says_something(value: Any, default: Any) -> bool:
    """Whether a key that is given differs from its default; a key without default says something always."""
    return default is None or value not in (None, default)


def keys_of(shape: type) -> tuple[str, ...]:
    """Keys of the case's table that a shape takes."""
    return tuple(field.name for field in fields(shape))


def needed_by(shape: type) -> set[str]:
    """Keys of the case's table that a shape cannot do without."""
    return {field.name for field in fields(shape) if field.default is MISSING}
