"""Materials that are installed or lie in a file: how they are found and loaded, and how faults of their code are contained."""

import contextlib
import re
import sys
import traceback
import types
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from indentfit.arrays import Array
from indentfit.errors import IndentfitError, MaterialError
from indentfit.material.model import GROUP, Material
from indentfit.material.words import nearest, one_line

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

NAMED = 12  # of the installed materials, in an error

# Finding and loading -------------------------------------------------------------------------------------------------


def _permitted(code: str) -> None:
    """Permit any code."""


_permit: ContextVar[Callable[[str], None]] = ContextVar("permit", default=_permitted)


@contextlib.contextmanager
def foreign_code(permit: Callable[[str], None]) -> Iterator[None]:
    """Context in which permit(code) is called before code that is not indentfit's own is run, or taken from memory again.

    Parameters
    ----------
    permit : function
        Receives the place of the code, in words; may raise MaterialError. In other processes and threads `permit` is not called:
        the code that they run was permitted here first.
    """
    token = _permit.set(permit)
    try:
        yield
    finally:
        _permit.reset(token)


def installed() -> dict[str, type[Material] | MaterialError]:
    """All installed materials, ours and third parties'.

    Returns
    -------
    dict of str to class of Material or MaterialError
        The materials by name. The value of a material that cannot be loaded is the error.
    """
    classes: dict[str, type[Material] | MaterialError] = {}
    for entry in _entries():
        name = entry.name
        if name in classes:
            hidden = f"material {name!r} of {entry.value} is hidden: another material has that name"
            classes[f"{name} ({entry.value})"] = MaterialError(hidden)
            continue
        try:
            classes[name] = _from_entry(entry)
        except MaterialError as error:
            classes[name] = error
    return classes


def load(name: str) -> type[Material]:
    """The material class of an installed name, or of a file.

    Parameters
    ----------
    name : str
        "neo_hookean", or "path/to/file.py:Class". The file is code, and is run; it is read again when it has changed.

    Returns
    -------
    class of Material

    Raises
    ------
    MaterialError
        No material has the name, or its code cannot be run or gives no material.
    """
    name = str(name)
    path, colon, class_name = name.rpartition(":")
    if colon and path.endswith(".py"):
        return _from_file(Path(path).expanduser(), class_name)
    if name.endswith(".py"):
        raise MaterialError(f"material file {name[:200]!r} needs a class: write FILE.py:MyModel")
    entries = _entries()
    for entry in entries:
        if entry.name == name:
            return _from_entry(entry)
    known = sorted({entry.name for entry in entries})
    near = nearest(name, known)
    more = f" and {len(known) - NAMED} more (`indentfit materials` lists all)" if len(known) > NAMED else ""
    others = f"{near}; `indentfit materials` lists all" if near else f"; installed: {', '.join(known[:NAMED]) or 'none'}{more}"
    raise MaterialError(f"no material {name[:60]!r}{others}")


def _entries() -> list["EntryPoint"]:
    """The entry points, those of indentfit first, so that no other package can take their names."""
    from importlib import metadata  # an import and a search that not every command needs

    return sorted(metadata.entry_points(group=GROUP), key=lambda entry: (not _ours(entry), entry.name))


def _ours(entry: "EntryPoint") -> bool:
    return entry.value.startswith(f"{GROUP}.")


def _from_entry(entry: "EntryPoint") -> type[Material]:
    if not _ours(entry):
        _permit.get()(f"the installed {entry.value}")
    try:
        cls = entry.load()
    except (Exception, SystemExit) as error:
        raise MaterialError(f"material {entry.name!r} ({entry.value}) cannot be loaded: {one_line(error)}") from error
    return _checked_class(cls, f"{entry.name!r} ({entry.value})")


