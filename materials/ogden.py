"""Isotropic rubber-like tissue by principal stretches, with one, two or three terms."""

from indentfit.material import Material, Parameter, Term


class Ogden(Material):
    """psi = 2 mu/alpha^2 (l1^alpha + l2^alpha + l3^alpha - 3), principal stretches isochoric; shear modulus mu.

    Any exponent but 0, where the formula is 0/0; its limit is Hencky's energy, mu (log(l1)^2 + log(l2)^2 + log(l3)^2).
    alpha 2 is neo-Hookean. Source: Ogden 1972, Proc R Soc Lond A 326:565, with 2 mu/alpha in place of its mu.
    """

    mu = Parameter("kPa", "shear modulus", min=0, scale=True)
    alpha = Parameter("1", "exponent of the stretches, not 0: stiffening in stretch, if negative in compression")

    def energy(self, l1: Term, l2: Term, l3: Term) -> Term:
        return _term(self.mu, self.alpha, (l1, l2, l3))


class Ogden2(Material):
    """psi = sum(2 mu_i/alpha_i^2 (l1^alpha_i + l2^alpha_i + l3^alpha_i - 3), i = 1 to 2); shear modulus mu1 + mu2.

    Principal stretches isochoric; any exponents but 0. A term may soften (mu_i < 0) while the sum does not.
    Source: Ogden 1972, Proc R Soc Lond A 326:565, with 2 mu_i/alpha_i in place of its mu_i.
    """

    mu1 = Parameter("kPa", "shear modulus of the first term")
    alpha1 = Parameter("1", "exponent of the first term, not 0")
    mu2 = Parameter("kPa", "shear modulus of the second term")
    alpha2 = Parameter("1", "exponent of the second term, not 0")

    def energy(self, l1: Term, l2: Term, l3: Term) -> Term:
        l = (l1, l2, l3)
        return _term(self.mu1, self.alpha1, l) + _term(self.mu2, self.alpha2, l)


class Ogden3(Material):
    """psi = sum(2 mu_i/alpha_i^2 (l1^alpha_i + l2^alpha_i + l3^alpha_i - 3), i = 1 to 3); shear modulus mu1 + mu2 + mu3.

    Principal stretches isochoric; any exponents but 0. A term may soften (mu_i < 0) while the sum does not.
    Source: Ogden 1972, Proc R Soc Lond A 326:565, with 2 mu_i/alpha_i in place of its mu_i.
    """

    mu1 = Parameter("kPa", "shear modulus of the first term")
    alpha1 = Parameter("1", "exponent of the first term, not 0")
    mu2 = Parameter("kPa", "shear modulus of the second term")
    alpha2 = Parameter("1", "exponent of the second term, not 0")
    mu3 = Parameter("kPa", "shear modulus of the third term")
    alpha3 = Parameter("1", "exponent of the third term, not 0")

    def energy(self, l1: Term, l2: Term, l3: Term) -> Term:
        l = (l1, l2, l3)
        return _term(self.mu1, self.alpha1, l) + _term(self.mu2, self.alpha2, l) + _term(self.mu3, self.alpha3, l)


def _term(mu: Term, alpha: Term, stretches: tuple[Term, Term, Term]) -> Term:
    l1, l2, l3 = stretches
    return 2 * mu / alpha**2 * (l1**alpha + l2**alpha + l3**alpha - 3)
