"""Isotropic rubber-like tissue with one constant."""

from indentfit.material import Material, Parameter, Term


class NeoHookean(Material):
    """psi = mu/2 (I1 - 3), isochoric. Source: Treloar 1943, Trans Faraday Soc 39:241."""

    mu = Parameter("kPa", "shear modulus", min=0, scale=True)

    def energy(self, I1: Term) -> Term:
        return self.mu / 2 * (I1 - 3)
