"""Isotropic rubber-like tissue: a polynomial of second order in both invariants."""

from indentfit.material import Material, Parameter, Term


class Polynomial(Material):
    """psi = sum(c_ij (I1 - 3)^i (I2 - 3)^j, 1 <= i + j <= 2), isochoric; shear modulus 2 (c10 + c01).

    A constant that is not needed is given as 0: c10 alone is neo-Hookean, c10 and c01 are Mooney-Rivlin.
    Source: Rivlin, Saunders 1951, Phil Trans R Soc A 243:251.
    """

    c10 = Parameter("kPa", "half the shear modulus from the first invariant")
    c01 = Parameter("kPa", "half the shear modulus from the second invariant")
    c20 = Parameter("kPa", "coefficient of (I1 - 3)^2")
    c11 = Parameter("kPa", "coefficient of (I1 - 3) (I2 - 3)")
    c02 = Parameter("kPa", "coefficient of (I2 - 3)^2")

    def energy(self, I1: Term, I2: Term) -> Term:
        x, y = I1 - 3, I2 - 3
        return self.c10 * x + self.c01 * y + self.c20 * x**2 + self.c11 * x * y + self.c02 * y**2
