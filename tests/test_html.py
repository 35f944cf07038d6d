"""report.html: one file that loads nothing, shows every name as it is, and stands in a real browser."""

import json
import math
import re
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from fixtures import browser
from fixtures.cases import CASES

from indentfit.cli import main
from indentfit.report.html import write_report
from indentfit.report.page import drawn, marked

EVIL = "<script>window.harmed=1</script>"
COARSE = ("--set", "mesh.elements=40", "--set", "solver.element=q1p0")


def run(*words):
    done = CliRunner().invoke(main, list(map(str, words)))
    assert done.exit_code == 0, done.output
    return done


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """The quickstart on a mesh of some elements, with a curve, a test and a title that would like to be markup."""
    folder = tmp_path_factory.mktemp("html") / "case"
    (folder / "curves").mkdir(parents=True)
    text = (CASES / "quickstart" / "case.toml").read_text().replace("elements = 100", "elements = 30")
    text = text.replace('name = "parallel"', f'name = "{EVIL}"').replace('title = "', f'title = "{EVIL} & ')
    text = text.replace("curves/parallel.csv", "curves/<b>&amp;.csv")
    (folder / "case.toml").write_text(text)
    for old, new in (("parallel", "<b>&amp;"), ("perpendicular", "perpendicular")):
        (folder / "curves" / f"{new}.csv").write_bytes((CASES / "quickstart" / "curves" / f"{old}.csv").read_bytes())
    return folder / "case.toml"


@pytest.fixture(scope="module")
def pages(case, tmp_path_factory):
    """A report of each kind: name -> path."""
    home = tmp_path_factory.mktemp("pages")
    free = ["--set", "material.zeta=3", "--set", "material.phi=1", "--set", "fit.workers=1"]
    run("fit", case, *free, "-o", home / "fit")
    vary = ["--vary", "material.zeta=+-15%", "--vary", "indenter.friction=0.2,stick"]
    run("sweep", case, *vary, "--workers", "1", "-o", home / "sweep")
    family = {"--elements": "24,30,36,44"}
    run("mesh-check", case, *(word for pair in family.items() for word in pair), "--mesh-only", "-o", home / "mesh-check")
    run("simulate", case, "--vtu", "-o", home / "simulate")
    run("design", case, *free, "-o", home / "design")
    return {path.name: path / "report.html" for path in home.iterdir() if path.is_dir()}


def references(key, value):
    """Names of the page that an attribute refers to; a bar whose hatching (fill) is not there is not seen."""
    if key == "href":
        return re.findall(r"^#(\S+)", value)
    return re.findall(r"url\(#([^)\s]+)\)", value) if key in ("clip-path", "fill") else []


KINDS = ("fit", "sweep", "mesh-check", "simulate", "design")
PICTURES = {"design": 1}  # at least two in pages of other kinds


