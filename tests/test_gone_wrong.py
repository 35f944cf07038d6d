"""Mechanics that go wrong: each with a message of its own, that says what and where."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from fixtures.cases import CASES, white_matter

from indentfit.curve import read_curve
from indentfit.errors import CaseError, ConvergenceError, CurveError, RecordError
from indentfit.experiment.measured import read_case
from indentfit.experiment.processed import process_record
from indentfit.experiment.record import RawRecord
from indentfit.fem import simulate
from indentfit.fem.element import Solid
from indentfit.fem.setup import Press
from indentfit.fem.simulate import Model
from indentfit.material import typed
from indentfit.runs.points import setup_of

TINY = ("mesh.elements=24", "solver.element=q1p0")
QUICK = CASES / "quickstart" / "case.toml"
FIBRE = "material.energy=mu/2*(I1-3) + k*(I4-1)^2"


@pytest.fixture(scope="module")
def model():
    return Model(setup_of(white_matter(*TINY, "test=[{name='a',angle=90,depth=0.2,points=2}]")))


def run(model, material, depth=0.2):
    return model.run(Press(material, 100.0, 90, np.array([depth / 2, depth]), "a"))


def test_a_material_without_positive_youngs_modulus_is_warned_of_at_the_start_values():
    """psi = mu/2 (I1 - 3) + k (I4 - 1)^2: E_along = 3 mu + 8 k, which vanishes at k = -3/8 mu."""
    for k, stable in ((-0.37, True), (-0.38, False)):
        case = read_case(QUICK, [FIBRE, f"material.parameters={{mu=1.0,k={k}}}"])
        said = [warning for warning in case.warnings() if "not stable" in warning]
        assert len(said) == (not stable)
        assert all("mu = 1, k = -0.38 (E_along = -0.04 kPa" in line for line in said)


def test_a_material_that_gets_unstable_within_the_bounds_is_warned_of():
    case = read_case(QUICK, [FIBRE, "material.parameters={mu={start=1,min=0.1,max=2},k={start=1,min=-0.5,max=2}}"])
    (warning,) = [one for one in case.warnings() if "not stable" in one]
    assert "k = -0.5" in warning and "E_along" in warning


def test_the_shipped_models_are_stable_within_the_bounds_of_the_shipped_cases():
    assert not [one for one in read_case(QUICK).warnings() if "not stable" in one]


def test_no_equilibrium_of_an_unstable_material_says_that_it_is_unstable(model):
    material = typed("mu/2*(I1-3) + k*(I4-1)^2", ["mu", "k"])(mu=1.0, k=-2.0)
    with pytest.raises(ConvergenceError, match=r"not stable at small strain \(E_along = -13 kPa") as error:
        run(model, material)
    assert 0 < error.value.displacement <= 0.2 and "test 'a'" in str(error.value)


def test_an_element_that_turns_inside_out_is_said_to(model, monkeypatch):
    state = Solid.state

    def inverted(self, u, fibre):
        found = state(self, u, fibre)
        return replace(found, valid=not u.any())

    monkeypatch.setattr(Solid, "state", inverted)
    with pytest.raises(ConvergenceError, match=r"test 'a': an element turned inside out"):
        run(model, typed("mu/2*(I1-3)", ["mu"])(mu=1.0))


@pytest.mark.parametrize("touching", [False, True])
def test_an_indenter_that_never_touches_or_only_just_does_is_said_to(model, monkeypatch, touching):
    """Points that touch without pressure carry no force: a curve that ends so was a ZeroDivisionError."""
    indent = simulate.indent

    def apart(*words):
        path = indent(*words)
        nowhere = replace(path[-1].contact, touching=path[-1].contact.touching & touching)
        return [*path[:-1], replace(path[-1], contact=nowhere, force=0.0)]

    monkeypatch.setattr(simulate, "indent", apart)
    with pytest.raises(ConvergenceError, match=r"no equilibrium at 0.2 mm .*'a': the indenter has lost contact"):
        run(model, typed("mu/2*(I1-3)", ["mu"])(mu=1.0))


@pytest.mark.parametrize(
    ("thickness", "said"),
    [(0.3, r"goes 0.33 mm deep, through the sample"), (0.6, "goes 0.33 mm deep; it must not exceed half of the thickness")],
)
def test_a_curve_deeper_than_the_sample_is_refused(thickness, said):
    with pytest.raises(CaseError, match=said):
        read_case(QUICK, [f"sample.thickness={thickness}"])


@pytest.mark.parametrize(
    ("signs", "said"),
    [((1, -1), "force -7 mN at the deepest point is not positive"), ((-1, 1), "none is positive"), ((-1, -1), "none is positive")],
)
def test_a_curve_of_the_wrong_sign_is_told_to_change_it(tmp_path, signs, said):
    path = tmp_path / "c.csv"
    path.write_text("displacement_mm,force_mN\n" + "".join(f"{0.1 * n * signs[0]},{n * signs[1]}\n" for n in range(8)))
    with pytest.raises(CurveError, match=f"line 9: .*{said}.*change the sign"):
        read_curve(path)


@pytest.mark.parametrize(
    ("signs", "said"),
    [
        ((1, -1), r"force falls to .* under load; compression is positive, change record.force.sign"),
        ((-1, 1), r"displacement goes backwards .*change record.displacement.sign"),
        ((1, 0), r"no contact: the force never rises clearly above its noise"),
        ((0, 1), r"the displacement is 0 throughout"),
    ],
)
def test_a_record_of_the_wrong_sign_or_without_contact_is_told_so(signs, said):
    t = np.arange(400) / 100
    d = 0.4 * np.clip(t - 0.5, 0, 1.5)
    f = 60 * np.clip(d - 0.1, 0, None)
    noise = 0.05 * np.random.default_rng(0).standard_normal(t.size)
    with pytest.raises(RecordError, match=f"rig.csv: .*{said}"):
        process_record(RawRecord(t, signs[0] * d, signs[1] * f + noise, "rig.csv"))


def test_a_working_folder_that_is_gone_is_one_line(tmp_path):
    """MKL would end the process with a word of its own."""
    pytest.importorskip("pypardiso")
    program = f"import os; os.rmdir({str(tmp_path / 'here')!r}); from indentfit.cli import main; main()"
    (tmp_path / "here").mkdir()
    words = [sys.executable, "-P", "-c", program, "simulate", QUICK, "--set", "mesh.elements=30"]
    done = subprocess.run(words, cwd=tmp_path / "here", capture_output=True, text=True)
    assert done.returncode == 2 and not done.stdout
    (line,) = [line for line in done.stderr.splitlines() if not line.startswith(("warning: ", "simulate"))]
    assert line.startswith("error: the working folder: ")
