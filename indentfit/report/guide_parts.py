"""Parts of the guide that are generated from the code: keys of the case, materials, public names, and kinds of result."""

import importlib
import inspect
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pkgutil import resolve_name
from typing import Any

from indentfit.case.reference import reference_page
from indentfit.errors import MaterialError
from indentfit.material import Material, installed
from indentfit.report.formulas import with_formulas
from indentfit.report.schema import CLASSES
from indentfit.report.typeset import symbol

PUBLIC = "indentfit"  # the package whose public names are described


def generated_parts() -> dict[str, str]:
    """Markdown of the generated parts of the guide, by name."""
    return {"case": _case(), "materials": "\n".join(_materials()), "api": "\n".join(_api()), "results": "\n".join(_results())}


def _case() -> str:
    """The tables of keys, without the heading of the page that they stand on."""
    return reference_page().partition("\n\n")[2]


def _materials() -> Iterator[str]:
    for name, law in installed().items():
        if isinstance(law, MaterialError) or not law.__module__.startswith("indentfit."):
            continue
        yield f"## {name}\n"
        yield from (f"{paragraph}\n" for paragraph in _in_words(law))
        yield "| parameter | unit | least | largest | meaning |\n|---|---|---|---|---|"
        for parameter, known in law.parameters.items():
            low, high = ("" if bound is None else f"{bound:g}" for bound in (known.min, known.max))
            scale = "; the energy is proportional to it" if known.scale else ""
            yield f"| `{parameter}` | {known.unit} | {low} | {high} | {_prose(known.meaning, law)}{scale} |"
        yield ""


def _in_words(law: type[Material]) -> Iterator[str]:
    """The paragraphs of a material's docstring, the energy that it begins with in one of its own, and the source."""
    said = " ".join(inspect.cleandoc(law.__doc__ or "").split())
    before, mark, source = said.partition("Source")
    text = _prose(before, law)
    if text.startswith("$"):
        _, energy, text = text.split("$", 2)
        yield f"${energy}$"
        text = text.lstrip(" .,;:")
        text = text[:1].upper() + text[1:]
    yield from (part for part in (text.strip(), f"{mark}{source}") if part)


def _prose(text: str, law: type[Material]) -> str:
    """A text about a material with its formulas between dollar signs, and Greek letters outside of them."""
    parts = with_formulas(text, law.parameters).split("$")
    return "$".join(symbol(part) if n % 2 == 0 else part for n, part in enumerate(parts))


def _api() -> Iterator[str]:
    package = importlib.import_module(PUBLIC)
    for name in sorted(package.__all__):
        value = getattr(package, name)
        yield f"## {name}\n"
        yield f"```text\n{name}{_signature(value)}\n\n{inspect.cleandoc(value.__doc__ or '')}\n```\n"
        for method in _methods(value):
            yield f"### {name}.{method.__name__}\n"
            yield f"```text\n{name}.{method.__name__}{_signature(method)}\n\n{inspect.cleandoc(method.__doc__ or '')}\n```\n"


def _signature(value: Any) -> str:
    try:
        return str(inspect.signature(value))
    except (TypeError, ValueError):
        return "(...)"


def _methods(value: Any) -> Iterator[Any]:
    """Public functions that a class itself defines, and says what they do."""
    for name, member in vars(value).items() if inspect.isclass(value) else ():
        if not name.startswith("_") and inspect.isfunction(member) and member.__doc__:
            yield member


def _results() -> Iterator[str]:
    for tag, name in CLASSES.items():
        kind = resolve_name(name)
        yield f"### {tag}\n"
        if is_dataclass(kind):
            yield f"```text\n{inspect.cleandoc(kind.__doc__ or '')}\n```\n"
            yield "| field | kind |\n|---|---|"
            yield from (f"| `{known.name}` | `{str(known.type).replace('|', 'or')}` |" for known in fields(kind))
            yield ""
