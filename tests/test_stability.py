"""Laws whose shear stress falls as the shear grows: how stiff they are against one more shear, and what a simulation says of it."""

import numpy as np
import pytest

from indentfit import Case, Indenter, MaterialChoice, Mesh, Sample, Test, simulate
from indentfit.fem.facts import SolveFacts, said_of_paths
from indentfit.fem.stability import remedy
from indentfit.material import least_shear_modulus, load

LAWS = [
    ("yeoh", {"c10": 1.0, "c20": -0.3, "c30": 0.0}),
    ("ogden", {"mu": 1.0, "alpha": 12.0}),
    ("mooney_rivlin", {"c10": 0.3, "c01": 0.2}),
]


def invariants(F):
    C = F.T @ F
    return np.array([[np.trace(C)], [(np.trace(C) ** 2 - np.trace(C @ C)) / 2], [1.0], [1.0]])


@pytest.mark.parametrize(("name", "values"), LAWS)
def test_the_least_shear_modulus_is_that_of_shears_in_all_directions(name, values):
    """Second differences of the energy along random shears are no smaller, and the smallest of them is near."""
    law, rng = load(name)(**values), np.random.default_rng(3)
    F = np.eye(3) + 0.2 * rng.standard_normal((3, 3))
    F /= np.cbrt(np.linalg.det(F))

    def bent(n, m, t=1e-3):
        by = np.outer(m, n)
        energies = [float(law.psi(invariants((np.eye(3) + s * by) @ F))[0]) for s in (-t, 0.0, t)]
        return (energies[0] - 2 * energies[1] + energies[2]) / t**2

    found = []
    for _ in range(1500):
        n, m = rng.standard_normal((2, 3))
        n /= np.linalg.norm(n)
        m -= (m @ n) * n
        found.append(bent(n, m / np.linalg.norm(m)))
    least = float(least_shear_modulus(law, invariants(F))[0])
    assert least <= min(found) + 1e-4 * abs(least)
    assert min(found) - least < 0.05 * (np.median(found) - least)


def test_a_yeoh_law_loses_its_stability_where_its_shear_stress_is_largest():
    """tau = 2 (c10 + 2 c20 gamma^2) gamma is largest at gamma^2 = -c10 / (6 c20)."""
    law = load("yeoh")(c10=1.0, c20=-2.0, c30=0.0)
    peak = np.sqrt(1 / 12)
    below, above = ((3 + (share * peak) ** 2) * np.ones((2, 1)) for share in (0.9, 1.01))
    rest = least_shear_modulus(law, law.rest[:, None])
    assert rest == pytest.approx(law.shear_modulus)
    assert least_shear_modulus(law, np.vstack([above, [[1], [1]]])) < 0 < least_shear_modulus(law, np.vstack([below, [[1], [1]]]))


@pytest.mark.parametrize(("c20", "unstable"), [(-2.0, True), (0.5, False)])
def test_a_simulation_says_where_its_law_loses_its_stability(c20, unstable):
    facts = (
        simulate(
            Case(
                sample=Sample(shape="disc", diameter=12.0, thickness=4.0, base="bonded"),
                indenter=Indenter(shape="sphere", diameter=4.0, friction=0),
                material=MaterialChoice(model="yeoh", parameters={"c10": 1.0, "c20": c20, "c30": 0.0}, poisson_ratio=0.4),
                mesh=Mesh(elements=40),
                tests=[Test("press", depth=0.25)],
            )
        )
        .tests[0]
        .facts
    )
    assert (facts.unstable_from is not None) == (facts.unstable > 0) == unstable
    assert SolveFacts.from_json(facts.as_json()) == facts
    said = list(said_of_paths([("press", facts)]))
    assert len(said) == unstable and all("the law loses its stability in test 'press': from" in sentence for sentence in said)


def test_a_path_that_ends_is_told_what_its_indenter_can_change():
    law = load("neo_hookean")(mu=1.0)
    sphere, punch = (Indenter(diameter=4.0, friction=0, **given).geometry for given in ({"shape": "sphere"}, {"shape": "cylinder"}))
    assert remedy(law, None, sphere) == "try a coarser mesh"
    assert remedy(law, None, punch) == "try a coarser mesh or an edge radius"
    assert remedy(law, 0.0625, sphere).startswith("the law loses its stability at 0.0625 mm")


def test_a_path_that_ends_where_its_law_is_unstable_at_a_point_is_tried_again():
    """A point that does not resist one more shear need not be what stops the contact: the second try solves it."""
    sample = Sample(shape="disc", diameter=12.0, thickness=4.0, base="bonded")
    law = MaterialChoice(model="yeoh", parameters={"c10": 0.5, "c20": -0.05, "c30": 0.0}, poisson_ratio=0.45)
    punch = Indenter(shape="cylinder", diameter=3.0, edge_radius=0.1, friction=0.5)
    case = Case(sample=sample, indenter=punch, mesh=Mesh(elements=40), material=law, test=[Test("press", depth=1.1)])
    (test,) = simulate(case, mesh_error=False).tests
    assert test.facts.tries > 1 and "the law loses its stability" in test.facts.first_failure and test.displacement[-1] == 1.1
