"""Accessibility as far as it can be told without a browser: contrasts of the style, order of headings, names of regions."""

import html.parser
import itertools
import re

import pytest

from indentfit.cli.reference import commands_page
from indentfit.report.guide import write_site
from indentfit.report.guide_parts import generated_parts
from indentfit.report.page import HERE, Code, Lines, Page, Section, Table, Text, render

CSS = (HERE / "page.css").read_text(encoding="utf-8")
SCHEMES = re.findall(r":root \{([^}]*--ink[^}]*)\}", CSS)


def colours(scheme):
    """The colours of a scheme as (red, green, blue), 0 to 1."""
    known = re.findall(r"--(\w+): #([0-9a-fA-F]{3,6})\b", scheme)
    full = {name: value if len(value) == 6 else "".join(digit * 2 for digit in value) for name, value in known}
    return {name: tuple(int(value[n : n + 2], 16) / 255 for n in (0, 2, 4)) for name, value in full.items()}


def luminance(colour):
    """Relative luminance, WCAG 2.2."""
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in colour]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(first, second):
    """Contrast of two colours, WCAG 2.2."""
    high, low = sorted((luminance(first), luminance(second)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def test_the_contrast_of_known_colours():
    assert contrast((0, 0, 0), (1, 1, 1)) == pytest.approx(21)
    assert contrast((0x76 / 255,) * 3, (1, 1, 1)) == pytest.approx(4.54, abs=0.01)  # the usual example of WCAG


@pytest.mark.parametrize("scheme", range(3), ids=["light", "dark", "print"])
def test_text_has_a_contrast_of_4_5_on_every_ground(scheme):
    assert len(SCHEMES) == 3
    known = colours(SCHEMES[scheme])
    for ground in ("paper", "card"):
        assert all(contrast(known[name], known[ground]) >= 4.5 for name in ("ink", "soft", "link", "good", "bad")), ground
        assert contrast(known["amber"], known["card"]) >= 3  # a border, which words repeat


class Outline(html.parser.HTMLParser):
    """Headings, regions, pictures and cells of a page."""

    def __init__(self, text):
        super().__init__()
        self.headings, self.regions, self.tags, self.ids = [], [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        known = dict(attributes)
        self.tags.append((tag, known))
        if re.fullmatch(r"h[1-6]", tag):
            self.headings.append(int(tag[1]))
        if known.get("role") == "region" or tag == "nav":
            self.regions.append(known.get("aria-label"))
        if "id" in known:
            self.ids.append(known["id"])


def check(text):
    """Raise AssertionError where a page breaks a rule."""
    page = Outline(text)
    assert page.headings[0] == 1 and page.headings.count(1) == 1
    assert all(after <= before + 1 for before, after in itertools.pairwise(page.headings))
    assert None not in page.regions and len(set(page.regions)) == len(page.regions)
    assert len(set(page.ids)) == len(page.ids)
    for tag, known in page.tags:
        assert tag != "html" or known["lang"] == "en"
        assert tag != "img" or known["alt"]
        assert tag != "svg" or (known["role"] == "img" and known["aria-label"])
        assert tag != "th" or known["scope"] in ("row", "col")
        assert tag not in ("script", "iframe", "object", "embed", "form", "input")
    assert ("a", {"class": "skip", "href": "#content"}) in page.tags and "content" in page.ids


def test_the_guide_keeps_the_rules(tmp_path):
    write_site(tmp_path, {**generated_parts(), "commands": commands_page()})
    pages = sorted(tmp_path.glob("*.html"))
    assert len(pages) > 25
    for path in pages:
        check(path.read_text(encoding="utf-8"))


def test_a_page_of_a_result_keeps_the_rules_and_a_page_that_breaks_one_is_seen():
    parts = (Text("words"), Lines(("a line",)), Table("Numbers", ("Name", "Number"), (("a", "1"),)), Code("A file", "text"))
    text = render(Page("Title", "Kind", "Good.", "Words.", True, (Section("a", "First", parts), Section("b", "Second", ()))))
    check(text)
    for spoilt in (text.replace("<h2", "<h3"), text.replace('scope="col"', 'scope="x"'), text.replace('id="b"', 'id="a"')):
        with pytest.raises(AssertionError):
            check(spoilt)
