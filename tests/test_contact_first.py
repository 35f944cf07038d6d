"""The iteration that solves the contact for itself: its equilibria are Newton's, and the contact obeys its own equations."""

import numpy as np
import pytest
from fixtures.cases import white_matter
from numpy.testing import assert_allclose

from indentfit.errors import ConvergenceError
from indentfit.fem import contact_first, newton
from indentfit.fem.controls import Controls
from indentfit.fem.linear import pardiso
from indentfit.fem.path import LEASH, _increment
from indentfit.fem.setup import Press
from indentfit.fem.simulate import Model
from indentfit.runs.points import setup_of

DEPTHS = np.linspace(0.033, 0.33, 10)


@pytest.fixture(scope="module", autouse=True)
def with_pardiso():
    try:
        pardiso.load()
    except (ImportError, OSError):
        pytest.skip("PARDISO is not installed")


def run(*texts, angle=90, mu=1.49, zeta=4.68, phi=0.68):
    case = white_matter("mesh.elements=60", f"material.parameters={{mu={mu},zeta={zeta},phi={phi}}}", *texts)
    material = case.law(**case.start_values())
    return Model(setup_of(case)).run(Press(material, case.material.bulk_modulus(material.shear_modulus), angle, DEPTHS))


@pytest.mark.parametrize(
    ("texts", "angle", "alike"),
    [
        ((), 0, 1e-6),
        (("indenter.friction=0.0",), 0, 1e-6),
        (("indenter.friction=0.0",), 90, 1e-6),
        (("indenter.friction='stick'",), 90, 1e-6),
        (("indenter.edge_radius=0.2",), 0, 1e-6),
        (("sample.base='bonded'",), 0, 1e-6),
        ((), 90, 1e-3),  # many points slip: Coulomb's law has several equilibria there
    ],
)
def test_its_equilibria_are_newtons(monkeypatch, texts, angle, alike):
    texts = (*texts, "solver.tolerance=1e-8", "solver.max_step=0.0413")
    ours = run(*texts, angle=angle)
    monkeypatch.setattr(newton, "approached", lambda *_: None)
    newtons = run(*texts, angle=angle)
    assert ours.facts.newton_iterations <= newtons.facts.newton_iterations / 3
    assert_allclose(ours.force, newtons.force, rtol=alike)


def test_newtons_iteration_gives_up_where_its_leash_is_too_short_for_the_way(monkeypatch):
    """With a leash of a thousandth of the step, 15 iterations go nowhere near the equilibrium: three say so. Each step itself
    reduces the residual, so that no other rule ends the iteration."""
    found = run(angle=0)
    here, model = found.path[1], found.model
    press = Press(white_matter().law(mu=1.49, zeta=4.68, phi=0.68), 1490.0, 0, DEPTHS)
    increment = _increment(model.equations, model._loading(press, here.springs), here, here.depth + 0.05, 5e-5)
    monkeypatch.setattr(newton, "approached", lambda *_: None)
    with pytest.raises(ConvergenceError, match="after 3 iterations"):
        model._newton(Controls(1e-6)).equilibrium(increment, here.at)


def test_stiff_fibres_take_few_steps():
    """At zeta = 15 Newton's iteration goes to and fro between points that stick and slip: it took 193 iterations in eight steps."""
    found = run("mesh.elements=124", zeta=15.0, mu=1.0, phi=0.0)
    assert found.facts.steps <= 5
    assert found.facts.newton_iterations <= 20


def test_without_a_schur_complement_newtons_iteration_does_it():
    by_superlu, by_pardiso = (run(f"solver.linear='{kind}'", "solver.tolerance=1e-8", angle=0) for kind in ("superlu", "pardiso"))
    assert by_superlu.facts.newton_iterations > 0
    assert_allclose(by_superlu.force, by_pardiso.force, rtol=1e-5)


@pytest.fixture(scope="module")
def half_way():
    """The contact's own equations in the middle of a path with friction, a step further on, and a Schur complement."""
    found = run()
    here, model = found.path[2], found.model
    press = Press(white_matter().law(mu=1.49, zeta=4.68, phi=0.68), 1490.0, 90, DEPTHS)
    increment = _increment(model.equations, model._loading(press, here.springs), here, here.depth + 0.05, LEASH * 0.33)
    balance = increment.balance(here.at, increment.linearised(here.at).tangent.dilatation)
    rng = np.random.default_rng(3)
    n = model.contact.surface.size
    M = rng.standard_normal((n, n)) / np.sqrt(n)
    return contact_first._Contact(increment, balance), 5 * (np.eye(n) + M @ M.T)


def inverse(S):
    return lambda C: lambda r: np.linalg.solve(S + C, r)


@pytest.mark.parametrize("size", [1e-3, 0.1, 3.0])
def test_the_contact_obeys_its_own_equations(half_way, size):
    """S d + t(u + d) - t(u) = b, with t by `ContactFace.touch` at the moved points; large b let points slip and lift off."""
    (contact, S), rng = half_way, np.random.default_rng(int(10 * size))
    b = contact._fixed.freed(np.zeros(contact._face.points.n_dofs))[contact._face.surface] + size * rng.standard_normal(len(S))
    d = contact.solve(S, inverse(S), b)
    moved = contact._here.at.u.copy()
    moved[contact._face.surface] += d
    there = contact._increment.contact(moved)
    change = contact._face.residual(there) - contact._face.residual(contact._here.contact)
    left = S @ d + contact._increment.equations.fixed.freed(change)[contact._face.surface] - b
    assert np.linalg.norm(left) <= 1.01 * contact_first.SOLVED * np.linalg.norm(b)
    if size > 1:
        assert (there.touching != contact._here.contact.touching).any()


def test_a_contact_without_a_solution_is_told(half_way):
    contact, S = half_way
    with pytest.raises(ConvergenceError, match="not solved"):
        contact.solve(S, lambda _: lambda r: np.full_like(r, np.nan), np.ones(len(S)))
