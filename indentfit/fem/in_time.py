"""The force of a test over time, in a ramp and a hold: by the viscoelastic model, with the hereditary integral beside it.

For a test under displacement control whose stress relaxes by one function, the deformation is nearly the elastic one at each
depth, and the force nearly the hereditary integral of the elastic force. The viscoelastic model (`viscous`) is solved in some
steps. The ratio of its force to the hereditary integral over the same steps, which is nearly 1, is interpolated between them, and
multiplies the integral over dense steps.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from indentfit.arrays import Array
from indentfit.errors import ConvergenceError, OutOfTime
from indentfit.fem.deadline import Deadline
from indentfit.fem.interpolation import Interpolant
from indentfit.fem.result import TestResult, TimeCurve
from indentfit.fem.setup import Press
from indentfit.fem.viscous import press_in_time

OF_RAMP = 0.1  # time since the end of a ramp, over its duration, from which on the logarithm of that time counts
# Times of a hold in the result: so many that lines between them are within 0.1 %; the first over the hold, if not late in the ramp.
HOLD_POINTS, EARLIEST = 40, 0.02


def with_time(
    test: TestResult,
    press: Press,
    hold: float,
    progress: Callable[[float], None] | None = None,
    deadline: Deadline | None = None,
    share: float = 0.0,
) -> TestResult:
    """A test with its force over time.

    Parameters
    ----------
    test : TestResult
        The solved press, whose path is elastic.
    press : Press
        It has a rate.
    hold : float, s
        Duration of the hold after the ramp; may be 0.
    progress : called with the share of the viscoelastic solution that is done
    deadline : Deadline, or None
        Of the viscoelastic solution.
    share : float
        Share of the elastic force that does not relax, in the hereditary integral.

    Returns
    -------
    TestResult
        A viscoelastic model that is not solved is recorded with its cause.
    """
    model = test.model
    if press.in_time is None or model is None or test.unfinished:
        return test
    ramp, function = press.in_time.ramp(float(press.depths[-1]), hold)
    wanted = np.append(press.depths / press.in_time.rate, ramp.seconds + of_hold(hold, ramp.seconds))
    dense = ramp.times(wanted)
    elastic = Interpolant([point.depth for point in test.path], [point.whole_force for point in test.path], model.power)
    counted = function.in_series(share)
    integral = counted.integral(dense, model.body.copies * elastic(ramp.depth_at(dense)), ramp.seconds)
    try:
        moments = model.over_time(press, partial(press_in_time, ramp=ramp, relaxation=function), progress, deadline)
    except (ConvergenceError, OutOfTime) as error:
        curve = TimeCurve(wanted, ramp.depth_at(wanted), np.interp(wanted, dense, integral), None, cause_of(error))
        return replace(test, in_time=curve)
    time = np.array([moment.time for moment in moments])
    at_steps = elastic(ramp.depth_at(time))
    stepwise = counted.integral(time, at_steps, ramp.seconds)  # it errs as the viscoelastic model does, by its steps of time
    ratio = np.array([moment.at.whole_force for moment in moments])[1:] / stepwise[1:]
    at = partial(between, time[1:], ratio, ramp.seconds)
    force = at(wanted) * np.interp(wanted, dense, integral)
    return replace(test, in_time=TimeCurve(wanted, ramp.depth_at(wanted), force, float(np.abs(ratio - 1).max()), ratio=at))


def between(time: Array, ratio: Array, corner: float, wanted: Array) -> Array:
    """A ratio that is known at steps of a path in time, at other times.

    Parameters
    ----------
    time : array (n,), s
        Rising, above 0.
    ratio : array (n,)
    corner : float, s
        Where the ramp ends: the ratio has a corner there, and in a hold it is smooth in the logarithm of the time since.
    wanted : array (m,), s

    Returns
    -------
    array (m,)
        Before the first step it is that of the first step.
    """
    until = int(np.count_nonzero(time < corner * (1 + 1e-9)))
    since = np.log1p(np.maximum(time[until - 1 :] / time[until - 1] - 1, 0.0) / OF_RAMP)
    ahead = np.log1p(np.maximum(wanted / time[until - 1] - 1, 0.0) / OF_RAMP)
    rise, rest = PchipInterpolator, CubicSpline  # in the ramp elements come to touch one by one, in the hold nothing jumps
    return np.where(
        wanted <= time[until - 1],
        _between(rise, time[:until], ratio[:until], wanted),
        _between(rest, since, ratio[until - 1 :], ahead),
    )


def _between(kind: type[PchipInterpolator] | type[CubicSpline], x: Array, y: Array, at: Array) -> Array:
    """Values between points (n,), those of the ends beyond them."""
    return np.asarray(kind(x, y)(np.clip(at, x[0], x[-1]))) if x.size > 1 else np.full(at.shape, y[0])


def cause_of(error: ConvergenceError | OutOfTime) -> str:
    """Why a viscoelastic model was not solved."""
    return error.cause if isinstance(error, ConvergenceError) else f"{error}; a larger fit.time_limit allows more"


def of_hold(hold: float, ramp: float) -> Array:
    """Times (n,) since the end of a ramp, s."""
    return np.geomspace(min(EARLIEST * hold, 0.1 * ramp), hold, HOLD_POINTS) if hold else np.zeros(0)
