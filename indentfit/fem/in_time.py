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
from scipy.interpolate import PchipInterpolator

from indentfit.arrays import Array
from indentfit.errors import ConvergenceError, OutOfTime
from indentfit.fem.deadline import Deadline
from indentfit.fem.interpolation import Interpolant
from indentfit.fem.result import TestResult, TimeCurve
from indentfit.fem.setup import Press
from indentfit.fem.viscous import press_in_time

HOLD_POINTS, EARLIEST = (
    15,
    0.02,
)  # times of a hold in the result: their number, and the first over the duration of the hold, if that is not late in the ramp


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
    integral = counted.integral(dense, model.body.copies * elastic(ramp.depth_at(dense)))
    try:
        moments = model.over_time(press, partial(press_in_time, ramp=ramp, relaxation=function), progress, deadline)
    except (ConvergenceError, OutOfTime) as error:
        curve = TimeCurve(wanted, ramp.depth_at(wanted), np.interp(wanted, dense, integral), None, cause_of(error))
        return replace(test, in_time=curve)
    time = np.array([moment.time for moment in moments])
    stepwise = counted.integral(time, elastic(ramp.depth_at(time)))  # it errs as the viscoelastic model does, by its steps of time
    ratio = np.array([moment.at.whole_force for moment in moments])[1:] / stepwise[1:]
    between = PchipInterpolator(time[1:], ratio)(np.clip(wanted, time[1], time[-1]))
    force = between * np.interp(wanted, dense, integral)
    return replace(test, in_time=TimeCurve(wanted, ramp.depth_at(wanted), force, float(np.abs(ratio - 1).max())))


def cause_of(error: ConvergenceError | OutOfTime) -> str:
    """Why a viscoelastic model was not solved."""
    return error.cause if isinstance(error, ConvergenceError) else f"{error}; a larger fit.time_limit allows more"


def of_hold(hold: float, ramp: float) -> Array:
    """Times (n,) since the end of a ramp, s."""
    return np.geomspace(min(EARLIEST * hold, 0.1 * ramp), hold, HOLD_POINTS) if hold else np.zeros(0)
