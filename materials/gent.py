"""Isotropic rubber-like tissue whose chains lock."""

from indentfit.material import Material, Parameter, Term, log


class Gent(Material):
    """psi = -mu Jm/2 log(1 - (I1 - 3)/Jm), isochoric; shear modulus mu.

    There is no energy at I1 >= 3 + Jm, where the chains are fully stretched; Jm -> infinity is neo-Hookean.
    Source: Gent 1996, Rubber Chem Technol 69:59.
    """

    mu = Parameter("kPa", "shear modulus", min=0, scale=True)
    Jm = Parameter("1", "I1 - 3 at which the chains lock", min=0.01)

    def energy(self, I1: Term) -> Term:
        return -self.mu * self.Jm / 2 * log(1 - (I1 - 3) / self.Jm)
