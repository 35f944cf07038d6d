"""Headers with powers of ten, deflections in volts, summaries below a sheet, gaps between tests, small first cycles."""

import numpy as np
import openpyxl
import pytest

from indentfit.case import Record
from indentfit.errors import RecordError
from indentfit.experiment.process import process
from indentfit.experiment.reading import read_record, read_records

N = 200
T = np.arange(N) / 10  # s
D = np.round(np.linspace(0.0, 0.2, N), 6)  # mm
F = np.round(2.0 * D**1.5, 7)  # mN


def read(tmp_path, header, *columns, separator=","):
    path = tmp_path / "r.txt"
    rows = (separator.join(f"{value:.9g}" for value in row) for row in zip(*columns, strict=True))
    path.write_text("\n".join([*header, *rows]), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("depth", "force", "lengths", "forces"),
    [
        ("Depth (mm x10-3)", "Load (N x10-3)", 1e-3, 1.0),
        ("Displacement (10^-6 m)", "Force (10^-6 N)", 1e-3, 1e-3),
        ("Weg [×10⁻³ mm]", "Kraft [10⁻³ N]", 1e-3, 1.0),
        ("Depth x10-3 mm", "Load 10^-3 N", 1e-3, 1.0),
        ("Travel (1e-3 mm)", "Load (N·10^-6)", 1e-3, 1e-3),
        ("Stage 1012 (mm)", "Fz10 (mN)", 1.0, 1.0),
    ],
)
def test_a_power_of_ten_beside_a_unit_is_a_part_of_it(depth, force, lengths, forces, tmp_path):
    """ "Load x10-3 N" was read in N, a thousand times too large; those in brackets were refused."""
    record = read_record(read(tmp_path, [f"Time (s);{depth};{force}"], T, D / lengths, F / forces, separator=";"))
    np.testing.assert_allclose(record.displacement, D, atol=1e-9)
    np.testing.assert_allclose(record.force, F, atol=1e-9)


@pytest.mark.parametrize("force", ["Force x10^3 (N)", "Load (x1000 N)", "Load x1000 (mN)", "Force ×10³ [mN]"])
def test_a_power_of_ten_with_two_readings_is_asked_for(force, tmp_path):
    """Either thousands of the unit, or numbers that were multiplied by a thousand."""
    path = read(tmp_path, [f"Time (s);Depth (mm);{force}"], T, D, F, separator=";")
    with pytest.raises(RecordError, match=r"can mean two units; give record\.force\.unit, such as 'mN', and its gain"):
        read_record(path)
    told = read_record(path, Record(force={"unit": "mN", "gain": 2.0}))
    np.testing.assert_allclose(told.force, 2 * F, atol=1e-9)


