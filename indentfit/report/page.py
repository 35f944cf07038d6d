"""One self-contained HTML page: text, tables, figures, in sections, from values; all values are escaped.

The page loads nothing: figures are inline SVG or images in the page itself; the content security policy allows one style sheet by
its hash, and no script.
"""

import base64
import functools
import hashlib
import importlib.metadata
import io
import itertools
import re
import struct
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import jinja2
import matplotlib
from markupsafe import Markup, escape
from matplotlib.figure import Figure

from indentfit.report.formulas import NoFormula, math, split_formulas
from indentfit.report.style import DOTS, PIXELS, STYLE
from indentfit.report.typeset import typeset

HERE = Path(__file__).parent
SVG, XLINK = "http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"
STACKED = 3
NUMBER = itertools.count()  # of figures: their names differ on a page
DRAWN = ("svg", "g", "defs", "path", "use", "clipPath", "pattern", "rect", "image", "text", "tspan")  # elements that a page shows


@dataclass(frozen=True)
class Text:
    """A paragraph; `warning` sets it off, in red, or in amber where it is milder."""

    text: str
    warning: bool = False
    amber: bool = False
    kind = "text"


@dataclass(frozen=True)
class Lines:
    """A list of lines."""

    lines: tuple[str, ...]
    kind = "list"


@dataclass(frozen=True)
class Table:
    """A table; the first column heads its rows. A column of numbers is set to the right. On a narrow page a table of more than
    STACKED columns is shown row by row, each cell beside its column's name."""

    caption: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    kind = "table"

    @functools.cached_property  # asked for each cell of a table, which may have hundreds of rows
    def numeric(self) -> list[bool]:
        """Whether each column holds numbers."""
        columns: Iterable[tuple[str, ...]] = zip(*self.rows, strict=True) if self.rows else [()] * len(self.header)
        return [all(re.fullmatch(r"[-+−±<>]? ?[\d.,]+(e[-+]?\d+)?( ?%)?|–|", cell) for cell in column) for column in columns]

    @property
    def stacked(self) -> bool:
        """Whether the table is too wide for a phone."""
        return len(self.header) > STACKED


@dataclass(frozen=True)
class Picture:
    """A drawn figure (inline SVG) or an image (a data: address), with its caption and what it shows in words."""

    caption: str
    alt: str
    svg: Markup | None = None
    source: str = ""
    width: int = 0
    height: int = 0


@dataclass(frozen=True)
class Figures:
    """Pictures side by side where there is room."""

    figures: tuple[Picture, ...]
    kind = "figures"


@dataclass(frozen=True)
class Code:
    """Text as it is in a file."""

    caption: str
    text: str
    kind = "code"


@dataclass(frozen=True)
class Beside:
    """Tables and text with a picture beside them, where there is room."""

    parts: "tuple[Text | Table, ...]"
    picture: Picture
    kind = "beside"


Part = Text | Lines | Table | Figures | Code | Beside


@dataclass(frozen=True)
class Section:
    """A heading with the parts below it."""

    id: str
    title: str
    parts: tuple[Part, ...]


@dataclass(frozen=True)
class Page:
    """The whole page; headline and lead: the result in a sentence or two; good: whether it went well."""

    title: str
    kind: str
    headline: str
    lead: str
    good: bool
    sections: tuple[Section, ...]


def marked(text: str) -> Markup:
    """An escaped sentence of indentfit, typeset, with the text between backticks as it is, as code, and no line break before a
    percent sign."""
    pieces = re.split("`([^`]+)`", text)
    return Markup("").join(Markup("<code>{}</code>").format(piece) if n % 2 else _set(piece) for n, piece in enumerate(pieces))


def _set(text: str) -> Markup:
    """Prose, typeset, with its formulas drawn."""
    parts = split_formulas(text)
    return Markup("").join(_formula(part) if n % 2 else _prose(part) for n, part in enumerate(parts))


def _formula(text: str) -> Markup:
    try:
        return Markup(math(text))  # of letters, digits and operators alone, which it escapes
    except NoFormula:
        return _prose(text)


