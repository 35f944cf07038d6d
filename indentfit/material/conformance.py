"""The conformance kit: whether a class of material is mechanically what it claims to be."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from indentfit.arrays import Array
from indentfit.errors import MaterialError
from indentfit.material.jets import at_rest
from indentfit.material.kinematics import invariant_gradients, invariants
from indentfit.material.model import Material, law_of, require_derivable
from indentfit.material.trials import trial_fibres, trial_states, trial_value, trial_values
from indentfit.material.words import one_line

SHARES = (1.0, 0.5, 0.25, 0.125)  # of the usual deformations
Measure = Callable[[Material, Array, Array], float]
"""The error of a material at deformation gradients (3, 3, n) and fibre directions (3, n), of two families (2, 3, n)."""


@dataclass(frozen=True)
class Check:
    """One conformance check of a class of material.

    Parameters
    ----------
    name : str
        The statement that is checked, in words.
    ok : bool
    detail : str
        The measured error and its tolerance, or what went wrong.
    """

    name: str
    ok: bool
    detail: str


def check(material_class: type[Material], seed: int = 0) -> list[Check]:
    """Check a class of material at random parameters, fibre directions and deformations (det F != 1).

    The checks are independent of the symbolic derivatives: stress, tangent and parameter derivatives are held against central
    differences of the energy, and the derivatives at rest against Taylor arithmetic.

    Parameters
    ----------
    material_class : class of Material
    seed : int
        Seed of the random numbers.

    A law whose chains lock is checked at smaller deformations, and the first check says so.

    Returns
    -------
    list of Check
        Where the energy has no derivatives, the list holds the first check only, which is not ok. A wrong material raises no
        exception: its checks are not ok.
    """
    rng = np.random.default_rng(seed)
    name = "the energy has derivatives"
    try:
        require_derivable(material_class)
        materials = [material_class(**trial_values(material_class.parameters, rng)) for _ in range(5)]
    except Exception as error:
        return [Check(name, False, _said(error))]
    F, a0 = trial_states(rng, 6)
    if material_class.two_families:
        a0 = trial_fibres(a0, rng, material_class.perpendicular)
    shares = [_share_with_energy(material, F, a0) for material in materials]
    locks = f"; at deformations down to {min(shares):g} of the usual ones, because the energy is not finite at larger ones"
    detail = f"by {', '.join((*material_class.invariants, *material_class.parameters))}{locks if min(shares) < 1 else ''}"
    trials = [
        (material, np.eye(3)[..., None] * (1 - share) + F * share, a0) for material, share in zip(materials, shares, strict=True)
    ]
    return [Check(name, True, detail), *(_checked(*statement, trials) for statement in CHECKS)]


def _share_with_energy(material: Material, F: Array, a0: Array) -> float:
    """The largest share, halved as often as needed, of deformations at which a law has an energy: chains may lock before."""
    for share in SHARES:
        if np.isfinite(material.psi(invariants(np.eye(3)[..., None] * (1 - share) + F * share, a0))).all():
            return share
    return 1.0


def _checked(name: str, measure: Measure, tolerance: float, trials: list[tuple[Material, Array, Array]]) -> Check:
    try:
        error = float(np.max([measure(*trial) for trial in trials]))
    except Exception as failure:
        return Check(name, False, _said(failure))
    return Check(name, bool(error <= tolerance), f"error {error:.1e}, tolerance {tolerance:.0e}")  # nan is not ok


def _said(error: Exception) -> str:
    return str(error) if isinstance(error, MaterialError) else one_line(error)


def isochoric_stress(material: Material, F: Array, a0: Array) -> Array:
    """First Piola stress of the isochoric energy.

    Parameters
    ----------
    material : Material
    F, a0 : arrays (3, 3, ...) and (3, ...) or (2, 3, ...)
        Deformation gradients and unit fibre directions, as `invariants` takes them.

    Returns
    -------
    array (3, 3, ...), kPa
    """
    return np.einsum("i...,ikl...->kl...", material.gradient(invariants(F, a0)), invariant_gradients(F, a0))


def _stress_at_rest(material: Material, F: Array, a0: Array) -> float:
    swollen = np.eye(3)[..., None] * np.linspace(0.8, 1.3, a0.shape[-1])
    return np.max(np.abs(isochoric_stress(material, swollen, a0))) / material.shear_modulus


def _derivatives_at_rest(material: Material, F: Array, a0: Array) -> float:
    """Error of gradient and Hessian at rest against jets, which do not use SymPy; 0 where jets cannot evaluate the energy.

    Of principal stretches jets know what small strains see: psi_1 + psi_2, and the derivatives by the fibres' invariants.
    """
    jet = at_rest(law_of(type(material)).energy, material.values, material.two_families)
    if jet is None:
        return 0.0
    gradient, hessian, exact = material.gradient(material.rest), material.hessian(material.rest), (jet.gradient, jet.hessian)
    if np.isnan(jet.hessian).any():
        gradient, *exact_gradient = (np.append(g[:2].sum(), g[2:]) for g in (gradient, jet.gradient))
        hessian, exact = hessian[2:, 2:], (exact_gradient[0], jet.hessian[2:, 2:])
    size = max(np.max(np.abs(array)) for array in exact)
    return max(_relative(array, other, size) for array, other in zip((gradient, hessian), exact, strict=True))


def _objectivity(material: Material, F: Array, a0: Array) -> float:
    Q = np.linalg.qr(np.random.default_rng(2).standard_normal((3, 3)))[0]
    Q = Q * np.sign(np.linalg.det(Q))
    turned, P = np.einsum("ij,jk...->ik...", Q, F), isochoric_stress(material, F, a0)
    psi = material.psi(invariants(turned, a0)), material.psi(invariants(F, a0))
    stress = isochoric_stress(material, turned, a0), np.einsum("ij,jk...->ik...", Q, P)
    return max(_relative(*psi), _relative(*stress))


def _stress(material: Material, F: Array, a0: Array) -> float:
    numerical = _differences(lambda G: material.psi(invariants(G, a0)), F)
    return _relative(isochoric_stress(material, F, a0), numerical)


def _tangent(material: Material, F: Array, a0: Array) -> float:
    """dP/dF from the Hessian, with the kinematic part by differences of dI/dF, against differences of the stress."""
    I, D = invariants(F, a0), invariant_gradients(F, a0)
    second = _differences(lambda G: invariant_gradients(G, a0), F)
    kinematic = np.einsum("a...,klaij...->klij...", material.gradient(I), second)
    tangent = np.einsum("ab...,aij...,bkl...->klij...", material.hessian(I), D, D) + kinematic
    return _relative(tangent, _differences(lambda G: isochoric_stress(material, G, a0), F))


def _major_symmetry(material: Material, F: Array, a0: Array) -> float:
    H = material.hessian(invariants(F, a0))
    A = _differences(lambda G: isochoric_stress(material, G, a0), F)
    return max(np.max(np.abs(H - np.swapaxes(H, 0, 1))), _relative(np.einsum("klij...->ijkl...", A), A))


def _parameter_derivatives(material: Material, F: Array, a0: Array) -> float:
    I, errors = invariants(F, a0), [0.0]
    for name, exact in zip(material.parameters, material.parameter_gradient(I), strict=True):
        h = 1e-5 * abs(material.values[name])
        gradients = [material.replace(**{name: material.values[name] + d}).gradient(I) for d in (h, -h)]
        # Against the stress too: a parameter may act on nothing at these states (slack fibres).
        size = max(np.max(np.abs(exact)), np.max(np.abs(gradients[0])) / abs(material.values[name]))
        errors.append(_relative((gradients[0] - gradients[1]) / (2 * h), exact, size))
    return max(errors)


def _scale(material: Material, F: Array, a0: Array) -> float:
    if material.scale is None:
        return 0.0
    s = trial_value(material.parameters[material.scale], np.random.default_rng(3))
    I, other, ratio = invariants(F, a0), material.replace(**{material.scale: s}), s / material.values[material.scale]
    psi, gradient = (other.psi(I), ratio * material.psi(I)), (other.gradient(I), ratio * material.gradient(I))
    return max(_relative(*psi), _relative(*gradient))


def _moduli_not_positive(material: Material, F: Array, a0: Array) -> float:
    return max(0.0, -min(material.moduli().values()) / material.shear_modulus)


CHECKS: tuple[tuple[str, Measure, float], ...] = (
    ("zero stress at rest", _stress_at_rest, 1e-12),
    ("derivatives at rest are those of Taylor arithmetic", _derivatives_at_rest, 1e-10),
    ("objectivity", _objectivity, 1e-10),
    ("stress is the derivative of the energy", _stress, 1e-7),
    ("tangent is the derivative of the stress", _tangent, 1e-6),
    ("major symmetry", _major_symmetry, 1e-6),
    ("parameter derivatives", _parameter_derivatives, 1e-7),
    ("the energy is proportional to its scale", _scale, 1e-12),
    ("positive small-strain moduli", _moduli_not_positive, 0.0),
)
"""Statements, what measures the error of each, and its tolerance."""


def _differences(function: Callable[[Array], Array], x: Array, h: float = 1e-5) -> Array:
    """Central differences of function by the first two axes of x, appended in front: shape (3, 3, ...)."""
    steps = [h * np.eye(3)[i][:, None] * np.eye(3)[j] for i in range(3) for j in range(3)]
    widen = (..., *[None] * (x.ndim - 2))
    out = [(function(x + step[widen]) - function(x - step[widen])) / (2 * h) for step in steps]
    return np.reshape(out, (3, 3, *np.shape(out[0])))


def _relative(a: Array, b: Array, size: float | None = None) -> float:
    """The largest difference against the size, by default the largest entry of b."""
    return np.max(np.abs(a - b)) / (np.max(np.abs(b)) if size is None else size)
