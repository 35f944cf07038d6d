"""README and guide: short, in short sentences, complete, with links that lead somewhere and commands that work."""

import html.parser
import inspect
import json
import re
import shlex
import shutil
from pathlib import Path

import click
import pytest
from click.testing import CliRunner
from fixtures.browser import Browser
from fixtures.cases import CASES

import indentfit
from indentfit.case.keys import keys
from indentfit.cli import COMMANDS, main
from indentfit.cli.reference import commands_page
from indentfit.material import installed
from indentfit.report.guide import PAGES, chapters, html_page, page_names, page_text, terms, write_site
from indentfit.report.guide_examples import BLOCK, TUTORIALS, pictures_of, run_page
from indentfit.report.guide_parts import generated_parts
from indentfit.report.page import Picture
from indentfit.report.schema import CLASSES

ROOT = Path(__file__).parent.parent
README = ROOT / "README.md"
MOST_WORDS, MOST_BYTES = 30, 4096


@pytest.fixture(scope="module")
def generated():
    return {**generated_parts(), "commands": commands_page()}


@pytest.fixture(scope="module")
def site(tmp_path_factory, generated):
    return write_site(tmp_path_factory.mktemp("site"), generated).parent


# README


def test_the_readme_is_short():
    assert README.stat().st_size <= MOST_BYTES


def sentences(text):
    """Sentences of the prose of a Markdown text: no code, no tables, no headings."""
    text = re.sub(r"```.*?```", "\n\n", text, flags=re.DOTALL)
    for block in re.split(r"\n\s*\n|\n(?=- |\d+\. |\|)", text):
        if re.match(r" {4}|#|\||!\[", block):
            continue
        yield from re.split(r"(?<=[.!?])\s+", re.sub(r"\]\([^)]*\)", "]", " ".join(block.split())))


@pytest.mark.parametrize("page", ["README", *sorted(file.stem for file in PAGES.glob("*.md"))])
def test_sentences_are_short(page):
    text = README.read_text() if page == "README" else (PAGES / f"{page}.md").read_text()
    long = [sentence for sentence in sentences(text) if len(re.findall(r"\S*\w\S*", sentence)) > MOST_WORDS]
    assert not long


def test_long_sentences_are_seen():
    words = " ".join(["word"] * 31)
    assert [len(s.split()) for s in sentences(f"Short one. {words}.\n\n    {words}\n\n- {words}\n- two")] == [2, 31, 32, 2]


def test_the_commands_of_the_readme_lead_from_a_curve_to_the_report_of_the_known_truth(tmp_path, monkeypatch):
    """Young's modulus of cases/hydrogel_sphere is 9 kPa: README.md there."""
    monkeypatch.chdir(tmp_path)
    shutil.copy(CASES / "hydrogel_sphere" / "press.csv", "my.csv")
    told = re.search(r"diameter (\d+), thickness (\d+), base\s+`\"(\w+)\"`, radius (\d+)", README.read_text())
    values = dict(zip(("diameter", "thickness", "base", "radius"), told.groups(), strict=True))
    lines = [line for _, text in BLOCK.findall(README.read_text()) for line in text.splitlines()]
    assert [line.split()[:2] for line in lines] == [
        ["indentfit", "init"], ["cd", "gel"], ["indentfit", "validate"], ["indentfit", "simulate"], ["indentfit", "fit"]
    ]  # fmt: skip
    for line in lines:
        program, *words = shlex.split(line)
        if program == "cd":
            monkeypatch.chdir(words[0])
            text = Path("case.toml").read_text()
            for key, value in values.items():
                assert f'{key} = "?"' in text
                text = text.replace(f'{key} = "?"', f"{key} = {json.dumps(value) if value.isalpha() else value}")
            Path("case.toml").write_text(text)
            continue
        extra = ["--set", "fit.workers=1", "--set", "indenter.friction=0"] if words[0] == "fit" else []
        done = CliRunner().invoke(main, [*words, *extra])
        assert done.exit_code == 0, done.output
    young = json.loads(Path("gel-result/result.json").read_text())["moduli"]["E"]
    assert young["value"] == pytest.approx(9.0, rel=0.02)
    assert Path("gel-result/report.html").is_file()


