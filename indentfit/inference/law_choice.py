"""The choice among laws by their evidences, with the right to abstain."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

THRESHOLD = 3.0  # least difference of two log evidences that counts: odds of 20 to 1
CERTAIN = 7.0  # difference of log evidences from which the odds are above 1000
GROSS = 0.2  # RMSE over the largest force above which no law is preferred


@dataclass(frozen=True)
class Weighed:
    """The facts about one law on which the choice rests.

    Parameters
    ----------
    log_evidence : float
        With the error of the mesh.
    without_mesh : float
        The same as if the mesh were exact.
    misfit : float
        Largest RMSE of a test over the test's largest force.
    systematic : bool
        Whether residuals of a test are systematic.
    parameters : int
        Number of free parameters.
    """

    log_evidence: float
    without_mesh: float
    misfit: float = 0.0
    systematic: bool = False
    parameters: int = 0


@dataclass(frozen=True)
class Choice:
    """The choice: the preferred law, or None with the laws among which the curves cannot tell, and a sentence."""

    preferred: str | None
    rivals: tuple[str, ...]
    sentence: str


def choose(laws: Mapping[str, Weighed]) -> Choice:
    """The law that the curves prefer.

    Parameters
    ----------
    laws : mapping of law -> Weighed
        The laws that were fitted, in the order in which they were asked for.

    Returns
    -------
    Choice
        `preferred` is None where the best log evidence is less than THRESHOLD above the next one, or no law follows the curves.
    """
    if not laws:
        return Choice(None, (), "none of the laws could be fitted")
    ranked = sorted(laws, key=lambda name: -laws[name].log_evidence)
    best = laws[ranked[0]]
    if best.misfit > GROSS:
        said = f"none of these laws follows the curves: the best, {ranked[0]}, misses {best.misfit:.0%} of the largest force"
        return Choice(None, tuple(ranked), said)
    close = tuple(name for name in ranked if best.log_evidence - laws[name].log_evidence < THRESHOLD)
    if len(close) > 1:
        return Choice(None, close, _undecided(laws, close))
    return Choice(ranked[0], close, _decided(laws, ranked))


def _undecided(laws: Mapping[str, Weighed], close: Sequence[str]) -> str:
    gap = laws[close[0]].log_evidence - laws[close[1]].log_evidence
    words = f"the curves cannot tell {_and(close)} apart: "
    words += f"the log evidences of the best two differ by {gap:.1f}, less than {THRESHOLD:g}"
    fewest = [name for name in close if laws[name].parameters == min(laws[other].parameters for other in close)]
    if len(fewest) == 1:
        words += f"; the simplest of them is {fewest[0]}"
    exact = sorted(close, key=lambda name: -laws[name].without_mesh)
    gain = laws[exact[0]].without_mesh - laws[exact[1]].without_mesh
    if gain >= THRESHOLD:
        words += f"; the error of the mesh could explain the difference (if the mesh were exact, {exact[0]} by {gain:.1f})"
        words += ": use a finer mesh"
    return words


def _decided(laws: Mapping[str, Weighed], ranked: Sequence[str]) -> str:
    best = laws[ranked[0]]
    if len(ranked) == 1:
        return f"only {ranked[0]} could be fitted"
    gap = best.log_evidence - laws[ranked[1]].log_evidence
    words = f"the curves prefer {ranked[0]}: its log evidence is {gap:.1f} above that of the next law, {ranked[1]} ({_odds(gap)})"
    if best.systematic:
        words += "; but its residuals are systematic, so the tissue may follow a law that is not listed"
    return words


def _odds(gap: float) -> str:
    return f"odds of {math.exp(gap):.0f} to 1" if gap < CERTAIN else "odds above 1000 to 1"


def _and(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
