"""Isotropic rubber-like tissue: a cubic polynomial in the first invariant."""

from indentfit.material import Material, Parameter, Term


class Yeoh(Material):
    """psi = c10 (I1 - 3) + c20 (I1 - 3)^2 + c30 (I1 - 3)^3, isochoric; shear modulus 2 c10.

    Source: Yeoh 1993, Rubber Chem Technol 66:754.
    """

    c10 = Parameter("kPa", "half the shear modulus", min=0)
    c20 = Parameter("kPa", "coefficient of (I1 - 3)^2; often negative in rubber")
    c30 = Parameter("kPa", "coefficient of (I1 - 3)^3")

    def energy(self, I1: Term) -> Term:
        return self.c10 * (I1 - 3) + self.c20 * (I1 - 3) ** 2 + self.c30 * (I1 - 3) ** 3
