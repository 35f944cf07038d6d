"""What the records of a fit can see of a relaxation: times between the shortest ramp and the end of the longest hold.

What relaxes much faster than the ramp has relaxed before the force is there, and acts as a viscous part of it. What relaxes much
more slowly than the hold has not relaxed at its end, and cannot be told from the long-term modulus.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from indentfit.case import Case
from indentfit.case.in_time import ramps_of, window_of
from indentfit.case.relaxation import Relaxation, Window
from indentfit.inference.result import ParameterEstimate

LATE = 0.02  # of the force at the end of the hold: where more than that is still to relax, the long-term modulus is not seen
MOMENTS = 201  # steps of a ramp
DETERMINED, MODULUS = "determined", "kPa"
FASTER = "a ramp of {seconds:.2g} s would show it"
LONGER = "a hold of {seconds:.3g} s would show it"
FAR = 0.01  # relative difference of the viscoelastic model from the hereditary integral, above which a fit says so
HEREDITARY = "the hereditary integral of the elastic force, with which the fit was made, is"
SHOWS = 3.0  # how much faster than a time a ramp must be to show it, or how much longer a hold


def unseen(case: Case, values: Mapping[str, float]) -> dict[str, str]:
    """Name -> why the records of a case cannot see a time of relaxation, and what would show it.

    Parameters
    ----------
    case : Case
    values : mapping of name -> value
        The parameters of the relaxation, among others.

    Returns
    -------
    dict of str to str
        Empty where the material is elastic, or relaxes by a fractional function, which has no single time.
    """
    relaxation = case.relaxation
    if relaxation is None or relaxation.order is not None:
        return {}
    window, reasons = window_of(list(ramps_of(case).values())), {}
    for name in relaxation.parameters:
        if name.startswith("tau") and (why := _why(float(values[name]), window)):
            reasons[name] = why
    return reasons


def _why(time: float, window: Window) -> str:
    if time < window.ramp:
        cure = FASTER.format(seconds=time / SHOWS)
        return f"{time:.3g} s is shorter than the ramp of {window.ramp:.3g} s, in which it relaxes unseen; {cure}"
    longest = max(window.hold, window.ramp)
    if time > longest:
        last = f"the hold of {window.hold:.3g} s" if window.hold else f"the ramp of {window.ramp:.3g} s, which no hold follows"
        return f"{time:.3g} s is longer than {last}: its end is not seen; {LONGER.format(seconds=SHOWS * time)}"
    return ""


def with_seen(case: Case, estimates: Mapping[str, ParameterEstimate], values: Mapping[str, float]) -> dict[str, ParameterEstimate]:
    """Estimates whose verdicts say which times of relaxation the records cannot see; a time that they cannot see is not determined,
    unless its interval says that it is, and nor is its share. Where much is still to relax by such a time, long-term moduli, and
    shares over them, are not determined either: their intervals hold only for times within the bounds."""
    known = dict(estimates)
    for name, why in unseen(case, values).items():
        if name not in known:
            continue
        said = known[name].verdict or ""
        if said.startswith(DETERMINED):
            known[name] = replace(known[name], verdict=f"{said}; {why}")
            continue
        known[name] = replace(known[name], verdict=f"not determined: {why}")
        if (share := name.replace("tau", "g")) in known:
            known[share] = replace(known[share], verdict=f"not determined: its time, {name}, is not seen")
    if why := extrapolated(case, known, values):
        for name, estimate in known.items():
            if name in case.free and case.law.parameters[name].unit == MODULUS:
                known[name] = replace(estimate, verdict=f"not determined: it is the modulus after infinite time; {why}")
            elif case.relaxation is not None and name in case.relaxation.free and name.startswith("g"):
                known[name] = replace(estimate, verdict=f"not determined: it is over the modulus after infinite time; {why}")
    return known


def extrapolated(case: Case, known: Mapping[str, ParameterEstimate], values: Mapping[str, float]) -> str:
    """Why long-term moduli are not known; empty where they are, and where the moduli are the instantaneous ones."""
    relaxation = case.relaxation
    return "" if relaxation is None or relaxation.base != "long_term" else not_reached(case, known, values)


def not_reached(case: Case, known: Mapping[str, ParameterEstimate], values: Mapping[str, float]) -> str:
    """Why the force after infinite time is not known; empty where it is."""
    relaxation = case.relaxation
    if relaxation is None or not (left := _left(case, relaxation, values)) > LATE:
        return ""
    window = window_of(list(ramps_of(case).values()))
    longest = max(window.hold, window.ramp)
    late = [name for name in known if name.startswith("tau") and name in relaxation.free and values[name] > longest]
    late = [name for name in late if not (known[name].verdict or "").startswith(DETERMINED)]
    end = f"the hold of {window.hold:.3g} s" if window.hold else "the ramp, which no hold follows,"
    return f"at the end of {end} {left:.0%} or more is still to relax, by {', '.join(late)}" if late else ""


def _left(case: Case, relaxation: Relaxation, values: Mapping[str, float]) -> float:
    """The part of the force at the end of the longest hold that is still to relax, over the long-term force."""
    longest = max(ramps_of(case).values(), key=lambda ramp: ramp.hold)
    function = relaxation.function(longest.seconds, 1e3 * longest.end, values)
    since = np.linspace(longest.hold, longest.end, MOMENTS)  # time since each step of the ramp
    return float(np.mean(function(since))) / function.long_term - 1


def seen_sentences(case: Case, values: Mapping[str, float]) -> Iterator[str]:
    """Sentences on the times that the records cannot see, and on a long-term modulus that they have not reached."""
    relaxation = case.relaxation
    if relaxation is None:
        return
    for name, why in unseen(case, values).items():
        yield f"the records cannot see {name}: {why}"
    window, left = window_of(list(ramps_of(case).values())), _left(case, relaxation, values)
    if left > LATE:
        end = f"the end of the hold of {window.hold:.3g} s" if window.hold else "the end of the ramp, which no hold follows"
        yield f"at {end} the force is still {left:.0%} above its long-term value, so the long-term modulus is extrapolated"


def far_from_model(differences: Mapping[str, float], where: str = "", by_mesh: Mapping[str, float] | None = None) -> Iterator[str]:
    """A sentence on tests whose force by the viscoelastic model is far from the hereditary integral with which a fit is made;
    `where` begins the sentence, where the model was not run at the optimum, and `by_mesh` is the mesh's part of a difference."""
    far = {name: size for name, size in differences.items() if size > FAR}
    if not far:
        return
    sizes = ", ".join(f"{name} {size:.1%}" for name, size in far.items())
    worst = max(far, key=lambda name: far[name])
    part = (by_mesh or {}).get(worst, 0.0)
    if part > far[worst] / 2:
        cause = f", {part:.1%} of it by the mesh: no interval holds this error; a smaller mesh.error makes it smaller"
    else:
        cause = (
            ", whose pressure does not relax: no interval holds this error; it is small where the sample is nearly incompressible "
            "(Poisson's ratio above 0.49)"
        )
    yield f"{where}{HEREDITARY} up to {sizes} from the viscoelastic model{cause}"
