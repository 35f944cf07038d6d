"""What the fuzz campaign (campaigns/fuzz.py) has found, each as a test: a clear line or something sound, and nothing else."""

import io
import json
import time
import zipfile

import numpy as np
import openpyxl
import pytest

from indentfit.curve import read_curve
from indentfit.errors import CaseError, CurveError, MaterialError, OutputError, RecordError
from indentfit.experiment.manifest import read_manifest
from indentfit.experiment.measured import read_case
from indentfit.experiment.outcomes import process_all
from indentfit.experiment.reading import read_record
from indentfit.experiment.specimens import read_specimens
from indentfit.material import load
from indentfit.report.html import write_report


def refused(error, function, *arguments):
    """The one line of an error, which comes within ten seconds."""
    started = time.perf_counter()
    with pytest.raises(error) as caught:
        function(*arguments)
    line = str(caught.value)
    assert "\n" not in line and len(line) < 600 and time.perf_counter() - started < 10
    return line


# ---- cases and curves --------------------------------------------------------------------------------------------


def test_a_line_about_a_key_or_a_name_of_thousands_of_letters_stays_short(tmp_path):
    path, long = tmp_path / "case.toml", "a" * 5000
    material = f'[material]\nenergy = "mu*(I1-3)"\n[material.parameters]\n"{long} {long}" = 1\n'
    path.write_text(f"{long} = 1\n[sample]\n{long} = 2\n{material}")
    with pytest.raises(CaseError) as error:
        read_case(path)
    assert len(error.value.faults) > 3
    assert all(len(line) < 600 and "\n" not in line for line in error.value.faults)


def test_a_line_about_a_material_of_thousands_of_letters_stays_short():
    assert "installed: " in refused(MaterialError, load, "a" * 5000)
    assert "FILE.py:MyModel" in refused(MaterialError, load, "a" * 5000 + ".py")


def test_a_force_that_gets_infinite_by_its_unit_is_refused(tmp_path):
    path = tmp_path / "c.csv"
    path.write_text("displacement_mm,force_N\n" + "".join(f"{0.1 * n},{n}\n" for n in range(8)) + "0.8,1e308\n")
    assert "line 10: '1e308' is not a finite number" in refused(CurveError, read_curve, path)


def test_the_columns_of_a_record_are_listed_shortly(tmp_path):
    path = tmp_path / "r.csv"
    path.write_text("a" * 5000 + ",b\n" + "1,2\n" * 60)
    assert "no columns of displacement" in refused(RecordError, read_record, path)


# ---- records -----------------------------------------------------------------------------------------------------


def workbook(path, **members):
    """A sound workbook of 60 rows with some of its members (sheet, strings) changed by functions of their bytes."""
    book, raw = openpyxl.Workbook(), io.BytesIO()
    book.active.append(["time (s)", "displacement (mm)", "force_mN"])
    for n in range(60):
        book.active.append([0.01 * n, 0.005 * n, 0.3 * n])
    book.save(raw)
    places = {"sheet": "xl/worksheets/sheet1.xml"}
    with zipfile.ZipFile(raw) as old, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as new:
        for name in old.namelist():
            change = next((change for key, change in members.items() if places[key] == name), bytes)
            new.writestr(name, change(old.read(name)))
    return path


def test_a_sound_workbook_is_read(tmp_path):
    record = read_record(workbook(tmp_path / "r.xlsx"))
    np.testing.assert_allclose(record.force, 0.3 * np.arange(60), rtol=1e-12)


def test_a_cell_in_the_last_row_and_column_asks_for_no_more_memory_than_there_is(tmp_path):
    far = workbook(tmp_path / "far.xlsx", sheet=lambda xml: xml.replace(b'r="A2"', b'r="XFD1048576"'))
    assert far.stat().st_size < 20_000  # for 17,000,000,000 cells
    assert "far.xlsx: cannot be read within 2 GB" in refused(RecordError, read_record, far)


