"""Moduli of a fitted material without fibres, beside its parameters: Young's modulus with its interval, and Poisson's ratio."""

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.special import stdtrit

from indentfit.case import Case
from indentfit.case.laws import isotropic_moduli
from indentfit.inference.plain import Interval
from indentfit.inference.result import FitResult, ParameterEstimate
from indentfit.inference.seen import not_reached

SMALL = 1e-6  # relative change of a parameter, for a derivative
UNITS = {"mu": "kPa", "G": "kPa", "E": "kPa", "nu": "1"}
RATIO = "Ginf_G0"
RATIO_OF_BULK = "bulk_ratio"
UNDETERMINED = "not determined"


def moduli(case: Case, result: FitResult) -> dict[str, ParameterEstimate]:
    """Name (E, nu, and mu or G where no parameter is the shear modulus) -> estimate; none of these for a material with fibres.
    Ginf_G0 is the long-term over the instantaneous modulus, where the fit frees the relaxation.

    A modulus that changes with one free parameter alone has the interval of that parameter, carried over. One that changes with
    several has no interval, because the parameters' errors are not independent. Where the bulk ratio is an uncertain input, moduli
    are those at its fitted value, and their intervals go over the ends of its interval too.
    """
    values = {name: known.value for name, known in result.parameters.items()}
    if (ratio := _uncertain_ratio(result)) is not None:
        values[RATIO_OF_BULK] = ratio[0]
    known = {name: _estimate(case, result, values, name, value) for name, value in _moduli(case, values).items()}
    return known | _of_relaxation(case, result, values)


def _uncertain_ratio(result: FitResult) -> tuple[float, Interval] | None:
    """The fitted value and the interval of a bulk ratio that is an uncertain input; None where it is known, or a parameter."""
    share = result.uncertain.inputs.get(RATIO_OF_BULK)
    if share is None or share.fitted is None or share.interval is None or RATIO_OF_BULK in result.parameters:
        return None
    return share.fitted, share.interval


def _of_relaxation(case: Case, result: FitResult, values: dict[str, float]) -> dict[str, ParameterEstimate]:
    """The long-term over the instantaneous modulus, where shares of the relaxation are free; its interval is that of linear theory,
    with the other errors of the shares in proportion."""
    relaxation = case.relaxation
    shares = [name for name in relaxation.parameters if name.startswith("g")] if relaxation is not None else []
    if relaxation is None or not any(name in result.free for name in shares):
        return {}
    total, long_term = sum(values[name] for name in shares), relaxation.base == "long_term"
    ratio = 1 / (1 + total) if long_term else 1 - total
    free = [name for name in shares if name in result.free]
    said = f"long-term over instantaneous modulus, from {' and '.join(free)}"
    if not_reached(case, result.parameters, values):
        said = f"{UNDETERMINED}: {said}, and the hold does not reach the long-term modulus"
    numbers = [result.free.index(name) for name in free]
    if result.covar is None or any(result.covar[a][b] is None for a in numbers for b in numbers):
        return {RATIO: ParameterEstimate(ratio, "1", verdict=said)}
    variance = sum(result.covar[a][b] or 0.0 for a in numbers for b in numbers)
    stderr = float(np.sqrt(max(variance, 0.0))) * (ratio**2 if long_term else 1.0)
    known = [result.parameters[name] for name in free]
    wider = max((share.total or 0.0) / share.stderr if share.stderr else 1.0 for share in known)
    freedom = max(sum(noise.effective_points for noise in result.noise.values()) - len(result.free), 1.0)
    half = float(stdtrit(freedom, 0.975)) * stderr * wider
    interval = max(ratio - half, 0.0), min(ratio + half, 1.0)
    return {RATIO: ParameterEstimate(ratio, "1", stderr=stderr, stderr_total=stderr * wider, interval=interval, verdict=said)}


def _moduli(case: Case, values: dict[str, float]) -> dict[str, float]:
    """The moduli at values of the parameters, and of a fitted bulk ratio."""
    ratio = values.get(RATIO_OF_BULK)
    choice = case.material if ratio is None else case.material.with_key("bulk_ratio", ratio)
    return isotropic_moduli(choice, case.law, values)


def _estimate(case: Case, result: FitResult, values: dict[str, float], modulus: str, value: float) -> ParameterEstimate:
    unit = UNITS[modulus.rpartition(".")[2]]
    changing = [name for name in result.free if _changes(case, result, values, name, modulus)]
    ratio = _uncertain_ratio(result)
    spans = () if ratio is None else [_moduli(case, {**values, RATIO_OF_BULK: end})[modulus] for end in ratio[1]]
    spread = [span for span in spans if abs(span - value) > 1e-9 * abs(value)]
    if not changing and spread:
        return ParameterEstimate(value, unit, interval=(min(*spans, value), max(*spans, value)), verdict="from the bulk ratio")
    if not changing:
        return ParameterEstimate(value, unit, fixed=True)
    verdict = f"from {' and '.join([*changing, *(['the bulk ratio'] if spread else [])])}"
    loose = [name for name in changing if (result.parameters[name].verdict or "").startswith(UNDETERMINED)]
    if loose:
        verdict = f"{UNDETERMINED}: {verdict}, and {' and '.join(loose)} {'is' if len(loose) == 1 else 'are'} not"
    if len(changing) > 1:
        return ParameterEstimate(value, unit, verdict=verdict)
    known = result.parameters[changing[0]]
    if known.interval is None:
        return ParameterEstimate(value, unit, verdict=verdict)

    def at(number: float) -> float:
        return _moduli(case, {**values, changing[0]: number})[modulus]

    low, high = sorted(at(number) for number in known.interval)
    if spread and value:  # the ends of the parameter and of the bulk ratio together: no interval of both is wider
        low, high = min(low, low * min(spans) / value), max(high, high * max(spans) / value)
    first, last = known.interval
    if first == last:  # a fit without any error
        first, last = known.value * (1 - SMALL), known.value * (1 + SMALL)
    slope = abs(at(last) - at(first)) / (last - first) if last > first else 0.0
    errors: dict[str, Any] = {name: _scaled(getattr(known, name), slope) for name in ("stderr", "stderr_total")}
    estimate = ParameterEstimate(value, unit, interval=(low, high), verdict=verdict, **errors)
    return replace(estimate, interval_linear=_carried(known.interval_linear, slope, value, known.value))


def _changes(case: Case, result: FitResult, values: dict[str, float], name: str, modulus: str) -> bool:
    """Whether a modulus changes with a free parameter."""
    known = result.parameters[name]
    ends = [_moduli(case, {**values, name: number})[modulus] for number in (known.min, known.max) if number]
    here = _moduli(case, values)[modulus]
    return any(abs(end - here) > 1e-9 * abs(here) for end in ends)


def _scaled(error: float | None, slope: float) -> float | None:
    return None if error is None else error * slope


def _carried(interval: Interval | None, slope: float, value: float, at: float) -> Interval | None:
    return None if interval is None else (value + slope * (interval[0] - at), value + slope * (interval[1] - at))
