"""The force of a test over time, in a ramp, a hold and a retraction: by the viscoelastic model, beside the hereditary integral.

For a test under displacement control whose stress relaxes by one function, the deformation is nearly the elastic one at each
depth, and the force nearly the hereditary integral of the elastic force. The viscoelastic model (`viscous`) is solved in some
steps. The ratio of its force to the hereditary integral over the same steps, which is nearly 1, is interpolated between them, and
multiplies the integral over dense steps. In a retraction the rule of the fits stands for the integral (`time_map`: Ting's under a
round end), and the difference of the model's force from it is interpolated and added.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from indentfit.arrays import Array
from indentfit.errors import ConvergenceError, OutOfTime
from indentfit.fem.deadline import Deadline
from indentfit.fem.interpolation import Interpolant
from indentfit.fem.result import HALF, TestResult, TimeCurve
from indentfit.fem.retraction import LEAST, Retraction, press_and_retract
from indentfit.fem.setup import Press
from indentfit.fem.time_map import TimeMap
from indentfit.fem.viscous import InTime, Moment, press_in_time
from indentfit.hereditary import RelaxationFunction
from indentfit.motion import Motion

if TYPE_CHECKING:
    from indentfit.fem.simulate import Model

OF_RAMP = 0.1  # time since the end of a ramp, over its duration, from which on the logarithm of that time counts
# Times of a hold in the result: so many that lines between them are within 0.1 %; the first over the hold, if not late in the ramp.
HOLD_POINTS, EARLIEST = 40, 0.02
BACK_POINTS, DENSE_BACK = 40, 400  # times of a retraction in the result, and those at which its end is sought


def with_time(
    test: TestResult,
    press: Press,
    hold: float,
    progress: Callable[[float], None] | None = None,
    deadline: Deadline | None = None,
    share: float = 0.0,
    motion: Motion | None = None,
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
    motion : Motion, or None
        The measured one, of which a retraction is followed.

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
    back = _Back.of(Retraction.after(ramp, motion) if motion else None, elastic, counted, model)
    path: InTime = partial(press_in_time, ramp=ramp, relaxation=function)
    if back is not None:
        path = partial(press_and_retract, ramp=ramp, relaxation=function, retraction=back.way, end=back.end)
    try:
        moments = model.over_time(press, path, progress, deadline)
    except (ConvergenceError, OutOfTime) as error:
        curve = TimeCurve(wanted, ramp.depth_at(wanted), np.interp(wanted, dense, integral), None, cause_of(error))
        return replace(test, in_time=curve if back is None else back.added(curve, None))
    loading = [moment for moment in moments if moment.time <= ramp.end * (1 + 1e-9)]
    time = np.array([moment.time for moment in loading])
    at_steps = elastic(ramp.depth_at(time))
    stepwise = counted.integral(time, at_steps, ramp.seconds)  # it errs as the viscoelastic model does, by its steps of time
    ratio = np.array([moment.at.whole_force for moment in loading])[1:] / stepwise[1:]
    at = partial(between, time[1:], ratio, ramp.seconds)
    force = at(wanted) * np.interp(wanted, dense, integral)
    curve = TimeCurve(wanted, ramp.depth_at(wanted), force, ratio=at)
    curve = replace(curve, difference=curve.counted(time[1:], ratio - 1))
    return replace(test, in_time=curve if back is None else back.added(curve, moments[len(loading) - 1 :]))


@dataclass(frozen=True, eq=False)
class _Back:
    """A retraction with the forces of the part of the sample that is meshed by the rule of the fits.

    Parameters
    ----------
    way : Retraction
    rule : function
        Forces (n,), mN, at times (n,), s.
    end : float, s
        The time to which the viscoelastic model is solved.
    copies : int
        Of the part that is meshed, in the sample.
    """

    way: Retraction
    rule: Callable[[Array], Array]
    end: float
    copies: int

    @classmethod
    def of(cls, way: Retraction | None, elastic: Interpolant, function: RelaxationFunction, model: Model) -> _Back | None:
        """That of an elastic force; None where the indenter does not go back."""
        if way is None:
            return None
        shrinks = model.contact.shape.edge_radius is None

        def rule(times: Array) -> Array:
            known = TimeMap.of(way.motion, times, lambda depth: elastic(depth)[:, None], shrinks)
            return known.forces(np.ones(1), function)

        dense = np.linspace(way.turn, float(way.motion.time[-1]), DENSE_BACK + 1)
        force = rule(dense)
        left = force >= LEAST * force[0]
        last = int(np.argmin(left)) - 1 if not left.all() else DENSE_BACK
        return cls(way, rule, float(dense[max(last, 1)]), model.body.copies)

    def added(self, curve: TimeCurve, moments: Sequence[Moment] | None) -> TimeCurve:
        """A curve of ramp and hold with the retraction: by the rule, and where moments from the turn on are known by the model."""
        way = self.way
        times = np.linspace(way.turn, float(way.motion.time[-1]), BACK_POINTS + 1)[1:]
        rule = self.rule(times)
        whole = replace(
            curve,
            time=np.append(curve.time, times),
            displacement=np.append(curve.displacement, way.depth_at(times)),
            force=np.append(curve.force, self.copies * rule),
        )
        if moments is None or curve.ratio is None:
            return whole
        solved = np.array([moment.time for moment in moments])
        if solved.size == 1:
            return replace(whole, in_retraction="its first step failed")
        turn, forces = float(self.rule(solved[:1])[0]), np.array([moment.at.whole_force for moment in moments])
        apart, loading = PchipInterpolator(solved, forces - self.rule(solved)), curve.ratio
        at_end = max(float(self.rule(solved[-1:])[0]), 1e-300)

        def change(at: Array) -> Array:
            """The model's force less that of the rule, mN; after the last step in proportion to that of the rule."""
            known = apart(np.clip(at, solved[0], solved[-1]))
            return np.where(at > solved[-1], known * np.minimum(self.rule(at) / at_end, 1.0), known)

        def ratio(at: Array) -> Array:
            late = np.maximum(at, way.turn)
            return np.where(at > way.turn, 1 + change(late) / np.maximum(self.rule(late), HALF * turn), loading(at))

        early = solved[-1] < self.end * (1 - 1e-9) and forces[-1] > LEAST * forces[0]
        return replace(
            whole,
            force=np.append(curve.force, self.copies * np.maximum(rule + change(times), 0.0)),
            in_retraction=float(np.abs(apart(solved) / turn).max()),
            ratio=ratio,
            ends=f"the model ends there {solved[-1] - way.turn:.3g} s after the turn" if early else "",
        )


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
