"""A block that is stretched along x before the indentation, its ends held: against the unstretched body, and closed forms."""

import numpy as np
import pytest

from indentfit import read_case
from indentfit.case.tables import Indenter, Layer, Mesh, Sample, Solver
from indentfit.errors import CaseError
from indentfit.fem.body import Volumetric
from indentfit.fem.element import XX, YY, Solid
from indentfit.fem.mesh import quarter
from indentfit.fem.setup import Press, Setup
from indentfit.fem.simulate import Model
from indentfit.material import Prestretched, layered, load, rest_pressure, typed

STRETCH, RATIO = 1.1, 1000.0
GEL, FIBRES = load("neo_hookean"), load("transversely_isotropic")
BLOCK = Sample(shape="block", length=10.0, width=8.0, thickness=2.0, base="sliding", prestretch=STRETCH)
STRIP = Indenter(shape="strip", width=1.0, length=30.0, friction=0.5)
LAWS = [GEL(mu=1.3), FIBRES(mu=1.3, zeta=3.0, phi=0.7), load("mooney_rivlin")(c10=0.4, c01=0.2), load("ogden")(mu=1.0, alpha=5.0)]


def model(piece=BLOCK, elements=40, **solver):
    return Model(Setup(piece.stretched, STRIP, Mesh(elements=elements), Solver(**solver), 0.2, "quarter"))


def press(material, kappa=None, **keys):
    return Press(material, kappa or RATIO * material.shear_modulus, 0, np.array([0.1, 0.2]), **keys)


@pytest.mark.parametrize("material", LAWS, ids=lambda law: type(law).__name__)
def test_the_law_of_the_stretched_body_is_that_of_the_unstretched_one(material):
    """A law on the unstretched mesh, stretched and deformed, gives the forces of `Prestretched` on the stretched mesh."""
    rng, x = np.random.default_rng(1), np.array([1.0, 0.0, 0.0])
    mesh = quarter(BLOCK.stretched, STRIP, Mesh(elements=30), "q2p1", 0.2)
    F0 = np.array([STRETCH, STRETCH**-0.5, STRETCH**-0.5])
    before = type(mesh)(mesh.p / F0[:, None], mesh.t)
    stretched, unstretched = Solid(mesh, "q2p1"), Solid(before, "q2p1")
    u = 0.01 * rng.standard_normal(stretched.n_dofs)
    whole = u + (stretched.points() - unstretched.points()).T.ravel()
    law, pressure = Prestretched(material, STRETCH), rng.standard_normal(stretched.means.shape)
    here = stretched.tangent(u, stretched.state(u, x), law, pressure, 100.0, x)
    there = unstretched.tangent(whole, unstretched.state(whole, x), material, pressure, 100.0, x)
    for one, other in zip(here, there, strict=True):
        assert one == pytest.approx(other, rel=1e-9, abs=1e-9 * np.abs(other).max())


def test_a_clamped_block_pulls_with_the_stress_of_a_stretched_one():
    """mu (l^2 - 1/l) of a neo-Hookean block, along the fibres mu (l^2 - 1/l) + 2 mu zeta l^2 (l^2 - 1); none across."""
    made, fibre = model(), np.array([1.0, 0.0, 0.0])
    u = np.zeros(made.body.n_dofs)
    for material, more in ((GEL(mu=1.3), 0.0), (FIBRES(mu=1.3, zeta=3.0, phi=0.7), 2 * 1.3 * 3.0 * STRETCH**2 * (STRETCH**2 - 1))):
        state = made.body.state(u, fibre)
        pressure = made.body.pressure(state, Volumetric(1300.0, rest_pressure(material, STRETCH)))
        stress = made.body.stress(u, state, made.placed(material), pressure, fibre)
        assert stress[XX] == pytest.approx(1.3 * (STRETCH**2 - 1 / STRETCH) + more)
        assert np.abs(stress[YY:]).max() < 1e-9
        forces = made.fixed.freed(made.body.residual(u, state, made.placed(material), pressure, fibre))
        assert np.abs(forces).max() < 1e-9


