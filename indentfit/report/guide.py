"""The guide as a static site: the Markdown pages of indentfit/guide, and reference pages generated from the code.

A page is Markdown with tables. A line `@@NAME@@` stands for a generated part. The page `index.md` lists all pages under the
headings of the site's menu. The site loads nothing from a network and runs no script.
"""

import base64
import hashlib
import importlib.metadata
import itertools
import posixpath
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import jinja2
from markdown_it import MarkdownIt
from markdown_it.token import Token
from markupsafe import Markup

from indentfit.errors import InputError, OutputError, suggestion
from indentfit.report.page import HERE

PAGES = Path(__file__).parents[1] / "guide"
ELSEWHERE = {"architecture": PAGES.parent / "ARCHITECTURE.md"}  # pages that lie elsewhere
GENERATED = re.compile(r"^@@(\w+)@@$", re.MULTILINE)
ITEM = re.compile(r"^- \[([^\]]+)\]\(([^)]+)\)$")


@dataclass(frozen=True)
class Entry:
    """A page in the menu."""

    name: str
    title: str


@dataclass(frozen=True)
class Chapter:
    """A heading of the menu with its pages."""

    title: str
    entries: tuple[Entry, ...]


def chapters() -> list[Chapter]:
    """The menu: headings of index.md with the pages that are listed below them."""
    parts = re.split(r"^## ", _source("index"), flags=re.MULTILINE)[1:]
    return [Chapter(part.splitlines()[0].strip(), tuple(_entries(part))) for part in parts]


def page_names() -> list[str]:
    """Names of all pages, in the order of the menu."""
    return ["index", *(entry.name for chapter in chapters() for entry in chapter.entries)]


def page_text(name: str, generated: Mapping[str, str]) -> str:
    """The Markdown of a page.

    Parameters
    ----------
    name : str
    generated : mapping of names to Markdown
        The generated parts.

    Raises
    ------
    InputError
        There is no such page.
    """
    if name not in page_names():
        raise InputError(f"the guide has no page {name!r}{suggestion(name, page_names())}; its pages: {', '.join(page_names())}")
    return GENERATED.sub(lambda part: generated[part[1]].strip(), _source(name))


def write_site(folder: str | Path, generated: Mapping[str, str]) -> Path:
    """Write the site.

    Parameters
    ----------
    folder : path
        Pages of an earlier site there are replaced.
    generated : mapping of names to Markdown

    Returns
    -------
    Path
        Its first page.

    Raises
    ------
    OutputError
        The folder cannot be written.
    """
    folder = Path(folder)
    pages = {name: html_page(name, page_text(name, generated)) for name in page_names()}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, html in pages.items():
            (folder / f"{name}.html").write_text(html, encoding="utf-8", newline="\n")
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written ({error.strerror}); choose another folder") from error
    return folder / "index.html"


def html_page(name: str, text: str) -> str:
    """One page of the site."""
    reader = MarkdownIt("commonmark", {"html": False}).enable("table")
    tokens = reader.parse(text)
    headings = list(_named(tokens))
    for token in tokens:
        for inner in token.children or ():
            if inner.type == "link_open":
                inner.attrSet("href", _address(str(inner.attrGet("href"))))
        if token.type == "fence":
            token.attrSet("tabindex", "0")
    body = _scrolling(reader.renderer.render(tokens, reader.options, {}))
    environment = jinja2.Environment(loader=jinja2.FileSystemLoader(HERE), autoescape=True, trim_blocks=True, lstrip_blocks=True)
    style = (HERE / "page.css").read_text(encoding="utf-8")
    return environment.get_template("guide.html").render(
        name=name,
        title=headings[0][1],
        sections=[(anchor, words) for level, words, anchor in ((h[2], h[1], h[0]) for h in headings) if level == "h2"],
        chapters=chapters(),
        body=Markup(body),  # of Markdown without HTML, which the reader escapes
        style=Markup(style),
        style_hash=base64.b64encode(hashlib.sha256(style.encode()).digest()).decode(),
        version=importlib.metadata.version("indentfit"),
    )


def anchor_of(heading: str) -> str:
    """The anchor of a heading: small letters, digits and hyphens."""
    return re.sub(r"[\s]+", "-", re.sub(r"[^\w\s-]", "", heading.lower()).strip())


def _named(tokens: list[Token]) -> Iterator[tuple[str, str, str]]:
    """Give each heading an anchor of its own; yields anchor, words and level."""
    used: set[str] = set()
    for token, inline in itertools.pairwise(tokens):
        if token.type == "heading_open":
            words = "".join(inner.content for inner in inline.children or ())
            anchor = stem = anchor_of(words)
            number = 1
            while anchor in used:
                anchor = f"{stem}-{(number := number + 1)}"
            used.add(anchor)
            token.attrSet("id", anchor)
            yield anchor, words, token.tag


def _address(link: str) -> str:
    """A link of a Markdown page as the site has it."""
    path, hash_mark, anchor = link.partition("#")
    if "://" in path or not path.endswith(".md"):
        return link
    name = posixpath.basename(path).removesuffix(".md")
    return f"{'architecture' if name == 'ARCHITECTURE' else name}.html{hash_mark}{anchor}"


def _scrolling(html: str) -> str:
    """Tables that scroll by themselves on a narrow page."""
    html = html.replace("<table>", '<div class="scroll" role="region" tabindex="0" aria-label="Table"><table>')
    return html.replace("</table>", "</table></div>").replace("<th>", '<th scope="col">')


def _source(name: str) -> str:
    return ELSEWHERE.get(name, PAGES / f"{name}.md").read_text(encoding="utf-8")


def _entries(part: str) -> Iterator[Entry]:
    for line in part.splitlines():
        if item := ITEM.match(line):
            yield Entry(_address(item[2]).removesuffix(".html"), item[1])
