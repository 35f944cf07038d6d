"""The guide as a static site: the Markdown pages of indentfit/guide, and reference pages generated from the code.

A page is Markdown with tables. A line `@@NAME@@` stands for a generated part. The page `index.md` lists all pages under the
headings of the site's menu. A formula stands between dollar signs, as the code writes it, and is drawn as MathML. The first use
of a word of the glossary on a page is linked to its definition. A picture is shown where the examples of its page were run
(guide_examples). The site loads nothing from a network and runs no script.
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
from markdown_it.rules_inline import StateInline
from markdown_it.token import Token
from markupsafe import Markup

from indentfit.errors import InputError, OutputError, suggestion
from indentfit.report.formulas import NoFormula, math, relations
from indentfit.report.page import HERE, Picture

PAGES = Path(__file__).parents[1] / "guide"
ELSEWHERE = {"architecture": PAGES.parent / "ARCHITECTURE.md"}  # pages that lie elsewhere
GENERATED = re.compile(r"^@@(\w+)@@$", re.MULTILINE)
TERM = r"(?<![\w-]){}(?:s|es)?(?![\w-])"
TABLE = '<div class="scroll" role="region" tabindex="0" aria-label="Table {}"><table>'  # regions have names of their own
FORMULA = '<div class="formula" role="region" tabindex="0" aria-label="Formula {}">{}</div>\n'
NO_PICTURES: Mapping[str, Picture] = {}
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


def write_site(folder: str | Path, generated: Mapping[str, str], pictures: Mapping[str, Picture] = NO_PICTURES) -> Path:
    """Write the site.

    Parameters
    ----------
    folder : path
        Pages of an earlier site there are replaced.
    generated : mapping of names to Markdown
    pictures : mapping of their addresses in the pages to pictures

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
    pages = {name: html_page(name, page_text(name, generated), pictures) for name in page_names()}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, html in pages.items():
            (folder / f"{name}.html").write_text(html, encoding="utf-8", newline="\n")
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written ({error.strerror}); choose another folder") from error
    return folder / "index.html"


def html_page(name: str, text: str, pictures: Mapping[str, Picture] = NO_PICTURES) -> str:
    """One page of the site."""
    reader = MarkdownIt("commonmark", {"html": False}).enable("table")
    reader.inline.ruler.before("escape", "formula", _formula)
    tokens = _displayed(_pictured(reader.parse(text), pictures))
    headings = list(_named(tokens))
    _link_terms(tokens, name)
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


def terms() -> dict[str, str]:
    """The words of the glossary, and their anchors."""
    return {words: anchor_of(words) for words in re.findall(r"^## (.+)$", _source("glossary"), flags=re.MULTILINE)}


def _link_terms(tokens: list[Token], page: str) -> None:
    """Link the first use of each word of the glossary in the prose of a page; in the glossary the first use outside of its own
    definition."""
    left, own, heading = terms(), "", False
    for token in tokens:
        heading = token.type == "heading_open" or (heading and token.type != "heading_close")
        if token.type == "inline" and heading:
            own = token.content if page == "glossary" else ""
        elif token.type == "inline" and token.children:
            token.children = list(_linked(token.children, left, own))


def _linked(children: list[Token], left: dict[str, str], own: str) -> Iterator[Token]:
    """Tokens of a line, with links in place of words of the glossary; the words that are linked are taken from `left`."""
    inside = 0
    for child in children:
        inside += (child.type == "link_open") - (child.type == "link_close")
        if child.type != "text" or inside:
            yield child
            continue
        rest = child.content
        while following := _next_term(rest, left, own):
            word, place = following
            yield _text(rest[: place.start()])
            yield Token("link_open", "a", 1, attrs={"href": f"glossary.md#{left.pop(word)}"})
            yield _text(place[0])
            yield Token("link_close", "a", -1)
            rest = rest[place.end() :]
        yield _text(rest)


