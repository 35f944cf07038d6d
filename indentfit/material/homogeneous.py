"""Stresses in homogeneous states of a nearly incompressible law: simple shear, uniaxial and biaxial stretch.

Axis 1 is that of the measured stress. In simple shear F = 1 + g e1 (x) e2; the plane of shear is that of axes 1 and 2. In the other
states the principal stretches are those along the axes: l1 is given, in a biaxial state l2 too, and the stretches along the free
axes are those at which no stress acts there. These are solved for numerically at the bulk modulus of the material, so the volume
changes as little as it does in the finite elements, whose energy kappa/2 (J - 1)^2 it is.

With logarithms e of the stretches, d = e - mean(e): I1 = sum exp 2d, I2 = sum exp -2d, I4 = exp 2d and I5 = exp 4d at the fibre's
axis. Of two families I4 = sum a^2 exp 2d, I5 = sum a^2 exp 4d, I8 = sum a b exp 2d; in a state of stretch they must keep the axes
principal (`case.specimen`). Kirchhoff stresses are the derivatives of the energy by e.
"""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

import numpy as np

from indentfit.arrays import Array, Bools
from indentfit.errors import InputError, NoStateError
from indentfit.material.kinematics import invariant_gradients, invariants
from indentfit.material.model import Material

Kind = Literal["shear", "uniaxial", "biaxial"]
Fibres = Literal["along", "across", "normal"]
AXES: dict[str, int] = {"along": 0, "across": 1, "normal": 2}  # of the fibres
FREE = {"uniaxial": [1, 2], "biaxial": [2]}  # axes along which no stress acts
NO_EFFECT = ("friction", "offset", "fibre_angle")  # inputs of an indentation, of which these states have none
STEP = 0.05  # largest step of a logarithmic stretch on the way to the wanted one
ITERATIONS, TOLERANCE = 30, 1e-13  # of Newton's method; of the shear modulus
DEVIATOR = np.eye(3) - 1 / 3
Weights = tuple[tuple[Array, int], ...]


@dataclass(frozen=True)
class Stresses:
    """Stresses (n,) along axis 1, kPa, and their derivatives (n,) by names, kPa per unit."""

    stress: Array
    sensitivities: dict[str, Array]