def test_a_workbook_that_unpacks_to_far_more_than_a_record_is_refused(tmp_path):
    bomb = workbook(tmp_path / "bomb.xlsx", sheet=lambda xml: xml.replace(b"</sheetData>", b" " * 600_000_000 + b"</sheetData>"))
    assert bomb.stat().st_size < 5_000_000
    assert "bomb.xlsx: 0.6 GB unpacked" in refused(RecordError, read_record, bomb)


def test_a_workbook_cut_short_is_refused(tmp_path):
    path = workbook(tmp_path / "cut.xlsx")
    path.write_bytes(path.read_bytes()[:-100])
    assert "cut.xlsx: not a workbook that can be read" in refused(RecordError, read_record, path)


def test_a_column_of_time_without_numbers_is_refused(tmp_path):
    path = tmp_path / "r.csv"
    path.write_text("time (s),displacement (mm),force_mN\n" + "".join(f"x{n},{n},{n}\n" for n in range(60)))
    assert "the column of time holds no numbers" in refused(RecordError, read_record, path)


@pytest.mark.parametrize("name", ["9" * 400, "a\0b"])
def test_a_file_name_that_the_system_refuses_is_the_problem_of_its_row(tmp_path, name):
    path = tmp_path / "manifest.csv"
    path.write_text(f"sample,direction,file\ns1,0,{name}\n")
    (outcome,) = process_all(read_manifest(path))
    assert outcome.processed is None and name[:50] in outcome.problem and len(outcome.problem) < 400


def test_a_cell_of_two_lines_does_not_make_two_lines_of_a_problem(tmp_path):
    path = tmp_path / "manifest.csv"
    path.write_text('sample,direction,file\n"s\u2028\x0b1",sideways,"a\x1cb.csv"\n')
    (outcome,) = process_all(read_manifest(path))
    assert len(outcome.problem.splitlines()) == 1 and "must be 0, 90, parallel" in outcome.problem


@pytest.mark.parametrize("thickness", ["nan", "inf", "-3.3", "0", "1e400", "three", "3,3"])
def test_a_thickness_in_the_table_of_samples_is_a_positive_number(tmp_path, thickness):
    path = tmp_path / "replicates.csv"
    path.write_text(f'sample,direction,curve,thickness_mm,diameter_mm\ns1,0,c.csv,"{thickness}",14\n')
    assert "row 2: thickness_mm" in refused(RecordError, read_specimens, path)


# ---- results that are read again ---------------------------------------------------------------------------------

SIMULATION = {
    "format": "indentfit.simulation/1",
    "title": "t",
    "parameters": {"mu": 1.0},
    "tests": [],
    "mesh": {},
    "solver": {},
    "overrides": [],
}


@pytest.mark.parametrize(
    "changes",
    [
        {"format": {"x": 1}},
        {"format": "a" * 5000},
        {"format": "a\nb"},
        {"parameters": [1]},
        {"tests": [{"name": "a", "angle": 0, "displacement_mm": 0, "force_mN": [1, 2], "facts": {"penalty_error": 0}}]},
        {"tests": 5},
        {"mesh": None},
        {"title": "\ud800"},
        {"format_version": 1, "format": "fit"},
    ],
    ids=lambda changes: str(changes)[:30].encode("ascii", "replace").decode(),
)
def test_a_damaged_result_is_refused_in_a_line_and_its_page_stays(tmp_path, changes):
    (tmp_path / "report.html").write_text("as it was")
    (tmp_path / "simulation.json").write_text(json.dumps(SIMULATION | changes))
    assert str(tmp_path) in refused(OutputError, write_report, tmp_path)
    assert (tmp_path / "report.html").read_text() == "as it was"


def test_a_result_nested_too_deep_is_refused(tmp_path):
    (tmp_path / "result.json").write_text("[" * 100_000)
    assert "result.json: cannot be read" in refused(OutputError, write_report, tmp_path)