def test_a_strip_along_the_stretch_meets_a_gel_that_is_softer_by_the_stretch():
    """In the plane across x a neo-Hookean block of stretch l is one of mu / l, at any strain; the meshes differ by 0.1 %."""
    there = model().run(press(GEL(mu=1.0))).force
    other = model(BLOCK.stretched.model_copy(update={"prestretch": 1.0})).run(press(GEL(mu=1 / STRETCH))).force
    assert there == pytest.approx(other, rel=2e-3)
    assert abs(there[-1] / model(BLOCK.model_copy(update={"prestretch": 1.0})).run(press(GEL(mu=1.0))).force[-1] - 1) > 0.01


def test_sensitivities_are_those_of_central_differences():
    made, step = model(tolerance=1e-8), 1e-3
    law = layered({"top": FIBRES, "low": GEL})
    layers = [{"name": n, "thickness": 1.0, "model": "neo_hookean", "parameters": {"mu": 1.0}} for n in ("top", "low")]
    made = model(BLOCK.model_copy(update={"layer": tuple(Layer(**keys) for keys in layers)}), tolerance=1e-8)
    values = {"top.mu": 1.3, "top.zeta": 3.0, "top.phi": 0.7, "low.mu": 0.5}

    def run(at, **keys):
        return made.run(press(law(**at), (RATIO * at["top.mu"], RATIO * at["low.mu"]), **keys))

    exact = run(values, sensitivities=tuple(values)).sensitivities
    for name, value in values.items():
        low, high = (run({**values, name: value * (1 + sign * step)}).force for sign in (-1, 1))
        slope = (high - low) / (2 * step * value)
        assert exact[name][-1] == pytest.approx(slope[-1], rel=1e-4, abs=1e-6)


def test_a_stretch_stiffens_a_sample_across_whose_pull_the_indenter_moves():
    """A taut string: under a strip across x, held ends that were pulled resist more."""
    fibres = FIBRES(mu=1.0, zeta=5.0, phi=0.0)
    ball = Indenter(shape="sphere", radius=1.0, friction=0.0)
    forces = []
    for stretch in (1.0, 1.05):
        piece = BLOCK.model_copy(update={"prestretch": stretch}).stretched
        forces.append(Model(Setup(piece, ball, Mesh(elements=60), Solver(), 0.2, "quarter")).run(press(fibres)).force[-1])
    assert forces[1] > 1.02 * forces[0]


CASE = """
[sample]
shape = "block"
length = 10
width = 8
thickness = 2
base = "sliding"
prestretch = 1.05

[indenter]
shape = "strip"
width = 1
length = 30
friction = 0.5

[material]
model = "transversely_isotropic"
parameters = { mu = 1, zeta = 3, phi = 1 }
bulk_ratio = 1000

[[test]]
name = "press"
angle = 0
depth = 0.2
"""


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("test.press.angle=30", "test.press.angle = 30: must be 0 where the sample has a prestretch"),
        ("test.press.dip=10", "test.press.dip = 10.0: must be 0 where the sample has a prestretch"),
        ("sample.fibre_angle=5", "sample.fibre_angle = 5.0: must be 0"),
        ("fit.uncertain.fibre_angle={start=0, min=-9, max=9}", "cannot be fitted where sample.prestretch is given"),
        ("sample.prestretch=0.9", "sample.prestretch = 0.9: must be at least 1"),
        ("sample.shape=disc", "sample.prestretch = 1.05: a disc has no ends that could be held; give a block, or remove it"),
    ],
)
def test_a_stretch_that_has_no_meaning_is_refused_in_a_line(tmp_path, override, words):
    (tmp_path / "case.toml").write_text(CASE)
    more = ["sample.diameter=10"] if override == "sample.shape=disc" else []
    with pytest.raises(CaseError) as refused:
        read_case(tmp_path / "case.toml", [override, *more])
    assert words in str(refused.value)
    assert len(refused.value.faults) == 1


def test_a_stretch_is_part_of_the_case(tmp_path):
    (tmp_path / "case.toml").write_text(CASE)
    case = read_case(tmp_path / "case.toml")
    assert case.sample.stretched.thickness == pytest.approx(2 / np.sqrt(1.05))
    assert case.hash != read_case(tmp_path / "case.toml", ["sample.prestretch=1.06"]).hash
    typed_energy = typed("mu/2*(I1 - 3)", ["mu"])
    assert rest_pressure(typed_energy(mu=3.0), 1.2) == pytest.approx(1.2**2 - 1 / 1.2)
