"""Files as other programs write them: dates, repeated headers, empty cells, raw counts, AFM exports; read with their values."""

from datetime import datetime, timedelta

import numpy as np
import openpyxl
import pytest

from indentfit.case import Record
from indentfit.errors import RecordError
from indentfit.experiment.reading import read_record, read_records

N = 200
T = np.arange(N) / 10  # s
D = np.round(np.linspace(0.0, 0.2, N), 6)  # mm
F = np.round(2.0 * D**1.5, 7)  # mN
BEGIN = datetime(2024, 3, 31, 23, 59, 50)  # 10 s before midnight


def lines(*columns, separator=","):
    return [separator.join(map(str, row)) for row in zip(*columns, strict=True)]


def read(tmp_path, *text, settings=None, **how):
    path = tmp_path / "r.txt"
    path.write_text("\n".join(text), **how)
    return read_record(path, settings)


def clock(form):
    return [(BEGIN + timedelta(seconds=float(t))).strftime(form) for t in T]


def as_written(record):
    np.testing.assert_allclose(record.time, T, atol=1e-6)
    np.testing.assert_allclose(record.displacement, D, atol=1e-9)
    np.testing.assert_allclose(record.force, F, atol=1e-9)


@pytest.mark.parametrize("form", ["%d.%m.%Y %H:%M:%S.%f", "%Y-%m-%dT%H:%M:%S.%fZ", "%m/%d/%Y %I:%M:%S.%f %p", "%H:%M:%S.%f"])
def test_times_of_the_clock_go_on_past_midnight_and_past_the_end_of_a_month(form, tmp_path):
    as_written(read(tmp_path, "Timestamp,Position (mm),Force (mN)", *lines(clock(form), D, F)))


def test_times_of_the_clock_beside_decimal_commas(tmp_path):
    comma = [[f"{value:.7f}".replace(".", ",") for value in column] for column in (D, F)]
    as_written(read(tmp_path, "Zeit;Weg [mm];Kraft [mN]", *lines(clock("%d.%m.%Y %H:%M:%S,%f"), *comma, separator=";")))


def test_a_header_that_a_logger_repeats_parts_no_record(tmp_path):
    """A file of two tests, whose times begin anew, is two records none the less."""
    rows, header = lines(T, D, F), "Time (s),Position (mm),Force (mN)"
    repeated = [line for n, row in enumerate(rows) for line in ([header, row] if n % 50 == 0 else [row])]
    as_written(read(tmp_path, *repeated))
    path = tmp_path / "two.txt"
    path.write_text("\n".join([*repeated, *repeated]))
    assert [record.time.size for record in read_records(path)] == [N, N]


@pytest.mark.parametrize("empty", ["NaN", "---", "#N/A", "", "#WERT!"])
def test_rows_with_empty_cells_are_left_out_and_said(empty, tmp_path):
    force = [empty if n % 40 == 7 else value for n, value in enumerate(F)]
    record = read(tmp_path, "Time (s);Position (mm);Force (mN)", *lines(T, D, force, separator=";"))
    kept = np.arange(N) % 40 != 7
    np.testing.assert_allclose(np.interp(T[kept], record.time, record.force), F[kept], rtol=1e-3, atol=1e-6)
    assert any("5 rows without numbers were left out" in note for note in record.notes)


def test_raw_counts_ask_for_their_gain(tmp_path):
    """8 counts per uN above an offset of 500."""
    text = ["Time (s),Position (um),Load cell (counts)", *lines(T, 1e3 * D, np.round(8e3 * F + 500).astype(int))]
    with pytest.raises(RecordError, match=r"the force is in count; give record\.force\.gain, mN per count"):
        read(tmp_path, *text)
    record = read(tmp_path, *text, settings=Record(force={"gain": 1.25e-4, "offset": -0.0625}))
    np.testing.assert_allclose(record.force, F, atol=7e-5)


def test_cells_that_hold_their_units(tmp_path):
    cells = [f"{f / 1e3:.10f} N" for f in F], [f"{1e3 * d:.4f} um" for d in D], [f"{t:.2f} s" for t in T]
    as_written(read(tmp_path, "Reading,Load,Travel,Time", *lines(range(N), *cells)))
    mixed = [*cells[0][:-1], "0.1 mN"]
    with pytest.raises(RecordError, match="no rows of numbers"):
        read(tmp_path, "Reading,Load,Travel,Time", *lines(range(N), mixed, *cells[1:]))


