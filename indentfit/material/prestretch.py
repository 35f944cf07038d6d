"""A law on a sample that was stretched along x before: what a body made of the stretched sample asks of it.

The stretch F0 = diag(l, 1/sqrt(l), 1/sqrt(l)) keeps the volume, and is the same in every direction across x. So the invariants of
the whole deformation F F0 are functions of those of F with a fibre along x: with q = 1/l and s = l^2 - q,

    I1 = q J1 + s J4,    I2 = q s (J1 J4 - J5) + q^2 J2,    I4 = l^2 J4,    I5 = l^2 (q J5 + s J4^2),

where J are those of F, and fibres of the law, where it has some, lie along x. Free sides carry no traction before the indentation
if the pressure is then that of `rest_pressure`. The bulk modulus counts from the stretched sample on.
"""

from typing import Any

import numpy as np

from indentfit.arrays import Array
from indentfit.errors import MaterialError
from indentfit.material.kinematics import REST
from indentfit.material.model import Material


class Prestretched:
    """A law after a stretch along x. Arrays of invariants are (4, n): those of the deformation since the stretch.

    Parameters
    ----------
    material : Material
        Or that of layers at the points of a body.
    stretch : float
    """

    def __init__(self, material: Any, stretch: float) -> None:
        if material.two_families:
            raise MaterialError(
                "sample.prestretch takes laws with one family of fibres, which lie along x, or without; leave it out"
            )
        self._material, self.shear_modulus = material, material.shear_modulus
        self._q, self._l2 = 1 / stretch, stretch**2
        self._s = self._l2 - self._q

    def gradient(self, I: Array) -> Array:
        return np.einsum("an,abn->bn", self._material.gradient(self._whole(I)), self._slopes(I))

    def hessian(self, I: Array) -> Array:
        whole, slopes = self._whole(I), self._slopes(I)
        first, second = self._material.gradient(whole), self._material.hessian(whole)
        out = np.einsum("abn,axn,byn->xyn", second, slopes, slopes, optimize=True)
        bend = self._q * self._s * first[1]
        out[0, 2] += bend
        out[2, 0] += bend
        out[2, 2] += 2 * self._l2 * self._s * first[3]
        return out

    def parameter_gradient(self, I: Array) -> Array:
        return np.einsum("pan,abn->pbn", self._material.parameter_gradient(self._whole(I)), self._slopes(I))

    def _whole(self, I: Array) -> Array:
        """The invariants of the whole deformation."""
        J1, J2, J4, J5 = I
        q, s, l2 = self._q, self._s, self._l2
        return np.array([q * J1 + s * J4, q * s * (J1 * J4 - J5) + q * q * J2, l2 * J4, l2 * (q * J5 + s * J4**2)])

    def _slopes(self, I: Array) -> Array:
        """Derivatives (4, 4, n) of the invariants of the whole deformation by those since the stretch."""
        q, s, l2 = self._q, self._s, self._l2
        slopes = np.zeros((4, *I.shape))
        slopes[0, 0], slopes[0, 2] = q, s
        slopes[1, 0], slopes[1, 1], slopes[1, 2], slopes[1, 3] = q * s * I[2], q * q, q * s * I[0], -q * s
        slopes[2, 2] = l2
        slopes[3, 2], slopes[3, 3] = 2 * l2 * s * I[2], l2 * q
        return slopes


def rest_pressure(material: Material, stretch: float) -> float:
    """Pressure, kPa, tension positive, of a stretched sample whose sides are free: a third of the stress along x, which is twice
    psi_4 + 2 psi_5 of the stretched law."""
    return _pressure(Prestretched(material, stretch).gradient(REST[:, None])[:, 0])


def rest_pressure_changes(material: Material, stretch: float) -> Array:
    """Derivatives (n_parameters,) of `rest_pressure` by the parameters."""
    changes = Prestretched(material, stretch).parameter_gradient(REST[:, None])[:, :, 0]
    return np.array([_pressure(change) for change in changes])


def _pressure(gradient: Array) -> float:
    return float(2 * gradient[2] + 4 * gradient[3]) / 3
