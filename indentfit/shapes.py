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
    under the same names; the shape needs a key whose field has no default, and can do without a key whose default is None.

    Parameters
    ----------
    kind : str
        "indenter" or "sample", for messages.
    group : str
        Entry-point group in which other packages register shapes. The group is read only when a case names a shape that is
        not registered, so that a package that cannot be loaded harms only the cases that name its shape.
    """

    def __init__(self, kind: str, group: str) -> None:
        self.kind, self.group = kind, group
        self.known: dict[str, type[Shape]] = {}

    def register(self, shape: type[Registered]) -> type[Registered]:
        """Register a shape under its `name`, and return the shape, so that the method serves as a decorator of classes."""
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
            A package offers the shape but cannot be loaded.
        """
        if name not in self.known:
            for entry in entry_points(group=self.group, name=name):
                self.known[name] = self._load(entry)
        return self.known.get(name)

    def find_or_none(self, name: object) -> type[Shape] | None:
        """The shape of this name; None where there is none, where `name` is not text, or where the shape cannot be loaded."""
        with suppress(InputError):
            return self.find(name) if isinstance(name, str) else None
        return None

    def _load(self, entry: Any) -> type[Shape]:
        try:
            return entry.load()
        except Exception as error:  # whatever the code of others raises
            raise InputError(f"the package that offers the {self.kind} {entry.name!r} cannot be loaded: {error}") from None

    def make(self, values: Mapping[str, Any]) -> Shape | None:
        """The shape that a table's keys describe; keys of other shapes are ignored.

        Parameters
        ----------
        values : mapping of keys, "shape" among them, to values

        Returns
        -------
        Shape or None
            None where the shape is not known, or a key that it takes has no value.
        """
        shape = self.find_or_none(values.get("shape"))
        if shape is None:
            return None
        optional = {field.name for field in fields(shape) if field.default is None}  # type: ignore[arg-type]
        own = {key: values[key] for key in keys_of(shape) if key in values and not (key in optional and values[key] is None)}
        complete = needed_by(shape) <= own.keys() and all(value is not None for value in own.values())
        return shape(**own) if complete else None

    def disagreements(self, name: str | None, values: Mapping[str, Any], defaults: Mapping[str, Any]) -> Iterator[tuple[str, bool]]:
        """Keys of a table that do not agree with a shape.

        Parameters
        ----------
        name : str or None
            Name of the shape. The keys of an unknown shape are not judged.
        values : mapping of the keys that are given to their values
            None is the value of a key that is wrong by itself.
        defaults : mapping of the keys of the table to their defaults

        Yields
        ------
        (str, bool)
            The key, and True where the shape lacks the key, False where the key belongs to another shape.
        """
        shape = self.find_or_none(name)
        if shape is None:
            return
        for key in sorted(self.all_keys()):
            if key in needed_by(shape) and key not in values:
                yield key, True
            elif key not in keys_of(shape) and key in values and _differs(values[key], defaults.get(key)):
                yield key, False

    def all_keys(self) -> set[str]:
        """Keys that any registered shape takes."""
        return {key for shape in self.known.values() for key in keys_of(shape)}


def _differs(value: Any, default: Any) -> bool:
    """Whether the value of a key differs from the key's default; the value of a key without a default always does."""
    return default is None or value not in (None, default)


def keys_of(shape: type) -> tuple[str, ...]:
    """Keys of the case's table that a shape takes."""
    return tuple(field.name for field in fields(shape))


def needed_by(shape: type) -> set[str]:
    """Keys of the case's table that a shape cannot do without."""
    return {field.name for field in fields(shape) if field.default is MISSING}
