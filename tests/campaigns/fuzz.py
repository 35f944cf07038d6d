"""Fuzz campaign: hostile files and texts for everything that indentfit reads.

    nice -n 19 python tests/campaigns/fuzz.py [--inputs 200000] [--seed 0] [--only case curve ...] [--atheris TARGET]

Hypothesis makes each input from a sound one: it changes keys, values, cells, rows and structure, then sometimes bytes. Property:
the reader returns something sound, or raises an error of exit code 2 to 4 whose lines each name the place; never another
exception, more than 10 s, or more than 2 GB beyond what the imports take. The same seed gives the same inputs. Each finding is
printed once, with the smallest input that shows it; the table at the end is the one of FAULTS.md. Exit code 1 for findings.

`--atheris TARGET` runs libFuzzer on the bytes of that target instead, until it is stopped (pip install atheris).
"""

import argparse
import collections
import contextlib
import io
import itertools
import json
import math
import os
import random
import resource
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
import tomllib
import traceback
import warnings
import zipfile
from pathlib import Path

import numpy as np
import tomli_w
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from indentfit import curve, material, units
from indentfit.case import Record as Layout
from indentfit.errors import CaseError, IndentfitError
from indentfit.experiment import manifest, outcomes, processed, reading, specimens
from indentfit.experiment.measured import read_case
from indentfit.material.typed_energy import typed_class
from indentfit.report import html, html_design, html_fit, html_process, html_samples, html_simulation, html_studies, page
from indentfit.report.case_text import case_facts, case_lines
from indentfit.report.schema import RESULT_FILES
from indentfit.runs import ledger
from indentfit.runs.run import Run

SHIPPED = Path(__file__).parents[2] / "cases"
FIRST_VERSION = Path(__file__).parents[1] / "baseline" / "results-0.1"
SECONDS, MEMORY = 10, 2 << 30
BATCH = 500  # examples of one run of Hypothesis: it stops at a finding, the next batch goes on with others
SHARES = {
    "case": 0.22, "curve": 0.2, "record": 0.14, "workbook": 0.02, "manifest": 0.13, "replicates": 0.08, "result": 0.07,
    "ledger": 0.02, "energy": 0.12,
}  # fmt: skip


class Slow(BaseException):
    """An input took longer than it may."""


class Wrong(AssertionError):
    """What a reader returned, or how it refused, is not as promised."""


# What inputs are made of

AWKWARD = (
    "", " ", "0", "-0", "-1", "1e400", "-1e400", "nan", "inf", "1e-400", "1e308", "5e-324", "١٢", "½", "1_000", "0x10", "1,5",
    "1.5.2", "--1", "+-1", "1e", "e1", "None", "true", "stick", "3.3 mm", "3.3 km", "3.3 mm^99", "3.3 mm*mm", "1e308 km",
    "1 mm/0", "9" * 400, "é", "\u202e", "\x00", "a\nb", '"', "'", "\\", ";", "\t", ",", "#", "=", "<script>alert(1)</script>",
    "{{7*7}}", "%s%n", "../../etc/passwd", "/dev/zero", "/dev/stdin", "a" * 5000,
    "\ud800".encode("utf-8", "surrogatepass").decode("utf-8", "replace"),
)  # fmt: skip
TEXTS = st.sampled_from(AWKWARD) | st.text(max_size=12)
NUMBERS = st.sampled_from(
    [0, -1, 1, 2, 90, 45, 10**30, -(10**400), 2**63, 0.0, -0.0, 1e-320, 1e308, -1e308, math.nan, math.inf, -math.inf, 0.5]
)
SCALARS = NUMBERS | TEXTS | st.booleans() | st.none() | st.integers() | st.floats()
VALUES = st.recursive(SCALARS, lambda one: st.lists(one, max_size=3) | st.dictionaries(TEXTS, one, max_size=3), max_leaves=5)
INDEX = st.integers(0, 10**6)
CHANGES = st.lists(
    st.tuples(st.sampled_from(("replace", "replace", "drop", "rename", "copy", "wrap", "swap")), INDEX, VALUES), max_size=4
)
BYTES = st.lists(
    st.tuples(st.sampled_from(("flip", "insert", "cut", "repeat", "truncate")), INDEX, st.binary(min_size=1, max_size=6)),
    max_size=3,
)
SELDOM = st.one_of(st.just([]), st.just([]), BYTES)


