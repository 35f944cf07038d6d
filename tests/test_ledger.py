"""The ledger: what was written comes back bit by bit or not at all, whatever happens to the file."""

import json
import os
import random
import sqlite3
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from indentfit.errors import LedgerError
from indentfit.experiment.measured import read_case
from indentfit.runs import key as key_module
from indentfit.runs import ledger as ledger_module
from indentfit.runs.key import Inputs
from indentfit.runs.ledger import InUse, Ledger, refuse_in_use
from indentfit.runs.run import Run

QUICKSTART = Path(__file__).parent.parent / "cases" / "quickstart"
POINT = {"mu": 1.0, "zeta": 3.0, "phi": 0.1 + 0.2}
ODD = np.array([5e-324, -0.0, 1 / 3, 1.7976931348623157e308, np.pi])  # no decimal text of 15 digits keeps these


def quickstart(*overrides):
    return read_case(QUICKSTART / "case.toml", overrides)


def forces(n):
    return np.random.default_rng(n).standard_normal(25) * 10.0 ** (n % 7)


def fill(path, case, number=8):
    """A ledger with runs at phi = 0, 1, ...; returns path and what was written."""
    written = {}
    with Ledger(path, case) as ledger:
        for n in range(number):
            written[n] = Run(forces(n), None, 0.5 * n, {"steps": n, "penalty_error": 1 / (n + 3)})
            ledger.add({**POINT, "phi": float(n)}, case.tests[n % 2], written[n])
    return written


def stored(ledger, n):
    return ledger.find({**POINT, "phi": float(n)}, ledger.case.tests[n % 2])


def same(a, b):
    """Whether two Runs are the same, bit by bit."""
    equal = a.force is b.force if a.force is None or b.force is None else a.force.tobytes() == b.force.tobytes()
    return equal and (a.cause, a.seconds, a.facts, a.lost) == (b.cause, b.seconds, b.facts, b.lost)


@pytest.fixture(scope="module")
def case():
    return quickstart()


def test_a_run_comes_back_bit_by_bit(tmp_path, case):
    fine = Run(ODD, None, 1.25, {"steps": np.int64(3), "penalty_error": np.float64(0.1)}, {"zeta": -ODD, "mu": ODD[::-1]})
    failed = Run(None, "no equilibrium at 0.1 mm: Größe µ ☂", 0.5, {})
    with Ledger(tmp_path / "l", case) as ledger:
        ledger.add(POINT, case.tests[0], fine)
        ledger.add(POINT, case.tests[1], failed)
    with Ledger(tmp_path / "l", case, resume=True) as ledger:
        back = ledger.find(POINT, case.tests[0], ["zeta"])
        assert back.force.tobytes() == ODD.tobytes()
        assert back.sensitivities["zeta"].tobytes() == (-ODD).tobytes()
        assert back.sensitivities["mu"].tobytes() == fine.sensitivities["mu"].tobytes()
        assert back.facts == {"steps": 3, "penalty_error": 0.1}
        assert same(ledger.find(POINT, case.tests[1]), failed)
        assert ledger.find({**POINT, "phi": 0.3}, case.tests[0]) is None  # 0.3 is not 0.1 + 0.2


@pytest.mark.parametrize(
    "override",
    [
        "sample.thickness=3.4",
        "sample.base=bonded",
        "indenter.friction=0.4",
        "mesh.elements=101",
        "solver.tolerance=1e-7",
        "solver.element=q2p1",
        "material.bulk_ratio=900",
        "material.kappa=900",
        "test.parallel.curve=curves/short.csv",
    ],
)
def test_what_decides_a_curve_is_in_its_hash(override, tmp_path):
    text = (QUICKSTART / "curves" / "parallel.csv").read_text().splitlines()
    rows = [line for line in text if line.strip()]
    short = tmp_path / "short.csv"
    short.write_text("\n".join(rows[:-3]) + "\n")
    override = override.replace("curves/short.csv", str(short))
    one, two = quickstart(), quickstart(override)
    hashes = [Inputs(c).hash(Inputs(c).of(POINT, c.tests[0])) for c in (one, two)]
    assert hashes[0] != hashes[1]


