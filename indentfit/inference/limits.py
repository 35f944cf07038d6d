"""What limits each parameter: noise, the law's misfit, the mesh, an uncertain input, or a bound."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from indentfit.inference.result import CurveNoise
from indentfit.inference.shares import DISCREPANCY, UncertainInputs

MAINLY = 0.5  # least share of the variance with which the residuals limit a parameter
WORDS = {
    "noise": "the noise",
    "misfit": "the misfit of the law",
    "mesh": "the error of the mesh",
    "force": "the error of the load cell",
    "bulk_ratio": "the error of the bulk ratio",
    "offset": "the error of the contact point",
    "base": "the doubt about the base",
}


@dataclass(frozen=True)
class MeshSize:
    """The number of elements of a mesh, and the power of this number with which the force's error falls."""

    elements: int
    power: float


@dataclass(frozen=True)
class Limit:
    """What limits one parameter.

    Parameters
    ----------
    cause : str
        "noise", "misfit", "mesh", or the name of an uncertain input.
    share : float
        Share of the cause in the parameter's variance.
    mesh : MeshSize or None
        The mesh, where the mesh is the cause.
    """

    cause: str = "noise"
    share: float = 1.0
    mesh: MeshSize | None = None

    @property
    def words(self) -> str:
        """The cause in words, as in "any value in 0-5 fits within the noise"."""
        return WORDS.get(self.cause, f"the error of the {self.cause}")

    def cure(self, wanted: float) -> str:
        """The number of elements with which the parameter's interval shrinks to the share `wanted` of its width, in words; where no
        mesh can do this, the number with which the mesh's part of the error is halved. Empty where the mesh is not the cause."""
        if self.mesh is None:
            return ""
        left = wanted**2 - (1 - self.share)
        if 0 < left < self.share:
            return f"about {self._elements(float(np.sqrt(left / self.share)))} elements would determine it"
        return f"about {self._elements(0.5)} elements would halve that"

    def _elements(self, part: float) -> str:
        assert self.mesh is not None
        number = self.mesh.elements * part ** (-1 / self.mesh.power)
        return f"{float(f'{number:.2g}'):,.0f}"


def limits(
    uncertain: UncertainInputs, noise: Mapping[str, CurveNoise], free: Mapping[str, object], mesh: MeshSize | None
) -> dict[str, Limit]:
    """What limits each free parameter.

    The residuals are the cause where they make most of the variance, otherwise the largest other source. The residuals are noise
    unless those of a test are systematic; then they are the law's misfit.

    Parameters
    ----------
    uncertain : UncertainInputs
    noise : dict of test -> CurveNoise
    free : the names of the free parameters
    mesh : MeshSize or None
        None where the mesh is not among the uncertain inputs.

    Returns
    -------
    dict of parameter -> Limit
    """
    residuals = "misfit" if any(known.systematic for known in noise.values()) else "noise"
    return {name: _limit(name, uncertain, residuals, mesh) for name in free}


def _limit(name: str, uncertain: UncertainInputs, residuals: str, mesh: MeshSize | None) -> Limit:
    shares = {cause: known.share.get(name) or 0.0 for cause, known in uncertain.inputs.items()}
    largest = max(shares, key=lambda cause: shares[cause], default=None)
    noise = uncertain.noise.share.get(name) if uncertain.noise else None
    own = 1 - sum(shares.values()) if noise is None else noise
    if largest is None or not shares[largest] or (own >= shares[largest] and (own >= MAINLY or residuals == "misfit")):
        return Limit(residuals, own)
    cause = "misfit" if largest == DISCREPANCY else largest
    return Limit(cause, shares[largest], mesh if largest == "mesh" else None)
