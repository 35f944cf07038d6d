"""Raw records in: the files of labs, what they are calibrated to, and what is refused."""

import codecs
import time

import numpy as np
import pytest

from indentfit import case
from indentfit.case import RecordChannel
from indentfit.errors import RecordError
from indentfit.experiment.formats.encodings import decoded
from indentfit.experiment.processed import process_record
from indentfit.experiment.reading import read_record
from indentfit.experiment.record import RawRecord
from indentfit.experiment.rig import Rig, SensorNoise

N = 60
D = np.round(np.linspace(0.0, 0.59, N), 2)  # mm
F = np.round(40.0 * D, 3)  # mN
PLAIN = case.Record(rate=1000.0)


def lines(form="{d},{f}", header="displacement_mm,force_mN", decimal="."):
    rows = [form.format(d=f"{d:.2f}".replace(".", decimal), f=f"{f:.3f}".replace(".", decimal)) for d, f in zip(D, F, strict=True)]
    return "\n".join([header, *rows]) + "\n"


@pytest.fixture
def read(tmp_path):
    def read(text, layout=PLAIN, encoding="utf-8", name="record.csv"):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode(encoding))
        return read_record(path, layout)

    return read


FORMS = {
    "commas": lines(),
    "tabs": lines("{d}\t{f}", "displacement_mm\tforce_mN"),
    "semicolons": lines("{d};{f}", "displacement_mm;force_mN"),
    "semicolons and decimal commas": lines("{d};{f}", "displacement_mm;force_mN", ","),
    "tabs and decimal commas": lines("{d}\t{f}", "displacement_mm\tforce_mN", ","),
    "blanks": lines("  {d}   {f}", "displacement_mm force_mN"),
    "blanks and decimal commas": lines("  {d}   {f}", "displacement_mm force_mN", ","),
    "comma and blank": lines("{d}, {f}", "displacement_mm, force_mN"),
    "quotes": lines('"{d}";"{f}"', '"displacement_mm";"force_mN"', ","),
    "a row of units": lines(header="Displacement,Force\nmm,mN"),
    "units in brackets": lines(header="Displacement [mm],Load (mN)"),
    "vendor's preamble": lines(header="RigSoft 3.2\nOperator,Li\nDate,2017-01-03\n\nPosition (mm),Load (mN)"),
    "carriage returns": lines().replace("\n", "\r\n"),
    "a third column of text": lines("{d},{f},ok", "displacement_mm,force_mN,state"),
    "an earlier column of clock times": lines("12:00:01,{d},{f}", "clock,displacement_mm,force_mN"),
}


@pytest.mark.parametrize("form", FORMS)
def test_the_forms_of_labs_files_hold_the_same_record(read, form):
    record = read(FORMS[form])
    np.testing.assert_allclose(record.displacement, D, atol=1e-12)
    np.testing.assert_allclose(record.force, F, atol=1e-12)
    np.testing.assert_allclose(record.time, np.arange(N) / 1000)


ENCODINGS = {
    "utf-8": "位移 (µm),力 (mN)",
    "utf-8-sig": "位移 (µm),力 (mN)",
    "utf-16": "位移 (µm),力 (mN)",
    "utf-16-le": "位移 (µm),力 (mN)",
    "utf-16-be": "位移 (µm),力 (mN)",
    "gbk": "试样：白质\n位移(mm),力(mN)",
    "latin-1": "Prüfkörper für Eindrückversuch 20 °C\nWeg (µm),Kraft (mN)",
}


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_vendors_headers_are_read_in_their_encodings(read, encoding):
    record = read(lines(header=ENCODINGS[encoding]), encoding=encoding)
    scale = 1e-3 if "µm" in ENCODINGS[encoding] else 1.0
    np.testing.assert_allclose(record.displacement, scale * D, atol=1e-12)
    np.testing.assert_allclose(record.force, F, atol=1e-12)


def test_text_without_marks_is_told_gbk_from_latin_1():
    for text, encoding in (("位移与载荷", "gbk"), ("Prüfung über 5 µm bei 20 °C", "latin-1"), ("déplacement", "latin-1")):
        assert decoded(text.encode(encoding)) == text
    assert decoded(codecs.BOM_UTF16_LE + "力".encode("utf-16-le")) == "力"


def test_a_named_encoding_is_kept_to(read):
    with pytest.raises(RecordError, match="klingon"):
        read(lines(), case.Record(rate=1000.0, encoding="klingon"))
    with pytest.raises(RecordError, match="not text in ascii"):
        read(lines(header="Weg µ,Kraft"), case.Record(rate=1000.0, encoding="ascii"))


