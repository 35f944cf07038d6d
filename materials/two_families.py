"""Soft tissue with two families of fibres, each as in white matter."""

from indentfit.material import Material, Parameter, Term


class TwoFamilies(Material):
    """psi = mu/2 [(I1 - 3) + zeta ((I4 - 1)^2 + second (I6 - 1)^2) + phi ((I5 - I4^2) + second (I7 - I6^2))], invariants isochoric.

    The energies of the families add up, each that of one family. Fibres resist extension and compression alike.
    Source, of one family: Feng, Lee, Sun, Ji, Zhao 2017, J Mech Behav Biomed Mater 65:490.
    """

    mu = Parameter("kPa", "shear modulus without fibres", min=0, scale=True)  # the force is linear in it
    zeta = Parameter("1", "fibre stretch stiffening", min=0)
    phi = Parameter("1", "fibre shear stiffening", min=0)
    second = Parameter("1", "stiffness of the second family over that of the first; 1 where they are alike", min=0)

    def energy(self, I1: Term, I4: Term, I5: Term, I6: Term, I7: Term) -> Term:
        stretch = (I4 - 1) ** 2 + self.second * (I6 - 1) ** 2
        shear = (I5 - I4**2) + self.second * (I7 - I6**2)
        return self.mu / 2 * ((I1 - 3) + self.zeta * stretch + self.phi * shear)
