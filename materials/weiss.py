"""Ligament and tendon: fibres that are crimped, straighten along an exponential toe, and are linear from then on."""

from indentfit.material import Material, Parameter, Term, exp, expi, log, positive, sqrt


class Weiss(Material):
    """psi = c/2 (I1 - 3) + W(l), l = sqrt(I4): l dW/dl = 0 for l < 1; c3 (exp(c4 (l - 1)) - 1) up to l = straight; then c5 l + c6.

    Invariants isochoric; c6 makes the stress continuous. At rest the fibres are about to be stretched: the small-strain moduli are
    those of the matrix, c.
    Source: Weiss, Maker, Govindjee 1996, Comput Methods Appl Mech Eng 135:107; values of the medial collateral ligament: Gardiner,
    Weiss 2003, J Orthop Res 21:1098.
    """

    c = Parameter("kPa", "shear modulus of the matrix, 2 C1", min=0)
    c3 = Parameter("kPa", "size of the exponential stress of the fibres", min=0)
    c4 = Parameter("1", "growth of this stress with stretch: how fast the fibres straighten", min=0.1, max=100)
    c5 = Parameter("kPa", "modulus of the straight fibres", min=0)
    straight = Parameter("1", "stretch at which the fibres are straight", min=1.001, max=1.5)

    def energy(self, I1: Term, I4: Term) -> Term:
        stretched = 1 + positive(sqrt(I4) - 1)
        beyond = positive(stretched - self.straight)
        toe = stretched - beyond
        c6 = self.c3 * (exp(self.c4 * (self.straight - 1)) - 1) - self.c5 * self.straight
        curled = self.c3 * (exp(-self.c4) * (expi(self.c4 * toe) - expi(self.c4)) - log(toe))
        return self.c / 2 * (I1 - 3) + curled + self.c5 * beyond + c6 * log(1 + beyond / self.straight)