def _from_file(path: Path, class_name: str) -> type[Material]:
    """The class from a file."""
    module = _module(path)
    if class_name not in vars(module):
        here = [n for n, c in vars(module).items() if _is_material(c) and c.__module__ == module.__name__]
        known = f"{', '.join(here) or 'none'}{nearest(class_name, here)}"
        raise MaterialError(f"{path} has no {class_name!r}; its materials: {known}")
    cls = _checked_class(vars(module)[class_name], f"{class_name!r} in {path}")
    if cls.__module__ == module.__name__:
        cls._source = load, f"{path.resolve()}:{class_name}"
    return cls


def _is_material(cls: Any) -> bool:
    return isinstance(cls, type) and issubclass(cls, Material) and cls is not Material


def _checked_class(cls: Any, where: str) -> type[Material]:
    if not _is_material(cls):
        raise MaterialError(f"{where} is not a subclass of indentfit.material.Material")
    return cls


_modules: dict[Path, tuple[tuple[int, int], types.ModuleType]] = {}


def _module(path: Path) -> types.ModuleType:
    """The file's module, run once for each state of the file so that a class stays one class within a process."""
    if not path.is_file():
        raise MaterialError(f"no material file {path}")
    path, stat = path.resolve(), path.stat()
    _permit.get()(f"the Python code in {path}")
    stamp = (stat.st_mtime_ns, stat.st_size)
    if path not in _modules or _modules[path][0] != stamp:
        name = f"indentfit_material_file_{len(_modules)}_{re.sub(r'[^0-9A-Za-z]', '_', path.stem)}"
        _modules[path] = stamp, _run(path, name)
    return _modules[path][1]


def _run(path: Path, name: str) -> types.ModuleType:
    module = types.ModuleType(name)
    module.__file__ = str(path)
    sys.modules[name] = module  # dataclasses and pickle look there
    try:
        # Compiled here, not imported: a byte-code cache cannot tell two edits within one second apart.
        exec(compile(path.read_bytes(), str(path), "exec"), vars(module))
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise MaterialError(f"{path}, line {_line(error, path)}: {one_line(error)}") from error
    return module


def _line(error: BaseException, path: Path) -> int | str | None:
    """The line of the file that raised."""
    if isinstance(error, SyntaxError) and error.filename == str(path):
        return error.lineno
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]
    return lines[-1] if lines else "?"


# Faults of foreign code ----------------------------------------------------------------------------------------------


@contextlib.contextmanager
def blamed(kind: type[Material]) -> Iterator[None]:
    """Context in which an exception from the code of a material class becomes a MaterialError that names the class.

    Exceptions that indentfit raises on purpose, or that its own code does not catch, stay as they are.

    Parameters
    ----------
    kind : class of Material

    Raises
    ------
    MaterialError
        The code of a class that is not indentfit's own raised an exception.
    """
    try:
        yield
    except (IndentfitError, MemoryError):
        raise
    except (Exception, SystemExit) as error:
        if kind.__module__.partition(".")[0] == "indentfit":
            raise
        raise MaterialError(f"the material {kind.__name__} failed ({one_line(error)}); correct it") from error


def checked_derivatives(material: Material, name: Literal["gradient", "hessian"], I: Array) -> Array:
    """A material's gradient or Hessian, checked for the compiled loops, which themselves check no shape.

    Parameters
    ----------
    material : Material
    name : "gradient" or "hessian"
    I : array (n, ...)
        Invariants, 4, or 7 where there are two families of fibres.

    Returns
    -------
    array (n, ...) or (n, n, ...), kPa, contiguous

    Raises
    ------
    MaterialError
        A plugin returns an array of another shape or type.
    """
    array = np.ascontiguousarray(getattr(material, name)(I))
    shape = I.shape[:1] * {"gradient": 1, "hessian": 2}[name] + I.shape[1:]
    if array.shape != shape or array.dtype != float:
        kind = type(material).__name__
        raise MaterialError(f"{kind}.{name} gives {array.dtype} {array.shape}, not float64 {shape}; correct the material")
    return array
