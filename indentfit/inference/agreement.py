"""How the curves of a fit agree with the law, and with each other: plain values."""

from dataclasses import dataclass


@dataclass(frozen=True)
class CurveMisfit:
    """The misfit of one test: its RMSE over its largest force, and R2, the share of the force's variance that the fit follows."""

    relative: float
    r2: float | None
