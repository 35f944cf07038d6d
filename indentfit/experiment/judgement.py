"""The rating of a record in words: its noise, its drift, its approach and its contact point."""

from __future__ import annotations

from dataclasses import dataclass

from indentfit.experiment.contact_point import METHODS, SHORTEST_TRAVEL, ContactPoint
from indentfit.experiment.loading import Ramp

RATINGS = ("good", "fair", "poor")
NOISE = (0.02, 0.08)  # shares of the peak from which noise makes a record fair, or poor
DRIFT = (0.03, 0.15)  # of the peak, over the loading
CONTACT = (0.03, 0.10)  # of the depth, for half of the interval of the contact point


@dataclass(frozen=True)
class Judgement:
    """The rating of a record, "good", "fair" or "poor", and the words for each of its aspects."""

    rating: str
    words: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.rating}: {', '.join(self.words)}"


def judged(ramp: Ramp, contact: ContactPoint, depth: float, peak: float, contradicted: bool = False) -> Judgement:
    """The `Judgement` of a record.

    Parameters
    ----------
    ramp : Ramp
    contact : ContactPoint
    depth : float, mm
    peak : float, mN
    contradicted : bool
        Whether the record contradicts what contact and peak assume (`assumptions`).

    Returns
    -------
    Judgement
        Its rating is that of its worst aspect.
    """
    drifted = abs(contact.drift) * ramp.duration / peak
    aspects = [
        (_grade(contact.noise / peak, NOISE), f"noise {_share(contact.noise / peak)} of the peak"),
        (_grade(contact.uncertainty / depth, CONTACT), f"contact within {_share(contact.uncertainty / depth)} of the depth"),
        (int(contact.method not in METHODS), _approach(ramp, contact)),
    ]
    if drifted > DRIFT[0]:
        aspects.append((_grade(drifted, DRIFT), f"drift {drifted:.0%} of the peak during the loading"))
    if contradicted:
        aspects.append((1, "its assumptions are contradicted (see its notes)"))
    return Judgement(RATINGS[max(grade for grade, _ in aspects)], tuple(words for _, words in aspects))


def _share(share: float) -> str:
    """A share in per cent, with one decimal."""
    return f"{share:.1%}" if share >= 0.001 else "less than 0.1%"


def _grade(share: float, limits: tuple[float, float]) -> int:
    return sum(share > limit for limit in limits)


def _approach(ramp: Ramp, contact: ContactPoint) -> str:
    if contact.method not in METHODS:
        return f"contact {contact.method}, not seen"
    travel, depth = contact.displacement - ramp.displacement[0], ramp.displacement[-1] - contact.displacement
    if travel < max(SHORTEST_TRAVEL * depth, 1.5 * contact.uncertainty):  # three standard errors
        return "hardly an approach"
    return "a short approach" if contact.index < ramp.length else "an approach"