def _prose(text: str) -> Markup:
    return escape(re.sub(r"(?<=\d) (?=%)", "\N{NO-BREAK SPACE}", typeset(text)))


def render(page: Page) -> str:
    """The HTML of a Page."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(HERE),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters["marked"] = marked
    environment.filters["typeset"] = typeset
    style = (HERE / "page.css").read_text(encoding="utf-8")
    return environment.get_template("page.html").render(
        page=page,
        style=Markup(style),  # a file of the package, not an input
        style_hash=base64.b64encode(hashlib.sha256(style.encode()).digest()).decode(),
        version=importlib.metadata.version("indentfit"),
    )


def drawn(figure: Figure, caption: str, alt: str) -> Picture:
    """The Picture of a matplotlib figure, as SVG to be put into the page."""
    text = io.StringIO()
    with matplotlib.rc_context(STYLE):
        figure.savefig(text, format="svg", transparent=True, metadata={"Date": None})
    width, height = (round(PIXELS * 72 * inches) for inches in figure.get_size_inches())
    return Picture(caption, alt, _inline(text.getvalue(), f"f{next(NUMBER)}-", alt), width=width, height=height)


def image(path: str | Path, caption: str, alt: str) -> Picture:
    """The Picture of a PNG file."""
    raw = Path(path).read_bytes()
    width, height = (round(PIXELS * 72 / _dots(raw) * dots) for dots in struct.unpack(">II", raw[16:24]))
    return Picture(caption, alt, source=f"data:image/png;base64,{base64.b64encode(raw).decode()}", width=width, height=height)


def vector_image(path: Path, caption: str, alt: str) -> Picture:
    """The Picture of an SVG file that matplotlib wrote."""
    svg = _inline(path.read_text(encoding="utf-8"), f"f{next(NUMBER)}-", alt)
    width = re.search(r'width="(\d+)"', svg)
    return Picture(caption, alt, svg, width=int(width[1]) if width else 0)


def _dots(png: bytes) -> float:
    """Dots of an inch of a PNG, where it says so."""
    at = png.find(b"pHYs")
    return DOTS if at < 0 else 0.0254 * float(struct.unpack(">I", png[at + 4 : at + 8])[0]) or DOTS


def _inline(text: str, prefix: str, alt: str) -> Markup:
    """SVG for the inside of a page: no names of its own that another figure has, too, and no styles that a policy forbids. Its
    width is such that the text of all figures has one size."""
    root = ET.fromstring(text)  # comments, which hold the texts, are left out
    width = f"{PIXELS * float(root.get('width', '0').removesuffix('pt')):.0f}"
    names = {name for element in root.iter() if (name := element.get("id"))}
    for parent in list(root.iter()):
        for child in list(parent):
            if child.tag.rpartition("}")[2] not in DRAWN:
                parent.remove(child)
    for element in root.iter():
        for declaration in (element.attrib.pop("style", "") or "").split(";"):
            name, colon, value = declaration.partition(":")
            if colon and name.strip() != "font":
                element.set(name.strip(), value.strip())
        element.attrib.pop("type", None)
        for name, value in list(element.attrib.items()):
            if name.lower().startswith("on"):  # no figure of ours answers to a click
                del element.attrib[name]
            elif name in ("id", f"{{{XLINK}}}href"):
                del element.attrib[name]
                element.set(name.rpartition("}")[2], re.sub(r"^(#?)(.*)$", rf"\1{prefix}\2", value))
            else:
                element.set(name, re.sub(r"url\(#", f"url(#{prefix}", value))
    _drop_unused_names(root, {prefix + name for name in names})
    for name in ("width", "height", "version"):
        root.attrib.pop(name, None)
    root.set("width", width)
    root.set("role", "img")
    root.set("aria-label", alt)
    ET.register_namespace("", SVG)
    return Markup(ET.tostring(root, encoding="unicode"))


def _drop_unused_names(root: ET.Element, names: set[str]) -> None:
    used: set[str] = set()
    for element in root.iter():
        for value in element.attrib.values():
            used |= set(re.findall(r"#([^)\s]+)", value))
    for element in root.iter():
        if element.get("id") in names - used:
            del element.attrib["id"]
