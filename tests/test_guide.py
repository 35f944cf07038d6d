"""README and guide: short, in short sentences, complete, with links that lead somewhere and commands that work."""

import html.parser
import inspect
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
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
from indentfit.report.guide import PAGES, chapters, html_page, page_names, page_text, write_site
from indentfit.report.guide_parts import generated_parts
from indentfit.report.schema import READERS

ROOT = Path(__file__).parent.parent
README = ROOT / "README.md"
TUTORIALS = ["gel_and_sphere", "punch_on_cartilage", "bar_on_fibres", "raw_records", "several_samples"]  # own_law: test_tutorial.py
BLOCK = re.compile(r"```(python|sh)\n(.*?)```", re.DOTALL)
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


@pytest.mark.parametrize("page", ["README", *TUTORIALS, "own_law", "which_case", "read_a_result", "curves"])
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
        heading = "[[test]]" if facts.table == "test" else f"[{facts.table}]"
        table = text.split(f"## {heading}\n")[1].split("\n## ")[0]
        assert f"| `{facts.name}` |" in table


def test_every_command_and_option_stands_in_the_reference(generated):
    text, context = page_text("commands", generated), click.Context(main)
    count = 0
    for name in COMMANDS:
        part = text.split(f"\n## {name}\n")[1].split("\n## ")[0]
        for parameter in main.get_command(context, name).params:
            if isinstance(parameter, click.Option):
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
    assert all(f"### {tag}\n" in page_text("results", generated) for tag in READERS)


# Tutorials: pytest -m guide


@pytest.mark.guide
@pytest.mark.parametrize("page", TUTORIALS)
def test_the_commands_of_a_tutorial_work(page, tmp_path):
    (tmp_path / "cases").symlink_to(CASES)
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}", "COLUMNS": "200"}
    said = {}
    for language, text in BLOCK.findall((PAGES / f"{page}.md").read_text()):
        if language == "python":
            (tmp_path / re.match(r"# file: (\S+)", text)[1]).write_text(text)
            continue
        for line in text.splitlines():
            before = os.times()
            done = subprocess.run(shlex.split(line), cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=600)
            after = os.times()
            said[line] = done.stdout, sum(after[2:4]) - sum(before[2:4])
            assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}"
    print(*(f"{seconds:6.1f} s  {line[:100]}" for line, (_, seconds) in said.items()), sep="\n")
    assert sum(seconds for _, seconds in said.values()) < 120  # of CPU
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


def test_the_menu_has_four_chapters():
    assert [chapter.title for chapter in chapters()] == ["Tutorials", "How to", "Reference", "Background"]
