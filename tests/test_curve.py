"""Curves: what a CSV file may look like, and how each wrong one is refused."""

import numpy as np
import pytest

from indentfit.curve import Curve, read_curve, write_curve
from indentfit.errors import CurveError
from indentfit.units import unit_factor

pytestmark = pytest.mark.quick

POINTS = [(0.0, 0.0), (0.1, 7.0), (0.2, 15.0), (0.3, 24.0), (0.4, 34.0)]
ROWS = "".join(f"{d},{f}\n" for d, f in POINTS)
HEADER = "displacement_mm,force_mN\n"


@pytest.fixture
def curve_of(tmp_path):
    """Reads a text or bytes as a curve file."""

    def read(content):
        path = tmp_path / "curve.csv"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return read_curve(path)

    return read


def refusal(curve_of, content):
    with pytest.raises(CurveError) as caught:
        curve_of(content)
    assert len(str(caught.value).splitlines()) == 1
    assert "curve.csv: " in str(caught.value)
    return str(caught.value).split("curve.csv: ", 1)[1]


def assert_is_the_curve(curve):
    np.testing.assert_allclose(curve.displacement, [d for d, _ in POINTS], rtol=1e-13)
    np.testing.assert_allclose(curve.force, [f for _, f in POINTS], rtol=1e-13)


GOOD = {
    "plain": HEADER + ROWS,
    "a BOM": "\ufeff" + HEADER + ROWS,
    "CRLF": (HEADER + ROWS).replace("\n", "\r\n"),
    "old Mac line ends": (HEADER + ROWS).replace("\n", "\r"),
    "no last line end": (HEADER + ROWS).rstrip(),
    "comments and blank lines": "# sample 3\n\n" + HEADER + "# loading\n" + ROWS + "\n\n",
    "spaces": HEADER.replace(",", " , ") + ROWS.replace(",", " ,  "),
    "quotes": '"displacement_mm","force_mN"\n' + ROWS,
    "tabs": (HEADER + ROWS).replace(",", "\t"),
    "semicolons": (HEADER + ROWS).replace(",", ";"),
    "semicolons and decimal commas": (HEADER + ROWS).replace(",", ";").replace(".", ","),
    "columns the other way": "force_mN,displacement_mm\n" + "".join(f"{f},{d}\n" for d, f in POINTS),
    "another column": "time_s,displacement_mm,force_mN\n" + "".join(f"9,{d},{f}\n" for d, f in POINTS),
    "micrometres and newtons": "displacement_um,force_N\n" + "".join(f"{d * 1e3},{f / 1e3}\n" for d, f in POINTS),
    "micro sign": "displacement_µm,force_mN\n" + "".join(f"{d * 1e3},{f}\n" for d, f in POINTS),
    "metres and micronewtons": "displacement_m,force_uN\n" + "".join(f"{d / 1e3},{f * 1e3}\n" for d, f in POINTS),
    "rounding below zero": HEADER + ROWS.replace("0.0,0.0", "-1e-17,0.0"),
    "a little negative force at first": HEADER + ROWS.replace("0.0,0.0", "0.0,-0.1"),
}


@pytest.mark.parametrize("name", GOOD)
def test_a_curve_is_read_whatever_wrote_it(curve_of, name):
    curve = curve_of(GOOD[name])
    if "negative" in name:
        assert curve.force[0] == -0.1
    else:
        assert_is_the_curve(curve)
    assert curve.displacement[0] >= 0


def test_grams_of_force_become_millinewtons(curve_of):
    curve = curve_of("displacement_mm,force_gf\n" + ROWS)
    np.testing.assert_allclose(curve.force, 9.80665 * np.array([f for _, f in POINTS]), rtol=1e-12)  # standard gravity