@dataclass(frozen=True)
class HomogeneousState:
    """A family of homogeneous states, by the strain along axis 1.

    Parameters
    ----------
    kind : "shear", "uniaxial" or "biaxial"
    fibres : "along", "across" or "normal"
        Axis of the fibres: 1; 2; or 3, normal to the plane of shear or of the two stretches.
    sign : 1 or -1
        The stretch is 1 + sign * strain: 1 in tension, -1 in compression. Strains and stresses count positive in both.
    ratio : float
        Strain along axis 2 over that along axis 1, of a biaxial state.
    cauchy : bool
        Whether the stress is force over the deformed area; otherwise it is force over the undeformed one.
    families : two numbers, degrees, or None
        Angles of two families of fibres from the axis `fibres`, in the plane of axes 1 and 2.
    """

    kind: Kind
    fibres: Fibres = "along"
    sign: int = 1
    ratio: float = 1.0
    cauchy: bool = False
    families: tuple[float, float] | None = None

    @property
    def directions(self) -> Array:
        """Unit directions of the fibres, (3,), or of two families (2, 3)."""
        axis = AXES[self.fibres]
        if self.families is None:
            return np.eye(3)[axis]
        turns = np.radians([90 * axis + angle for angle in self.families])
        return np.stack([np.cos(turns), np.sin(turns), np.zeros(2)], axis=1)

    def solve(self, material: Material, kappa: float, strain: Array, names: Collection[str] = ()) -> Stresses:
        """Stresses at strains.

        Parameters
        ----------
        material : Material
        kappa : float, kPa
            Bulk modulus.
        strain : array (n,)
            Amount of shear, or |stretch - 1|, not negative.
        names : names of sensitivities
            Parameters of the material, which the bulk modulus follows as it follows the shear modulus; "bulk_ratio"; "friction",
            "offset" and "fibre_angle", by which nothing changes.

        Returns
        -------
        Stresses

        Raises
        ------
        NoStateError
            There is no stable state without stress along the free axes.
        InputError
            A name among `names` is unknown.
        """
        for name in names:
            if name not in (*material.parameters, *NO_EFFECT, "bulk_ratio"):
                raise InputError(f"no sensitivity to {name!r} here")
        strain = np.asarray(strain, dtype=float)
        with np.errstate(all="ignore"):
            solved = self._shear(material, strain) if self.kind == "shear" else self._stretch(material, kappa, strain)
        wrong = ~np.isfinite(solved.stress)
        if wrong.any():
            raise NoStateError(f"{self._at(strain, wrong)} the stress is not a finite number; check the law's parameters")
        rows = {name: solved.row(name, material, kappa) for name in names}
        stress = np.where(strain == 0, 0.0, self.sign * solved.stress)
        return Stresses(stress, {name: self.sign * row for name, row in rows.items()})

    def _at(self, strain: Array, wrong: Bools) -> str:
        """Where a state fails, in words."""
        first = float(strain[np.argmax(wrong)])
        return f"at a shear of {first:.4g}" if self.kind == "shear" else f"at a stretch of {1 + self.sign * first:.4g}"

    def _shear(self, material: Material, g: Array) -> "_Solved":
        """F = 1 + g e1 (x) e2 keeps the volume, and P12 is the derivative of the energy by g."""
        if self.families is not None:
            return self._shear_of_two(material, g)
        rest, zero, axis = np.ones_like(g), np.zeros_like(g), AXES[self.fibres]
        I4, I5 = [(rest, 1 + g**2), (1 + g**2, g**2 + (1 + g**2) ** 2), (rest, rest)][axis]
        by_g = [(zero, 2 * g), (2 * g, 2 * g + 4 * g * (1 + g**2)), (zero, zero)][axis]
        I, D = np.stack([3 + g**2, 3 + g**2, I4, I5]), np.stack([2 * g, 2 * g, *by_g])
        gradient = material.parameter_gradient(I)
        return _Solved(np.einsum("an,an->n", material.gradient(I), D), np.einsum("pan,an->pn", gradient, D), zero)

    def _shear_of_two(self, material: Material, g: Array) -> "_Solved":
        """The same with two families of fibres."""
        F, fibres = np.repeat(np.eye(3)[..., None], g.size, axis=2), self.directions[..., None] + np.zeros(g.size)
        F[0, 1] = g
        I, D = invariants(F, fibres), invariant_gradients(F, fibres)[:, 0, 1]
        return _Solved(
            np.einsum("an,an->n", material.gradient(I), D),
            np.einsum("pan,an->pn", material.parameter_gradient(I), D),
            np.zeros_like(g),
        )

    def _stretch(self, material: Material, kappa: float, strain: Array) -> "_Solved":
        """The state with no stress along the free axes, approached in steps of the stretch."""
        free, target = FREE[self.kind], np.zeros((3, strain.size))
        target[0] = np.log1p(self.sign * strain)
        if self.kind == "biaxial":
            target[1] = np.log1p(self.sign * self.ratio * strain)
        steps = max(1, int(np.ceil(np.abs(target).max(initial=0.0) / STEP)))
        weights, e, converged = self._weights(), np.zeros_like(target), np.ones(strain.size, dtype=bool)
        for step in range(1, steps + 1):
            fixed = target * step / steps
            e[free] -= (fixed.sum(axis=0) - np.delete(e, free, axis=0).sum(axis=0)) / len(free)  # keeps the volume
            e = np.where(np.isin(np.arange(3), free)[:, None], e, fixed)
            e, converged = _relaxed(material, kappa, e, free, weights, TOLERANCE if step == steps else 1e-6)
        point = _Point(material, kappa, e, weights)
        inner = np.moveaxis(point.tangent[np.ix_(free, free)], -1, 0)
        smallest = np.linalg.eigvalsh(np.where(np.isfinite(inner), inner, -1.0))[:, 0]
        stable = np.logical_and(converged, smallest > 0)
        if not stable.all():
            raise NoStateError(
                f"{self._at(strain, ~stable)} the law has no stable state without stress on the free sides; check its parameters, "
                "or leave out such large strains"
            )
        return point.solved(free, self.cauchy)

    def _weights(self) -> "Weights":
        """The invariants of the fibres as sums over the axes of weights (3,) times the squared stretches to a power."""
        if self.families is None:
            own = np.eye(3)[AXES[self.fibres]]
            return (own, 1), (own, 2)
        a, b = self.directions
        return (a * a, 1), (a * a, 2), (b * b, 1), (b * b, 2), (a * b, 1)


