"""Files of instruments: what is recognised without a table, and records that begin in contact, in stages or on a cantilever."""

import importlib.util
import sys
import time
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from indentfit.case import Record, RecordChannel
from indentfit.errors import RecordError
from indentfit.experiment.process import process
from indentfit.experiment.processed import process_record
from indentfit.experiment.reading import read_record, read_records
from indentfit.experiment.record import RawRecord

N = 400
T = np.arange(N) / 100
D = np.round(np.linspace(0.0, 0.2, N), 6)  # mm
F = np.round(2.0 * D**1.5, 7)  # mN


def written(path, header, columns, separator="\t", encoding="utf-8"):
    rows = [separator.join(f"{value:.12g}" for value in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([*header, *rows]) + "\n", encoding=encoding)
    return path


VENDORS = {  # lines above the numbers, columns, separator
    "Instron Bluehill": (["General : Operator,x", "", "Time,Extension,Load", "(s),(mm),(N)"], (T, D, F / 1000), ","),
    "Zwick testXpert": (["Prüfzeit;Standardweg;Standardkraft", "s;mm;N"], (T, D, F / 1000), ";"),
    "Mach-1": (
        ["<Mach-1 File>", "<Stress Relaxation>", "<DATA>", "Time, s\tPosition (z), mm\tPosition (x), mm\tFz, gf"],
        (T, D - 3.0, 0 * D, F / 9.80665),
        "\t",
    ),
    "CellScale": (["SetName,Cycle,Time_S,Displacement_um,Force_uN"], (1 + 0 * T, 1 + 0 * T, T, 1e3 * D, 1e3 * F), ","),
    "TA.XT": (["Force,Distance,Time", "g,mm,sec"], (F / 9.80665, D, T), ","),
    "Anton Paar Bioindenter": (
        ["Measured values", "Time (s)\tPd (µm)\tFn (µN)\tFnRef (µN)\tSegmentID", ""],
        (T, 1e3 * D, 1e3 * F, 5 + 0 * D, 1 + 0 * D),
        "\t",
    ),
    "Hysitron": (
        ["Number of Points = 400", "Depth (nm)\tLoad (µN)\tTime (s)\tDepth (V)\tLoad (V)"],
        (1e6 * D, 1e3 * F, T, D, F),
        "\t",
    ),
    "FemtoTools": (["Index,Time [s],Displacement [µm],Force [µN]"], (np.arange(N), T, 1e3 * D, 1e3 * F), ","),
    "NanoSuite": (["Time On Sample\tDisplacement Into Surface\tLoad On Sample", "s\tnm\tmN"], (T, 1e6 * D, F), "\t"),
    "MTS TestSuite": (
        [
            "MTS793|MPT|ENU|1|2|/|.|:|1|0|0|A,,,",
            "Station Name: gel.cfg,,,",
            "Time,Axial Displacement,Axial Force,Axial Count",
            "s,mm,kN,segments",
        ],
        (T, D, F / 1e6, 1 + np.floor(T)),
        ",",
    ),
    "MTS": (["Axial Displacement\tAxial Force\tRunning Time", "mm\tN\ts"], (D, F / 1000, T), "\t"),
    "Shimadzu": (["時間,試験力,ストローク", "sec,N,mm"], (T, F / 1000, D), ","),
    "TA DMA": (
        [
            "Instrument\tDMA Q800 V20.6",
            "Size\t10.0 5.0 3.0 mm",
            "Nsig\t3",
            "Sig1\tTime (min)",
            "Sig2\tDisplacement (um)",
            "Sig3\tStatic Force (N)",
            "OrgMethod\t1: Ramp force",
            "StartOfData",
        ],
        (T / 60, 1e3 * D, F / 1000),
        "\t",
    ),
    "French tester": (["Temps (s);Allongement (mm);Charge (N)"], (T, D, F / 1000), ";"),
}


PRESETS = {name: name for name in VENDORS} | {
    "MTS TestSuite": "MTS",
    "Zwick testXpert": "Zwick testXpert",
    "Mach-1": "Biomomentum Mach-1",
    "TA.XT": "Stable Micro Systems TA.XT",
    "NanoSuite": "Agilent/KLA NanoSuite",
}
PRESETS = {vendor: name for vendor, name in PRESETS.items() if vendor not in ("Shimadzu", "French tester", "TA DMA")}


@pytest.mark.parametrize("vendor", VENDORS)
def test_the_layout_of_a_vendor_is_read_without_a_table(vendor, tmp_path):
    header, columns, separator = VENDORS[vendor]
    record = read_record(written(tmp_path / "r.txt", header, columns, separator))
    np.testing.assert_allclose(record.time, T, atol=1e-6)
    np.testing.assert_allclose(np.ptp(record.displacement), 0.2, rtol=1e-6)
    np.testing.assert_allclose(record.force, F, atol=2e-6)
    assert "force" in record.taken and record.notes == ()
    assert vendor not in PRESETS or record.taken.startswith(f"{PRESETS[vendor]}: time ")


def test_a_tester_that_counts_compression_negative_may_have_a_tare_beyond_the_force(tmp_path):
    """WinTest's layout: an empty first column, units in a row below; the sensor reads -20 mN without contact."""
    header = ["WinTest Digital Control System 7", "File: specimen3.csv", "", ",Scan,Elapsed Time,Disp,Load 225N", ",,Sec,mm,N"]
    rows = [f",1,{t:.6f},{2.5 - d:.7f},{-(f + 20) / 1000:.9f}" for t, d, f in zip(T, D, F, strict=True)]
    (tmp_path / "r.csv").write_text("\n".join([*header, *rows]) + "\n")
    record = read_record(tmp_path / "r.csv")
    np.testing.assert_allclose(np.ptp(record.displacement), 0.2, rtol=1e-5)
    np.testing.assert_allclose(record.force, F + 20, atol=2e-6)
    assert any("both signs were turned" in note for note in record.notes)


def rows_of(spelled, separator):
    """A file of time, position in um and force in uN, each value as it is spelled."""
    rows = [separator.join(spelled(value) for value in row) for row in zip(T, 1e3 * D + 1500, 1e3 * F, strict=True)]
    return "\n".join([separator.join(["Time (s)", "Position (um)", "Force (uN)"]), *rows]) + "\n"


SPELLED = {  # how a number is spelled, and the separator
    "thousands in quotes": (lambda value: f'"{value:,.5f}"', ","),
    "thousands": (lambda value: f"{value:,.5f}", "\t"),
    "thousands of German": (lambda value: f"{value:,.5f}".translate(str.maketrans(".,", ",.")), ";"),
    "thousands of Swiss": (lambda value: f"{value:,.5f}".replace(",", "'"), ";"),
    "thousands of French": (lambda value: f"{value:,.5f}".replace(",", "\u202f").replace(".", ","), ";"),
    "decimal comma in quotes": (lambda value: '"' + f"{value:.5f}".replace(".", ",") + '"', ","),
}


@pytest.mark.parametrize("how", SPELLED)
def test_numbers_are_read_however_they_are_spelled(how, tmp_path):
    path = tmp_path / "r.csv"
    path.write_text(rows_of(*SPELLED[how]))
    record = read_record(path)
    np.testing.assert_allclose(record.time, T, atol=1e-6)
    np.testing.assert_allclose(record.displacement - record.displacement[0], D, atol=1e-7)
    np.testing.assert_allclose(record.force, F, atol=2e-8)


def test_two_columns_between_commas_are_no_thousands(tmp_path):
    """Rows such as 1,500.250."""
    path = tmp_path / "r.csv"
    path.write_text("\n".join(["Position (mm),Force (uN)", *(f"{n // 40},{100 + n}.25" for n in range(N))]))
    record = read_record(path, Record(rate=100.0))
    np.testing.assert_allclose(record.force, 1e-3 * (100.25 + np.arange(N)))


def test_times_of_the_clock_are_seconds(tmp_path):
    rows = [f"2026-01-02,23:04:{t:06.3f},{d:.6f},{f:.7f}" for t, d, f in zip(T, D, F, strict=True)]
    path = tmp_path / "r.csv"
    path.write_text("\n".join(["Date,Time,Position (mm),Force (mN)", *rows]))
    np.testing.assert_allclose(read_record(path).time, T, atol=1e-6)


def test_tests_side_by_side_are_records_of_their_own(tmp_path):
    """The second test is half as long."""
    names = "gel_1,,,gel_2,,\nForce,Distance,Time,Force,Distance,Time\ng,mm,sec,g,mm,sec"
    rows = [
        f"{f / 9.80665:.9f},{d:.6f},{t:.2f}," + (f"{2 * f / 9.80665:.9f},{d:.6f},{t:.2f}" if n < N // 2 else ",,")
        for n, (t, d, f) in enumerate(zip(T, D, F, strict=True))
    ]
    path = tmp_path / "r.csv"
    path.write_text("\n".join([names, *rows]))
    first, second = read_records(path)
    assert first.name.endswith("gel_1") and second.name.endswith("gel_2") and not first.notes + second.notes
    np.testing.assert_allclose(first.force, F, atol=1e-7)
    np.testing.assert_allclose(second.force, 2 * F[: N // 2], atol=1e-7)


def test_a_deflection_in_newtons_is_the_force_and_bends_the_cantilever(tmp_path):
    """A cantilever of 50 mN/mm takes F / 50 of the travel."""
    lines = ["# Spring constant: 50 N/m", "Time (s);Z-Axis Sensor [m];Deflection [N]"]
    path = written(tmp_path / "r.csv", lines, (T, 1e-3 * (D + F / 50), 1e-3 * F), ";")
    record = read_record(path)
    np.testing.assert_allclose(record.force, F, atol=1e-9)
    np.testing.assert_allclose(record.displacement, D, atol=1e-9)


def test_the_end_mark_of_a_block_is_no_cut_off_line(tmp_path):
    path = written(tmp_path / "r.txt", ["<DATA>", "Time, s\tPosition, mm\tLoad, gf"], (T, D, F))
    path.write_text(path.read_text() + "<END DATA>")
    assert read_record(path).notes == ()


@pytest.mark.parametrize(
    ("header", "encoding"),
    [
        ("時間 (s),ストローク (mm),試験力 (mN)", "cp932"),
        ("시간(s),변위(mm),하중(mN)", "cp949"),
        ("Время (с),Перемещение (мм),Сила (мН)", "cp1251"),
        ("Время (с),Деформация (мм),Усилие (мН)", "cp866"),
        ("Час (с),Переміщення (мм),Зусилля (мН)", "koi8-u"),
        ("Час (с),Переміщення (мм),Сила (мН)", "cp1251"),
        ("Tijd (s),Verplaatsing (mm),Kracht (mN)", "utf-8"),
        ("Czas [s],Przemieszczenie [mm],Siła [mN]", "utf-8"),
        ("time_S,tip_position_mm,normal_force_mN", "utf-8"),
        ("Tid (s),Förskjutning (mm),Kraft (mN)", "cp1252"),
        ("Tempo (s),Deslocamento (mm),Força (mN)", "cp1252"),
    ],
)
def test_a_header_of_another_language_is_read_in_its_own_encoding(header, encoding, tmp_path):
    record = read_record(written(tmp_path / "r.csv", [header], (T, D, F), ",", encoding))
    np.testing.assert_allclose(record.displacement, D, atol=1e-9)
    np.testing.assert_allclose(record.force, F, atol=1e-9)
    np.testing.assert_allclose(record.time, T, atol=1e-9)


@pytest.mark.parametrize("header", ["Time (s)\tGap (mm)\tNormal force (mN)", "Zeit [s]\tSpaltweite [mm]\tNormalkraft [mN]"])
def test_a_gap_falls_toward_the_sample(header, tmp_path):
    """Rheometers write the gap between their plates."""
    record = read_record(written(tmp_path / "r.txt", [header], (T, 3.0 - D, F)))
    np.testing.assert_allclose(record.displacement, D - 3.0, atol=1e-9)


def test_units_of_a_labchart_text_are_those_of_its_channels_and_not_of_their_ranges(tmp_path):
    """Two blocks; the range of an amplifier is in V, and the unit in a line of its own. The file may leave times out."""
    keys = "Interval=\t0.01 s\nTimeFormat=\tStartOfBlock\nChannelTitle=\tForce\tDisplacement\nRange=\t10.0 V\t5.0 V\n"
    keys += "UnitName=\tuN\tum\nTopValue=\t1\t2\n"
    rows = "".join(f"{t:.4f}\t{1e3 * f:.6f}\t{1e3 * d:.6f}\n" for t, d, f in zip(T, D, F, strict=True))
    path = tmp_path / "r.txt"
    path.write_text(keys + rows + keys + rows.replace("\t", "\t ", 1))
    records = read_records(path)
    assert len(records) == 2
    for record in records:
        np.testing.assert_allclose(record.force, F, atol=1e-8)
        np.testing.assert_allclose(record.displacement, D, atol=1e-8)
        np.testing.assert_allclose(record.time, T, atol=1e-4)
    path.write_text(keys + "".join(line.partition("\t")[2] + "\n" for line in rows.splitlines()))
    with pytest.raises(RecordError, match="no column of time and no sampling rate"):
        read_record(path)
    np.testing.assert_allclose(read_record(path, Record(rate=100)).force, F, atol=1e-8)


@pytest.mark.parametrize(("size", "told"), [(1e-6, True), (1.0, False)])
def test_forces_so_small_that_a_cantilever_measures_them_are_told_in_any_unit(size, told, tmp_path):
    """A travel of the piezo beside forces in N: the bending of the cantilever is a part of it."""
    path = written(tmp_path / "r.txt", ["Time (s)\tZSnsr (m)\tForce (N)"], (T, 1e-3 * D, 1e-3 * size * F / F.max()))
    assert any("what a cantilever bends" in note for note in read_record(path).notes) == told


LABVIEW = """LabVIEW Measurement\t
Separator\tTab
Decimal_Separator\t{point}
Multi_Headings\tYes
X_Columns\t{columns}
***End_of_Header***\t

"""
PACKET = """Channels\t2
Samples\t200\t200
Y_Unit_Label\tMillimeters\tNewtons
X_Dimension\tTime\tTime
X0\t{start}\t{start}
Delta_X\t0.01\t0.01
***End_of_Header***\t\t
X_Value\tStage\tLoad cell\tComment
"""


@pytest.mark.parametrize("point", [".", ","])
@pytest.mark.parametrize("columns", ["One", "No", "Multi"])
def test_a_labview_measurement_file_has_its_units_and_times_in_its_header(point, columns, tmp_path):
    """Two packets of 200 rows, the first row with a comment; X for all channels, for each of them, or the step alone."""
    text = LABVIEW
    for begin in (0, 200):
        part = slice(begin, begin + 200)
        text += PACKET.format(start=T[begin]).replace(
            "Stage\tLoad", "Stage\tX_Value\tLoad" if columns == "Multi" else "Stage\tLoad"
        )
        for t, d, f in zip(T[part], D[part], F[part], strict=True):
            x = "" if columns == "No" else f"{t:.6f}"
            text += f"{x}\t{d:.7f}\t" + (f"{x}\t" if columns == "Multi" else "") + f"{f / 1000:.10f}\n"
    text = text.replace("\n0.000000\t", "\n0.000000\t").format(point=point, columns=columns)
    head, _, rows = text.partition("X_Value")
    (tmp_path / "r.lvm").write_text(head + "X_Value" + (rows.replace(".", ",") if point == "," else rows))
    record = read_record(tmp_path / "r.lvm")
    np.testing.assert_allclose(record.time, T, atol=1e-6)
    np.testing.assert_allclose(record.displacement, D, atol=1e-6)
    np.testing.assert_allclose(record.force, F, atol=1e-6)
    assert record.notes == ()


def test_the_travel_of_a_piezo_less_the_cantilever_is_the_indentation(tmp_path):
    """Optics11: the indentation is 1.5 um behind 2 um of travel; the file states sphere and stiffness."""
    header = ["k (N/m)\t0.019", "Tip radius (um)\t27.500", "", "Time (s)\tLoad (uN)\tIndentation (nm)\tCantilever (nm)\tPiezo (nm)"]
    bent = 0.25 * D
    record = read_record(written(tmp_path / "r.txt", header, (T, F, 1e3 * D, 1e6 * bent, 1e6 * (D + bent))))
    np.testing.assert_allclose(record.displacement, D, atol=1e-9)
    assert "minus 'Cantilever (nm)'" in record.taken
    assert record.stated.radius == pytest.approx(0.0275) and record.stated.stiffness == pytest.approx(0.019)
    named = read_record(tmp_path / "r.txt", Record(displacement=RecordChannel(column="Piezo"), preset=None))
    np.testing.assert_allclose(named.displacement, D, atol=1e-9)


def test_a_travel_of_another_sensor_is_named(tmp_path):
    """A crosshead that moves a fifth more than the sensor beside the sample; the same travel the other way round is no other."""
    path = written(tmp_path / "r.csv", ["Time (s),Crosshead (mm),LVDT (mm),Load (N)"], (T, 1.2 * D, D, F / 1000), ",")
    (note,) = read_record(path).notes
    assert "'LVDT (mm)' moves otherwise than 'Crosshead (mm)'" in note and "record.displacement.column" in note
    chosen = read_record(path, Record(displacement=RecordChannel(column="LVDT")))
    np.testing.assert_allclose(chosen.displacement, D, atol=1e-9)
    same = written(tmp_path / "s.csv", ["Time (s),Extension (mm),Position (mm),Load (N)"], (T, D, 50 - D, F / 1000), ",")
    assert chosen.notes == read_record(same).notes == ()


def test_of_a_sensor_with_three_directions_that_of_the_indenter_is_taken(tmp_path):
    header = ["Time [s],z-Position [µm],F_x [mN],F_z [mN],F_y [mN]"]
    record = read_record(written(tmp_path / "r.csv", header, (T, 1e3 * D, 0.1 * F, F, -0.1 * F), ","))
    np.testing.assert_allclose(record.force, F, atol=1e-9)


def test_stiffness_and_compliance_are_subtracted(tmp_path):
    path = written(tmp_path / "r.txt", ["Time (s)\tStroke (mm)\tLoad (mN)"], (T, D + F / 4.0, F))
    for settings in (Record(stiffness=4.0), Record(compliance=0.25), Record(stiffness="4 N/m")):
        np.testing.assert_allclose(read_record(path, settings).displacement, D, atol=1e-7)


def test_a_file_of_several_tables_is_several_records(tmp_path):
    block = ["Test {}", "Time (s)\tDisplacement (mm)\tLoad (mN)"]
    rows = ["\t".join(f"{value:.6f}" for value in row) for row in zip(T, D, F, strict=True)]
    text = [line.format(n) for n in (1, 2, 3) for line in [*block, *rows, ""]]
    (tmp_path / "r.txt").write_text("\n".join(text))
    assert [record.name.split()[-2:] for record in read_records(tmp_path / "r.txt")] == [["Test", str(n)] for n in (1, 2, 3)]
    with pytest.raises(RecordError, match=r"holds 3 records; give record\.block"):
        read_record(tmp_path / "r.txt")
    assert read_record(tmp_path / "r.txt", Record(block=2)).name.endswith("r.txt")
    assert len(process(tmp_path / "r.txt", settings=Record(indenter="sphere")).outcomes) == 3


def test_a_preset_of_the_lab_beside_its_records(tmp_path):
    path = written(tmp_path / "r.txt", ["Rig seven", "a\tb\tc"], (T, D, F))
    with pytest.raises(RecordError, match="no columns of displacement"):
        read_record(path)
    (tmp_path / "seven.preset.toml").write_text(
        'name = "Rig seven"\nmatch = ["rig SEVEN"]\n[record]\nrate = 100\n'
        'displacement = { column = "b", unit = "mm" }\nforce = { column = "c", unit = "mN" }\n'
    )
    record = read_record(path)
    np.testing.assert_allclose(record.force, F, atol=1e-6)
    assert record.taken.startswith("Rig seven: ")


def test_a_binary_file_is_called_one(tmp_path):
    (tmp_path / "r.dat").write_bytes(bytes(range(32)) * 200)
    with pytest.raises(RecordError, match=r"a binary file, not text; .*indentfit\[afm\]"):
        read_record(tmp_path / "r.dat")


def test_times_that_repeat_are_spread(tmp_path):
    doubled = np.repeat(T[::2], 2)
    record = read_record(written(tmp_path / "r.txt", ["Time (s)\tDisplacement (mm)\tLoad (mN)"], (doubled, D, F)))
    np.testing.assert_allclose(record.time, T, atol=1e-9)


def hertz(start, count=1200, radius=0.5, modulus=830.3, noise=2e-4, seed=0):
    """A record of a sphere that begins `start` mm beyond contact: its displacement is 0 there, and its sensor's zero is 0."""
    d = np.linspace(0.0, 0.012, count)
    force = 4 / 3 * modulus * np.sqrt(radius) * (d + start) ** 1.5
    return RawRecord(np.arange(count) / 100, d, force + noise * np.random.default_rng(seed).standard_normal(count))


@pytest.mark.parametrize("start", [0.0, 0.001, 0.004])
def test_a_record_that_begins_in_contact_has_no_invented_baseline(start):
    record = hertz(start)
    done = process_record(record, settings=Record(indenter="sphere", radius=0.5))
    assert done.contact.baseline == 0 and any("no approach" in note for note in done.notes)
    assert abs(done.contact.displacement + start) <= max(2 * done.contact.uncertainty, 2e-6)
    assert done.hertz.modulus == pytest.approx(830.3, rel=0.01)
    assert done.peak == pytest.approx(record.force[-1], rel=0.01)


def test_contact_in_a_staged_loading_is_sought_in_the_first_stage():
    """Approach, preload to 4 mN, a hold, and the load: contact at 1 mm."""
    position = np.concatenate([np.linspace(0, 1.2, 600), np.full(400, 1.2), np.linspace(1.2, 2.2, 500), np.full(200, 2.2)])
    force = 20 * np.maximum(position - 1.0, 0) + 0.02 * np.random.default_rng(0).standard_normal(position.size)
    done = process_record(RawRecord(np.arange(position.size) / 100, position, force), settings=Record(indenter="flat"))
    assert done.contact.displacement == pytest.approx(1.0, abs=0.01)
    assert done.peak == pytest.approx(24.0, rel=0.01)
    assert any("pause" in note for note in done.notes)


def test_a_stated_contact_zero_and_limit_are_kept_to():
    settings = Record(indenter="sphere", contact=-0.002, zero="sensor", max_depth=0.008)
    done = process_record(hertz(0.002), settings=settings)
    assert done.contact.displacement == -0.002 and done.contact.method == "stated"
    assert done.depth == pytest.approx(0.008, abs=1e-4)


# Atomic force microscopes: a stub stands for afmformats


def test_a_toe_before_contact_is_not_taken_for_waves():
    """A sample whose first touch is soft, as of skin: contact lies where the force leaves zero, and no waves are fitted."""
    rng = np.random.default_rng(0)
    x = np.linspace(-1.0, 1.0, 1500)  # mm
    f = 100 * np.where(x > 0, 0.02 * np.expm1(4 * np.maximum(x, 0)), 0)  # the powers do not hold
    record = RawRecord(np.arange(x.size) / 100, x, f + 0.01 * f.max() * rng.standard_normal(x.size))
    done = process_record(record, settings=Record(indenter="flat"))
    assert done.contact.form in ("constant", "drift") and abs(done.contact.displacement) <= max(done.contact.uncertainty, 0.15)
    assert done.peak == pytest.approx(f.max(), rel=0.02)


def test_a_deflection_that_a_stated_stiffness_takes_off_needs_no_note(tmp_path):
    rows = (T, 1e3 * D + 50, 0.01 * F, 1e3 * F)
    header = ["# springConstant: 0.05 N/m", "Time (s)\tHeight (um)\tDeflection (nm)\tForce (nN)"]
    record = read_record(written(tmp_path / "r.txt", header, rows))
    assert "minus force / 0.05 mN/mm" in record.taken and record.notes == ()


@pytest.mark.parametrize(("column", "notes"), [("Travel (nm)", 1), ("Displacement (nm)", 1), ("Indentation (nm)", 0)])
def test_a_travel_under_nanonewtons_asks_for_the_cantilever(tmp_path, column, notes):
    """Without its stiffness E was 5.5 % low, and nothing said so."""
    record = read_record(written(tmp_path / "r.txt", [f"Time (s)\t{column}\tForce (nN)"], (T, 1e6 * D, 1e6 * F)))
    assert len(record.notes) == notes and all("give record.stiffness" in note for note in record.notes)


class StubCurve(dict):
    """What afmformats gives of a curve: columns and metadata."""

    def __init__(self, columns, metadata):
        super().__init__(columns)
        self.columns, self.metadata = list(columns), metadata


def force_curve(rng, count=2000, stiffness=0.05, timed=True):
    """A sphere of 5 um on a gel, on a cantilever of 0.05 N/m: a height that falls, approach and retract; with contact, m."""
    travel = np.concatenate([np.linspace(0, 6e-6, count // 2), np.linspace(6e-6, 0, count // 2)])
    contact = rng.uniform(3e-6, 4e-6)
    depth = np.maximum(travel - contact, 0) * 0.9
    force = 4 / 3 * 1000 * np.sqrt(5e-6) * depth**1.5
    height = 50e-6 - np.where(travel > contact, contact + depth + force / stiffness, travel)
    force = force + 2e-11 * rng.standard_normal(count)
    columns = {"force": force, "height (measured)": height, "segment": np.arange(count) >= count // 2}
    if timed:
        columns["time"] = np.arange(count) / 1000
    return StubCurve(columns, {"spring constant": stiffness}), 50e-6 - contact


@pytest.fixture
def afmformats(monkeypatch):
    stub = ModuleType("afmformats")
    monkeypatch.setitem(sys.modules, "afmformats", stub)
    return stub


@pytest.mark.parametrize("timed", [True, False])
def test_the_height_of_an_afm_less_the_cantilever_is_the_indentation(afmformats, tmp_path, timed):
    curve, contact = force_curve(np.random.default_rng(0), timed=timed)
    afmformats.load_data = lambda path, **told: [curve]
    (tmp_path / "r.jpk-force").write_bytes(b"binary")
    (outcome,) = process(tmp_path / "r.jpk-force", settings=Record(indenter="sphere", radius=0.005)).outcomes
    done = outcome.processed
    assert abs(-done.contact.displacement - 1e3 * contact) <= done.contact.uncertainty < 1e-4
    assert done.hertz.modulus == pytest.approx(1.0, rel=0.02)  # kPa
    assert "minus force / 0.05 mN/mm" in done.record.taken and done.record.stated.stiffness == 0.05


def test_curves_of_a_map_have_the_instrument_s_order(afmformats, tmp_path):
    """Groups of HDF5 are sorted as texts: 0, 1, 10, 2; curve 3 was the eleventh of the map."""
    rng = np.random.default_rng(2)
    curves = [force_curve(rng)[0] for _ in range(4)]
    for curve, number in zip(curves, (0, 1, 10, 2), strict=True):
        curve.metadata["enum"] = number
    afmformats.load_data = lambda path, **told: curves
    (tmp_path / "r.h5").write_bytes(b"binary")
    records = read_records(tmp_path / "r.h5")
    assert [float(record.force[0]) for record in records] == pytest.approx([1e3 * curves[n]["force"][0] for n in (0, 1, 3, 2)])


def test_what_afmformats_cannot_read_is_one_line(afmformats, tmp_path):
    class MissingMetaDataError(BaseException):
        """As in afmformats: no Exception."""

    def load_data(path, **told):
        raise MissingMetaDataError("Missing meta data: 'spring constant'")

    afmformats.load_data = load_data
    (tmp_path / "r.jpk-force").write_bytes(b"binary")
    with pytest.raises(RecordError, match=r"^\S+r\.jpk-force: afmformats cannot read it .*; give record\.stiffness") as caught:
        read_record(tmp_path / "r.jpk-force")
    assert "\n" not in str(caught.value)


def test_a_force_map_of_686_curves_takes_less_than_a_minute(afmformats, tmp_path):
    """30 of them are processed, and the time is scaled: at most 60 s of CPU for 686."""
    rng = np.random.default_rng(1)
    curves, contacts = zip(*[force_curve(rng) for _ in range(30)], strict=True)
    afmformats.load_data = lambda path, **told: list(curves)
    (tmp_path / "r.jpk-force-map").write_bytes(b"binary")
    started = time.process_time()
    outcomes = process(tmp_path / "r.jpk-force-map", settings=Record(indenter="sphere", radius=0.005)).outcomes
    assert (time.process_time() - started) / len(curves) * 686 < 60
    done = [outcome.processed for outcome in outcomes]
    held = [
        abs(-one.contact.displacement - 1e3 * contact) <= one.contact.uncertainty
        for one, contact in zip(done, contacts, strict=True)
    ]
    assert np.mean(held) > 0.8 and outcomes[1].name.endswith("curve 2")


_spec = importlib.util.spec_from_file_location("records_campaign", Path(__file__).parent / "campaigns" / "records.py")
campaign = importlib.util.module_from_spec(_spec)
sys.modules["records_campaign"] = campaign  # its dataclasses look themselves up
_spec.loader.exec_module(campaign)


@pytest.mark.parametrize("kind", ["approach", "end_not_known", "ringing", "wavy", "preload", "clipped"])
def test_intervals_of_contact_hold_the_truth_in_kinds_of_records(kind):
    """The campaign in short: 20 records of a kind; those without a flag hold the truth, and no peak without a flag is off."""
    counts = campaign.tally(kind, 20, seed=3)
    assert counts.passes() and counts.plain + counts.flagged + counts.refused == 20
    assert counts.refused == 20 if kind == "clipped" else counts.refused <= 6
