"""The first screen of a fit: estimates in the field's words, the doubts about the result, and one sentence on the next step."""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass

from indentfit.case.draining import HOLDS_DIFFER
from indentfit.fem.facts import UNSTABLE
from indentfit.inference.limits import WORDS
from indentfit.inference.plain import by_error
from indentfit.inference.reconciled import AGREE
from indentfit.inference.result import AloneEstimate, FitResult, ParameterEstimate
from indentfit.inference.seen import HEREDITARY
from indentfit.inference.verdicts import contradictions, kind_of
from indentfit.inference.what_if import warnings_of
from indentfit.inference.zeroed_late import ZEROED
from indentfit.inverse.sharp_edges import FOLDED, LEFT_OUT
from indentfit.runs.closed_form import OF_MISFIT, OUTSIDE

# Measured with 6 to 14 points: of such intervals 78 to 86 % hold the truth under a correlation of 0.8, 89 to 92 % under 0.5.
FEW = (
    "are too few to tell whether their noise is correlated: where neighbouring points are (by 0.5 to 0.8), intervals are short by "
    "a factor of up to 2; more points would tell"
)
SYSTEMATIC = 0.02  # RMSE over the largest force from which systematic residuals are worth another law
CURE = re.compile(r"about ([\d,]+) elements")
INPUTS = {  # limited_by -> the next step
    "force": "calibrate the load cell better, and state its error as fit.uncertain.force",
    "friction": "measure the friction, or lubricate or glue the contact, and state what is known as fit.uncertain.friction",
    "bulk_ratio": "find out how compressible the sample is, and state what is known as fit.uncertain.bulk_ratio",
    "thickness": "measure the thickness better, and state its error as fit.uncertain.thickness",
    "size": "measure the indenter better, and state its size's error as fit.uncertain.size",
    "offset": "find the contact point more exactly (slower approach, less noise), and state its error as fit.uncertain.offset",
    "base": "find out whether the sample slides or sticks on its base, and state sample.base",
}


@dataclass(frozen=True)
class Doubt:
    """One reason to doubt a result: `red` where the parameters mean nothing until it is dealt with, otherwise amber."""

    red: bool
    text: str

    @property
    def word(self) -> str:
        """The colour as a word, for a terminal and for those who see no colours."""
        return "red" if self.red else "amber"


def value_words(known: ParameterEstimate, digits: int = 5) -> str:
    """The value of an estimate, with the digits that its error leaves it (so many digits where it has no error). An estimate at its
    bound has no value of its own, so the words then give the interval."""
    if known.fixed:
        return f"{known.value:.{digits}g}"
    if known.at_bound is None:
        return by_error(known.value, error_of(known), digits)
    if known.interval is None or _whole_range(known):
        return f"any, {known.min:.3g} to {known.max:.3g}" if known.min is not None and known.max is not None else "not known"
    return f"< {known.interval[1]:.3g}" if known.at_bound == "lower" else f"> {known.interval[0]:.3g}"


def _whole_range(known: ParameterEstimate) -> bool:
    low, high = known.interval or (float("nan"), float("nan"))
    return known.min is not None and known.max is not None and low <= known.min and high >= known.max


def error_of(known: ParameterEstimate) -> float | None:
    """The standard error by which the digits of an estimate are chosen: the total one, or a quarter of a narrower interval.
    A parameter at its bound has none."""
    if known.at_bound:
        return None
    quarter = None if known.interval is None else (known.interval[1] - known.interval[0]) / 4
    errors = [error for error in (known.total, quarter) if error is not None and math.isfinite(error) and error > 0]
    return min(errors, default=None)


def pieces_words(known: ParameterEstimate, digits: int = 4) -> str:
    """The 95 % interval of an estimate in words, or its pieces, with the digits of the value."""
    if known.fixed:
        return "fixed"
    pieces, error = known.pieces or (() if known.interval is None else (known.interval,)), error_of(known)
    return " or ".join(" to ".join(by_error(end, error, digits) for end in piece) for piece in pieces) or "unknown"


