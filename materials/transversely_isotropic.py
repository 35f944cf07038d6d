"""Soft tissue with one family of fibres, such as white matter."""

from indentfit.material import Material, Parameter, Term


class TransverselyIsotropic(Material):
    """psi = mu/2 [(I1 - 3) + zeta (I4 - 1)^2 + phi (I5 - I4^2)], invariants isochoric.

    Fibres resist extension and compression alike. Small strain: mu_along = mu (1 + phi), E_along = (1 + zeta) E_across.
    Source: Feng, Lee, Sun, Ji, Zhao 2017, J Mech Behav Biomed Mater 65:490.
    """

    mu = Parameter("kPa", "shear modulus across the fibres", min=0, scale=True)  # the force is linear in it
    zeta = Parameter("1", "fibre stretch stiffening", min=0)
    phi = Parameter("1", "fibre shear stiffening", min=0)

    def energy(self, I1: Term, I4: Term, I5: Term) -> Term:
        return self.mu / 2 * ((I1 - 3) + self.zeta * (I4 - 1) ** 2 + self.phi * (I5 - I4**2))
