"""Soft tissue with one family of dispersed collagen fibres that resist extension only."""

from indentfit.material import Material, Parameter, Term, exp, positive


class Holzapfel(Material):
    """psi = c/2 (I1 - 3) + k1/(2 k2) (exp(k2 E^2) - 1), E = max(dispersion (I1 - 3) + (1 - 3 dispersion) (I4 - 1), 0).

    Invariants isochoric. Dispersion 0: all fibres along a0; 1/3: isotropic. At rest the fibres are slack, so the
    small-strain moduli are those of the matrix, c. As k2 falls, the fibre term tends to k1/2 E^2.
    Source: Gasser, Ogden, Holzapfel 2006, J R Soc Interface 3:15, with one family.
    """

    c = Parameter("kPa", "shear modulus of the matrix", min=0)
    k1 = Parameter("kPa", "fibre stiffness", min=0)
    k2 = Parameter("1", "growth of the fibre stiffness with stretch", min=1e-3)  # the formula is 0/0 at 0
    dispersion = Parameter("1", "spread of the fibre directions", min=0, max=1 / 3)

    def energy(self, I1: Term, I4: Term) -> Term:
        E = positive(self.dispersion * (I1 - 3) + (1 - 3 * self.dispersion) * (I4 - 1))
        return self.c / 2 * (I1 - 3) + self.k1 / (2 * self.k2) * (exp(self.k2 * E**2) - 1)
