"""An elastic layer under a round, frictionless indenter, exact at small strain, for a flat punch and for a paraboloid.

The pressure is p(r) = phi(a) / sqrt(a^2 - r^2) - integral of phi'(t) / sqrt(t^2 - r^2) over t from r to a, which is zero beyond the
contact's radius a. With phi as the unknown, the mixed boundary conditions become a Fredholm equation of the second kind (Lebedev
and Ufliand 1958, J Appl Math Mech 22:442; Hayes, Keer, Herrmann and Mockros 1972, J Biomech 5:541):

    phi(t) + integral of K(t, s) phi(s) ds from 0 to a = 2 G / (pi (1 - nu)) g(t),    F = 2 pi integral of phi from 0 to a,

where K(t, s) = 2 / pi integral of (L(x) - 1) cos(x t) cos(x s) dx, lengths in thicknesses, L is the compliance of the layer over
that of the half-space, and g = depth for a flat punch, depth - t^2 / R for a paraboloid. Here the shear modulus G and the thickness
are 1.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from indentfit.arrays import Array

NODES = 64  # of Gauss-Legendre over the contact's radius
WAVES, LONGEST = 400, 25.0  # nodes, and end, of the integral over x; L - 1 falls like exp(-2 x)
WIDEST = 10.0  # contact radius over thickness: the equation is well conditioned up to here
RADII = np.geomspace(1e-3, WIDEST, 60)  # contact radii for which a paraboloid's depth and force are computed


@dataclass(frozen=True)
class Layer:
    """A layer of thickness 1 and shear modulus 1.

    Parameters
    ----------
    bonded : bool
        Whether the base is bonded; else it slides without friction.
    nu : float
        Poisson's ratio, 0 to 0.5.
    """

    bonded: bool
    nu: float

    def punch_stiffness(self, a: float) -> float:
        """Force over depth of a flat punch of radius a. Half-space: 4 a / (1 - nu).

        Raises
        ------
        ValueError
            The punch is wider than `WIDEST`.
        """
        (even,) = self._solutions(a, lambda t: (np.ones_like(t),))
        return self._force(a, even)

    def sphere_force(self, radius: float, depth: Array) -> Array:
        """Forces on a paraboloid r^2 / (2 radius) at depths. Half-space: 8 / (3 (1 - nu)) sqrt(radius) depth^1.5.

        Parameters
        ----------
        radius : float, thicknesses
        depth : array (n,), thicknesses, above zero

        Returns
        -------
        array (n,)

        Raises
        ------
        ValueError
            The contact is wider than `WIDEST`.
        """
        known, forces = _paraboloid(self)  # both for radius 1: F radius depends on depth radius alone
        wanted = np.asarray(depth, dtype=float) * radius
        if wanted.max() > known[-1]:
            raise ValueError(f"the contact is wider than {WIDEST:g} thicknesses")
        below = 8 / (3 * (1 - self.nu)) * wanted**1.5  # where the layer is as good as a half-space
        shares = CubicSpline(np.log(known), np.log(forces / (8 / (3 * (1 - self.nu)) * known**1.5)))
        return below * np.exp(shares(np.log(np.maximum(wanted, known[0])))) / radius

    def _solutions(self, a: float, right: Callable[[Array], tuple[Array, ...]]) -> tuple[Array, ...]:
        """phi (1 - nu) pi / 2 at the Gauss nodes for each right side."""
        if a > WIDEST:
            raise ValueError(f"the contact is wider than {WIDEST:g} thicknesses")
        t, weights = _gauss(NODES, 0.0, a)
        matrix = np.eye(NODES) + self._kernel(t, t) * weights
        return tuple(np.linalg.solve(matrix, np.stack(right(t), axis=1)).T)

    def _force(self, a: float, phi: Array) -> float:
        return float(4 / (1 - self.nu) * _gauss(NODES, 0.0, a)[1] @ phi)

    def _kernel(self, t: Array, s: Array) -> Array:
        x, weights = _gauss(WAVES, 0.0, LONGEST)
        return 2 / np.pi * (np.cos(np.outer(t, x)) * (weights * (self.compliance(x) - 1))) @ np.cos(np.outer(x, s))

    def compliance(self, x: Array) -> Array:
        """Displacement of the layer's top over that of a half-space, under a pressure J0(x r), (n,)."""
        fading = np.exp(-2 * x)  # hyperbolic functions are divided by exp(2 x) / 2
        if not self.bonded:
            return (1 - fading) ** 2 / (1 - fading**2 + 4 * x * fading)
        k = 3 - 4 * self.nu
        return (k * (1 - fading**2) - 4 * x * fading) / (k * (1 + fading**2) + (1 + k**2 + 4 * x**2) * fading)


def _gauss(n: int, low: float, high: float) -> tuple[Array, Array]:
    """Nodes and weights of Gauss and Legendre between two bounds."""
    x, weights = _legendre(n)
    return low + (high - low) * (x + 1) / 2, weights * (high - low) / 2


@functools.cache
def _legendre(n: int) -> tuple[Array, Array]:
    return np.polynomial.legendre.leggauss(n)


@functools.cache
def _paraboloid(layer: Layer) -> tuple[Array, Array]:
    """Depths and forces of a paraboloid of radius 1 at the contact radii `RADII`: the pressure ends at zero, phi(a) = 0."""
    rows = []
    for a in RADII.tolist():
        flat, bowl = layer._solutions(a, lambda t: (np.ones_like(t), t**2))
        t, weights = _gauss(NODES, 0.0, a)
        edge = (layer._kernel(np.array([a]), t) * weights)[0]
        depth = (a**2 - edge @ bowl) / (1 - edge @ flat)
        rows.append((depth, depth * layer._force(a, flat) - layer._force(a, bowl)))
    depths, forces = np.array(rows).T
    return depths, forces
