"""How the curves of a fit agree with the law, and with each other: plain values."""

from dataclasses import dataclass
from typing import ClassVar

CONTRADICTS = 0.01  # largest probability with which a test counts as contradicting the others


@dataclass(frozen=True)
class CurveMisfit:
    """The misfit of one test: its RMSE over its largest force, and R2, the share of the force's variance that the fit follows."""

    relative: float
    r2: float | None


@dataclass(frozen=True)
class TestPrediction:
    """One test, predicted from the others.

    Parameters
    ----------
    p : float
        Posterior predictive probability that a curve of this test would be as far from what the others predict, or farther.
    off : float
        Measured force at the deepest point, over the force that the others predict there, less 1.
    """

    __test__: ClassVar[bool] = False

    p: float
    off: float

    @property
    def contradicts(self) -> bool:
        """Whether the test contradicts the others."""
        return self.p <= CONTRADICTS