def alone_words(known: AloneEstimate) -> str:
    """The value that a test alone finds for a parameter, or at a bound only the end of its interval: a bound is no value."""
    for end, words in (("lower", f"< {known.interval[1]:.3g}"), ("upper", f"> {known.interval[0]:.3g}")):
        if known.verdict.startswith(f"at its {end} bound"):
            return "any value" if "not determined" in known.verdict else words
    return f"{known.value:.4g}"


def doubts_of(result: FitResult) -> Iterator[Doubt]:
    """The reasons to doubt a result, the gravest first."""
    if result.no_fit:
        yield Doubt(True, f"no fit: {result.no_fit}")
    elif not result.success:
        yield Doubt(True, f"the fit did not converge: {result.message}")
    if result.no_fit:
        return
    yield from (Doubt(True, sentence) for sentence in contradictions(result.predicted))
    yield from (Doubt(False, sentence) for sentence in result.conclusions if sentence.startswith(AGREE))
    yield from (Doubt(False, f"{known.test}: {known.seen}") for known in result.recording)
    yield from _doubts_of_residuals(result)
    yield from _doubts_of_parameters(result)
    told = (HOLDS_DIFFER, HEREDITARY, LEFT_OUT, FOLDED, UNSTABLE, ZEROED, OUTSIDE)
    yield from (Doubt(False, sentence) for sentence in result.conclusions if sentence.startswith(told))
    yield from (Doubt(False, sentence) for sentence in warnings_of(result.taken_as_known, result.parameters))


def _doubts_of_residuals(result: FitResult) -> Iterator[Doubt]:
    smooth = _beside_the_law(result)
    if smooth:
        sizes = ", ".join(f"{name} {result.misfit[name].relative:.1%}" for name in smooth if name in result.misfit)
        yield Doubt(False, f"the residuals are systematic, so the law does not follow the curves ({sizes} of the largest force)")

    few = [f"{noise.points} points of {name}" for name, noise in result.noise.items() if noise.few]
    if few and any(result.parameters[name].limited_by in (None, "noise") for name in result.free):
        yield Doubt(False, f"the {_and(few)} {FEW}")


def _beside_the_law(result: FitResult) -> list[str]:
    """The tests whose curves the law does not follow: their residuals are systematic, and larger than what the mesh may err."""
    mesh = result.uncertain.inputs.get("mesh")
    least = 0.0 if mesh is None else mesh.sd or 0.0
    smooth = [name for name, noise in result.noise.items() if noise.systematic]
    return [name for name in smooth if name not in result.misfit or result.misfit[name].relative > least]


def _doubts_of_parameters(result: FitResult) -> Iterator[Doubt]:
    for name in result.free:
        known = result.parameters[name]
        if known.at_bound:
            bound = known.min if known.at_bound == "lower" else known.max
            yield Doubt(False, f"{name} sits at its {known.at_bound} bound ({bound:g}), so the curves give no value for it")
        if known.pieces:
            yield Doubt(False, f"the interval of {name} is in {len(known.pieces)} pieces: {pieces_words(known)}")
    for cause, names in _by_cause(result).items():
        yield Doubt(False, f"{WORDS.get(cause, f'the error of {cause}')} dominates the error of {_and(names)}")


def _by_cause(result: FitResult) -> dict[str, list[str]]:
    """The inputs (and the mesh) that limit parameters which are not determined well, with these parameters."""
    causes: dict[str, list[str]] = {}
    for name in result.free:
        known = result.parameters[name]
        cause = known.limited_by or "noise"
        if cause not in ("noise", "misfit", "bound", "tests", "search", "recording") and kind_of(known) != "determined":
            causes.setdefault(cause, []).append(name)
    return causes


