"""Isotropic rubber-like tissue with two constants."""

from indentfit.material import Material, Parameter, Term


class MooneyRivlin(Material):
    """psi = c10 (I1 - 3) + c01 (I2 - 3), isochoric; shear modulus 2 (c10 + c01).

    Source: Mooney 1940, J Appl Phys 11:582; Rivlin 1948, Phil Trans R Soc A 241:379.
    """

    c10 = Parameter("kPa", "half the shear modulus from the first invariant", min=0)
    c01 = Parameter("kPa", "half the shear modulus from the second invariant", min=0)

    def energy(self, I1: Term, I2: Term) -> Term:
        return self.c10 * (I1 - 3) + self.c01 * (I2 - 3)