@pytest.mark.parametrize(
    "override",
    [
        "test.parallel.weight=0.9",
        "fit.seed=4",
        "fit.method=ga",
        "material.zeta={start=9,min=1,max=12}",
        "title=other",
        "fit.uncertain={friction=0.1,thickness=0.05,base=0.3,mesh=0}",
        "fit.published={mu=1.49}",
    ],
)
def test_what_does_not_decide_a_curve_is_not(override, case):
    other = quickstart(override)
    assert Inputs(other).hash(Inputs(other).of(POINT, other.tests[1])) == Inputs(case).hash(Inputs(case).of(POINT, case.tests[1]))


def test_the_measured_forces_are_not_in_the_hash_but_angle_and_parameters_are(case, tmp_path):
    lines = (QUICKSTART / "curves" / "parallel.csv").read_text().splitlines()
    other = [line if not line[:1].isdigit() else f"{line.split(',')[0]},{2 * float(line.split(',')[1])}" for line in lines]
    (tmp_path / "twice.csv").write_text("\n".join(other) + "\n")
    twice = quickstart(f"test.parallel.curve={tmp_path / 'twice.csv'}")
    assert not np.array_equal(twice.curves[0].force, case.curves[0].force)
    inputs = Inputs(case)
    one = inputs.hash(inputs.of(POINT, case.tests[0]))
    assert Inputs(twice).hash(Inputs(twice).of(POINT, twice.tests[0])) == one
    assert inputs.hash(inputs.of({**POINT, "phi": 0.3}, case.tests[0])) != one
    assert inputs.hash(inputs.of(POINT, case.tests[1])) != one


def test_a_typed_energy_is_in_the_hash():
    cases = [quickstart("material.parameters={mu=1}", f"material.energy={psi}") for psi in ("mu*(I1-3)", "mu/2*(I1-3)")]
    assert Inputs(cases[0]).origin != Inputs(cases[1]).origin


def test_a_plugin_counts_by_what_it_says_and_not_by_where_it_lies(tmp_path):
    text = "from indentfit.material import Material, Parameter\nclass M(Material):\n    mu = Parameter('kPa', 'x', min=0)\n"
    origins = []
    for name, factor in (("a", "/ 2"), ("b", "/ 2"), ("c", "* 2")):
        (tmp_path / f"{name}.py").write_text(text + f"    def energy(self, I1):\n        return self.mu {factor} * (I1 - 3)\n")
        origins.append(Inputs(quickstart(f"material.model={tmp_path / name}.py:M", "material.parameters={mu=1}")).origin)
    assert origins[0] == origins[1] != origins[2]


def test_another_version_of_a_library_finds_nothing(case, monkeypatch):
    before = Inputs(case).origin
    monkeypatch.setattr(key_module, "versions", lambda law: {"numpy": "0.1"})
    assert Inputs(case).origin != before


def test_the_earliest_run_that_serves_is_taken(tmp_path, case):
    """A resumed fit knows later runs from the start, and must still take those that the first one took."""
    plain, more = Run(forces(1), None, 1.0, {}), Run(forces(2), None, 1.0, {}, {"zeta": forces(3)})
    with Ledger(tmp_path / "l", case) as ledger:
        for run in (plain, more):
            ledger.add(POINT, case.tests[0], run)
    with Ledger(tmp_path / "l", case, resume=True) as ledger:
        assert same(ledger.find(POINT, case.tests[0]), plain)
        assert same(ledger.find(POINT, case.tests[0], ("zeta",)), more)
        assert ledger.find(POINT, case.tests[0], ("phi", "zeta")) is None


