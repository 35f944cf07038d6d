"""The names of the search methods, in a module without imports of others: the help of a command needs nothing else of the case."""

from typing import Literal

SearchMethod = Literal["ga", "least_squares", "differential_evolution", "cma"]
