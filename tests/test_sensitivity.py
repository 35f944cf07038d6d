"""Exact sensitivities against central differences of whole runs, which share nothing with them but the forward model."""

import numpy as np
import pytest
from fixtures.cases import white_matter

from indentfit.errors import InputError
from indentfit.fem.setup import Press
from indentfit.fem.simulate import Model
from indentfit.runs.points import setup_of

DEPTHS = np.linspace(0.33 / 10, 0.33, 10)
VALUES = {"mu": 1.49, "zeta": 4.68, "phi": 0.68, "friction": 0.5, "bulk_ratio": 1000.0}
RIGS = {
    "sharp strip": (),
    "rounded strip": ("indenter.edge_radius=0.2",),
    "eight-node bricks": ("solver.element='q1p0'", "mesh.elements=150"),
    "sphere": ("indenter={shape='sphere',diameter=8.0,friction=0.5}", "mesh.elements=60"),
    "plain forms": ("solver.assembly='forms'", "solver.element='q1p0'"),
}


def run(rig, values, sensitivities=(), angle=90, depths=DEPTHS):
    texts = [
        "mesh.elements=60",
        "solver.tolerance=1e-8",  # differences of 1e-4 show what Newton leaves
        "solver.max_step=0.04",  # no step is cut back: the differences would be those of two discrete paths
        f"material.parameters={{mu={values['mu']!r},zeta={values['zeta']!r},phi={values['phi']!r}}}",
        f"material.bulk_ratio={values['bulk_ratio']!r}",
        *([] if "sphere" in "".join(rig) else [f"indenter.friction={values['friction']!r}"]),
    ]
    case = white_matter(*texts, *rig)
    material = case.law(**case.start_values())
    kappa = case.material.bulk_modulus(material.shear_modulus)
    return Model(setup_of(case)).run(Press(material, kappa, angle, depths, sensitivities=sensitivities))


@pytest.mark.parametrize(
    ("rig", "angle", "names"),
    [
        ("sharp strip", 90, ("mu", "zeta", "phi", "friction", "bulk_ratio")),
        pytest.param("sharp strip", 0, ("mu", "zeta", "phi"), marks=pytest.mark.campaign),
        pytest.param("rounded strip", 90, ("mu", "zeta", "friction"), marks=pytest.mark.campaign),
        ("eight-node bricks", 90, ("zeta", "friction")),
        pytest.param("sphere", 90, ("zeta",), marks=pytest.mark.campaign),  # spheres of gels are solved in the plane
        ("plain forms", 90, ("zeta",)),
    ],
)
def test_sensitivities_are_those_of_central_differences(rig, angle, names):
    depths = DEPTHS if rig != "plain forms" else DEPTHS[:3]
    exact = run(RIGS[rig], VALUES, names, angle, depths).sensitivities
    for name in names:
        step = 1e-4 * VALUES[name]
        above, below = (run(RIGS[rig], VALUES | {name: VALUES[name] + side * step}, (), angle, depths) for side in (1, -1))
        assert above.facts.steps == below.facts.steps  # the differences are those of one discrete path
        differences = (above.force - below.force) / (2 * step)
        assert np.abs(exact[name] - differences).max() < 1e-4 * np.abs(differences).max(), name


def test_force_is_proportional_to_the_shear_modulus():
    found = run((), VALUES, ("mu",))
    assert found.sensitivities["mu"] == pytest.approx(found.force / VALUES["mu"], rel=1e-6)


def test_offset_of_the_contact_point_shifts_the_curve():
    found = run((), VALUES, ("offset",))
    h = 1e-4
    shifted = [run((), VALUES, depths=np.append(DEPTHS[:-1] + side * h, 0.33)).force[:-1] for side in (-1, 1)]
    assert found.sensitivities["offset"][:-1] == pytest.approx((shifted[0] - shifted[1]) / (2 * h), rel=1e-4)


def test_sensitivities_leave_the_curve_as_it_is():
    """To the tolerance of the equilibria: a factor at each of them makes Newton's path to the next another one."""
    assert run((), VALUES, ("zeta", "friction")).force == pytest.approx(run((), VALUES).force, rel=1e-6)


def test_an_unknown_name_is_refused():
    with pytest.raises(InputError, match="no sensitivity to 'thickness'"):
        run((), VALUES, ("thickness",))


def test_friction_that_sticks_has_no_sensitivity():
    with pytest.raises(InputError, match="friction"):
        run(("indenter.friction='stick'",), VALUES, ("friction",))


# stiff fibres fold the corner: that path is cut back, and relaxed
@pytest.mark.parametrize("zeta", [4.0, pytest.param(18.0, marks=pytest.mark.campaign)])
def test_sensitivities_leave_the_path_as_it_is_bit_by_bit(zeta):
    case = white_matter("mesh.elements=60")
    material, depths = case.law(mu=1.0, zeta=zeta, phi=0.5), np.linspace(0.033, 0.33, 10)
    model = Model(setup_of(case))
    alone, with_slopes, again = (
        model.run(Press(material, 1000.0, 90, depths, sensitivities=names)) for names in ((), ("zeta", "phi", "friction"), ())
    )
    assert (alone.force == with_slopes.force).all() and (alone.force == again.force).all()
    assert alone.facts.newton_iterations == with_slopes.facts.newton_iterations
