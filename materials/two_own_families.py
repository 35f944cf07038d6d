"""Soft tissue with two families of fibres, each as in white matter, that differ in stretch and in shear."""

from indentfit.material import Material, Parameter, Term


class TwoOwnFamilies(Material):
    """psi = mu/2 [(I1 - 3) + zeta (I4 - 1)^2 + phi (I5 - I4^2) + zeta_second (I6 - 1)^2 + phi_second (I7 - I6^2)].

    Invariants isochoric. The energies of the families add up, each that of one family with parameters of its own; a case says
    which of them the families share (`shared = ["phi_second"]`). Fibres resist extension and compression alike.
    Source, of one family: Feng, Lee, Sun, Ji, Zhao 2017, J Mech Behav Biomed Mater 65:490.
    """

    mu = Parameter("kPa", "shear modulus without fibres", min=0, scale=True)  # the force is linear in it
    zeta = Parameter("1", "stretch stiffening of the first family", min=0)
    phi = Parameter("1", "shear stiffening of the first family", min=0)
    zeta_second = Parameter("1", "stretch stiffening of the second family", min=0)
    phi_second = Parameter("1", "shear stiffening of the second family", min=0)

    def energy(self, I1: Term, I4: Term, I5: Term, I6: Term, I7: Term) -> Term:
        first = self.zeta * (I4 - 1) ** 2 + self.phi * (I5 - I4**2)
        second = self.zeta_second * (I6 - 1) ** 2 + self.phi_second * (I7 - I6**2)
        return self.mu / 2 * ((I1 - 3) + first + second)
