"""Demiray's exponential energy."""

from indentfit.material import Material, Parameter, exp


class Demiray(Material):
    """psi = mu / (2 b) [exp(b (I1 - 3)) - 1]; mu is the small-strain shear modulus."""

    mu = Parameter("kPa", "small-strain shear modulus", min=0, scale=True)
    b = Parameter("1", "exponential stiffening", min=1e-3)

    def energy(self, I1):
        return self.mu / (2 * self.b) * (exp(self.b * (I1 - 3)) - 1)
