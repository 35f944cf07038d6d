"""The import closure of a module: the source of all that the module can run, found by following its imports.

Imports are read from the source with `ast`, those inside functions too, and those by `import_module("name")`; imports for
type checkers only are left out, and those in an `except` block that ends with `raise`: the wording of an error decides no curve.
A name that a package gives out lazily, by a stub `__init__.pyi`, is followed to its module.
Names are relative to the package, so that two machines with the same sources get the same hash.
"""

import ast
import contextlib
import hashlib
import importlib.metadata
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import NamedTuple

PACKAGE = "indentfit"
HOME = Path(__file__).parents[1]
DISTRIBUTIONS = {"skfem": "scikit-fem"}  # packages whose distribution has another name
RUNNING = "indentfit.runs.bench"  # the module whose function computes a run

# Import statements of a source in the project's style: parsing these alone takes a tenth of the time of parsing the whole file.
STATEMENT = re.compile(rb"^[ \t]*((?:from[ \t]+[\w.]+[ \t]+import|import)\b(?:[^\n(\\]|\([^)]*\))*)", re.MULTILINE)
BY_NAME = re.compile(rb"\bimport_module\(\s*['\"]([\w.]+)['\"]")
OTHER_STYLE = re.compile(rb"[;:][ \t]*(?:from|import)[ \t]|TYPE_CHECKING|except[^\n]*:\n[ \t]+(?:from|import)\b|\\\n")

Find = Callable[[str], Path | None]


class Imported(NamedTuple):
    """One import: `from module import names` (level dots before the module), or `import module` without names."""

    module: str
    names: tuple[str, ...] = ()
    level: int = 0


@dataclass(frozen=True)
class Closure:
    """A module and what it imports.

    Parameters
    ----------
    start : str
        Name of the module that the closure starts from.
    sources : dict of module name -> bytes
        Source of each module, with line ends of Unix.
    foreign : frozenset of str
        First names of the packages of others that are imported; the standard library is not among them.
    """

    start: str
    sources: dict[str, bytes]
    foreign: frozenset[str]

    @property
    def hash(self) -> str:
        """SHA-256 of all sources with their names; of the start, only the content counts, not the place."""
        digest = hashlib.sha256(_sha(self.sources[self.start]))
        for name in sorted(self.sources.keys() - {self.start}):
            digest.update(_sha(name.encode()) + _sha(self.sources[name]))
        return digest.hexdigest()


@cache
def of_runs() -> Closure:
    """The closure of the installed function that computes a run."""
    return of_package(HOME)


def of_package(home: Path, start: str = RUNNING) -> Closure:
    """The closure of a module of the package whose sources are in the folder `home`."""
    return follow(start, lambda name: _file_below(home, PACKAGE, name))


def of_law(law: type) -> Closure:
    """The closure of the file that defines the class of a material: its own file and what that file imports.

    The closure follows files beside the law's file, modules of the law's package and of indentfit, and modules that no installed
    distribution holds. A loaded module is represented by the file from which it was loaded.
    """
    module, file = law.__module__, _loaded(law.__module__)
    if file is None:
        return Closure(module, {module: law.__qualname__.encode()}, frozenset())
    return follow(module, lambda name: file if name == module else _file_of_law(name, module, file.parent))


def follow(start: str, find: Find) -> Closure:
    """The closure of a module.

    Parameters
    ----------
    start : str
        Name of the module.
    find : function
        Name of a module -> file of its source; None where the module is not followed.

    Returns
    -------
    Closure
    """
    sources: dict[str, bytes] = {}
    foreign: set[str] = set()
    queue = [start]
    while queue:
        name = queue.pop()
        file = find(name)
        if name in sources or file is None:
            continue
        sources[name] = file.read_bytes().replace(b"\r\n", b"\n")
        package = name if file.name == "__init__.py" else name.rpartition(".")[0]
        for imported in imports(sources[name]):
            needed = [place for name in _needed(imported, package) for place in _given_out(name, find)]
            ours = [other for other in needed if find(other)]
            queue += ours
            first = needed[0].partition(".")[0]
            if not ours and first != PACKAGE and first not in sys.stdlib_module_names:
                foreign.add(first)
    return Closure(start, sources, frozenset(foreign))