def test_a_flipped_bit_is_found_wherever_it_is(tmp_path, case):
    """250 random flips: the file is refused in one line, or its runs are missing, but none is ever another one."""
    path, dice = tmp_path / "l", random.Random(0)
    written = fill(path, case)
    whole, outcomes = path.read_bytes(), {"refused": 0, "missing": 0, "same": 0}
    for _ in range(250):
        spoilt = bytearray(whole)
        spoilt[dice.randrange(len(whole))] ^= 1 << dice.randrange(8)
        path.write_bytes(spoilt)
        try:
            with Ledger(path, case, resume=True) as ledger:
                back = [stored(ledger, n) for n in written]
                assert all(run is None or same(run, written[n]) for n, run in enumerate(back))
                outcomes["missing" if None in back else "same"] += 1
                assert (None not in back) or ledger.remarks
        except LedgerError as error:
            assert len(str(error).splitlines()) == 1
            outcomes["refused"] += 1
    assert outcomes["missing"] > 20  # what the checksums are for
    assert outcomes["refused"] > 5


def test_a_truncated_ledger_is_refused_in_one_line_or_has_only_what_was_written(tmp_path, case):
    path = tmp_path / "l"
    written = fill(path, case)
    whole = path.read_bytes()
    for size in sorted({1, 15, 16, 99, 100, 4096, len(whole) - 4096, len(whole) - 1, *range(0, len(whole), 3001)} - {0}):
        path.write_bytes(whole[:size])
        with pytest.raises(LedgerError) as error, Ledger(path, case, resume=True) as ledger:
            assert all(stored(ledger, n) is None or same(stored(ledger, n), written[n]) for n in written)
            raise LedgerError("the runs that are left are what was written")
        assert len(str(error.value).splitlines()) == 1


def test_an_empty_file_is_a_ledger_that_was_never_begun(tmp_path, case):
    (tmp_path / "l").touch()
    with Ledger(tmp_path / "l", case, resume=True) as ledger:
        assert len(ledger) == 0
        assert "holds no run" in ledger.remarks[0]


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda file: file.execute("PRAGMA user_version = 2"), "format 2"),
        (lambda file: file.execute("PRAGMA application_id = 7"), "not a ledger"),
        (lambda file: file.execute("DROP TABLE runs"), "damaged"),
        (lambda file: file.execute("UPDATE about SET value = 'x' WHERE name = 'case'"), "damaged"),
        (lambda file: file.execute("DELETE FROM about"), "damaged"),
        (lambda file: file.execute("CREATE TRIGGER t AFTER DELETE ON about BEGIN DELETE FROM runs; END"), "damaged"),
    ],
)
def test_a_ledger_of_another_making_is_refused(tmp_path, case, spoil, said):
    path = tmp_path / "l"
    fill(path, case)
    with sqlite3.connect(path) as file:
        spoil(file)
    file.close()
    with pytest.raises(LedgerError, match=said):
        Ledger(path, case, resume=True)
    with Ledger(path, case) as ledger:  # not to be resumed: begun anew, and said so
        ledger.add(POINT, case.tests[0], Run(forces(0), None, 1.0, {}))
    assert ledger.remarks or said == "damaged"


def test_a_ledger_that_cannot_be_written_now_is_not_begun_anew(tmp_path, case, monkeypatch):
    fill(tmp_path / "l", case)
    before = (tmp_path / "l").read_bytes()

    def full(path):
        error = sqlite3.OperationalError("database or disk is full")
        error.sqlite_errorcode = sqlite3.SQLITE_FULL
        raise error

    monkeypatch.setattr(ledger_module, "_locked", full)
    with pytest.raises(LedgerError, match="disk is full"):
        Ledger(tmp_path / "l", case)
    assert (tmp_path / "l").read_bytes() == before


def test_a_file_that_is_no_ledger_is_refused(tmp_path, case):
    (tmp_path / "l").write_text("case = 'a text'\n" * 500)
    with pytest.raises(LedgerError, match="damaged"):
        Ledger(tmp_path / "l", case, resume=True)
    with pytest.raises(LedgerError):
        Ledger(tmp_path, case, resume=True)


