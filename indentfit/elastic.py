"""Elastic constants of an isotropic sample at small strain: how the field's words follow from each other. All moduli in kPa."""

import math


def bulk_ratio(poisson_ratio: float) -> float:
    """Bulk modulus over shear modulus: 2 (1 + nu) / (3 (1 - 2 nu)); inf at 0.5, where the sample keeps its volume exactly."""
    if poisson_ratio == 0.5:
        return math.inf
    return 2 * (1 + poisson_ratio) / (3 * (1 - 2 * poisson_ratio))


def poisson_ratio(bulk_ratio: float) -> float:
    """Poisson's ratio of a bulk modulus over shear modulus; 0.5 at inf."""
    if math.isinf(bulk_ratio):
        return 0.5
    return (3 * bulk_ratio - 2) / (2 * (3 * bulk_ratio + 1))


def young(shear_modulus: float, bulk_ratio: float) -> float:
    """Young's modulus: 2 mu (1 + nu)."""
    return 2 * shear_modulus * (1 + poisson_ratio(bulk_ratio))


def shear_modulus(young: float, bulk_ratio: float) -> float:
    """Shear modulus: E / (2 (1 + nu))."""
    return young / (2 * (1 + poisson_ratio(bulk_ratio)))


def shear_modulus_beside(young: float, bulk_modulus: float) -> float:
    """Shear modulus of a sample with a known bulk modulus kappa: 3 kappa E / (9 kappa - E), for E < 9 kappa."""
    return 3 * bulk_modulus * young / (9 * bulk_modulus - young)
