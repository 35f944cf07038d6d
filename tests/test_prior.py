"""Small-strain moduli known from elsewhere: their weight beside measured curves, by closed forms, and what is refused."""

import numpy as np
import pytest
from click.testing import CliRunner

from indentfit.case import Case, MaterialChoice, Range, Test
from indentfit.case.prior_tests import with_prior_tests
from indentfit.cli import main
from indentfit.curve import Curve
from indentfit.errors import CaseError
from indentfit.inference.fit import fit

MU, PHI, SIGMA = 1.5, 0.7, 0.004  # kPa, 1, kPa
STRAIN = np.arange(1, 25) / 120
SQUARES = {"method": "least_squares"}


def case_of(prior, options=SQUARES, seed=3, parameters=None):
    """Simple shear across the fibres, with noise: it gives mu alone."""
    stress = MU * STRAIN + SIGMA * np.random.default_rng(seed).standard_normal(STRAIN.size)
    free = {"mu": Range(start=1.0, min=0.1, max=5.0), "zeta": 3.0, "phi": Range(start=1.0, min=0.0, max=5.0)}
    return Case(
        material=MaterialChoice(model="transversely_isotropic", parameters=parameters or free, bulk_ratio=1000.0),
        tests=[Test("across", kind="shear", fibres="normal", curve=Curve(STRAIN, stress))],
        fit={**options, "prior": prior, "workers": 1},
    )


def test_a_modulus_known_from_elsewhere_counts_by_its_standard_deviation():
    """The curve alone gives mu with SIGMA / |strain|; a modulus across combines with it by inverse variances, and one along the
    fibres, mu (1 + phi), gives phi."""
    known = {"shear_across": [1.513, 0.005], "shear_along": [MU * (1 + PHI), 0.05]}
    case = case_of(known)
    result = fit(case)
    curve = case.curves[0]
    alone, se = float(curve.force @ STRAIN / (STRAIN @ STRAIN)), SIGMA / float(np.linalg.norm(STRAIN))
    shares = np.array([se**-2, 0.005**-2])
    together = float(shares @ [alone, 1.513] / shares.sum())
    error = float(shares.sum() ** -0.5)
    mu, phi = result.parameters["mu"], result.parameters["phi"]
    assert abs(alone - 1.513) > 2 * error  # otherwise the weight would not show
    assert mu.value == pytest.approx(together, abs=0.35 * error)  # the curve's noise is estimated
    assert mu.stderr == pytest.approx(error, rel=0.35)
    assert phi.value == pytest.approx(MU * (1 + PHI) / mu.value - 1, abs=1e-3)
    assert phi.stderr == pytest.approx(np.hypot(0.05, (1 + PHI) * error) / MU, rel=0.1)
    assert [test.name for test in result.case.tests] == ["across", "known shear modulus along", "known shear modulus across"]


def test_a_vague_modulus_changes_nothing():
    parameters = {"mu": Range(start=1.0, min=0.1, max=5.0), "zeta": 3.0, "phi": 0.7}
    plain, vague = (fit(case_of(prior, parameters=parameters)) for prior in ({}, {"shear_across": [3.0, 3.0]}))
    assert vague.parameters["mu"].value == pytest.approx(plain.parameters["mu"].value, rel=1e-4)
    assert vague.parameters["mu"].stderr == pytest.approx(plain.parameters["mu"].stderr, rel=0.05)


def test_the_key_of_a_case_without_known_moduli_is_as_it_was():
    assert with_prior_tests(case_of({})).hash == case_of({}).hash != case_of({"shear_across": [1.5, 0.1]}).hash


@pytest.mark.parametrize(
    ("prior", "options", "words"),
    [
        ({"shear": [1.5, 0.1]}, SQUARES, "give shear_along or shear_across: the material has fibres"),
        ({"shear_along": [1.5, 0.1]}, {"method": "ga"}, 'set fit.method = "least_squares"'),
        ({"shear_along": [1.5, 0.0]}, SQUARES, "fit.prior.shear_along"),
    ],
)
def test_what_does_not_agree_is_refused(prior, options, words):
    with pytest.raises(CaseError) as error:
        fit(case_of(prior, options))
    assert words in str(error.value)


def test_laws_are_not_compared_with_it(tmp_path):
    from indentfit.case import write_case

    write_case(case_of({"shear_across": [1.53, 0.005]}), tmp_path)
    place = str(tmp_path / "case.toml")
    done = CliRunner().invoke(main, ["compare", place, "--materials", "neo_hookean,mooney_rivlin"])
    assert done.exit_code == 2 and "fit.prior" in done.stderr
    assert CliRunner().invoke(main, ["validate", place]).exit_code == 0
