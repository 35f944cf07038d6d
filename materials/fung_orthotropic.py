"""Soft tissue with three planes of symmetry and a stiffness that grows exponentially, such as pericardium or valve leaflets."""

from indentfit.material import Material, Parameter, Term, exp, sqrt


class FungOrthotropic(Material):
    """psi = c/2 (exp(Q) - 1), Q = 2 sum(m_i n_i.E^2 n_i, i = 1 to 3) + s1 E11^2 + s2 E22^2 + 2 r sqrt(s1 s2) E11 E22, r = coupling.

    E is the isochoric Green strain, in the axes n1 = a0, n2 = b0 and n3 normal to both; the families a0 and b0, the axes of the
    tissue in its plane, are at right angles. Small strain: the shear modulus in the plane of n_i and n_k is c (m_i + m_k)/2.
    Source: Fung 1993, Biomechanics, 2nd ed., 7.11; without choice of coordinates: Ateshian, Costa 2009, J Biomech 42:781, with
    a_ii = s_i, a_12 = r sqrt(s1 s2) and no further stiffness along n3, which the other two decide in a body of constant volume.
    """

    perpendicular = True

    c = Parameter("kPa", "size of the energy", min=0, scale=True)  # the force is linear in it
    m1 = Parameter("1", "share of axis 1 in shear", min=0)
    m2 = Parameter("1", "share of axis 2 in shear", min=0)
    m3 = Parameter("1", "share of the normal axis in shear", min=0)
    s1 = Parameter("1", "growth of the stiffness along axis 1", min=1e-3)  # their root is not differentiable at 0
    s2 = Parameter("1", "growth of the stiffness along axis 2", min=1e-3)
    coupling = Parameter("1", "coupling of the axes 1 and 2", min=-1, max=1)

    def energy(self, I1: Term, I2: Term, I4: Term, I5: Term, I6: Term, I7: Term) -> Term:
        E1, E2 = (I4 - 1) / 2, (I6 - 1) / 2
        first, second = (I5 - 2 * I4 + 1) / 4, (I7 - 2 * I6 + 1) / 4  # n.E^2 n of the axes 1 and 2
        square = (I1**2 - 2 * I2 - 2 * I1 + 3) / 4  # tr E^2
        shear = self.m1 * first + self.m2 * second + self.m3 * (square - first - second)
        along = self.s1 * E1**2 + self.s2 * E2**2 + 2 * self.coupling * sqrt(self.s1 * self.s2) * E1 * E2
        return self.c / 2 * (exp(2 * shear + along) - 1)
