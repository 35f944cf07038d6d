"""Slips in a case file get one line with the line as it is right."""

import re
import tomllib

import pytest
from fixtures.cases import CASES

from indentfit.case.read import read_case_file
from indentfit.case.slips import remedy
from indentfit.errors import CaseError

pytestmark = pytest.mark.quick
GOOD = (CASES / "hydrogel_sphere" / "case.toml").read_text(encoding="utf-8")
SLIPS = [
    (r'curve = "curves\press.csv"', 'curve = "curves/press.csv"'),
    (r'curve = "C:\Users\me\press.csv"', 'curve = "C:/Users/me/press.csv"'),
    ("thickness = 5 mm", 'thickness = "5 mm"'),
    ("thickness = 5mm  # along y", 'thickness = "5mm"'),
    ("thickness = 5,0", "thickness = 5.0"),
    ("thickness = 5,0 mm", 'thickness = "5.0 mm"'),
    ("shape = disc", 'shape = "disc"'),
    ("curve = press.csv", 'curve = "press.csv"'),
    ("curve = press 2.csv", 'curve = "press 2.csv"'),
    ('curve = "press.csv', 'curve = "press.csv"'),
    ("curve = “press.csv”", 'curve = "press.csv"'),
    ("thickness: 5", "thickness = 5"),
    ("thickness = .5", "thickness = 0.5"),
    ("thickness = 5.", "thickness = 5.0"),
    ("thickness = 05", "thickness = 5"),
    ("mu = { start = 1,5, min = 0,1, max = 10 }", "mu = { start = 1.5, min = 0.1, max = 10 }"),
    ("mu = { start = 1; min = 0.1; max = 10 }", "mu = { start = 1, min = 0.1, max = 10 }"),
    ("mu = { start = 1 kPa, min = 0.1, max = 10 kPa }", 'mu = { start = "1 kPa", min = 0.1, max = "10 kPa" }'),
    ("synthetic = True", "synthetic = true"),
    ("[sample", "[sample]"),
    ("[[test]", "[[test]]"),
]


@pytest.mark.parametrize(("wrong", "right"), SLIPS)
def test_a_slip_is_answered_with_the_line_as_it_is_right(tmp_path, wrong, right):
    tomllib.loads(right)
    with pytest.raises(tomllib.TOMLDecodeError):
        tomllib.loads(wrong)
    assert right.removeprefix("curve = ") in remedy(wrong)
    key = re.escape(wrong.split("=")[0].split(":")[0].strip())
    place = tmp_path / "case.toml"
    lines = [wrong if re.match(rf"{key}\b", line) and wrong[0] != "[" else line for line in GOOD.split("\n")]
    lines = lines if wrong in lines else [*lines, wrong]
    place.write_text(GOOD.replace(right, wrong) if wrong[0] == "[" else "\n".join(lines), encoding="utf-8")
    with pytest.raises(CaseError) as caught:
        read_case_file(place)
    assert "\n" not in str(caught.value) and right.removeprefix("curve = ") in str(caught.value)


@pytest.mark.parametrize("line", ["thickness = = 5", "x = [1, 2", "]", "a b c"])
def test_what_is_no_known_slip_gets_no_wrong_remedy(line):
    with pytest.raises(tomllib.TOMLDecodeError):
        tomllib.loads(line)
    assert remedy(line) is None


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (r'curve = "data\new.csv"', 'write "data/new.csv"'),
        ('thickness = "5,0 mm"', 'has a decimal comma; write a point, "5.0 mm"'),
        ("thickness = None", "leave out the line"),
    ],
)
def test_a_backslash_and_a_comma_that_toml_takes_are_found_too(tmp_path, line, said):
    key = line.split(" ")[0]
    place = tmp_path / "case.toml"
    place.write_text(re.sub(rf"(?m)^{key} = .*", lambda _: line, GOOD), encoding="utf-8")
    with pytest.raises(CaseError) as caught:
        read_case_file(place)
    assert said in str(caught.value)