def test_a_workbook_holds_the_same_record(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    pytest.importorskip("python_calamine")
    book = openpyxl.Workbook()
    book.active.append(["notes", "nothing here"])
    sheet = book.create_sheet("run 2")
    for row in (
        [],
        ["Rig", "RigSoft"],
        ["time (s)", "Position (mm)", "Load (N)"],
        *([n / 500, d, f / 1000] for n, (d, f) in enumerate(zip(D, F, strict=True))),
    ):
        sheet.append(row)
    book.save(tmp_path / "record.xlsx")
    for name in ("run 2", 2):
        record = read_record(tmp_path / "record.xlsx", case.Record(sheet=name))
        np.testing.assert_allclose(record.displacement, D, atol=1e-12)
        np.testing.assert_allclose(record.force, F, atol=1e-9)
        np.testing.assert_allclose(record.time, np.arange(N) / 500, atol=1e-12)
    for wrong, text in (("run 3", "no such sheet; the workbook has Sheet, run 2"), (5, "2 sheets"), (1, "no row of numbers")):
        with pytest.raises(RecordError, match=text):
            read_record(tmp_path / "record.xlsx", case.Record(sheet=wrong))
    record = read_record(tmp_path / "record.xlsx")  # the first sheet is no record, the second is
    np.testing.assert_allclose(record.displacement, D, atol=1e-12)
    assert "every sheet was looked at" in record.notes[0]
    (tmp_path / "broken.xlsx").write_text("no workbook")
    with pytest.raises(RecordError, match=r"broken\.xlsx: not a workbook"):
        read_record(tmp_path / "broken.xlsx")


CALIBRATIONS = {  # gain, sign, offset and unit by hand: mm and mN of a reading of 2
    "V to mm": ("displacement", RecordChannel(column=1, gain=6.0, sign=-1, offset=30.0, unit="mm"), 30 - 12),
    "V to um": ("displacement", RecordChannel(column=1, gain=6.0, unit="um"), 0.012),
    "V to mN": ("force", RecordChannel(column=2, gain=24.0), 48.0),
    "N": ("force", RecordChannel(column=2, unit="N"), 2000.0),
    "gf": ("force", RecordChannel(column=2, unit="gf"), 2 * 9.80665),
    "kgf falling": ("force", RecordChannel(column=2, sign=-1, unit="kgf"), -2 * 9806.65),
}


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_a_calibration_turns_readings_into_mm_and_mn(read, name):
    quantity, channel, expected = CALIBRATIONS[name]
    channels = {"displacement": RecordChannel(column=1, unit="mm"), "force": RecordChannel(column=2, unit="mN"), quantity: channel}
    record = read("a,b\n" + "2,2\n" * 60, case.Record(rate=10.0, **channels))
    assert getattr(record, quantity)[0] == pytest.approx(expected, rel=1e-12)


def test_columns_go_by_name_or_number_and_time_by_rate_or_column(read):
    text = "t (ms),x (mm),y (mN)\n" + "".join(f"{5 * n},{d},{f}\n" for n, (d, f) in enumerate(zip(D, F, strict=True)))
    for x, y in (("x", "y"), ("X (mm)", "y (mn)"), (2, 3)):
        record = read(text, case.Record(displacement=RecordChannel(column=x), force=RecordChannel(column=y)))
        np.testing.assert_allclose(record.force, F)
        np.testing.assert_allclose(record.time, 0.005 * np.arange(N), atol=1e-12)
    assert read(
        text, case.Record(displacement=RecordChannel(column=2), force=RecordChannel(column=3), rate=100.0)
    ).interval == pytest.approx(0.01)


REFUSED = {
    "no unit": (lines(header="displacement,force"), PLAIN, "unit of the displacement; give record.displacement.unit"),
    "volts": (lines(header="displacement_V,force_V"), PLAIN, "in V; give record.displacement.gain, mm per V"),
    "no rate": (lines(), case.Record(), "give record.rate"),
    "no such column": (
        lines(),
        case.Record(displacement=RecordChannel(column="stroke"), rate=1.0),
        "'stroke': no such columns.*1: displacement_mm; 2: force_mN",
    ),
    "no such number": (lines(), case.Record(displacement=RecordChannel(column=3), rate=1.0), "the file has 2 columns"),
    "same column": (lines(), case.Record(displacement=RecordChannel(column=2), rate=1.0), "same column"),
    "no header": (lines(header=""), PLAIN, "give record.displacement.column"),
    "wrong unit": (lines(), case.Record(displacement=RecordChannel(unit="kPa"), rate=1.0), "record.displacement.unit is in kPa"),
    "text among numbers": (lines().replace("0.20,8.000", "0.20,eight"), PLAIN, "line 22: 'eight' is not a number"),
    "a short line": (lines().replace("0.20,8.000", "0.20"), PLAIN, "line 22: 1 columns"),
    "3 rows": ("displacement_mm,force_mN\n0,0\n1,1\n2,2\n", PLAIN, "3 rows of numbers; a record needs at least 50"),
    "empty": ("", PLAIN, "the file is empty"),
    "words": ("once upon a time\n" * 30, PLAIN, "no rows of numbers"),
    "time going back": (
        "time_s,displacement_mm,force_mN\n" + "".join(f"{n % 40},{n},{n}\n" for n in range(60)),
        case.Record(),
        "row 42: the time 0 s",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_read_is_named_with_its_remedy(read, case):
    text, layout, message = REFUSED[case]
    with pytest.raises(RecordError, match=message) as caught:
        read(text, layout)
    assert "record.csv" in str(caught.value) and "\n" not in str(caught.value)


def test_a_missing_file_and_a_folder_are_named(tmp_path):
    for path, text in ((tmp_path / "none.csv", "no such file"), (tmp_path, "not a file")):
        with pytest.raises(RecordError, match=text):
            read_record(path)


def test_a_last_line_cut_off_and_rows_without_numbers_are_left_out_with_a_note(read):
    text = lines().replace("0.20,8.000", "0.20,NaN").removesuffix(",23.600\n")
    record = read(text)
    assert record.time.size == N - 2
    assert record.time[20] - record.time[19] == pytest.approx(0.002)  # the rate goes on meanwhile
    assert any("cut off" in note for note in record.notes) and any("1 rows without numbers" in note for note in record.notes)


def test_several_hundred_thousand_rows_take_about_a_second(tmp_path):
    """CPU time, with room for a slow machine: 300,000 rows within 3 s, decimal commas and all."""
    rng = np.random.default_rng(0)
    rows = [f"{a:.3f};{b:.3f}".replace(".", ",") for a, b in rng.uniform(0, 5, (300_000, 2))]
    (tmp_path / "long.txt").write_text("Weg [mm];Kraft [mN]\n" + "\n".join(rows), encoding="utf-8")
    started = time.process_time()
    assert read_record(tmp_path / "long.txt", PLAIN).time.size == 300_000
    assert time.process_time() - started < 3


# Records that are no loading of a sample


def good(**changes):
    rig = Rig(noise=SensorNoise(vibration=(0.05, 0.0)), **changes)
    d = np.linspace(0, 0.33, 34)[1:]
    from indentfit.curve import Curve

    return rig.run(Curve(d, 80 * d), np.random.default_rng(0))[0]


def without(record, dropped):
    keep = np.ones(record.time.size, bool)
    keep[dropped] = False
    return keep


def broken():
    record = good()
    t, d, f = record.time, record.displacement, record.force
    top = 0.6 * (f.max() - f.min()) + f.min()
    keep = without(record, slice(600, 700))  # a third of the ramp
    return {
        "no contact": (t, d, f[0] + np.random.default_rng(1).normal(0, 0.02, t.size), "no contact"),
        "saturated": (t, d, np.minimum(f, top), "the force is saturated"),
        "saturated displacement": (t, np.minimum(d, d.min() + 0.6 * np.ptp(d)), f, "the displacement is saturated"),
        "dropped samples, by time": (t[keep], d[keep], f[keep], "samples are missing in the ramp"),
        "dropped samples, by rate": (t[: keep.sum()], d[keep], f[keep], "the displacement jumps"),
        "displacement backwards": (t, -d, f, "goes backwards.*record.displacement.sign"),
        "force falling": (t, d, -f, "under load.*record.force.sign"),
        "constant force": (t, d, np.full_like(f, 1.5), "the force is 1.5 throughout"),
        "constant displacement": (t, np.full_like(d, 1.5), f, "the displacement is 1.5 throughout"),
        "3 rows": (t[:3], d[:3], f[:3], "3 rows of numbers"),
    }


@pytest.mark.parametrize("name", broken())
def test_a_record_that_shows_no_loading_is_refused_in_one_line(name):
    *channels, message = broken()[name]
    with pytest.raises(RecordError, match=message) as caught:
        process_record(RawRecord(*channels, name="run7.csv"))
    assert str(caught.value).startswith("run7.csv: ") and "\n" not in str(caught.value)


def test_a_record_that_begins_in_contact_is_extrapolated_and_flagged():
    """Contact was 0.1 mm, 8 mN, before the first sample; the sensor's zero is its reading without contact."""
    record = good()
    zero = 1.7
    part = RawRecord(record.time[550:] - record.time[550], record.displacement[550:], record.force[550:] - zero)
    done = process_record(part, settings=case.Record(indenter="flat"))
    assert any("the record has no approach" in note for note in done.notes)
    assert done.contact.method == "extrapolated" and done.contact.baseline == 0
    assert abs(done.contact.displacement - 0.7) <= done.contact.uncertainty < 0.02
    assert done.peak == pytest.approx(80 * 0.33, rel=0.01)


def test_the_record_that_these_were_made_of_is_fine():
    done = process_record(good(), thickness=3.3)
    assert done.line.slope == pytest.approx(80, rel=0.02)
    assert done.depth == pytest.approx(0.33, abs=0.005)
    assert done.notes == ()


def test_samples_missing_in_the_hold_are_only_noted():
    record = good()
    keep = without(record, slice(record.time.size - 200, record.time.size - 150))
    done = process_record(RawRecord(record.time[keep], record.displacement[keep], record.force[keep]))
    assert any("samples are missing at 1 places, 0.05 s" in note for note in done.notes)
