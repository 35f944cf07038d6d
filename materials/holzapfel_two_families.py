"""Soft tissue with two families of dispersed collagen fibres that resist extension only, such as cornea or artery."""

from indentfit.material import Material, Parameter, Term, exp, positive


class HolzapfelTwoFamilies(Material):
    """psi = c/2 (I1 - 3) + k1/(2 k2) sum(exp(k2 E_i^2) - 1, i = 4, 6), E_i = max(d (I1 - 3) + (1 - 3 d) (I_i - 1), 0).

    Invariants isochoric. The families have the same stiffness. The dispersion d is 0 where all fibres run along a0 and b0,
    1/3 where the directions are even. At rest they are slack, so the small-strain moduli are those of the matrix, c. As k2 falls,
    a fibre term tends to k1/2 E_i^2.
    Source: Gasser, Ogden, Holzapfel 2006, J R Soc Interface 3:15.
    """

    c = Parameter("kPa", "shear modulus of the matrix", min=0)
    k1 = Parameter("kPa", "fibre stiffness", min=0)
    k2 = Parameter("1", "growth of the fibre stiffness with stretch", min=1e-3)  # the formula is 0/0 at 0
    dispersion = Parameter("1", "spread of the fibre directions", min=0, max=1 / 3)

    def energy(self, I1: Term, I4: Term, I6: Term) -> Term:
        first, second = (positive(self.dispersion * (I1 - 3) + (1 - 3 * self.dispersion) * (I - 1)) for I in (I4, I6))
        fibres = exp(self.k2 * first**2) + exp(self.k2 * second**2) - 2
        return self.c / 2 * (I1 - 3) + self.k1 / (2 * self.k2) * fibres