class Outline(HTMLParser):
    """Tags with their attributes, and the text of the page."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.texts = [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, text):
        self.texts.append(text)


@pytest.mark.parametrize("kind", KINDS)
def test_a_page_loads_nothing_and_runs_nothing(pages, kind):
    text = pages[kind].read_text()
    outline = Outline(text)
    assert not [tag for tag, _ in outline.tags if tag in ("script", "link", "iframe", "object", "embed", "base", "form")]
    for tag, attributes in outline.tags:
        assert "style" not in attributes and not [name for name in attributes if name.startswith("on")], (tag, attributes)
        for name in ("src", "href", "srcset", "xlink:href"):
            assert attributes.get(name, "#").startswith(("#", "data:image/png;base64,"))
    policy = next(a["content"] for t, a in outline.tags if t == "meta" and a.get("http-equiv") == "Content-Security-Policy")
    assert policy.startswith("default-src 'none'") and "unsafe" not in policy and "script" not in policy


@pytest.mark.parametrize("kind", KINDS)
def test_names_are_shown_as_they_are_and_do_no_harm(pages, kind):
    text = pages[kind].read_text()
    outline = Outline(text)
    assert EVIL not in text and "<b>" not in text
    assert any(EVIL in one for one in outline.texts)  # in the title, and as the name of a test
    assert "curves/<b>&amp;.csv" in outline.texts


@pytest.mark.parametrize("kind", KINDS)
def test_names_within_the_page_are_its_own_and_every_reference_is_met(pages, kind):
    outline = Outline(pages[kind].read_text())
    names = [attributes["id"] for _, attributes in outline.tags if "id" in attributes]
    assert len(names) == len(set(names))
    used = {name for _, attributes in outline.tags for key, value in attributes.items() for name in references(key, value or "")}
    assert used <= set(names)


@pytest.mark.parametrize("kind", KINDS)
def test_what_hears_a_page_instead_of_seeing_it(pages, kind):
    outline = Outline(pages[kind].read_text())
    tags = [tag for tag, _ in outline.tags]
    assert ("html", {"lang": "en"}) in outline.tags and tags.count("h1") == 1 and tags.count("main") == 1
    assert tags.count("table") == tags.count("caption") and tags.count("figure") == tags.count("figcaption") > 0
    for tag, attributes in outline.tags:
        if tag == "svg":
            assert attributes["role"] == "img" and len(attributes["aria-label"]) > 20
        if tag == "img":
            assert len(attributes["alt"]) > 20
        if tag == "th":
            assert attributes["scope"] in ("row", "col")


def test_a_fit_page_says_what_was_found_how_sure_it_is_and_how_to_get_it_again(pages):
    folder = pages["fit"].parent
    result = json.loads((folder / "result.json").read_text())
    said = " ".join(" ".join(Outline(pages["fit"].read_text()).texts).split())
    mu = result["parameters"]["mu"]
    decimals = 1 - math.floor(math.log10(mu["stderr"]))  # two digits of the error
    assert 2 <= decimals <= 5 and f"{mu['value']:.{decimals}f}" in said and mu["verdict"].replace("+-", "±") in said
    assert " to ".join(f"{x:.{decimals}f}" for x in mu["interval"]) in said
    assert f"{result['objective']:.4g} mN" in said
    assert result["case_hash"] in said and "--set material.zeta=3" in said
    assert (folder / "case.toml").read_text().splitlines()[0] in said


def test_what_stands_between_backticks_is_code_and_still_escaped():
    assert marked("the error of `fit` & `<b>`, a`") == "the error of <code>fit</code> &amp; <code>&lt;b&gt;</code>, a`"


def test_optional_parts_of_a_fit_are_shown_where_a_result_has_them(pages, tmp_path):
    folder = pages["fit"].parent
    result = json.loads((folder / "result.json").read_text())
    (tmp_path / "curves.csv").write_bytes((folder / "curves.csv").read_bytes())
    values = np.linspace(0.8, 1.4, 7)
    runs = [{"value": 0.9, "chi2": 4.1, "predicted": 4.0}, {"value": 1.3, "chi2": None, "predicted": 4.0}]
    profile = {"values": values.tolist(), "chi2": (100 * (values - 1.1) ** 2).tolist(), "limit": 4.0, "interval": [0.9, 1.3]}
    result["profiles"] = {"mu": {**profile, "confirmed": runs}}
    alone = {"value": 1.1, "interval": [0.7, 1.5], "verdict": "weakly determined (+-40 %)"}
    result["tests_alone"] = {EVIL: {"rmse": 0.1, "confirmed_rmse": 0.1, "parameters": {"mu": alone}}}
    result["summary"] = ["determined by this curve: mu (0.9 to 1.3)"]
    made = {
        "friction": {"value": 0.5, "sd": 0.1, "share": {"mu": 0.25}},
        "mesh": {"value": 0.0, "sd": 0.012, "elements": 30, "share": {"mu": 0.35}},
        "base": {"value": "sliding", "sd": None, "probability": 0.3, "effect": {"mu": -0.3}, "share": {"mu": 0.1}},
    }
    result["uncertain"] = {"inputs": made, "noise": {"share": {"mu": 0.3}}}
    result["weights_scan"] = [{"weights": [0.25, 0.75], "parameters": {"mu": 1.15}, "rmse": {"a": 0.1, "b": 0.2}}]
    result["rivals"] = [{"parameters": {"mu": 2.0}, "objective": 0.9}]
    (tmp_path / "result.json").write_text(json.dumps(result))
    text = write_report(tmp_path).read_text()
    for words in ("Profile of μ", "weakly determined (±40 %)", "Determined by this curve", "25.0 %", "Other optima"):
        assert words in text
    for words in ("mesh (forces ± 1.20 %", "30.0 %", "30 % that it is bonded", "On a bonded base", "μ −0.3", "Weight of b"):
        assert words in text
    assert EVIL not in text
    del result["case"]  # a result of before the page
    (tmp_path / "result.json").write_text(json.dumps(result))
    assert "Profile of μ" in write_report(tmp_path).read_text()


@pytest.mark.parametrize("kind", KINDS)
def test_report_draws_the_same_page_again(pages, kind):
    def without_names(text):
        return re.sub(r"\bf\d+-", "f-", text)

    before = pages[kind].read_text()
    assert run("report", pages[kind].parent).stdout.strip() == str(pages[kind])
    assert without_names(pages[kind].read_text()) == without_names(before)


@pytest.mark.parametrize(
    "content", [None, "{", "[]", '{"format": "indentfit.sweep/9"}', '{"format": "indentfit.sweep/1"}', '{"format_version": 1}']
)
def test_what_is_no_result_folder_ends_with_2_in_one_line(tmp_path, content):
    if content is not None:
        (tmp_path / "result.json").write_text(content)
    done = CliRunner().invoke(main, ["report", str(tmp_path)])
    assert done.exit_code == 2 and len(done.stderr.splitlines()) == 1 and str(tmp_path) in done.stderr
    assert not (tmp_path / "report.html").exists()


def test_a_drawn_figure_has_no_style_and_keeps_its_colours():
    from matplotlib.figure import Figure

    figure = Figure()
    figure.add_subplot().plot([0, 1], [0, 1], color="#0072B2")
    svg = str(drawn(figure, "caption", "a line").svg)
    assert "style" not in svg and 'stroke="#0072b2"' in svg and "url(#f" in svg


def test_a_hatched_bar_of_a_figure_keeps_its_hatching():
    from matplotlib.figure import Figure

    figure = Figure()
    figure.add_subplot().bar([0, 1], [1, 2], color="#D55E00", hatch="////")
    svg = str(drawn(figure, "caption", "two bars").svg)
    (used,) = set(re.findall(r'fill="url\(#([^)]+)\)"', svg))
    assert f'<pattern id="{used}"' in svg or re.search(rf'<pattern [^>]*id="{used}"', svg)


# ---- in a browser ------------------------------------------------------------------------------------------------


def overlap(a, b):
    return min(a[2], b[2]) - max(a[0], b[0]) > 1 and min(a[3], b[3]) - max(a[1], b[1]) > 1


@pytest.fixture(scope="module")
def chromium(tmp_path_factory):
    program = browser.Browser(tmp_path_factory.mktemp("browser"))
    yield program
    program.close()


LOOKS = pytest.mark.parametrize(("kind", "width", "dark"), [(k, w, d) for k in KINDS for w in (390, 1400) for d in (False, True)])


@LOOKS
def test_in_a_browser_no_picture_is_missing_cut_or_overlapping(pages, chromium, kind, width, dark):
    chromium.open(pages[kind], width, dark)
    found = chromium.run(browser.LOOK)
    assert not chromium.said  # not a word of a policy that was broken
    assert found["width"] == width and found["edge"] == "5px" and not found["harmed"]
    assert found["background"] == ("rgb(20, 23, 27)" if dark else "rgb(255, 255, 255)")
    assert found["scrolls"] <= width and not found["wide"]  # nor does a table or a listing
    assert len(found["pictures"]) >= PICTURES.get(kind, 2)
    for picture in found["pictures"]:
        left, top, right, bottom = picture["box"]
        assert picture["whole"] and left >= 0 and right <= width and right - left > 250 and bottom - top > 100, picture
        assert picture["scale"] > 0.8, picture  # text of 13 pixels stays at 10 at least; a figure of several panels scrolls
    boxes = [picture["box"] for picture in found["pictures"]]
    assert not [1 for n, a in enumerate(boxes) for b in boxes[n + 1 :] if overlap(a, b)]
    assert not [1 for a in boxes for b in found["texts"] if overlap(a, b)]


@LOOKS
def test_axe_finds_nothing_to_complain_of(pages, chromium, kind, width, dark):
    axe = browser.package("axe-core", "4.14.1", "package/axe.min.js")
    chromium.open(pages[kind], width, dark)
    chromium.run(axe.read_text(encoding="utf-8") + "; 0")
    found = chromium.run("axe.run().then(r => [r.violations.map(v => [v.id, v.nodes[0].html]), r.passes.length])")
    assert found[0] == [] and found[1] > 15


def test_a_page_prints_on_paper_without_what_is_for_the_screen(pages, chromium):
    chromium.open(pages["fit"], 1400, dark=True)
    chromium.ask("Emulation.setEmulatedMedia", media="print")
    assert chromium.run("getComputedStyle(document.querySelector('nav')).display") == "none"
    assert chromium.run("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert chromium.run("getComputedStyle(document.querySelector('figure svg')).filter") == "none"
    assert len(chromium.ask("Page.printToPDF")["data"]) > 10_000
    chromium.ask("Emulation.setEmulatedMedia", media="")


def test_the_pages_are_valid_html(pages):
    """By the Nu Html Checker, the validator of the W3C."""
    if subprocess.run(["which", "java"], capture_output=True).returncode:
        pytest.skip("java, which the HTML validator needs, is not installed")
    jar = browser.package("vnu-jar", "26.9.27", "package/build/dist/vnu.jar")
    command = ["java", "-jar", jar, "--format", "json", *pages.values()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    found = [one for one in json.loads(done.stderr)["messages"] if one["type"] != "info" or one.get("subType") == "warning"]
    # it does not know hashes and data: in a policy; a browser does, and above it had not a word to say
    problems = [one for one in found if "Content Security Policy" not in one["message"]]
    assert not problems, [(Path(one["url"]).parent.name, one.get("lastLine"), one["message"]) for one in problems][:10]
