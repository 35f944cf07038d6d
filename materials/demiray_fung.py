"""Isotropic soft tissue that stiffens exponentially."""

from indentfit.material import Material, Parameter, Term, exp


class DemirayFung(Material):
    """psi = mu/(2 b) (exp(b (I1 - 3)) - 1), isochoric; shear modulus mu; b -> 0 is neo-Hookean.

    Source: Demiray 1972, J Biomech 5:309, after Fung 1967, Am J Physiol 213:1532.
    """

    mu = Parameter("kPa", "shear modulus", min=0, scale=True)
    b = Parameter("1", "growth of the stiffness with I1 - 3", min=1e-3)  # the formula is 0/0 at 0

    def energy(self, I1: Term) -> Term:
        return self.mu / (2 * self.b) * (exp(self.b * (I1 - 3)) - 1)