def test_of_two_forces_that_which_stays_is_no_force(tmp_path):
    as_written(read(tmp_path, "Time [s],Displacement [mm],Force A [mN],Force B [mN]", *lines(T, D, F, 0 * F + 0.01)))


def test_a_text_of_jpk_has_its_columns_in_comments_and_the_way_back_in_the_same_test(tmp_path):
    """The separation of tip and sample falls toward the sample and is free of the cantilever's bending."""
    top = ["# springConstant: 0.05", "#"]
    names = ["# columns: height vDeflection tipSampleSeparation seriesTime"]
    names += ['# fancyNames: "Height (measured)" "Vertical deflection" "Tip-Sample Separation" "Series Time"', "# units: m N m s"]
    rows = lines(1e-3 * (5 - D - F / 0.05), 1e-3 * F, 1e-3 * (5 - D), T, separator=" ")
    there = ["# segment: extend", "#", *names, *rows[:120]]
    back = ["", "# segment: retract", "#", *names, *rows[120:]]
    record = read(tmp_path, *top, *there, *back)
    np.testing.assert_allclose(record.displacement + 5, D, atol=1e-9)
    np.testing.assert_allclose(record.force, F, atol=1e-9)
    assert record.time.size == N and record.stated.stiffness == pytest.approx(0.05)


@pytest.mark.parametrize("side", [1, -1])  # a height that rises, or falls, toward the sample
def test_a_text_of_nanoscope_has_the_way_back_in_columns_of_its_own(side, tmp_path):
    """The height less the deflection is the indentation; a cantilever of 0.05 mN/mm bends by F / 0.05."""
    height, bent = 1e6 * side * (D + F / 0.05), 1e6 * F / 0.05
    header = "Calc_Ramp_Ex_nm,Height_Sensor_nm_Ex,Height_Sensor_nm_Rt,Defl_nm_Ex,Defl_nm_Rt,Defl_pN_Ex,Defl_pN_Rt"
    columns = np.arange(N), height, height[::-1], bent, bent[::-1], 1e9 * F, 1e9 * F[::-1]
    record = read(tmp_path, header, *lines(*columns), settings=Record(rate=10.0))
    np.testing.assert_allclose(record.displacement, D, atol=1e-9)
    np.testing.assert_allclose(record.force, F, atol=1e-9)


@pytest.mark.parametrize("mark", ",.")
def test_a_workbook_whose_numbers_are_text(mark, tmp_path):
    book = openpyxl.Workbook()
    book.active.append(["Zeit", "Weg", "Kraft"])
    book.active.append(["s", "mm", "mN"])
    for row in zip(T, D, F, strict=True):
        book.active.append([f"{value:.7f}".replace(".", mark) for value in row])
    book.save(tmp_path / "r.xlsx")
    as_written(read_record(tmp_path / "r.xlsx"))


def test_numbers_with_the_exponents_of_fortran(tmp_path):
    rows = [f"{t:14.6E} {d:14.6E} {f:14.6E}".replace("E", "D") for t, d, f in zip(T, D, F, strict=True)]
    record = read(tmp_path, "TIME DISP FORCE", "s mm mN", *rows)
    np.testing.assert_allclose(record.displacement, D, rtol=1e-6)
    np.testing.assert_allclose(record.force, F, rtol=1e-6)


def test_of_two_travels_that_which_is_corrected_is_taken_and_said(tmp_path):
    """What the frame gives way, 0.1 mm/mN of force, is in the raw travel."""
    header = "Time [s];Displacement [um];Load [mN];Displacement Corrected [um]"
    record = read(tmp_path, header, *lines(T, 1e3 * (D + 0.1 * F), F, 1e3 * D, separator=";"))
    as_written(record)
    assert any("'Displacement [um]' moves otherwise" in note for note in record.notes)


def test_units_in_words(tmp_path):
    as_written(read(tmp_path, "time_milliseconds,position_microns,force_micronewtons", *lines(1e3 * T, 1e3 * D, 1e3 * F)))


def test_a_table_of_few_points_is_told_so_before_it_is_asked_for_times(tmp_path):
    with pytest.raises(RecordError, match=r"5 rows of numbers; a record needs at least 50 \(a curve of fewer points"):
        read(tmp_path, "displacement_mm,force_mN", *lines(D[:5], F[:5]))
