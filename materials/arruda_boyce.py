"""Isotropic rubber-like tissue of eight chains in a cube."""

from indentfit.material import Material, Parameter, Term

COEFFICIENTS = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)  # of the inverse Langevin function's series


class ArrudaBoyce(Material):
    """psi = mu sum(C_i/lambda_m^(2i-2) (I1^i - 3^i), i = 1 to 5), isochoric.

    C = 1/2, 1/20, 11/1050, 19/7000, 519/673750: the series of the inverse Langevin function. Shear modulus
    mu (1 + 3/(5 L) + 99/(175 L^2) + 513/(875 L^3) + 42039/(67375 L^4)), L = lambda_m^2.
    Source: Arruda, Boyce 1993, J Mech Phys Solids 41:389.
    """

    mu = Parameter(
        "kPa", "rubber modulus n k T, below the shear modulus by a factor that tends to 1 as lambda_m grows", min=0, scale=True
    )
    lambda_m = Parameter("1", "stretch at which the chains lock", min=1)

    def energy(self, I1: Term) -> Term:
        return self.mu * sum(c / self.lambda_m ** (2 * i) * (I1 ** (i + 1) - 3 ** (i + 1)) for i, c in enumerate(COEFFICIENTS))
