"""Random admissible parameters and deformations, on which a law is tried out.

Annotations of random generators are text, because `numpy.random` takes 20 ms to import and moduli need none of it.
"""

from collections.abc import Mapping

import numpy as np

from indentfit.arrays import Array
from indentfit.material.parameter import Parameter


def trial_values(parameters: Mapping[str, Parameter], rng: "np.random.Generator") -> dict[str, float]:
    """Random admissible values of parameters.

    Parameters
    ----------
    parameters : mapping of names to Parameter
    rng : numpy.random.Generator

    Returns
    -------
    dict of str to float, in the parameters' units
    """
    return {name: trial_value(parameter, rng) for name, parameter in parameters.items()}


def trial_value(parameter: Parameter, rng: "np.random.Generator") -> float:
    """A random admissible value: between the two bounds, or within two decades of the only bound."""
    low, high, decade = parameter.min, parameter.max, 10 ** rng.uniform(-1, 1)
    if low is not None and high is not None:
        if low > 0 and high > 10 * low:
            return float(low * (high / low) ** rng.uniform(0.05, 0.95))
        return float(low + (high - low) * rng.uniform(0.05, 0.95))
    if high is not None:
        return float(high - decade)
    return float(decade + (low or 0.0))


def trial_states(rng: "np.random.Generator", n: int) -> tuple[Array, Array]:
    """Random states of deformation.

    Parameters
    ----------
    rng : numpy.random.Generator
    n : int
        Number of states.

    Returns
    -------
    F : array (3, 3, n)
        Deformation gradients, det F in 0.5 to 2.
    a0 : array (3, n)
        Unit fibre directions.
    """
    F: list[Array] = []
    while len(F) < n:
        trial = np.eye(3) + 0.2 * rng.standard_normal((3, 3))
        F += [trial] if 0.5 < np.linalg.det(trial) < 2 else []
    a0 = rng.standard_normal((3, n))
    return np.moveaxis(np.array(F), 0, -1), a0 / np.linalg.norm(a0, axis=0)


def trial_fibres(a0: Array, rng: "np.random.Generator", perpendicular: bool = False) -> Array:
    """Two families of fibres.

    Parameters
    ----------
    a0 : array (3, n)
        Unit directions of the first.
    rng : numpy.random.Generator
    perpendicular : bool
        Whether the second family is at right angles to the first.

    Returns
    -------
    array (2, 3, n)
    """
    b0 = rng.standard_normal(a0.shape)
    if perpendicular:
        b0 = b0 - (a0 * b0).sum(axis=0) * a0
    return np.stack([a0, b0 / np.linalg.norm(b0, axis=0)])