@lru_cache(maxsize=1000)
def imports(source: bytes) -> tuple[Imported, ...]:
    """All imports that the code of a source can reach, without those that only a type checker reads."""
    return (*_written(source), *(Imported(name.decode()) for name in BY_NAME.findall(source)))


def _written(source: bytes) -> Iterable[Imported]:
    """The import statements of a source."""
    if not OTHER_STYLE.search(source):
        try:
            nodes: Iterable[ast.AST] = [node for text in STATEMENT.findall(source) for node in ast.parse(text).body]
            return list(_imported(nodes))
        except SyntaxError:
            pass  # a line of a docstring looks like an import, or an import holds a comment: the whole file is parsed
    return list(_imported(_statements(ast.parse(source).body)))


def _imported(nodes: Iterable[ast.AST]) -> Iterator[Imported]:
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (Imported(alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield Imported(node.module or "", tuple(alias.name for alias in node.names), node.level)


def _statements(body: list[ast.AST] | list[ast.stmt]) -> Iterator[ast.AST]:
    """The statements of a body and of its inner blocks, without those for type checkers or for the wording of an error."""
    for node in body:
        if isinstance(node, ast.ExceptHandler) and isinstance(node.body[-1], ast.Raise):
            continue
        yield node
        for_checkers = isinstance(node, ast.If) and ast.unparse(node.test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING")
        for block in ("orelse",) if for_checkers else ("body", "orelse", "finalbody", "handlers", "cases"):
            yield from _statements(getattr(node, block, []))


def _needed(imported: Imported, package: str) -> Iterator[str]:
    """Names of the modules that an import may load: first the enclosing packages, then imported names that may be modules."""
    module = imported.module
    if imported.level:
        steps = package.split(".")
        module = ".".join([*steps[: len(steps) + 1 - imported.level], *([module] if module else [])])
    steps = module.split(".")
    yield from (".".join(steps[: n + 1]) for n in range(len(steps)))
    yield from (f"{module}.{name}" for name in imported.names)


def _given_out(name: str, find: Find) -> Iterator[str]:
    """The name, and the module that defines it where a package exports the name lazily by a stub."""
    yield name
    package, _, last = name.rpartition(".")
    file = find(package) if package else None
    stub = file.with_suffix(".pyi") if file and file.name == "__init__.py" else None
    if stub and stub.is_file():
        for node in ast.parse(stub.read_bytes()).body:
            if isinstance(node, ast.ImportFrom) and last in [alias.asname for alias in node.names]:
                yield next(place for place in reversed([*_needed(Imported(node.module or "", (), node.level), package)]))


def _file_below(home: Path, package: str, name: str) -> Path | None:
    """The file of a module of a package in a folder; None for the package's own, lazy, `__init__`."""
    first, _, rest = name.partition(".")
    return _file(home, rest) if first == package and rest else None


def _file(folder: Path, name: str) -> Path | None:
    """The file of the module `name`, relative to a folder."""
    place = folder.joinpath(*name.split("."))
    return next((file for file in (place.with_name(f"{place.name}.py"), place / "__init__.py") if file.is_file()), None)


def _file_of_law(name: str, module: str, folder: Path) -> Path | None:
    """The file of a module that a law imports, None for the standard library and for installed distributions."""
    first = name.partition(".")[0]
    if first == PACKAGE:
        return None if name == PACKAGE or name in of_runs().sources else _loaded(name) or _file_below(HOME, PACKAGE, name)
    beside = _file(folder, name)
    if beside or first == module.partition(".")[0]:
        return _loaded(name) or beside
    if first in sys.stdlib_module_names or version_of(first) is not None:
        return None
    return _loaded(name)


def _loaded(name: str) -> Path | None:
    """The source from which a module was loaded; None where the module is not loaded, or has no source."""
    file = getattr(sys.modules.get(name), "__file__", None)
    return Path(file) if file and file.endswith(".py") and Path(file).is_file() else None


@cache
def version_of(package: str) -> str | None:
    """Version of the distribution that holds a package of this first name, None where none does."""
    with contextlib.suppress(importlib.metadata.PackageNotFoundError):
        return importlib.metadata.version(DISTRIBUTIONS.get(package, package))
    holders = importlib.metadata.packages_distributions().get(package)  # slow: it reads the files of all distributions
    return importlib.metadata.version(holders[0]) if holders else None


def _sha(content: bytes) -> bytes:
    return hashlib.sha256(content).digest()
