"""Small-strain moduli that are known from elsewhere, as tests of their own: each is a straight line with its standard deviation.

The weight of such a test is that of its standard deviation beside the noise of the measured curves, so that the sum of squares
weighs all residuals by their variances. Its misfit, and whether it contradicts the other tests, are reported as those of any test.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from indentfit.arrays import Array
from indentfit.axes import Axes
from indentfit.case.curves import file_for
from indentfit.case.doubts import noise_of_points
from indentfit.case.laws import has_fibres
from indentfit.case.messages import Fault, line
from indentfit.case.tables import Test
from indentfit.curve import Curve
from indentfit.errors import CaseError

if TYPE_CHECKING:
    from indentfit.case.whole import Case

STATES = {  # of each modulus: kind of test, direction of the fibres
    "shear": ("shear", "along"),
    "young": ("uniaxial", "along"),
    "shear_along": ("shear", "along"),
    "shear_across": ("shear", "normal"),
    "young_along": ("uniaxial", "along"),
    "young_across": ("uniaxial", "across"),
}
STRAINS = 1e-3 * np.arange(1, 6) / 5  # small: the law is linear there
LEAST_NOISE = 0.01  # of the largest force: what a measured curve errs at least, with the misfit of its law
OF_ISOTROPIC = ("shear", "young")


def with_prior_tests(case: Case) -> Case:
    """The case with a test for each modulus of [fit.prior], which is then empty; the case itself where there is none.

    Raises
    ------
    CaseError
        A modulus does not belong to the law, or the fit does not weigh squares.
    """
    given = case.fit.prior.given
    if not given:
        return case
    if faults := [line(case.path, Fault(("fit", "prior", name), list(pair), text)) for name, pair, text in _faults(case)]:
        raise CaseError(faults)
    made = [_test(case, name, *pair) for name, pair in given.items()]
    tests, curves = (*case.tests, *(test for test, _ in made)), (*case.curves, *(curve for _, curve in made))
    fit = case.fit.model_copy(update={"prior": type(case.fit.prior).untouched()})
    return case.model_copy(update={"tests": tests, "curves": curves, "fit": fit})


def _faults(case: Case) -> list[tuple[str, tuple[float, float], str]]:
    fibres, faults = has_fibres(case.law), []
    for name, pair in case.fit.prior.given.items():
        if fibres == (name in OF_ISOTROPIC):
            text = f"give {name}_along or {name}_across: the material has fibres" if fibres else "the material has no fibres; give "
            faults.append((name, pair, text if fibres else text + name.partition("_")[0]))
        elif case.material.relaxation is not None:
            faults.append(
                (name, pair, "is not taken where the material relaxes: at which rate would it hold? Fix a parameter by it")
            )
        elif case.fit.method != "least_squares":
            text = 'is weighed by its standard deviation in a sum of squares: set fit.method = "least_squares"'
            faults.append((name, pair, text))
    return faults


def _test(case: Case, name: str, value: float, sd: float) -> tuple[Test, Curve]:
    kind, fibres = STATES[name]
    stress, own = value * STRAINS, sd * STRAINS * np.sqrt(STRAINS.size)  # the mean of the points has the modulus' own error
    curve = Curve(STRAINS, stress, sd=own, axes=Axes("strain", "stress"))
    pull = {} if kind == "shear" else {"loading": "tension"}
    label = _label(name)
    keys = {"kind": kind, "fibres": fibres, "weight": weight_of(case, curve, own), **pull}
    return Test(
        label,
        **keys,
        curve=file_for(label, {str(test.curve).removeprefix("curves/").removesuffix(".csv").lower() for test in case.tests}),
    ), curve


def _label(name: str) -> str:
    """The name of the test of a modulus."""
    kind, _, fibres = name.partition("_")
    return f"known {kind} modulus {fibres}".rstrip()


def is_prior_test(test: Test) -> bool:
    """Whether a test stands for a modulus of [fit.prior]: no file holds its curve."""
    return test.kind != "indentation" and test.name in {_label(name) for name in STATES}


def weight_of(case: Case, curve: Curve, own: Array) -> float:
    """The weight of a curve whose points have the standard deviations `own` (n,), with which squared residuals count by their
    variances, as those of the measured curves do on average.

    A residual of test k counts with w_k s_k^2 / n_k, where s_k makes curves of different kinds as large as the first
    (`objective.Target`); times its variance that should be the same for all points.
    """
    pairs = [(test, known) for test, known in zip(case.tests, case.curves, strict=True) if known is not None and test.weight]
    sizes = [_size(known.force) for _, known in pairs]
    first = sizes[0]
    counts = []
    for (test, known), size in zip(pairs, sizes, strict=True):
        noise = _noise(known)
        scale = first / size  # with a test of another kind beside them, all curves are made as large as the first
        counts.append(float(test.weight or 0.0) * scale**2 * noise**2 / known.force.size)
    per_variance = float(np.mean(counts))
    return per_variance * own.size * float(np.mean(own**-2.0)) * (_size(curve.force) / first) ** 2


def _noise(curve: Curve) -> float:
    """Standard deviation of a point of a measured curve: the stated one, or that of its second differences."""
    if curve.sd is not None:
        return float(np.sqrt(1 / np.mean(np.asarray(curve.sd) ** -2.0)))
    return max(noise_of_points(curve.loading.force), LEAST_NOISE * float(np.abs(curve.force).max()))


def _size(force: Array) -> float:
    return float(np.sqrt(np.mean(force**2)))