def test_the_files_that_the_readme_names_are_there():
    links = re.findall(r"\]\(([^)]+)\)", README.read_text())
    assert len(links) > 3
    assert all("://" in link or (ROOT / link).exists() for link in links)
    assert ".venv/bin/pip install '.[test]' && .venv/bin/pytest -n 2" in README.read_text()


# The guide as a site


class Page(html.parser.HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.links, self.names = [], set()
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        known = dict(attributes)
        if tag == "a":
            self.links.append(known["href"])
        if "id" in known:
            assert known["id"] not in self.names, known["id"]
            self.names.add(known["id"])


def test_every_link_of_the_guide_leads_to_a_page_and_an_anchor(site):
    pages = {path.name: Page(path.read_text()) for path in site.glob("*.html")}
    assert set(pages) == {f"{name}.html" for name in page_names()}
    broken, seen = [], 0
    for name, page in pages.items():
        for link in page.links:
            path, _, anchor = link.partition("#")
            if "://" in link:
                continue
            seen += 1
            there = pages.get(path or name)
            if there is None or (anchor and anchor not in there.names):
                broken.append((name, link))
    assert not broken and seen > 500


def test_a_broken_link_is_seen():
    page = Page(html_page("x", "# Title\n\n[there](mesh.md#no-such) [same](#title)\n"))
    assert page.links[-2:] == ["mesh.html#no-such", "#title"]
    assert "title" in page.names


def test_every_page_is_in_the_menu_and_every_generated_part_is_used(generated):
    files = {path.stem for path in PAGES.glob("*.md")}
    assert files == set(page_names()) - {"architecture"}
    used = set(re.findall(r"^@@(\w+)@@$", "".join(path.read_text() for path in PAGES.glob("*.md")), re.MULTILINE))
    assert used == set(generated)


def test_every_word_of_the_glossary_is_linked_where_a_page_uses_it_first(site):
    words = terms()
    assert len(words) > 20 and len(set(words.values())) == len(words)
    linked = 0
    for page in (*TUTORIALS, "own_law", "which_case", "read_a_result", "search", "accuracy"):
        html = (site / f"{page}.html").read_text()
        prose = re.sub(r'<a href="glossary.html#[^>]*>(.*?)</a>', r"\1", html)
        prose = re.sub(r"<(h\d|a|pre|code|title|details|nav|footer)\b.*?</\1>", " ", prose, flags=re.DOTALL)
        for word, anchor in words.items():
            if re.search(rf"(?<![\w-]){re.escape(word)}(?:s|es)?(?![\w-])", prose, re.IGNORECASE):
                assert html.count(f'href="glossary.html#{anchor}"') == 1, (page, word)
                linked += 1
    assert linked > 30


def test_a_word_is_linked_once_and_not_in_headings_code_or_links():
    body = html_page("x", "# The surrogate\n\n`surrogate` [a surrogate](mesh.md), a Surrogate and a surrogate.\n").split("<main")[1]
    assert body.count("glossary.html#surrogate") == 1
    assert '<a href="glossary.html#surrogate">Surrogate</a> and a surrogate' in body


def test_a_picture_that_was_not_made_is_left_out():
    text = "# Title\n\nBefore.\n\n![A fit](there/fit.svg)\n\nAfter.\n"
    without = html_page("x", text).split("<main")[1]
    assert (
        "<img" not in without and "figure" not in without and without.count("<p>") == without.count("</p>") == 3
    )  # and the footer
    made = {"there/fit.svg": Picture("A fit.", "A fit", source="data:image/png;base64,AA", width=3, height=2)}
    figure = '<figure><img src="data:image/png;base64,AA" alt="A fit" width="3" height="2"><figcaption>A fit.</figcaption></figure>'
    assert figure in html_page("x", text, made)


def test_markup_in_a_page_is_text():
    assert "<script>" not in html_page("x", "# Title\n\n<script>alert(1)</script>\n")


def test_what_names_a_file_of_the_source_names_one_that_is_there():
    text = "".join(path.read_text() for path in PAGES.glob("*.md"))
    for name in set(re.findall(r"`((?:cases|tests|indentfit)/[\w./]+)`", text)):
        assert (ROOT / name).exists(), name


def test_the_command_prints_pages_and_refuses_others(tmp_path):
    done = CliRunner().invoke(main, ["guide", "mesh"])
    assert done.exit_code == 0 and done.stdout.startswith("# Choose a mesh")
    done = CliRunner().invoke(main, ["guide", "mesg"])
    assert done.exit_code == 2 and "did you mean mesh?" in done.stderr
    done = CliRunner().invoke(main, ["guide", "--list"])
    assert done.exit_code == 0 and "gel_and_sphere" in done.stdout
    done = CliRunner().invoke(main, ["guide", "-o", str(tmp_path / "site")])
    assert done.exit_code == 0 and (tmp_path / "site" / "index.html").is_file()


def test_the_site_is_readable_on_a_phone_and_in_the_dark(site, tmp_path):
    browser = Browser(tmp_path)
    try:
        for width in (390, 1400):
            for dark in (False, True):
                for page in ("index", "case_file", "gel_and_sphere"):
                    browser.open(site / f"{page}.html", width, dark)
                    assert browser.run("document.documentElement.scrollWidth") <= width
                    assert not browser.said
    finally:
        browser.close()


# The reference


def test_every_key_stands_in_the_reference(generated):
    text = page_text("case_file", generated)
    for facts in keys():
        heading = f"[[{facts.table}]]" if facts.table in ("test", "test.field", "sample.layer") else f"[{facts.table}]"
        table = text.split(f"## {heading}\n")[1].split("\n## ")[0]
        assert f"| `{facts.name}` |" in table


def test_every_command_and_option_stands_in_the_reference(generated):
    text, context = page_text("commands", generated), click.Context(main)
    count = 0
    for name in COMMANDS:
        part = text.split(f"\n## {name}\n")[1].split("\n## ")[0]
        for parameter in main.get_command(context, name).params:
            if isinstance(parameter, click.Option) and not parameter.hidden:
                assert parameter.opts[-1] in part and parameter.help.split(";")[0][:40] in part
                count += 1
    assert count > 60


def test_every_public_name_material_and_kind_of_result_stands_in_the_reference(generated):
    api = page_text("api", generated)
    for name in indentfit.__all__:
        assert f"\n## {name}\n" in api
        assert inspect.getdoc(getattr(indentfit, name)).splitlines()[0] in api
    materials = page_text("materials", generated)
    for name, law in installed().items():
        part = materials.split(f"\n## {name}\n")[1].split("\n## ")[0]
        assert all(f"| `{parameter}` |" in part for parameter in law.parameters)
    assert all(f"### {tag}\n" in page_text("results", generated) for tag in CLASSES)


# Tutorials: pytest -m guide


@pytest.mark.guide
@pytest.mark.parametrize("page", TUTORIALS)
def test_the_commands_of_a_tutorial_work_and_make_its_pictures(page, tmp_path):
    ran = run_page(page, CASES, tmp_path)
    print(*(f"{each.seconds:6.1f} s  {each.line[:100]}" for each in ran), sep="\n")
    assert sum(each.seconds for each in ran) < 120  # of CPU
    pictures = pictures_of(page, tmp_path)
    assert pictures and all(picture.alt for picture in pictures.values())
    TRUTHS.get(page, lambda folder: None)(tmp_path)


def gel(folder):
    low, high = json.loads((folder / "gel-result" / "result.json").read_text())["moduli"]["E"]["interval"]
    assert low < 9.0 < high


def cartilage(folder):
    value = json.loads((folder / "cartilage-result" / "result.json").read_text())["parameters"]["mu"]["value"]
    assert value == pytest.approx(200, rel=0.01)


def bar(folder):
    low, high = json.loads((folder / "quickstart-result" / "result.json").read_text())["parameters"]["mu"]["interval"]
    assert low < 1.2 < high


TRUTHS = {"gel_and_sphere": gel, "punch_on_cartilage": cartilage, "bar_on_fibres": bar}


def test_every_campaign_is_named_on_the_page_of_tests():
    page = (PAGES / "development.md").read_text(encoding="utf-8")
    campaigns = {file.name for file in (ROOT / "tests" / "campaigns").glob("*.py")}
    assert campaigns == set(re.findall(r"python tests/campaigns/(\w+\.py)", page))


def test_the_menu_has_four_chapters():
    assert [chapter.title for chapter in chapters()] == ["Tutorials", "How to", "Reference", "Background"]