def test_a_ledger_of_another_case_or_version_is_not_resumed(tmp_path, case, monkeypatch):
    path = tmp_path / "l"
    fill(path, case)
    with pytest.raises(LedgerError, match="another case"):
        Ledger(path, quickstart("test.parallel.weight=0.9"), resume=True)
    known = key_module.versions(case.law)
    monkeypatch.setattr(key_module, "versions", lambda law: {**known, "numpy": "9.9"})
    with pytest.raises(LedgerError, match=r"numpy \(.*, now 9.9\)"):
        Ledger(path, case, resume=True)
    with Ledger(path, case) as ledger:
        assert len(ledger) == 0  # never a mixture


@pytest.mark.parametrize("override", ["fit.uncertain={friction=0.1,mesh=0}", "fit.published={mu=1.49}", "fit.profiles=false"])
def test_a_fit_is_resumed_also_where_more_is_asked_of_its_end(tmp_path, case, override):
    """What is uncertain, and what was published, decides no run of the search."""
    written = fill(tmp_path / "l", case)
    with Ledger(tmp_path / "l", quickstart(override), resume=True) as ledger:
        assert len(ledger) == len(written)


def test_an_input_that_is_fitted_makes_another_search(tmp_path, case):
    fill(tmp_path / "l", case)
    with pytest.raises(LedgerError, match="another case"):
        Ledger(tmp_path / "l", quickstart("fit.uncertain.friction={start=0.5,min=0.1,max=0.8}"), resume=True)


def test_runs_of_other_settings_at_the_same_parameters_are_other_runs(tmp_path, case):
    """On another mesh or base, and at another thickness, as uncertain inputs ask for."""
    with Ledger(tmp_path / "l", case) as ledger:
        for n, change in enumerate([{}, {"mesh.elements": 50}, {"sample.base": "bonded"}, {"sample.thickness": 3.2}]):
            ledger.add({**POINT, **change}, case.tests[0], Run(forces(n), None, 0.5, {}))
    with Ledger(tmp_path / "l", case, resume=True) as ledger:
        assert ledger.find({**POINT, "sample.base": "bonded"}, case.tests[0]).force.tobytes() == forces(2).tobytes()
        assert ledger.find(POINT, case.tests[0]).force.tobytes() == forces(0).tobytes()
        assert ledger.find({**POINT, "mesh.elements": 51}, case.tests[0]) is None


def test_two_fits_cannot_hold_one_ledger(tmp_path, case):
    path = tmp_path / "l"
    with Ledger(path, case):
        for attempt in (lambda: Ledger(path, case, resume=True), lambda: Ledger(path, case), lambda: refuse_in_use(path)):
            with pytest.raises(InUse, match="another run"):
                attempt()
    refuse_in_use(path)
    Ledger(path, case).close()


WRITER = """
import sys
import numpy as np
from indentfit.experiment.measured import read_case
from indentfit.runs.ledger import Ledger
from indentfit.runs.run import Run
case = read_case(sys.argv[1])
with Ledger(sys.argv[2], case, resume=len(sys.argv) > 3) as ledger:
    for n in range(10**6):
        run = Run(np.full(25, float(n)), None, 1.0, {})
        ledger.add({"mu": 1.0, "zeta": 3.0, "phi": float(n)}, case.tests[0], run)
        print(n, flush=True)
"""