@dataclass(frozen=True)
class _Solved:
    """Stresses along axis 1, and their derivatives by the parameters of the law at a constant kappa, (p, n), and by kappa."""

    stress: Array
    by_parameters: Array
    by_kappa: Array

    def row(self, name: str, material: Material, kappa: float) -> Array:
        if name in NO_EFFECT:
            return np.zeros_like(self.stress)
        if name == "bulk_ratio":
            return material.shear_modulus * self.by_kappa
        number = list(material.parameters).index(name)
        modulus = float(2 * material.parameter_gradient(material.rest)[number, :2].sum())
        return self.by_parameters[number] + kappa / material.shear_modulus * modulus * self.by_kappa


class _Point:
    """Kirchhoff stresses (3, n) and their derivatives (3, 3, n) by the logarithms e (3, n) of the stretches."""

    def __init__(self, material: Material, kappa: float, e: Array, weights: Weights) -> None:
        d = e - e.mean(axis=0)
        twice, inverse = np.exp(2 * d), np.exp(-2 * d)
        self.material, self.e, self.growth = material, e, np.expm1(e.sum(axis=0))
        shares = [np.where(weight[:, None] != 0, weight[:, None] * twice**power, 0.0) for weight, power in weights]
        self.I = np.stack([twice.sum(axis=0), inverse.sum(axis=0), *(share.sum(axis=0) for share in shares)])
        powers = [power for _, power in weights]
        first = np.stack([2 * twice, -2 * inverse, *(2 * p * share for p, share in zip(powers, shares, strict=True))])
        second = np.stack([4 * twice, 4 * inverse, *(4 * p**2 * share for p, share in zip(powers, shares, strict=True))])
        self.D = np.einsum("ij,ajn->ain", DEVIATOR, first)
        curved = np.einsum("ik,akn,kj->aijn", DEVIATOR, second, DEVIATOR)
        J, gradient = 1 + self.growth, material.gradient(self.I)
        self.pressing = np.broadcast_to(self.growth * J, e.shape)  # derivative of the stresses by kappa
        self.stress = np.einsum("an,ain->in", gradient, self.D) + kappa * self.pressing
        self.tangent = np.einsum("abn,ain,bjn->ijn", material.hessian(self.I), self.D, self.D)
        self.tangent += np.einsum("an,aijn->ijn", gradient, curved) + kappa * (2 * J**2 - J)

    def solved(self, free: list[int], cauchy: bool) -> _Solved:
        """The stress along axis 1 with its derivatives, in which the free stretches follow."""
        by_parameters = np.einsum("pan,ain->pin", self.material.parameter_gradient(self.I), self.D)
        by = np.concatenate([by_parameters, self.pressing[None]])  # (p + 1, 3, n)
        inner = np.moveaxis(self.tangent[np.ix_(free, free)], -1, 0)
        moved = -np.linalg.solve(inner, np.moveaxis(by[:, free], -1, 0).swapaxes(1, 2)).transpose(2, 1, 0)  # (p + 1, free, n)
        rows = by[:, 0] + np.einsum("fn,pfn->pn", self.tangent[0, free], moved)
        area = np.exp(self.e.sum(axis=0)) if cauchy else np.exp(self.e[0])
        stress = self.stress[0] / area
        rows = rows / area - (stress * moved.sum(axis=1) if cauchy else 0.0)
        return _Solved(stress, rows[:-1], rows[-1])


def _relaxed(
    material: Material, kappa: float, e: Array, free: list[int], weights: Weights, tolerance: float
) -> tuple[Array, Bools]:
    """The logarithms of the stretches at which no stress acts along the free axes, by Newton's method; and where it has ended."""
    size, e = material.shear_modulus, e.copy()
    ended = np.zeros(e.shape[1], dtype=bool)
    for _ in range(ITERATIONS):
        point = _Point(material, kappa, e, weights)
        rest = point.stress[free]
        rounding = 1e-15 * (kappa + np.abs(point.stress[0]) + size)  # of the stresses that cancel
        ended = np.abs(rest).max(axis=0) <= np.maximum(tolerance * size, rounding)
        if ended.all():
            break
        inner = np.moveaxis(point.tangent[np.ix_(free, free)], -1, 0)
        going = np.isfinite(rest).all(axis=0) & np.isfinite(inner).all(axis=(1, 2))
        going[going] = np.linalg.det(inner[going]) != 0
        if not going.any():
            break
        step = np.linalg.solve(inner[going], -rest.T[going][..., None])[..., 0].T
        e[np.ix_(free, going)] += np.clip(step, -2 * STEP, 2 * STEP)
    return e, ended