def _next_term(text: str, left: Mapping[str, str], own: str) -> tuple[str, re.Match[str]] | None:
    """The first word of the glossary in a text, the longest one where several begin there."""
    uses = [(word, place) for word in left if word != own and (place := re.search(TERM.format(re.escape(word)), text, re.I))]
    return min(uses, key=_place_of_term, default=None)


def _place_of_term(use: tuple[str, re.Match[str]]) -> tuple[int, int]:
    return use[1].start(), -len(use[0])


def _text(content: str) -> Token:
    return Token("text", "", 0, content=content)


def _pictured(tokens: list[Token], pictures: Mapping[str, Picture]) -> list[Token]:
    """Tokens of a page with pictures as figures; a picture that was not made is left out, with its paragraph."""
    kept: list[Token] = []
    for token in tokens:
        images = [child for child in token.children or () if child.type == "image"]
        if token.type != "inline" or not images:
            kept.append(token)
            continue
        shown = [pictures[address] for image in images if (address := str(image.attrGet("src"))) in pictures]
        kept.pop()  # the paragraph, which a figure cannot stand in
        kept += [Token("html_block", "", 0, content=f"<figure>{_figure(picture)}</figure>\n") for picture in shown]
        kept.append(Token("html_block", "", 0, content=""))
    return [token for n, token in enumerate(kept) if not (token.type == "paragraph_close" and kept[n - 1].type == "html_block")]


def _figure(picture: Picture) -> Markup:
    image = Markup('<img src="{}" alt="{}" width="{}" height="{}">').format(
        picture.source, picture.alt, picture.width, picture.height
    )
    return (picture.svg or image) + Markup("<figcaption>{}</figcaption>").format(picture.caption)


def _formula(state: StateInline, silent: bool) -> bool:
    """Markdown's rule of formulas between dollar signs; a text that is no formula stays, with its signs."""
    end = state.src.find("$", state.pos + 1)
    if state.src[state.pos] != "$" or end < 0:
        return False
    formula = state.src[state.pos + 1 : end]
    if formula != formula.strip():  # two sums of money
        return False
    try:
        drawn = math(formula)
    except NoFormula:
        return False
    if not silent:
        state.push("html_inline", "math", 0).content = drawn
        state.tokens[-1].info = formula
    state.pos = end + 1
    return True


def _displayed(tokens: list[Token]) -> list[Token]:
    """Tokens of a page in which a paragraph that is a formula stands by itself, each relation of it in a row that may scroll."""
    shown, count = list(tokens), itertools.count(1)
    for n, token in enumerate(tokens):
        inner = token.children or []
        if token.type == "inline" and len(inner) == 1 and inner[0].tag == "math" and tokens[n - 1].type == "paragraph_open":
            rows = "".join(FORMULA.format(next(count), math(row, block=True)) for row in relations(inner[0].info))
            shown[n - 1 : n + 2] = [Token("html_block", "", 0, content=each) for each in (rows, "", "")]
    return shown


def _address(link: str) -> str:
    """A link of a Markdown page as the site has it."""
    path, hash_mark, anchor = link.partition("#")
    if "://" in path or not path.endswith(".md"):
        return link
    name = posixpath.basename(path).removesuffix(".md")
    return f"{'architecture' if name == 'ARCHITECTURE' else name}.html{hash_mark}{anchor}"


def _scrolling(html: str) -> str:
    """Tables that scroll by themselves on a narrow page."""
    count = itertools.count(1)
    html = re.sub("<table>", lambda _: TABLE.format(next(count)), html)
    return html.replace("</table>", "</table></div>").replace("<th>", '<th scope="col">')


def _source(name: str) -> str:
    return ELSEWHERE.get(name, PAGES / f"{name}.md").read_text(encoding="utf-8")


def _entries(part: str) -> Iterator[Entry]:
    for line in part.splitlines():
        if item := ITEM.match(line):
            yield Entry(_address(item[2]).removesuffix(".html"), item[1])
