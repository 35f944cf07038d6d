"""How stiff a law without fibres is against one more shear, at a finite strain.

A law whose shear stress falls as the shear grows has no unique equilibrium: strain concentrates in bands, and forces depend on the
mesh. Along the shears (1 + t m n) F of a state, with m and n unit vectors at right angles, the second derivative of the energy by t
is the acoustic tensor's m.Q(n)m; an incompressible law is strongly elliptic where it is positive for all m and n. With B = Fb Fb^T,

    dI1/dt = 2 m.B n,  d2I1/dt2 = 2 n.B n,  dI2/dt = -2 m.B^-1 n,  d2I2/dt2 = 2 m.B^-1 m.

Vectors in the planes of two principal axes are tried, so that what is found is a bound from above (Zee and Sternberg 1983, Arch
Rational Mech Anal 83:53: in plane strain it is all of the condition).
"""

import numpy as np

from indentfit.arrays import Array
from indentfit.material.model import Material

ANGLES = np.pi / 36 * np.arange(19)  # of n in the plane of two principal axes; those beyond a right angle give the same


def least_shear_modulus(material: Material, I: Array) -> Array:
    """The least second derivative of the energy along a shear in the plane of two principal axes; the shear modulus at rest.

    Parameters
    ----------
    material : Material
        A law without fibres.
    I : array (4, n)
        Isochoric invariants.

    Returns
    -------
    array (n,), kPa
    """
    g, H = material.gradient(I), material.hessian(I)
    squares, least = _squares(I[0], I[1]), np.full(I.shape[1], np.inf)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        for s, c in zip(np.sin(ANGLES), np.cos(ANGLES), strict=True):
            first = 2 * s * c * (squares[j] - squares[i]), -2 * s * c * (1 / squares[j] - 1 / squares[i])
            second = 2 * (c * c * squares[i] + s * s * squares[j]), 2 * (s * s / squares[i] + c * c / squares[j])
            bent = H[0, 0] * first[0] ** 2 + 2 * H[0, 1] * first[0] * first[1] + H[1, 1] * first[1] ** 2
            least = np.minimum(least, g[0] * second[0] + g[1] * second[1] + bent)
    return least


def _squares(I1: Array, I2: Array) -> Array:
    """The squares (3, n) of the principal stretches, roots of z^3 - I1 z^2 + I2 z - 1."""
    spread = np.maximum(I1**2 - 3 * I2, 0.0) / 9
    cosine = (2 * I1**3 - 9 * I1 * I2 + 27) / 54 / np.maximum(spread, 1e-30) ** 1.5
    angle = np.arccos(np.clip(cosine, -1, 1)) / 3
    return np.array([I1 / 3 + 2 * np.sqrt(spread) * np.cos(angle - 2 * np.pi * k / 3) for k in range(3)])
