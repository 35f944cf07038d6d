"""Creep: the depth over time under a force that rises and is then held, by the viscoelastic model.

For a material whose stress relaxes by one function m, the force is nearly the hereditary integral of the elastic force F_e:

    F(t) = integral from 0 to t of m(t - s) dF_e(d(s)).

Solved for F_e step by step, and then for the depth, this tells the depth d(t) under a force F(t) while the contact does not shrink
(under a sphere Lee and Radok 1960, J Appl Mech 27:438). It is where the steps of the viscoelastic model (`viscous`) start: each is
repeated, from the step before it, at depths that a secant finds, until the force is the one that is asked for. The ratio of the
depths of the model to those of the hereditary integral over the same steps, which is nearly 1, is interpolated between the steps.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from indentfit.arrays import Array
from indentfit.errors import ConvergenceError, IndentfitError, OutOfTime
from indentfit.fem import path as paths
from indentfit.fem.deadline import Deadline
from indentfit.fem.equations import Equations, Loading
from indentfit.fem.in_time import between, cause_of, of_hold
from indentfit.fem.interpolation import Interpolant
from indentfit.fem.newton import Newton
from indentfit.fem.result import TestResult, TimeCurve
from indentfit.fem.setup import Press
from indentfit.fem.viscous import SMALLEST, Moment, StressHistory, _as_stiff, _elastic, firmed, in_step, next_step
from indentfit.hereditary import RelaxationFunction, is_at
from indentfit.motion import Load

FIRST, GROWTH = 0.15, 0.3  # as of `viscous`: here the elastic stress changes in a hold too
INVERSE = 4000  # depths at which the elastic force is inverted
HELD = 2e-4  # difference of the force from the one that is asked for, as a share of it
TRIES = 8  # depths of one step
EARLY = 0.25  # first step under a flat end, in units of the usual one: outputs before it have the ratio that is known there


@dataclass(frozen=True, eq=False)
class Creep:
    """The depth over time under a load, by the hereditary integral of an elastic force.

    Parameters
    ----------
    load : Load
        On the part of the sample that the elastic force is of.
    relaxation : RelaxationFunction
    depths : array (m,), mm
        Rising, from 0.
    forces : array (m,), mN
        Elastic forces at these depths.
    """

    load: Load
    relaxation: RelaxationFunction
    depths: Array = field(repr=False)
    forces: Array = field(repr=False)

    @classmethod
    def of(cls, load: Load, relaxation: RelaxationFunction, elastic: Callable[[Array], Array], deepest: float) -> "Creep":
        """That of an elastic force as a function of depths (m,), mm, up to the deepest."""
        depths = deepest * np.linspace(0.0, 1.0, INVERSE + 1) ** 2
        return cls(load, relaxation, depths, np.maximum.accumulate(np.append(0.0, elastic(depths[1:]))))

    def at(self, time: Array, forces: Array | None = None) -> Array:
        """Depths (n,), mm, at times (n,), s, from 0, under forces (n - 1,), mN, at these times after the first, by default those of
        the load; the deepest one where the creep goes deeper."""
        history, elastic = StressHistory.none(self.relaxation, (1,)), [0.0]
        for start, dt, force in zip(time[:-1], np.diff(time), self.load.at(time[1:]) if forces is None else forces, strict=True):
            if is_at(self.load.arrived, start):
                history = history.at_corner()
            now = history.elastic_of(float(force), float(dt))
            history = history.after(float(dt), now)
            elastic.append(float(now[0]))
        return np.interp(elastic, self.forces, self.depths)


@dataclass(frozen=True, eq=False)
class Plan:
    """Where the steps of the viscoelastic model go.

    Parameters
    ----------
    load : Load
        On the part of the sample that is meshed.
    time : array (n,), s
    depth : array (n,), mm
        Expected depths at these times.
    end : float, s
        The last time.
    shortest : float, s
        The shortest time in which the depth of a hold changes.
    early : bool
        Whether the first step is a short one. Under a round end few elements touch that early, and the mesh would be seen.
    """

    load: Load
    time: Array
    depth: Array
    end: float
    shortest: float
    early: bool = False

    def depth_at(self, time: float) -> float:
        """The expected depth, mm, at a time, s."""
        return float(np.interp(time, self.time, self.depth))

    def next(self, time: float, longest: float) -> float:
        """The time of the next step, s, which goes no deeper than `longest`, mm."""
        deeper = float(np.interp(self.depth_at(time) + longest, self.depth, self.time, right=self.end))
        if time < self.load.arrived * (1 - 1e-9):
            corner = min(self.load.arrived, self.end)
            return corner if deeper + 0.01 * (deeper - time) > corner else deeper
        step = max(FIRST * self.shortest, GROWTH * (time - self.load.arrived))
        there = min(time + step, max(deeper, time + 1e-3 * step))
        return self.end if time + 1.3 * (there - time) > self.end else there


def with_creep(
    test: TestResult,
    press: Press,
    load: Load,
    relaxation: RelaxationFunction,
    points: Array,
    progress: Callable[[float], None] | None = None,
    deadline: Deadline | None = None,
    share: float = 0.0,
) -> TestResult:
    """A test with its depth over time under a load.

    Parameters
    ----------
    test : TestResult
        The solved press, whose path is elastic and goes to the depth to which the creep is followed.
    press : Press
        Without times.
    load : Load
        On the whole sample.
    relaxation : RelaxationFunction
    points : array (n,), s
        Times since contact at which the depth is asked for, after 0.
    progress : called with the share of the viscoelastic solution that is done
    deadline : Deadline, or None
        Of the viscoelastic solution.
    share : float
        Share of the elastic force that does not relax, in the hereditary integral.

    Returns
    -------
    TestResult
        A viscoelastic model that is not solved is recorded with its cause, and a creep that goes deeper than the press with the
        time at which it does.
    """
    model = test.model
    if model is None or test.unfinished:
        return test
    force = Interpolant([point.depth for point in test.path], [point.whole_force for point in test.path], model.power)
    own = replace(load, force=load.force / model.body.copies)
    flat = model.contact.shape.end == "flat"
    elastic = force if flat else _growing(force, test.path[1].depth, model.power)
    creep = Creep.of(own, relaxation.in_series(share), elastic, float(press.depths[-1]))
    dense = load.times(points)
    depth = creep.at(dense)
    end, ends = _end(dense, depth, creep.depths[-1], load)
    wanted = np.append(points[points < end * (1 - 1e-9)], end)
    plan = Plan(
        own,
        dense,
        depth,
        end,
        max(min(relaxation.times, default=load.arrived), 0.1 * load.arrived),
        flat,
    )
    try:
        moments = model.over_time(press, partial(creep_in_time, plan=plan, relaxation=relaxation), progress, deadline)
    except (ConvergenceError, OutOfTime) as error:
        expected = np.interp(wanted, dense, depth)
        curve = TimeCurve(wanted, expected, load.at(wanted), None, cause_of(error), control="force", ends=ends)
        return replace(test, in_time=curve)
    time = np.array([moment.time for moment in moments])
    held = np.array([moment.at.whole_force for moment in moments])[1:]
    stepwise = creep.at(time, held)  # it errs as the viscoelastic model does, by its steps of time and by its forces
    ratio = np.array([moment.at.depth for moment in moments])[1:] / stepwise[1:]
    crept = between(time[1:], ratio, own.arrived, wanted) * np.interp(wanted, dense, depth)
    curve = TimeCurve(wanted, crept, load.at(wanted), control="force", ends=ends)
    return replace(test, in_time=replace(curve, difference=curve.counted(time[1:], ratio - 1)))


def _growing(force: Interpolant, first: float, power: float) -> Callable[[Array], Array]:
    """The force (m,) of a growing contact at depths (m,), mm, up to a first one, mm, as this power of them. A spline from zero may
    overshoot there: the depth of a small force would be next to nothing, and no first step would be solved."""

    def at(depths: Array) -> Array:
        share = np.minimum(depths / first, 1.0)
        return np.asarray(share**power * force(np.maximum(depths, first)))

    return at


def points_of(load: Load, number: int) -> Array:
    """Times (n,), s, of a result: a number of them in the ramp, and some in the hold."""
    rise = load.arrived * np.arange(1, number + 1) / number
    return np.append(rise, load.arrived + of_hold(load.end - load.arrived, load.arrived))


def _end(time: Array, depth: Array, deepest: float, load: Load) -> tuple[float, str]:
    """The time, s, to which the creep is followed, and why it ends before that of the load."""
    beyond = np.flatnonzero(depth >= deepest * (1 - 1e-9))
    if not beyond.size:
        return load.end, ""
    end = float(time[beyond[0]])
    held = "creep" if end > load.arrived else "ramp"
    reached = f"the {held} reaches the test's depth, {deepest:.4g} mm, after {end:.4g} s of {load.end:.4g} s"
    return end, f"{reached}; a larger depth follows it on"


def creep_in_time(
    equations: Equations, loading: Loading, newton: Newton, plan: Plan, relaxation: RelaxationFunction
) -> list[Moment]:
    """Moments from the untouched sample to the end of a plan, at each of which the force is that of its load.

    Parameters
    ----------
    equations, loading, newton
        As of `viscous.press_in_time`.
    plan : Plan
    relaxation : RelaxationFunction

    Returns
    -------
    list of Moment

    Raises
    ------
    ConvergenceError
        Even the smallest step fails.
    OutOfTime

    The `part` of these errors is the tuple of moments so far.
    """
    loading = replace(loading, springs=loading.springs.scaled(relaxation.instantaneous), directions=())
    force = StressHistory.none(relaxation, (1,))
    deepest = plan.depth_at(plan.end)
    longest = min(deepest / newton.controls.first_steps, newton.controls.max_step)
    first, _ = force.ahead(plan.next(0.0, longest))
    rest = paths.untouched(equations, _as_stiff(loading, first), newton)
    moments = [Moment(0.0, rest, StressHistory.none(relaxation, _elastic(equations, loading, rest).shape), force)]
    try:
        _follow(moments, equations, loading, newton, plan, longest)
    except IndentfitError as error:
        error.part = tuple(moments)
        raise
    return moments


def _follow(moments: list[Moment], equations: Equations, loading: Loading, newton: Newton, plan: Plan, longest: float) -> None:
    """Add moments up to the end of a plan."""
    step, failed, leash, springs = np.inf, False, paths.LEASH * plan.depth_at(plan.end), loading.springs
    while moments[-1].time < plan.end * (1 - 1e-9):
        newton.controls.deadline.check()
        here = moments[-1].at_corner() if is_at(plan.load.arrived, moments[-1].time) else moments[-1]
        largest = plan.next(here.time, longest) - here.time
        if here.time == 0 and plan.early:
            largest *= EARLY
        dt, before = min(step, largest), newton.work.iterations

        def at(depth: float, here: Moment = here, dt: float = dt, failed: bool = failed, loading: Loading = loading) -> Moment:
            return in_step(here, dt, depth, leash, equations, loading, newton, failed)

        try:
            moments.append(_held(here, here.time + dt, plan, at))
        except ConvergenceError as error:
            step, failed = dt / 2, True
            loading = loading.softened() if dt < paths.SHORT * largest else loading
            short = step < SMALLEST * plan.end and step < 0.01 * plan.load.arrived
            paths._cut_back(newton, short, here.at.depth, error)
            continue
        newton.work.steps += 1
        springs, loading = firmed(springs, loading, equations, moments[-1])
        step, failed = next_step(dt, newton.work.iterations - before), False
        if newton.controls.progress is not None:
            newton.controls.progress(0.5 * (min(here.time / plan.load.arrived, 1.0) + here.time / plan.end))


def _held(here: Moment, time: float, plan: Plan, at: Callable[[float], Moment]) -> Moment:
    """The moment at a time at which the force is that of the load, by a secant in the depth.

    Raises ConvergenceError.
    """
    wanted, expected = float(plan.load.at(np.array(time))), plan.depth_at(time)
    ahead = plan.depth_at(here.time)
    share = here.at.depth / ahead if ahead > 0 else 1.0  # the model's depths go on in their ratio to the expected ones
    depth = max(share * expected, here.at.depth)
    there = at(depth)
    slope, off = there.at.stiffness, wanted - there.at.whole_force
    for _ in range(TRIES):
        if abs(off) <= HELD * wanted:
            return there
        before = depth, off
        depth += off / slope
        there = at(depth)
        off = wanted - there.at.whole_force
        if abs(depth - before[0]) > 1e-9 * depth and (before[1] - off) / (depth - before[0]) > 0:
            slope = (before[1] - off) / (depth - before[0])
    raise ConvergenceError("the depth at which the force is the one that is held was not found", depth)
