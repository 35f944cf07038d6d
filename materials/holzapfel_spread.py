"""Soft tissue whose collagen fibres spread differently within a plane and out of it, such as artery, skin or cornea."""

from indentfit.material import Material, Parameter, Term, exp, positive


class HolzapfelSpread(Material):
    """psi = c/2 (I1 - 3) + k1/(2 k2) (exp(k2 E^2) - 1), E = max(A (I1 - 3) + B (I4 - 1) + (1 - 3 A - B) (I_n - 1), 0).

    E = H:Cb - 1 with the structure tensor H of fibres about a0 in the plane of a0 and b0: A = 2 s p, B = 2 s (1 - 2 p), where
    p (in_plane, 0 to 1) is the spread within the plane and s (out_of_plane, 0 to 1/2) that across it; I_n = I1 - I4 - I6 is the
    squared stretch along the plane's normal. All fibres along a0: p = 0, s = 1/2; planar: s = 1/2 (p = 1/2: even in the plane);
    isotropic: p = 1/2, s = 1/3; round about a0, as `holzapfel` with a dispersion d: 2 s = 1 - d, 2 s p = d.
    b0 only names the plane, at a right angle to a0 (`families = [0, 90]`). Invariants isochoric. At rest the fibres are slack, so
    the small-strain moduli are those of the matrix, c.
    Source: Holzapfel, Niestrawska, Ogden, Reinisch, Schriefl 2015, J R Soc Interface 12:20150188, one family; there fibres are
    left out where I4 < 1, here where E < 0, as in Gasser, Ogden, Holzapfel 2006, J R Soc Interface 3:15.
    """

    perpendicular = True

    c = Parameter("kPa", "shear modulus of the matrix", min=0)
    k1 = Parameter("kPa", "fibre stiffness", min=0)
    k2 = Parameter("1", "growth of the fibre stiffness with stretch", min=1e-3)  # the formula is 0/0 at 0
    in_plane = Parameter("1", "spread of the directions within the plane; 0: none, 1/2: even", min=0, max=1)
    out_of_plane = Parameter("1", "spread across the plane, falling: 1/2: none, all fibres in the plane", min=0, max=1 / 2)

    def energy(self, I1: Term, I4: Term, I6: Term) -> Term:
        A, B = 2 * self.out_of_plane * self.in_plane, 2 * self.out_of_plane * (1 - 2 * self.in_plane)
        E = positive(A * (I1 - 3) + B * (I4 - 1) + (1 - 3 * A - B) * (I1 - I4 - I6 - 1))
        return self.c / 2 * (I1 - 3) + self.k1 / (2 * self.k2) * (exp(self.k2 * E**2) - 1)
