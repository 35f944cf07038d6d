"""Size, seed and end of a global search."""

from dataclasses import dataclass

from indentfit.case import Fit


@dataclass(frozen=True)
class SearchSettings:
    """Size, seed and end of a global search.

    Parameters
    ----------
    population, generations : int
    seed : int
    tolerance : float
        Relative change of the objective below which the search ends.
    """

    population: int
    generations: int
    seed: int = 0
    tolerance: float = 1e-6


def sized(options: Fit, population: int, generations: int) -> SearchSettings:
    """The settings of a case's [fit]; `population` and `generations` are the defaults."""
    return SearchSettings(options.population or population, options.generations or generations, options.seed, options.tolerance)