@pytest.mark.parametrize("sensitivity", ["# Deflection sensitivity: 65 nm/V", "InvOLS (nm/V): 65", "Deflection Sens.\t0.065 um/V"])
def test_a_deflection_in_volts_is_the_force_where_the_file_calibrates_it(sensitivity, tmp_path):
    """65 nm per V and 0.1 mN/mm: the piezo travels by the indentation and the deflection."""
    scale = 1e-3
    deflection = scale * F / 0.1  # mm
    lines = [sensitivity, "# Spring constant: 0.1 N/m", "Time (s)\tPiezo (um)\tDeflection (V)"]
    path = read(tmp_path, lines, T, 1e3 * (scale * D + deflection), deflection / 65e-6, separator="\t")
    record = read_record(path)
    np.testing.assert_allclose(record.force, scale * F, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(record.displacement, scale * D, rtol=1e-6, atol=1e-9)
    assert "65 nm/V, 0.1 N/m" in record.taken and "minus" in record.taken


def test_a_deflection_as_a_length_needs_the_spring_constant_alone(tmp_path):
    path = read(tmp_path, ["Time (s)\tPiezo (um)\tDeflection (nm)"], T, 1e3 * (D + F / 50), 1e6 * F / 50, separator="\t")
    with pytest.raises(RecordError, match="no columns of force"):
        read_record(path)
    record = read_record(path, Record(stiffness=50.0))
    np.testing.assert_allclose(record.force, F, atol=1e-6)
    np.testing.assert_allclose(record.displacement, D, atol=1e-6)


def test_a_deflection_in_volts_without_its_sensitivity_is_no_force(tmp_path):
    lines = ["# Spring constant: 0.1 N/m", "# Sensitivity Z: 20 nm/V", "Time (s)\tPiezo (um)\tDeflection (V)"]
    with pytest.raises(RecordError, match="no columns of force"):
        read_record(read(tmp_path, lines, T, D, F, separator="\t"))


def test_a_summary_below_the_rows_of_a_sheet_is_left_out_and_said(tmp_path):
    book = openpyxl.Workbook()
    sheet = book.active
    for row in [("Time (s)", "Depth (mm)", "Force (mN)"), *zip(T.tolist(), D.tolist(), F.tolist(), strict=True)]:
        sheet.append([None, *row])
    for name, at in (("Mean", np.mean), ("Maximum", np.max)):
        sheet.append([None, name, float(at(D)), float(at(F))])
    book.save(tmp_path / "r.xlsx")
    record = read_record(tmp_path / "r.xlsx")
    np.testing.assert_allclose(record.force, F, atol=1e-9)
    assert any("rows 202 to 203 ('Mean') hold words among numbers and were left out" in note for note in record.notes)
    sheet.cell(100, 4).value = "fault"
    book.save(tmp_path / "r.xlsx")
    with pytest.raises(RecordError, match="row 100: 'fault' is not a number"):
        read_record(tmp_path / "r.xlsx")


def test_tests_side_by_side_with_an_empty_column_between(tmp_path):
    rows = (f"{t:.2f},{d:.6f},{f:.7f},,{t:.2f},{d:.6f},{2 * f:.7f}" for t, d, f in zip(T, D, F, strict=True))
    path = tmp_path / "r.csv"
    names = "Time (s),Ext (mm),Load (mN)"
    path.write_text("\n".join(["Gel A,,,,Gel B,,", f"{names},,{names}", *rows]))
    first, second = read_records(path)
    assert first.name.endswith("Gel A") and second.name.endswith("Gel B")
    np.testing.assert_allclose(first.force, F, atol=1e-7)
    np.testing.assert_allclose(second.force, 2 * F, atol=1e-7)


@pytest.mark.parametrize("words", ["Uhrzeit;Kolbenweg [mm];Druckkraft [mN]", "Versuchszeit [s];Maschinenweg [mm];Axialkraft [mN]"])
def test_german_words_end_in_the_quantity(words, tmp_path):
    clock = "Uhrzeit" in words
    rows = (
        f"{f'11:00:{t:06.3f}' if clock else f'{t:.3f}'};{d:.6f};{f:.7f}".replace(".", ",") for t, d, f in zip(T, D, F, strict=True)
    )
    path = tmp_path / "r.csv"
    path.write_text("\n".join([words, *rows]))
    record = read_record(path)
    np.testing.assert_allclose(record.time, T, atol=1e-6)
    np.testing.assert_allclose(record.force, F, atol=1e-7)


def test_cycles_that_grow_are_all_counted(tmp_path):
    """Depths of 0.05, 0.1 and 0.15 mm: the first has a fifth of the last force, and `cycle = 1` gave the second."""
    depths = (0.05, 0.1, 0.15)
    place = np.concatenate([np.r_[np.linspace(-0.1, depth, 300), np.linspace(depth, -0.1, 300)] for depth in depths])
    noise = 0.003 * np.random.default_rng(1).standard_normal(place.size)
    force = 26.7 * np.maximum(place, 0) ** 1.5 + noise
    path = read(tmp_path, ["Time (s),Displacement (mm),Load (mN)"], np.arange(place.size) / 100, place, force)
    for cycle, depth in enumerate(depths, start=1):
        (outcome,) = process(path, settings=Record(indenter="sphere", cycle=cycle)).outcomes
        assert outcome.processed.peak == pytest.approx(26.7 * depth**1.5, abs=0.01)
    (default,) = process(path, settings=Record(indenter="sphere")).outcomes
    assert any("3 loading cycles; number 3 is used" in note for note in default.processed.notes)


@pytest.mark.parametrize(
    "line",
    ["Sampling rate: 10 Hz", "# dt = 0.1 s", "Acquisition frequency (Hz): 10", "Sample interval\t100 ms", "Abtastrate\t0,01 kHz"],
)
def test_the_sampling_rate_of_a_file_without_times_is_that_which_it_states(line, tmp_path):
    path = read(tmp_path, [line, "Position (mm)\tForce (mN)"], D, F, separator="\t")
    record = read_record(path)
    np.testing.assert_allclose(record.time, T, atol=1e-9)
    assert record.timed and "by 10 Hz, as the file states" in record.taken


@pytest.mark.parametrize("line", ["Scan rate: 10 Hz", "Sampling rate: 10", "Sampling time: 20 s"])
def test_a_line_that_states_no_sampling_rate_with_its_unit_gives_none(line, tmp_path):
    """A scan rate counts curves, a sampling time may be that of the whole record, and a rate may be of Hz or kHz."""
    with pytest.raises(RecordError, match=r"no column of time and no sampling rate"):
        read_record(read(tmp_path, [line, "Position (mm)\tForce (mN)"], D, F, separator="\t"))


@pytest.mark.parametrize(
    ("header", "length", "force"),
    [
        ("Zeit (s)|Weg/µ|Kraft (kp)", 1e-3, 9806.65),
        ("Time (s)|Displacement (Å)|Force (dyn)", 1e-7, 0.01),
        ("TIME (SEC)|DISPLACEMENT (MIL)|LOAD (GF)", 0.0254, 9.80665),
        ("Prüfzeit in Sekunden|Eindringtiefe in Mikrometer|Prüfkraft in Millinewton", 1e-3, 1.0),
        ("Temps en secondes|Enfoncement en millimètres|Force en newtons", 1.0, 1e3),
    ],
)
def test_units_in_full_old_ones_and_columns_between_bars(header, length, force, tmp_path):
    record = read_record(read(tmp_path, [header], T, D / length, F / force, separator="|"))
    np.testing.assert_allclose(record.time, T, atol=1e-9)
    np.testing.assert_allclose(record.displacement, D, atol=1e-8)
    np.testing.assert_allclose(record.force, F, rtol=1e-6, atol=1e-9)
