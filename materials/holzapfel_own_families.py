"""Soft tissue with two families of dispersed collagen fibres that differ, such as artery, tendon sheath or annulus fibrosus."""

from indentfit.material import Material, Parameter, Term, exp, positive


class HolzapfelOwnFamilies(Material):
    """psi = c/2 (I1 - 3) + sum(k_i/(2 q_i) (exp(q_i E_i^2) - 1), i = 4, 6), E_i = max(d_i (I1 - 3) + (1 - 3 d_i) (I_i - 1), 0).

    The first family has k_i = k1, q_i = k2 and d_i = dispersion, the second k1_second, k2_second and dispersion_second; a case says
    which of them the families share (`shared = ["k2_second"]`). Invariants isochoric. Dispersion 0: all fibres along a0 and b0;
    1/3: isotropic. At rest the fibres are slack, so the small-strain moduli are those of the matrix, c.
    Source: Gasser, Ogden, Holzapfel 2006, J R Soc Interface 3:15, with parameters of their own for each family.
    """

    c = Parameter("kPa", "shear modulus of the matrix", min=0)
    k1 = Parameter("kPa", "stiffness of the first family", min=0)
    k2 = Parameter("1", "growth of the first family's stiffness with stretch", min=1e-3)  # the formula is 0/0 at 0
    dispersion = Parameter("1", "spread of the first family's directions", min=0, max=1 / 3)
    k1_second = Parameter("kPa", "stiffness of the second family", min=0)
    k2_second = Parameter("1", "growth of the second family's stiffness with stretch", min=1e-3)
    dispersion_second = Parameter("1", "spread of the second family's directions", min=0, max=1 / 3)

    def energy(self, I1: Term, I4: Term, I6: Term) -> Term:
        first = positive(self.dispersion * (I1 - 3) + (1 - 3 * self.dispersion) * (I4 - 1))
        second = positive(self.dispersion_second * (I1 - 3) + (1 - 3 * self.dispersion_second) * (I6 - 1))
        fibres = self.k1 / (2 * self.k2) * (exp(self.k2 * first**2) - 1)
        fibres += self.k1_second / (2 * self.k2_second) * (exp(self.k2_second * second**2) - 1)
        return self.c / 2 * (I1 - 3) + fibres