def next_step(result: FitResult) -> str:
    """One sentence on what to do next."""
    unsure = result.no_fit or not result.success or any(kind_of(result.parameters[name]) != "determined" for name in result.free)
    if result.recording and (unsure or _next_of_law(result)):
        return _next_of_recording(result)
    if result.no_fit:
        return "check the curves, their units and the law before anything else; no parameter has a meaning yet"
    if not result.success and result.uncertain.at:
        inputs = _and([*result.uncertain.at])
        return f"fit again with narrower ranges of the parameters, or state more exactly what is known of {inputs}"
    if not result.success:
        return "fit again with other start values or wider ranges, or with --method ga"
    wrong = [name for name, known in result.predicted.items() if known.contradicts]
    if wrong:
        return (
            f"repeat {_and(wrong)}, or find out what differed (contact point, direction, sample); until then take each test alone"
        )
    if any(sentence.startswith(HOLDS_DIFFER) for sentence in result.conclusions):
        return "fit each test alone, since no single relaxation describes them, and compare their moduli"
    if law := _next_of_law(result):
        return law
    return _next_of_parameters(result)


def _next_of_recording(result: FitResult) -> str:
    """What to do about curves that show a preload or adhesion: before that is mended, no other law is worth a try."""
    names = [known.test for known in result.recording]
    return f"mend {_and(names)} first, then fit again: {result.recording[0].remedy}"


def _next_of_law(result: FitResult) -> str:
    large = [name for name in _beside_the_law(result) if name in result.misfit and result.misfit[name].relative >= SYSTEMATIC]
    if not large:
        return ""
    if any(name.endswith(("(hold)", "(retraction)")) for name in result.noise):
        return "fit the same curves with another law or another relaxation (more terms, an order); `compare` takes loadings alone"
    layer = " --layer NAME" if any("." in name for name in result.free) else ""
    return f"try other laws on the same curves: `indentfit compare CASE{layer} --materials LAW,LAW,...` says which one they prefer"


def _next_of_parameters(result: FitResult) -> str:
    bound = [name for name in result.free if result.parameters[name].at_bound]
    if bound:
        return _next_of_bound(bound[0], result.parameters[bound[0]])
    causes = _by_cause(result)
    if "mesh" in causes:
        cure = CURE.search(" ".join(result.parameters[name].verdict or "" for name in causes["mesh"]))
        size = f"mesh.elements = {cure.group(1).replace(',', '')}" if cure else "a smaller mesh.error"
        return f"fit again on a finer mesh ({size}): the mesh limits {_and(causes['mesh'])}"
    for cause, names in causes.items():
        if cause in INPUTS:
            return f"{INPUTS[cause]}: that limits {_and(names)}"
    weak = [name for name in result.free if kind_of(result.parameters[name]) != "determined"]
    if weak:
        without = " (without [fit.discrepancy] in the case)" if result.law_misfit is not None else ""
        return f"do another test: `indentfit design CASE --result DIR`{without} says which one determines {_and(weak)} best"
    if any(said.endswith(OF_MISFIT) for said in result.conclusions):
        return 'fit again with the law\'s own misfit as a term: [fit.discrepancy] with scale = "unknown" widens the intervals by it'
    law = tuple(tried for tried in result.taken_as_known if tried.input == "law")
    if law and _beside_the_law(result) and not result.recording:
        return (
            'fit again with the law\'s own misfit as a term: [fit.discrepancy] with scale = "unknown" widens the intervals by what '
            "the law misses, and `compare` tells whether another law misses less"
        )
    checked = "nothing is missing for these parameters; check the inputs that are taken as known, on which the intervals rest"
    if any(warnings_of(law, result.parameters)):
        return f'{checked}; of the law, `compare` and [fit.discrepancy] with scale = "unknown" tell'
    return checked


def _next_of_bound(name: str, known: ParameterEstimate) -> str:
    if known.at_bound == "lower" and known.min is not None and known.min <= 0:
        return f"{name} may be 0: see with `indentfit compare` whether a law without it will do, or do the test that `design` names"
    bound, key = (known.max, "max") if known.at_bound == "upper" else (known.min, "min")
    return f"move the bound of {name} ({key} = {bound:g}) if other values are admissible, and fit again; or give {name} as a number"


def first_lines(result: FitResult) -> Iterator[str]:
    """Doubts and the next step, line by line, for a terminal."""
    for doubt in doubts_of(result):
        yield f"{doubt.word:<9} {doubt.text}"
    yield f"next      {next_step(result)}"


def _and(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