def changed(tree, changes):
    """A tree of tables, lists and values after changes, each (how, which place, new value)."""
    for how, which, value in changes:
        places = list(_places(tree))
        if not places:
            return tree
        inner, key = places[which % len(places)]
        if how == "replace":
            inner[key] = value
        elif how == "drop":
            del inner[key]
        elif how == "wrap":
            inner[key] = [inner[key]] if which % 2 else {"x": inner[key]}
        elif how == "swap":
            other, place = places[(which // 7) % len(places)]
            inner[key], other[place] = other[place], inner[key]
            if _cyclic(tree):
                inner[key] = value
        elif isinstance(inner, dict) and how in ("rename", "copy"):
            inner[str(value)] = inner.pop(key) if how == "rename" else inner[key]
        elif isinstance(inner, list):
            inner.insert(which % (len(inner) + 1), inner[key])
    return tree


def _places(tree):
    """(container, key) of everything in a tree."""
    items = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in list(items):
        yield tree, key
        yield from _places(value)


def _cyclic(tree, above=()):
    if not isinstance(tree, dict | list):
        return False
    inner = tree.values() if isinstance(tree, dict) else tree
    return id(tree) in above or any(_cyclic(one, (*above, id(tree))) for one in inner)


def bytes_changed(raw, changes):
    """Bytes after changes, each (how, where, new bytes)."""
    for how, where, new in changes:
        n = where % (len(raw) + 1)
        if how == "flip":
            raw = raw[:n] + bytes(b ^ (1 << where % 8) for b in raw[n : n + 1]) + raw[n + 1 :]
        elif how == "insert":
            raw = raw[:n] + new + raw[n:]
        elif how == "cut":
            raw = raw[:n] + raw[n + len(new) :]
        elif how == "repeat":
            raw = raw[:n] + raw[n : n + 50] * (new[0] % 20) + raw[n:]
        else:
            raw = raw[:n]
    return raw


def table_changed(rows, changes):
    """Rows of cells (text) after changes to cells and rows."""
    for how, which, value in changes:
        if not rows:
            break
        row = rows[which % len(rows)]
        cell = (which // 13) % (len(row) or 1)
        if how in ("replace", "wrap") and row:
            row[cell] = str(value)
        elif how == "drop" and row and which % 3:
            del row[cell]
        elif how == "drop":
            rows.remove(row)
        elif how == "rename" and rows[0]:
            rows[0][cell % len(rows[0])] = str(value)
        elif how == "copy":
            rows.insert(which % (len(rows) + 1), list(row))
        elif how == "swap" and row:
            other = rows[(which // 7) % len(rows)]
            row[:], other[:] = other[:], row[:]
        else:
            row.insert(cell, str(value))
    return rows


def toml(tree):
    """TOML of a tree, with what TOML cannot say left out."""
    return tomli_w.dumps(_sayable(tree)).encode("utf-8", "replace")


def _sayable(value):
    if isinstance(value, dict):
        return {str(key): _sayable(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_sayable(one) for one in value]
    return "" if value is None else value


# Targets: classes with `inputs`, a strategy, and `read`, which reads one such input and checks what comes out


def require(condition, text):
    if not condition:
        raise Wrong(text)


class CaseFile:
    """Case TOML with --set texts, as `validate` reads it."""

    def __init__(self, folder):
        self.folder = folder
        for name in ("quickstart", "white_matter_2017", "rig_records"):
            for file in (SHIPPED / name).rglob("*.csv"):
                place = folder / file.relative_to(SHIPPED / name)
                place.parent.mkdir(parents=True, exist_ok=True)
                place.write_bytes(file.read_bytes())
        texts = [(SHIPPED / name / "case.toml").read_text() for name in ("quickstart", "white_matter_2017")]
        texts += [TYPED, BLOCK]
        if (SHIPPED / "rig_records" / "case.toml").exists():
            texts.append(RECORDS)
        self.texts = texts
        base = st.sampled_from([0, 1, 2, 2, 3, 3, 3, 4][: 8 if len(texts) > 4 else 7])
        sets = st.lists(st.tuples(st.sampled_from(KEYS), TEXTS), max_size=1).map(lambda pairs: [f"{k}={v}" for k, v in pairs])
        self.inputs = st.tuples(st.builds(self.text, base, CHANGES, SELDOM), st.one_of(st.just([]), st.just([]), sets))

    def text(self, base, changes, bits):
        return bytes_changed(toml(changed(tomllib.loads(self.texts[base]), changes)), bits)

    def read(self, given):
        text, sets = given
        path = self.folder / "case.toml"
        path.write_bytes(text)
        found = read_case(path, sets)
        json.dumps(case_facts(found), allow_nan=False)
        require("\n" not in "".join(case_lines(found)), "a summary line with a line break")
        require(all("\n" not in line for line in found.warnings()), "a warning of two lines")
        require(all(np.isfinite(found.outputs(test)).all() for test in found.tests), "depths that are not finite")

    where = "case.toml"


class CurveFile:
    """Curve CSV."""

    where = "curve.csv"

    def __init__(self, folder):
        self.path = folder / self.where
        units = st.sampled_from(
            ["displacement_mm,force_mN", "displacement_um;force_N", "force_gf\tdisplacement_mm", "displacement_mm,x,force_mN"]
        )
        rows = st.integers(0, 30).map(lambda n: [[repr(0.01 * k), repr(0.3 * k), "1"] for k in range(n)])
        self.inputs = st.builds(self.text, units, rows, CHANGES, SELDOM)

    def text(self, header, rows, changes, bits):
        mark = next(c for c in ";\t," if c in header)
        width = len(header.split(mark))
        table = table_changed([header.split(mark), *(row[:width] for row in rows)], changes)
        return bytes_changed("\n".join(mark.join(row) for row in table).encode("utf-8", "replace"), bits)

    def read(self, text):
        self.path.write_bytes(text)
        found = curve.read_curve(self.path)
        require(np.isfinite(found.force).all() and np.isfinite(found.displacement).all(), "a curve that is not finite")
        require((np.diff(found.displacement) > 0).all() and found.displacement[0] >= 0, "displacements that do not rise")
        require(found.force[-1] > 0, "no force at the deepest point")


class RecordFile:
    """Raw record in text, with a layout; one in eight of those that are read is processed too."""

    where = "record.csv"

    def __init__(self, folder):
        self.path, self.count = folder / self.where, 0
        t = np.arange(120) / 100
        d = np.clip(t - 0.2, 0, 0.6)
        f = 60 * np.clip(d - 0.1, 0, None) + 0.02 * np.sin(37 * t)
        self.rows = [[f"{a:.4g}", f"{b:.5g}", f"{c:.5g}"] for a, b, c in zip(t, d, f, strict=True)]
        marks, encodings = (
            st.sampled_from(",;\t "),
            st.sampled_from(["utf-8", "utf-16", "gb18030", "latin-1", "utf-8-sig", "utf-32"]),
        )
        layouts = st.sampled_from(
            [Layout(), Layout(rate=100.0), Layout(skip_rows=1), Layout(encoding="utf-16"), Layout(encoding="no-such")]
        )
        self.inputs = st.tuples(st.builds(self.text, marks, encodings, st.integers(0, 120), CHANGES, SELDOM), layouts)

    def text(self, mark, encoding, length, changes, bits):
        rows = [["time (s)", "displacement (mm)", "force_mN"], *(list(row) for row in self.rows[:length])]
        return bytes_changed("\r\n".join(mark.join(row) for row in table_changed(rows, changes)).encode(encoding, "replace"), bits)

    def read(self, given):
        text, layout = given
        self.path.write_bytes(text)
        raw_record = reading.read_record(self.path, layout)
        require(np.isfinite([raw_record.time, raw_record.displacement, raw_record.force]).all(), "a record that is not finite")
        require((np.diff(raw_record.time) > 0).all(), "times that do not rise")
        self.count += 1
        if self.count % 8 == 0:
            done = processed.process_record(raw_record, 3.3)
            require(np.isfinite(done.curve.force).all(), "a processed curve that is not finite")


class Workbook(RecordFile):
    """Raw record as XLSX: cells changed, or the file's own XML, zip structure and bytes."""

    where = "record.xlsx"

    def __init__(self, folder):
        super().__init__(folder)
        self.sound = self._sound()
        parts = st.sampled_from([None, None, "xl/worksheets/sheet1.xml", "xl/workbook.xml", "[Content_Types].xml", "xl/styles.xml"])
        self.bomb = self.packed(
            {**self.sound, "xl/worksheets/sheet1.xml": self.sound["xl/worksheets/sheet1.xml"] + b" " * 600_000_000}
        )
        tricks = st.sampled_from([None] * 30 + ["twice", "no sheet", "entities", "far"] * 4 + ["bomb"])
        self.inputs = st.tuples(st.builds(self.text, st.integers(0, 40), CHANGES, parts, BYTES, SELDOM, tricks), st.just(Layout()))

    def _sound(self):
        import openpyxl

        book, raw = openpyxl.Workbook(), io.BytesIO()
        book.active.append(["time (s)", "displacement (mm)", "force_mN"])
        for row in self.rows[:60]:
            book.active.append([float(cell) for cell in row])
        book.save(raw)
        with zipfile.ZipFile(raw) as file:
            return {name: file.read(name) for name in file.namelist()}

    def text(self, length, changes, part, inner, bits, trick):
        members = dict(self.sound)
        if part:
            members[part] = bytes_changed(members[part], inner)
        sheet = members["xl/worksheets/sheet1.xml"]
        if trick == "entities":
            head = b'<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa">' + b"".join(
                b'<!ENTITY %c "%s">' % (98 + n, b"&%c;" % (97 + n) * 10) for n in range(9)
            ) + b"]>"  # fmt: skip
            members["xl/worksheets/sheet1.xml"] = head + sheet.replace(b"<v>0</v>", b"<v>&j;</v>")
        elif trick == "far":
            members["xl/worksheets/sheet1.xml"] = sheet.replace(b'r="A2"', b'r="XFD1048576"')
        elif trick == "no sheet":
            members.pop("xl/worksheets/sheet1.xml")
        elif trick == "bomb":
            return self.bomb
        return bytes_changed(self.packed(members, trick == "twice"), bits)

    def packed(self, members, twice=False):
        raw = io.BytesIO()
        with warnings.catch_warnings(), zipfile.ZipFile(raw, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as file:
            warnings.simplefilter("ignore")
            for name, content in members.items():
                file.writestr(name, content)
                if twice:
                    file.writestr(name, content[: len(content) // 2])
        return raw.getvalue()


class ManifestFile:
    """Manifest CSV."""

    where = "manifest.csv"

    def __init__(self, folder):
        self.path = folder / self.where
        self.inputs = st.builds(self.text, st.sampled_from(",;\t"), st.integers(0, 6), CHANGES, SELDOM)

    def text(self, mark, length, changes, bits):
        rows = [["sample", "direction", "file", "thickness_um", "diameter"]]
        rows += [[f"s{n // 2}", ("0", "90")[n % 2], f"r{n}.csv", "3300", "14"] for n in range(length)]
        return bytes_changed("\n".join(mark.join(row) for row in table_changed(rows, changes)).encode("utf-8", "replace"), bits)

    def read(self, text):
        self.path.write_bytes(text)
        for entry, outcome in zip(
            manifest.read_manifest(self.path), outcomes.process_all(manifest.read_manifest(self.path)), strict=True
        ):
            require(outcome.processed or outcome.problem, "a row without result and without problem")
            require("\n" not in (outcome.problem or ""), "a problem of two lines")
            if not entry.problem:
                require(entry.direction in (0, 90) and entry.sample, "a row that does not say what it is")


class Replicates:
    """The table that `fit --per-sample` reads."""

    where = "replicates.csv"

    def __init__(self, folder):
        self.path = folder / self.where
        self.inputs = st.builds(self.text, st.integers(0, 6), CHANGES, SELDOM)

    def text(self, length, changes, bits):
        rows = [
            list(specimens.COLUMNS),
            *([f"s{n // 2}", ("0", "90")[n % 2], f"curves/{n}.csv", "3.3", "14"] for n in range(length)),
        ]
        return bytes_changed("\n".join(",".join(row) for row in table_changed(rows, changes)).encode("utf-8", "replace"), bits)

    def read(self, text):
        self.path.write_bytes(text)
        for one in specimens.read_specimens(self.path):
            require(one.name and one.curves, "a sample without name or curves")
            require(all(x is None or (x > 0 and math.isfinite(x)) for x in (one.thickness, one.diameter)), "a length that is none")


class ResultFolder:
    """What `report` reads back: the JSON file of each kind of result, of this version and of 0.1. Figures are made, and not drawn:
    20 times as many inputs."""

    where = "result"

    def __init__(self, folder):
        self.folder = folder / self.where
        self.folder.mkdir()
        self.results = [(file.name, json.loads(file.read_text())) for file in sound_results(folder)]
        for module in (html_design, html_fit, html_process, html_samples, html_simulation, html_studies):
            module.drawn = lambda figure, caption, alt: page.Picture(str(caption), str(alt))
        self.inputs = st.builds(self.text, st.integers(0, len(self.results) - 1), CHANGES, SELDOM)

    def text(self, which, changes, bits):
        name, sound = self.results[which]
        tree = changed(json.loads(json.dumps(sound)), changes)
        with contextlib.suppress(ValueError, RecursionError):
            return name, bytes_changed(json.dumps(tree).encode("utf-8", "replace"), bits)
        return name, b"{}"

    def read(self, named):
        for name in RESULT_FILES:
            (self.folder / name).unlink(missing_ok=True)
        name, text = named
        (self.folder / name).write_bytes(text)
        written = html.write_report(self.folder).read_text(encoding="utf-8")
        require("<script" not in written.lower(), "a script in the page")
        require("Content-Security-Policy" in written, "a page without its policy")


class LedgerFile:
    """The ledger, by --resume, by --reuse and anew. A run that is found has the numbers that were written."""

    where = "ledger.sqlite"

    def __init__(self, folder):
        self.path, self.other = folder / self.where, folder / "other.sqlite"
        (folder / "curves").mkdir(exist_ok=True)
        (folder / "case.toml").write_text(BLOCK)
        self.case = read_case(folder / "case.toml")
        self.force = np.linspace(0.5, 9, 10)
        self.points = [{"mu": 1.0 + 0.1 * n, "zeta": 1.0, "phi": 0.5} for n in range(6)]
        with ledger.Ledger(self.path, self.case) as file:
            for n, point in enumerate(self.points):
                slopes = {"mu": self.force + n} if n % 2 else None
                file.add(point, self.case.tests[0], Run(self.force + n, None, 1.0, {"steps": 8}, slopes))
        self.sound = self.path.read_bytes()
        sql = st.sampled_from([None, None, *STATEMENTS])
        raw = st.builds(lambda bits: bytes_changed(self.sound, bits), BYTES)
        self.inputs = st.tuples(raw, sql, st.sampled_from(["resume", "anew", "reuse"]), st.booleans())

    def read(self, given):
        raw, sql, how, journal = given
        self.path.with_name(f"{self.path.name}-journal").unlink(missing_ok=True)
        self.other.unlink(missing_ok=True)
        self.path.write_bytes(raw if sql is None else self.sound)
        if sql:
            with contextlib.closing(sqlite3.connect(self.path)) as file, contextlib.suppress(sqlite3.Error):
                file.executescript(sql)
        if journal:
            self.path.with_name(f"{self.path.name}-journal").write_bytes(raw[:700])
        if how == "reuse":
            with ledger.Ledger(self.other, self.case) as file:
                file.take_over(self.path)
                self.compare(file)
            return
        with ledger.Ledger(self.path, self.case, resume=how == "resume") as file:
            self.compare(file)
            file.add({"mu": 9.0, "zeta": 0.0, "phi": 0.0}, self.case.tests[0], Run(self.force, None, 1.0, {}))

    def compare(self, file):
        for n, point in enumerate(self.points):
            found = file.find(point, self.case.tests[0])
            require(found is None or np.array_equal(found.force, self.force + n), "a ledger's run with other numbers")


class Energy:
    """Energies typed into a case."""

    where = ""

    def __init__(self, folder):
        leaf = st.sampled_from(
            [
                "I1",
                "I2",
                "I4",
                "I5",
                "mu",
                "k",
                "1",
                "2",
                "3",
                "0",
                "0.5",
                "1e15",
                "1e-300",
                "I3",
                "e",
                "pi",
                "1e999",
                "0x1f",
                "1_0",
            ]
        )
        call = st.sampled_from([*material.FUNCTIONS, "eval", "__import__", "sin", "max"])

        def grown(inner):
            return st.one_of(
                st.tuples(inner, st.sampled_from(["+", "-", "*", "/", "^", "**", " * ", "//", "%", "@", "<", "."]), inner).map(
                    "".join
                ),
                st.tuples(call, st.just("("), inner, st.just(")")).map("".join),
                inner.map(lambda x: f"({x})"),
                inner.map(lambda x: f"-{x}"),
            )

        formula = st.recursive(leaf, grown, max_leaves=14)
        sound = st.sampled_from(
            [
                "mu/2*(I1-3) + k*(I4-1)^2",
                "mu*(I1-3) + k*(exp(positive(I4-1)^2)-1)",
                "mu*(I1-3) + k*(I2-3) + {}",
                "mu*(I1-3)*({}) + k*(I1-3)",
            ]
        )
        mixed = st.builds(lambda text, x: text.replace("{}", x), sound, formula)
        broken = st.builds(lambda text, bits: bytes_changed(text.encode(), bits).decode("utf-8", "replace"), mixed, BYTES)
        self.inputs = st.tuples(
            st.one_of(formula, mixed, mixed, broken, broken, TEXTS),
            st.sampled_from([("mu", "k"), ("mu", "k"), ("mu",), ("k", "mu", "I1"), ("",)]),
        )

    def read(self, given):
        text, names = given
        kind = material.typed(text, names)
        values = dict.fromkeys(names, 1.0)
        found = kind(**values).gradient(material.REST)
        require(found.shape == (4,), "a gradient of another shape")
        with contextlib.suppress(IndentfitError):
            kind(**values).moduli()


TARGETS = {
    "case": CaseFile, "curve": CurveFile, "record": RecordFile, "workbook": Workbook, "manifest": ManifestFile,
    "replicates": Replicates, "result": ResultFolder, "ledger": LedgerFile, "energy": Energy,
}  # fmt: skip

KEYS = (
    "sample.thickness", "sample.shape", "indenter.friction", "indenter.shape", "mesh.elements", "material", "material.mu",
    "material.mu.start", "material.energy", "material.model", "material.parameters", "test", "test.0", "test.parallel.depth",
    "test.0.angle", "fit.seed", "fit.uncertain.friction", "record.rate", "solver", "solver.linear", "", "x", "a.b.c.d",
    "test.parallel", "title", "record.strains", "record.displacement.gain",
)  # fmt: skip
BLOCK = """title = "block"
sample = { shape = "block", length = 10, width = "12 mm", thickness = 3.3, base = "sliding" }
indenter = { shape = "strip", width = 2, length = 20, friction = 0.5, edge_radius = 0.1 }
mesh = { elements = 40 }
material.model = "transversely_isotropic"
material.bulk_ratio = 100
material.parameters = { mu = { start = 1, min = 0.1, max = 10 }, zeta = 1.0, phi = 0.5 }
test = [
    { name = "parallel", angle = 0, depth = 0.33, points = 10 },
    { name = "across", angle = 90, depth = "330 um", weight = 0.7 },
]
fit.method = "ga"
fit.time_limit = 10
fit.published.mu = 1
fit.uncertain = { friction = 0.1, thickness = { start = 3.3, min = 3, max = 3.6 }, mesh = 1 }
solver = { linear = "auto", penalty = 1.0, max_step = "0.1 mm" }
"""
TYPED = BLOCK.replace('model = "transversely_isotropic"', 'energy = "mu/2*((I1-3) + zeta*(I4-1)^2 + phi*(I5-I4^2))"').replace(
    "friction = 0.5,", 'friction = "stick",'
)
RECORDS = """sample = { shape = "disc", diameter = 14, thickness = 3.3, base = "bonded" }
indenter = { shape = "strip", width = 2, length = 20, friction = 0.3 }
material = { model = "neo_hookean", kappa = "1 MPa", parameters = { mu = "1000 Pa" } }
test = [{ name = "a", angle = 0, record = "records/none.csv" }, { name = "b", angle = 90, curve = "curves/parallel.csv" }]
record.rate = "1 kHz"
record.displacement = { column = 1, gain = 6, sign = -1, unit = "mm" }
record.force = { column = "f", gain = 24, unit = "mN" }
record.strains = [0.1]
"""
STATEMENTS = (
    "UPDATE runs SET force = sensitivities", "UPDATE runs SET force = zeroblob(80)", "UPDATE runs SET hash = 1",
    "UPDATE runs SET checksum = NULL", "DELETE FROM about", "UPDATE about SET value = '{'", "UPDATE about SET value = NULL",
    "PRAGMA user_version = 9", "PRAGMA application_id = 7", "DROP TABLE runs", "UPDATE runs SET facts = '['",
    "CREATE TRIGGER t AFTER INSERT ON runs BEGIN DELETE FROM runs; END", "CREATE VIEW v AS SELECT 1",
    "UPDATE runs SET names = 'null'", "UPDATE runs SET seconds = 'x'", "UPDATE runs SET lost = 5.5, cause = x'ff'",
    "INSERT INTO runs SELECT id + 100, hash, origin, test, inputs, names, x'00', NULL, facts, seconds, cause, lost, checksum "
    "FROM runs",
    "DELETE FROM runs", "INSERT INTO about VALUES ('case', 'x', 'y')", "UPDATE runs SET checksum = 5",
    "UPDATE about SET checksum = 1.5", "UPDATE runs SET id = id - 1000",
)  # fmt: skip


def sound_results(folder):
    """The result file of each kind: made by its command on a tiny case, and those that version 0.1 wrote."""
    program = [sys.executable, "-c", "from indentfit.cli import main; main()"]
    small = ["--set", "mesh.elements=24", "--set", "fit.workers=1", "--set", "fit.profiles=false"]
    case, records = SHIPPED / "quickstart" / "case.toml", SHIPPED / "rig_records"
    processed_records = folder / "sound-process"
    commands = {
        "simulate": [case, "--set", "mesh.elements=24"],
        "fit": [case, *small, "--method", "least_squares", "--no-fields"],
        "sweep": [case, *small, "--vary", "material.mu=+-10%", "--vary", "indenter.friction=0.2,0.4"],
        "mesh-check": [case, *small[2:], "--elements", "24,30,40", "--mesh-only"],
        "design": [case, *small],
        "process": ["--manifest", records / "manifest.csv", "--case", "--base", records / "case.toml", "--no-figures"],
        "fit --per-sample": [processed_records / "case.toml", *small, "--method", "least_squares"],
    }
    for command, options in commands.items():
        place = folder / f"sound-{command.replace(' ', '')}"
        given = [*command.split(), *map(str, options), "-o", str(place)]
        done = subprocess.run([*program, *given], capture_output=True, text=True)
        if not place.exists():
            sys.exit(f"{command} did not write its result: {done.stderr}")
        yield next(place / name for name in RESULT_FILES if (place / name).exists())
    yield from sorted(file for name in RESULT_FILES for file in FIRST_VERSION.rglob(name))


# Running


def judged(target, given):
    """How one input ended: "read" or "refused". Raises what must not be."""
    try:
        with within(SECONDS):
            target.read(given)
        return "read"
    except IndentfitError as error:
        require(2 <= error.exit_code <= 4, f"exit code {error.exit_code}")
        for line in error.faults if isinstance(error, CaseError) else [str(error)]:
            require("\n" not in line and line.strip(), f"not one line: {line[:200]!r}")
            require(len(line) < 1000, f"a line that is too long: {line[:200]!r}")
            require(target.where in line, f"a line that does not name the place: {line[:200]!r}")
        return "refused"


@contextlib.contextmanager
def within(seconds):
    """Context that raises Slow once the time is over."""

    def end(*_):
        raise Slow

    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def campaign(name, number, first_seed, folder):
    """Counter of outcomes, and findings (signature -> smallest input), of a number of inputs for a target."""
    target, counts, findings = TARGETS[name](folder), collections.Counter(), {}
    for batch in itertools.count():
        if counts["inputs"] >= number:
            break
        found = _batch(target, min(BATCH, number - counts["inputs"]), first_seed * 1_000_003 + batch, counts, findings)
        if found:
            signature, text, smallest = found
            findings[signature] = smallest
            print(f"FINDING {name}: {signature}\n{text}\ninput: {repr(smallest)[:800]}\n", flush=True)
        typed_class.cache_clear()
        units.unit_factor.cache_clear()
    return counts, findings


def _batch(target, examples, number, counts, known):
    """Runs that many examples of a target; (signature, traceback, smallest input) of a finding that is not known, or None."""
    last = []

    @seed(number)
    @settings(
        max_examples=examples, deadline=None, database=None, suppress_health_check=list(HealthCheck), report_multiple_bugs=False,
        phases=(Phase.generate, Phase.shrink),
    )  # fmt: skip
    @given(given=target.inputs)
    def one(given):
        counts["inputs"] += 1
        try:
            counts[judged(target, given)] += 1
        except (Exception, SystemExit, Slow) as error:
            signature = _signature(error)
            counts["wrong"] += 1
            if signature not in known:
                last[:] = signature, "".join(traceback.format_exception(error)[-3:]), given
                raise Wrong(signature) from None

    with open(os.devnull, "w") as quiet, contextlib.redirect_stdout(quiet), contextlib.redirect_stderr(quiet):
        try:
            one()
        except BaseException as error:
            if not last or isinstance(error, KeyboardInterrupt):
                raise
    return last


def _signature(error):
    """What tells one finding from another: the error and where in indentfit it was raised."""
    if isinstance(error, Wrong):
        return f"Wrong: {str(error).partition(':')[0]}"
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if "indentfit/" in frame.filename]
    place = f"{Path(frames[-1].filename).name}:{frames[-1].lineno}" if frames else "?"
    return f"{type(error).__name__} at {place}"


def peak():
    """Largest memory held so far, bytes."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def atheris_campaign(name, folder):
    """libFuzzer on a target whose inputs are bytes; its corpus begins with sound ones."""
    import atheris

    target = TARGETS[name](folder)

    def one(raw):
        given = raw if name in ("curve", "manifest", "replicates") else None
        if name == "result":
            given = "result.json", raw
        elif name == "energy":
            given = raw.decode("utf-8", "replace"), ("mu", "k")
        elif name in ("record", "workbook"):
            given = raw, Layout()
        elif name == "case":
            given = raw, []
        judged(target, given)

    atheris.instrument_all()
    atheris.Setup(sys.argv[:1], one)
    atheris.Fuzz()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=200_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="*", choices=list(TARGETS), default=[])
    parser.add_argument("--atheris", choices=list(TARGETS))
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    random.seed(options.seed)
    room = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    with tempfile.TemporaryDirectory(dir=room) as place:
        if options.atheris:
            atheris_campaign(options.atheris, Path(place))
            return
        virtual = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (virtual + MEMORY, resource.RLIM_INFINITY))
        rows, total = [], 0
        for name in options.only or TARGETS:
            folder, started = Path(place) / name, time.process_time()
            folder.mkdir()
            share = SHARES[name] / sum(SHARES[one] for one in options.only or TARGETS)
            counts, findings = campaign(name, math.ceil(share * options.inputs), options.seed, folder)
            seconds = time.process_time() - started
            rows.append(
                f"| {name} | {counts['inputs']:,} | {counts['read']:,} | {counts['refused']:,} | {counts['wrong']} "
                f"({len(findings)} kinds) | {seconds:.0f} s | {peak() / 2**20:.0f} MB |"
            )
            total += counts["wrong"]
            print(rows[-1], flush=True)
    print("\n| target | inputs | read | refused | findings | CPU | peak memory so far |\n|---|---|---|---|---|---|---|")
    print("\n".join(rows))
    sys.exit(total > 0)


if __name__ == "__main__":
    main()
