"""Files as other programs write them: dates, repeated headers, empty cells, raw counts, AFM exports; read with their values."""

from datetime import datetime, timedelta

import numpy as np
import openpyxl
import pytest

from indentfit.case import Record
from indentfit.errors import RecordError
from indentfit.experiment.process import entries_of
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


@pytest.mark.parametrize(
    ("head", "separator", "row"),
    [
        (["Test 1", "Ts\tDisp\tLoad", "s\tnm\tuN"], "\t", lambda t, d, f: (t, 1e6 * d, 1e3 * f)),  # Agilent
        (["Thời gian (s),Chuyển vị (mm),Lực (mN)"], ",", lambda t, d, f: (t, d, f)),
        (["Zaman (sn);Yer değiştirme (mm);Kuvvet (mN)"], ";", lambda t, d, f: (t, d, f)),
        (["% exported", "% time [s]  disp [um]  force [uN]"], "  ", lambda t, d, f: (t, 1e3 * d, 1e3 * f)),
        (["Time (s),Stage position (mm),Balance (mg)"], ",", lambda t, d, f: (t, d, f / 9.80665e-3)),
        (["IGOR", "WAVES/D\tTime_s\tZ_um\tForce_uN", "BEGIN"], "\t", lambda t, d, f: (t, 1e3 * d, 1e3 * f)),
    ],
)
def test_headers_of_more_programs_and_languages(head, separator, row, tmp_path):
    rows = [separator.join(f"{value:.12g}" for value in row(*each)) for each in zip(T, D, F, strict=True)]
    end = ["END"] if head[0] == "IGOR" else []
    as_written(read(tmp_path, *head, *rows, *end, encoding="utf-8"))


def test_a_column_of_seconds_that_rises_is_the_time_whatever_its_name(tmp_path):
    """One that does not rise is none: such a file is asked for its sampling rate."""
    text = ["Χρόνος (s);Μετατόπιση (mm);Δύναμη (mN)", *lines(T, D, F, separator=";")]
    as_written(read(tmp_path, *text, encoding="utf-8"))
    with pytest.raises(RecordError, match="no column of time"):
        read(tmp_path, "Dwell (s);Weg (mm);Kraft (mN)", *lines(T[::-1], D, F, separator=";"))


def test_of_base_and_tip_of_a_probe_the_tip_is_the_indenter(tmp_path):
    record = read(tmp_path, "Time_s,Base_Position_mm,Tip_Position_mm,Force_mN", *lines(T, D + F / 5, D, F))
    as_written(record)
    assert any("'Base_Position_mm' moves otherwise" in note for note in record.notes)


PRESSED = np.maximum(np.linspace(-0.2, 0.2, N), 0) ** 1.5  # an approach and a loading


@pytest.mark.parametrize("preload", [0.0, 1.0])
def test_a_tester_that_counts_compression_as_negative_is_turned_and_said(preload, tmp_path):
    """Extension and load both fall, with an approach or from a preload on."""
    force = 10 * PRESSED if not preload else preload + F
    record = read(tmp_path, "Time (s),Extension (mm),Load (mN)", *lines(T, -D, -force))
    np.testing.assert_allclose([record.displacement, record.force], [D, force], atol=1e-9)
    assert any("both signs were turned" in note for note in record.notes)


def test_a_stage_that_counts_upwards_is_turned_where_the_force_first_stays(tmp_path):
    """A force that falls from the first row, while the stage goes up, may be a retraction that counts the other way: not turned."""
    header = "Time (s),z (mm),Force (mN)"
    record = read(tmp_path, header, *lines(T, 5 - D, PRESSED))
    np.testing.assert_allclose(record.displacement, D - 5, atol=1e-9)
    assert any("its sign was turned" in note for note in record.notes)
    away = read(tmp_path, header, *lines(T, D[::-1], -PRESSED[::-1]))
    np.testing.assert_allclose([away.displacement, away.force], [D[::-1], -PRESSED[::-1]], atol=1e-9)


def test_a_file_of_two_tests_is_two_entries_before_it_is_processed(tmp_path):
    """What the command's progress counts."""
    path = tmp_path / "two.txt"
    rows = ["Time (s),Position (mm),Force (mN)", *lines(T, D, PRESSED), ""]
    path.write_text("\n".join(["Test 1", *rows, "Test 2", *rows]))
    assert [entry.sample for entry in entries_of(path, None, None, Record())] == ["two Test 1", "two Test 2"]