@pytest.mark.campaign
def test_what_was_added_outlives_kill_9(tmp_path, case):
    """Every run that was reported as written before the kill is there, whole, and the lock is gone with the process."""
    for wait in (1, 7, 40):
        path = tmp_path / f"l{wait}"
        command = [sys.executable, "-P", "-c", WRITER, str(QUICKSTART / "case.toml"), str(path)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
            said = [int(writer.stdout.readline()) for _ in range(wait)]
            writer.kill()
            said += [int(line) for line in writer.stdout.read().split("\n")[:-1]]
        with Ledger(path, case, resume=True) as ledger:
            assert len(ledger) >= len(said)
            for n in said:
                assert ledger.find({**POINT, "phi": float(n)}, case.tests[0]).force.tolist() == [n] * 25


def test_a_full_disk_ends_in_one_line_and_loses_nothing(tmp_path, case):
    path, written = tmp_path / "l", 0
    with Ledger(path, case) as ledger:
        ledger._file.execute("PRAGMA max_page_count = 20")  # SQLite then answers as it does where the disk is full
        with pytest.raises(LedgerError, match=r"disk is full; .*--resume"):
            for n in range(1000):
                ledger.add({**POINT, "phi": float(n)}, case.tests[n % 2], Run(forces(n), None, 1.0, {}))
                written = n + 1
    assert written > 3
    with Ledger(path, case, resume=True) as ledger:
        assert len(ledger) == written
        assert all(np.array_equal(stored(ledger, n).force, forces(n)) for n in range(written))


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="needs /proc")
def test_a_ledger_leaves_one_file_and_no_open_ones(tmp_path, case):
    fill(tmp_path / "l", case)
    assert [path.name for path in tmp_path.iterdir()] == ["l"]
    assert not [link for link in Path("/proc/self/fd").iterdir() if os.path.realpath(link).startswith(str(tmp_path))]


def test_runs_that_the_machine_failed_are_kept_for_resuming_and_tried_again_by_another_fit(tmp_path, case):
    with Ledger(tmp_path / "l", case) as ledger:
        ledger.add(POINT, case.tests[0], Run(None, "killed", 1.0, {}, lost=True))
        ledger.add(POINT, case.tests[1], Run(None, "the fibres buckle", 1.0, {}))
    with Ledger(tmp_path / "l", case, resume=True) as ledger:
        assert len(ledger) == 2
    with Ledger(tmp_path / "other", case) as ledger:
        assert ledger.take_over(tmp_path / "l") == 1
    with Ledger(tmp_path / "l", case) as ledger:
        assert ledger.find(POINT, case.tests[0]) is None
        assert ledger.find(POINT, case.tests[1]).cause == "the fibres buckle"


def test_only_runs_of_the_same_mechanics_are_taken_over_and_only_once(tmp_path, case):
    fill(tmp_path / "l", case)
    with Ledger(tmp_path / "same", quickstart("fit.seed=9", "test.parallel.weight=0.9")) as ledger:
        assert ledger.take_over(tmp_path / "l") == 8
        assert ledger.take_over(tmp_path / "l") == 0
        assert not ledger.has_own
    with Ledger(tmp_path / "other", quickstart("mesh.elements=60")) as ledger:
        assert ledger.take_over(tmp_path / "l") == 0
        with pytest.raises(LedgerError, match="no such ledger"):
            ledger.take_over(tmp_path / "nowhere")


def test_a_ledger_of_several_cases_keeps_their_runs_apart(tmp_path, case):
    """One file and one lock; the same parameters and test of another case are another run."""
    other = quickstart("indenter.friction=0.1")
    with Ledger(tmp_path / "l", case, others=[other]) as ledger:
        ledger.add(POINT, case.tests[0], Run(forces(0), None, 1.0, {}))
        ledger.of(other).add(POINT, other.tests[0], Run(forces(1), None, 1.0, {}))
        assert len(ledger) == 2 and ledger.has_own
    with Ledger(tmp_path / "both", case, others=[other]) as both, Ledger(tmp_path / "one", case) as one:
        assert both.take_over(tmp_path / "l") == 2 and one.take_over(tmp_path / "l") == 1
        for n, ledger in enumerate((both, both.of(other))):
            assert np.array_equal(ledger.find(POINT, case.tests[0]).force, forces(n))
        assert one.of(other).find(POINT, case.tests[0]) is None and not both.has_own


def test_nothing_in_a_ledger_is_code(tmp_path, case):
    """Numbers are raw float64, the rest is text or JSON."""
    fill(tmp_path / "l", case, 1)
    with sqlite3.connect(tmp_path / "l") as file:
        (force, inputs, facts) = file.execute("SELECT force, inputs, facts FROM runs").fetchone()
    file.close()
    assert np.array_equal(np.frombuffer(force, "<f8"), forces(0))
    assert json.loads(inputs)["parameters"] == {**POINT, "phi": 0.0}
    assert json.loads(facts)["steps"] == 0