BAD = {
    "an empty file": ("", "empty"),
    "blank lines only": ("\n\n", "empty"),
    "comments only": ("# nothing\n", "empty"),
    "a header only": (HEADER, "0 points"),
    "too few points": (HEADER + "0.1,1\n0.2,2\n0.3,3\n0.4,4\n", "4 points; a curve needs at least 5"),
    "no header": (ROWS, "line 1: numbers and no header; write one above them"),
    "a wrong header": (
        "depth,load\n" + ROWS,
        "no column displacement_mm: 'depth' states no unit; write for example 'depth (mm)'",
    ),
    "a header without units": ("displacement,force\n" + ROWS, "no column displacement_mm"),
    "no force": ("displacement_mm,stress_mN\n" + ROWS, "no column force_mN"),
    "two forces": ("displacement_mm,force_mN,force_N\n" + ROWS, "2 columns of force"),
    "a unit of another kind": ("displacement_mm,force_kPa\n" + ROWS, "'force_kPa' is in kPa"),
    "an unknown unit": ("displacement_mm,force_foo\n" + ROWS, "unknown unit 'foo'; use mN"),
    "a wild unit": ("displacement_mm,force_9**9**9\n" + ROWS, "no readable unit"),
    "an endless unit": ("displacement_mm,force_" + "x" * 10_000 + "\n" + ROWS, "unknown unit"),
    "text in a number column": (HEADER + ROWS + "0.5,abc\n", "line 7: 'abc' is not a number"),
    "a missing number": (HEADER + ROWS + "0.5,\n", "line 7: '' is not a number"),
    "digits grouped by underscores": (HEADER + ROWS + "0.5,1_0\n", "line 7: '1_0' is not a number"),
    "NaN": (HEADER + ROWS + "0.5,nan\n", "line 7: 'nan' is not a finite number"),
    "infinity": (HEADER + ROWS + "0.5,inf\n", "line 7: 'inf' is not a finite number"),
    "a missing column": (HEADER + ROWS + "0.5\n", "line 7: '0.5' has 1 columns, the header 2"),
    "decimal commas between commas": (HEADER + "0,1,7,0\n" + ROWS, "line 2: '0,1,7,0' has 4 columns, the header 2;"),
    "unsorted displacements": (HEADER + ROWS + "0.25,40\n", "line 7: displacement 0.25 mm comes after 0.4 mm; sort"),
    "an unloading": (
        HEADER + ROWS + "0.3,20\n0.2,10\n0.1,5\n0,0\n",
        "line 7: displacement 0.3 mm comes after 0.4 mm: from here",
    ),
    "a hold": (
        HEADER + ROWS + "0.4,20\n0.4,10\n0.4,5\n",
        "line 7: displacement 0.4 mm is held from here on; keep the loading before it, or add a column time_s",
    ),
    "a hold and an unloading": (HEADER + ROWS + "0.4,20\n0.4,10\n0.4,5\n0.2,4\n", "line 7: displacement 0.4 mm is held from here"),
    "a pause in the loading": (HEADER + ROWS + "0.4,20\n0.4,10\n0.4,5\n0.5,40\n", "line 7: displacement 0.4 mm is given twice"),
    "a rest before the loading": (
        HEADER + "0,0\n0,0\n0,0\n0,0\n" + ROWS,
        "line 3: displacement 0 mm is given twice",
    ),
    "a duplicate displacement": (HEADER + ROWS + "0.4,40\n", "line 7: displacement 0.4 mm is given twice"),
    "unloading": (HEADER + ROWS + "0.3,2\n0.2,1\n", "keep the loading only"),
    "a negative displacement": (HEADER + "-0.1,1\n" + ROWS, "line 2: displacement -0.1 mm is negative"),
    "only zero force": (HEADER + "".join(f"{d},0\n" for d, _ in POINTS), "every force is zero"),
    "tension": (HEADER + "".join(f"{d},{-f}\n" for d, f in POINTS), "line 6: force -34 mN"),
    "Latin-1": ("# Größe\n".encode("latin-1") + (HEADER + ROWS).encode(), "line 1: not UTF-8"),
    "UTF-16": ((HEADER + ROWS).encode("utf-16"), "line 1: not UTF-8"),
    "a spreadsheet": (b"PK\x03\x04\x14\x00\x06\x00\xff\xfe", "not UTF-8"),
    "a line of a book": (HEADER + ROWS + "0.5," + "x" * 100_000 + "\n", "line 7: 'xxx"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_wrong_curve_is_refused_in_one_line(curve_of, name):
    content, said = BAD[name]
    message = refusal(curve_of, content)
    assert said in message
    assert len(message) < 250


def test_a_missing_file_and_a_folder_are_refused(tmp_path):
    for path, said in ((tmp_path / "none.csv", "no such file"), (tmp_path, "not a file")):
        with pytest.raises(CurveError, match=said):
            read_curve(path)


def test_a_curve_reads_back_as_it_was_written(tmp_path):
    rng = np.random.default_rng(0)
    curve = Curve(np.cumsum(rng.random(50) + 1e-3), rng.random(50) + 0.1)
    write_curve(tmp_path / "curve.csv", curve)
    again = read_curve(tmp_path / "curve.csv")
    assert np.array_equal(again.displacement, curve.displacement)
    assert np.array_equal(again.force, curve.force)


def test_a_curve_cannot_be_changed():
    curve = Curve([0.0, 1.0], [0.0, 2.0])
    with pytest.raises(ValueError, match="read-only"):
        curve.force[0] = 1.0


def test_a_curve_needs_a_force_for_each_displacement():
    with pytest.raises(CurveError, match="one force for each displacement"):
        Curve([0.0, 1.0], [0.0])


def test_a_long_record_is_read(curve_of):
    rows = "".join(f"{n / 1e6:.7f},{n / 1e3:.4f}\n" for n in range(1, 100_001))
    assert curve_of(HEADER + rows).force.size == 100_000


@pytest.mark.parametrize(("unit", "factor"), [("Pa", 1e-3), ("MPa", 1e3), ("N/m^2", 1e-3), ("kPa", 1.0)])
def test_units_of_pressure_are_turned_into_kilopascals(unit, factor):
    assert unit_factor(unit, "kPa") == pytest.approx(factor, rel=1e-13)


def test_a_curve_of_other_things_than_numbers_is_refused():
    with pytest.raises(CurveError, match="the force of a curve must be numbers"):
        Curve([1, 2], ["a", "b"])
    with pytest.raises(CurveError, match="one force for each displacement"):
        Curve([1, 2], [1])


def test_a_curve_is_shown_in_one_line():
    assert repr(Curve([0.1, 0.33], [1.0, 24.06])) == "Curve(2 points to 0.33 mm and 24.06 mN)"
    assert repr(Curve([], [])) == "Curve(0 points)"


@pytest.mark.parametrize(
    ("header", "displacement", "force"),
    [
        ("Displacement (mm),Load (gf)", 1.0, 9.80665),  # one gram-force is 9.80665 mN by definition
        ("Indentation [um],Force [nN]", 1e-3, 1e-6),
        ("depth_um,LOAD_uN", 1e-3, 1e-3),
        ("Displacement um,Load mN", 1e-3, 1.0),
    ],
)
def test_headers_of_other_programs_are_read(tmp_path, header, displacement, force):
    (tmp_path / "c.csv").write_text(header + "\n" + "".join(f"{n},{2 * n}\n" for n in range(1, 7)))
    curve = read_curve(tmp_path / "c.csv")
    np.testing.assert_allclose(curve.displacement, displacement * np.arange(1, 7), rtol=1e-12)
    np.testing.assert_allclose(curve.force, 2 * force * np.arange(1, 7), rtol=1e-12)
    assert curve.notes == ()


@pytest.mark.parametrize(
    ("more", "note"),
    [
        (
            "displacement_retract_mm,force_retract_mN",
            "the loading is read, and the retraction is left out: displacement_retract_mm, force_retract_mN",
        ),
        (
            "displacement_sd_mm,force_sd_mN",
            "standard deviations of displacements are left out; fit.uncertain.offset states one of all points: displacement_sd_mm",
        ),
    ],
)
def test_columns_that_are_left_out_are_named(tmp_path, more, note):
    rows = "".join(f"{n},{2 * n},{n},{n}\n" for n in range(1, 7))
    (tmp_path / "c.csv").write_text(f"displacement_mm,force_mN,{more}\n{rows}")
    curve = read_curve(tmp_path / "c.csv")
    assert curve.force.tolist() == [2.0 * n for n in range(1, 7)]
    (said,) = curve.notes
    assert said.endswith(note)


def test_two_forces_of_one_kind_name_the_other_way(tmp_path):
    (tmp_path / "c.csv").write_text("Displacement (mm),Load (gf),Force (N)\n" + "1,1,1\n" * 6)
    with pytest.raises(CurveError, match=r"2 columns of force; .* a rig's own file is read as test\.record"):
        read_curve(tmp_path / "c.csv")


@pytest.mark.parametrize(
    ("text", "factors", "notes"),
    [
        ("Depth (m),Force (N)\n", (1e3, 1e3), 0),
        ("Displacement / mm,Force / mN\n", (1, 1), 0),
        ("Displacement in um,Force in N\n", (1e-3, 1e3), 0),
        ("Indentation depth (nm),Normal force (nN)\n", (1e-6, 1e-6), 0),
        ("DISPLACEMENT (MM),FORCE (N)\n", (1, 1e3), 0),
        ("Depth,Force\num,N\n", (1e-3, 1e3), 0),
        ("Time,Depth,Force\n(s),(um),(N)\n", (1e-3, 1e3), 0),
        ("Instrument: X\nForce sensor,10 N\nDepth (um),Force (N)\n", (1e-3, 1e3), 1),
        ("h (nm),P (uN)\n", (1e-6, 1e-3), 2),
        ("Eindringtiefe (um),Kraft (N)\n", (1e-3, 1e3), 0),
    ],
)
@pytest.mark.parametrize("separator", [",", ";", "\t", "  "])
def test_headers_as_people_write_them(tmp_path, text, factors, notes, separator):
    timed = text.startswith("Time")
    rows = "".join(separator.join([*([str(n)] if timed else []), str(n), str(2 * n)]) + "\n" for n in range(1, 7))
    (tmp_path / "c.csv").write_text(text.replace(",", separator) + rows, encoding="utf-8")
    curve = read_curve(tmp_path / "c.csv")
    np.testing.assert_allclose(curve.displacement, factors[0] * np.arange(1, 7), rtol=1e-12)
    np.testing.assert_allclose(curve.force, 2 * factors[1] * np.arange(1, 7), rtol=1e-12)
    assert len(curve.notes) == notes


@pytest.mark.parametrize("name", ["Stroke (mm)", "Extension (mm)", "z (um)", "Position_mm", "Compressive extension (mm)"])
def test_the_travel_of_a_stage_is_no_displacement_from_contact(tmp_path, name):
    (tmp_path / "c.csv").write_text(f"{name},Load (N)\n" + "".join(f"{n},{2 * n}\n" for n in range(1, 7)))
    with pytest.raises(CurveError) as caught:
        read_curve(tmp_path / "c.csv")
    assert f"if {name!r} begins at contact, rename it so" in str(caught.value) and "test.record" in str(caught.value)


@pytest.mark.parametrize("header", ["Displacement (MM),Force (MN)", "h (nm),d (nm),P (uN)", "h (nm),P (kPa)", "depth,load"])
def test_headers_that_could_mean_two_things_are_refused(tmp_path, header):
    width = header.count(",") + 1
    (tmp_path / "c.csv").write_text(f"{header}\n" + "".join(",".join([str(n)] * width) + "\n" for n in range(1, 7)))
    with pytest.raises(CurveError):
        read_curve(tmp_path / "c.csv")
