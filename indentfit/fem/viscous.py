"""Quasi-linear viscoelasticity at finite strain: the isochoric second Piola-Kirchhoff stress relaxes, the pressure does not.

With the elastic isochoric stress S_e of a law and a relaxation function m (`hereditary`), the stress is the hereditary integral of
m(t - s) dS_e(s) plus the elastic pressure's. Over a step of time in which S_e is quadratic, through the step before it too, it is

    S = c S_e + H,    c = m_inf + sum m_i k_i,    H = sum m_i (exp(-x_i) h_i - k_i S_e before the step - b_i (its last change)),

with the decays, k and b of `hereditary`, so that each step is an elastic one: of a law that is c times as stiff, on a body that
keeps the stress H. In the undeformed coordinates the forces of H are linear in the displacements (`Body.prestress`), and the
tangent is consistent.

The path goes through a ramp of the depth and a hold. Its steps of a ramp are those of an elastic path; in a hold, where only the
small redistribution of the stress changes S_e, they grow in proportion to the time since the ramp's end. A step of a hold starts
from tractions and pressures that have relaxed as the whole force does, so that little is left to iterate. The factor of an earlier
step serves the next, although that is another number of times as stiff (`contact_first` corrects this); steps of a hold, in which
the indenter rests, make no tangent.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Protocol, cast

import numpy as np

from indentfit.arrays import Array
from indentfit.errors import ConvergenceError, IndentfitError
from indentfit.fem import path as elastic
from indentfit.fem.contact_state import Springs
from indentfit.fem.controls import Controls
from indentfit.fem.equations import Equations, Loading, Memory
from indentfit.fem.equilibrium import Equilibrium
from indentfit.fem.newton import Newton
from indentfit.hereditary import Ramp, RelaxationFunction, is_at
from indentfit.material import Material

FIRST, GROWTH = 0.3, 2.0  # steps of a hold: the first in units of the shortest time that matters, the next in those since the ramp
SMALLEST = 1e-3  # step over the whole time; where this is not small enough, the path ends
VOIGT = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]])  # places of the components of a symmetric tensor: xx yy zz xy yz xz


@dataclass(frozen=True, eq=False)
class StressHistory:
    """What the stresses of a body remember.

    Parameters
    ----------
    relaxation : RelaxationFunction
    elastic : array (..., 3, 3), kPa
        Elastic isochoric second Piola-Kirchhoff stresses now.
    terms : array (n_terms, ..., 3, 3), kPa
        h of each term of the relaxation function.
    change : array (..., 3, 3), kPa
        The last change of the elastic stresses.
    before : float, s
        The step of time of that change; infinite where the next step does not go on smoothly.
    """

    relaxation: RelaxationFunction
    elastic: Array
    terms: Array
    change: Array
    before: float = np.inf

    @classmethod
    def none(cls, relaxation: RelaxationFunction, shape: tuple[int, ...]) -> StressHistory:
        """That of a body at rest, with stresses of a shape."""
        return cls(relaxation, np.zeros(shape), np.zeros((len(relaxation.times), *shape)), np.zeros(shape))

    def at_corner(self) -> StressHistory:
        """This history at a time at which the rate of the stresses jumps."""
        return replace(self, before=np.inf)

    def ahead(self, dt: float) -> tuple[float, Array]:
        """c and H (..., 3, 3), kPa, of a step of time dt, s: the stress at its end is c times the elastic one, plus H."""
        decay, gain, back = self.relaxation.steps(dt, self.before)
        shares = np.array(self.relaxation.shares)
        gained, kept = float(shares @ gain), np.tensordot(shares * decay, self.terms, 1)
        return self.relaxation.long_term + gained, kept - gained * self.elastic - float(shares @ back) * self.change

    def elastic_of(self, whole: float, dt: float) -> Array:
        """The elastic stress (...) after a step of time dt, s, of which the whole stress is `whole`, kPa."""
        factor, kept = self.ahead(dt)
        return np.asarray((whole - kept) / factor)

    def after(self, dt: float, elastic: Array) -> StressHistory:
        """The history at the end of a step of time dt, s, where the elastic stresses are `elastic` (..., 3, 3), kPa."""
        rule = self.relaxation.steps(dt, self.before)
        decay, gain, back = (factor.reshape(-1, *(1,) * elastic.ndim) for factor in rule)
        change = elastic - self.elastic
        terms = decay * self.terms + gain * change - back * self.change
        return replace(self, elastic=elastic, terms=terms, change=change, before=dt)


@dataclass(frozen=True, eq=False)
class Moment:
    """A converged step in time.

    Parameters
    ----------
    time : float, s
    at : Equilibrium
    stress : StressHistory
    force : StressHistory
        That of the force, mN, (1,): its elastic part is the one of which the steps so far make the whole force.
    """

    time: float
    at: Equilibrium
    stress: StressHistory = field(repr=False)
    force: StressHistory = field(repr=False)

    def at_corner(self) -> Moment:
        """This moment where the motion has a corner: the stresses do not go on smoothly."""
        return replace(self, stress=self.stress.at_corner(), force=self.force.at_corner())

    def share_left(self, dt: float) -> float:
        """The force after a time dt, s, in which the elastic force stays as it is, over the force now."""
        now, factor, kept = self.at.force, *self.force.ahead(dt)
        return float(factor * self.force.elastic[0] + kept[0]) / now if now > 0 else 1.0

    def stiffened(self, equations: Equations, loading: Loading, dt: float) -> Loading:
        """The loading of the next step of time, of dt, s: of a law that is c times as stiff, on a body that keeps the stress H."""
        factor, kept = self.stress.ahead(dt)
        at_rest, values = equations.body.prestress(kept)
        return replace(_as_stiff(loading, factor), memory=Memory(at_rest, equations.body.matrix(values)))

    def after(self, dt: float, there: Equilibrium, equations: Equations, loading: Loading) -> Moment:
        """The moment of an equilibrium that ends the next step of time, of dt, s."""
        force = self.force.after(dt, self.force.elastic_of(there.force, dt))
        return Moment(self.time + dt, there, self.stress.after(dt, _elastic(equations, loading, there)), force)


class _Stiffer:
    """A law that is a number of times as stiff: what a body asks of a law."""

    def __init__(self, material: Material, factor: float) -> None:
        self._material, self._factor = material, factor
        self.shear_modulus = factor * material.shear_modulus

    def gradient(self, I: Array) -> Array:
        return self._factor * self._material.gradient(I)

    def hessian(self, I: Array) -> Array:
        return self._factor * self._material.hessian(I)


class InTime(Protocol):
    """A path in time: from the equations, the loading of the elastic law and a Newton iteration to moments."""

    def __call__(self, equations: Equations, loading: Loading, newton: Newton) -> list[Moment]: ...


def press_in_time(
    equations: Equations, loading: Loading, newton: Newton, ramp: Ramp, relaxation: RelaxationFunction
) -> list[Moment]:
    """Moments from the untouched sample to the end of the hold.

    Parameters
    ----------
    equations, loading, newton
        As of `path.indent`; the loading's law is the elastic one of the relaxation function.
    ramp : Ramp
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
    first, _ = force.ahead(_largest(0.0, ramp, newton.controls, _shortest(ramp, relaxation)))
    rest = elastic.untouched(equations, _as_stiff(loading, first), newton)
    moments = [Moment(0.0, rest, StressHistory.none(relaxation, _elastic(equations, loading, rest).shape), force)]
    try:
        _follow(moments, equations, loading, newton, ramp, relaxation)
    except IndentfitError as error:
        error.part = tuple(moments)
        raise
    return moments


def _follow(
    moments: list[Moment], equations: Equations, loading: Loading, newton: Newton, ramp: Ramp, relaxation: RelaxationFunction
) -> None:
    """Add moments up to the end of the hold."""
    shortest, step, failed, springs = _shortest(ramp, relaxation), np.inf, False, loading.springs
    while moments[-1].time < ramp.end * (1 - 1e-9):
        newton.controls.deadline.check()
        here = moments[-1].at_corner() if is_at(ramp.seconds, moments[-1].time) else moments[-1]
        largest = _largest(here.time, ramp, newton.controls, shortest)
        dt, before = _to_end(here.time, min(step, largest), ramp), newton.work.iterations
        try:
            depth = float(ramp.depth_at(here.time + dt))
            moments.append(in_step(here, dt, depth, elastic.LEASH * ramp.depth, equations, loading, newton, failed))
        except ConvergenceError as error:
            step, failed = dt / 2, True
            loading = loading.softened() if dt < elastic.SHORT * largest else loading
            elastic._cut_back(
                newton, step < SMALLEST * ramp.end and step < 0.01 * ramp.seconds, float(ramp.depth_at(here.time)), error
            )
            continue
        newton.work.steps += 1
        springs, loading = firmed(springs, loading, equations, moments[-1])
        step, failed = next_step(dt, newton.work.iterations - before), False
        if newton.controls.progress is not None:
            newton.controls.progress(_share(moments[-1].time, ramp))


def firmed(springs: Springs, loading: Loading, equations: Equations, there: Moment) -> tuple[Springs, Loading]:
    """Springs that are firm under the pressures of a moment, and the loading with them, or with softer ones after a cutback: a wall
    beside a rounded edge that gives way lets points in behind it, and a path of many such points is not solved."""
    modulus = there.stress.relaxation.instantaneous * loading.material.shear_modulus
    springs = equations.face.firm(springs, there.at.contact, modulus)
    return springs, loading.stiffened(springs)


def next_step(dt: float, iterations: int) -> float:
    """The longest next step, s, after one of dt, s, that took a number of iterations."""
    return 2 * dt if iterations <= elastic.EASY else dt


def _shortest(ramp: Ramp, relaxation: RelaxationFunction) -> float:
    """The shortest time in which the force of a hold changes: what is over within the ramp has relaxed."""
    return max(min(relaxation.times, default=ramp.seconds), 0.1 * ramp.seconds)


def _largest(time: float, ramp: Ramp, controls: Controls, shortest: float) -> float:
    """The largest step of time at a time: it ends no later than the ramp, or the hold."""
    if time < ramp.seconds * (1 - 1e-9):
        longest = min(ramp.seconds / controls.first_steps, controls.max_step / ramp.depth * ramp.seconds)
        return ramp.seconds - time if time + 1.01 * longest > ramp.seconds else longest
    return _to_end(time, max(FIRST * shortest, GROWTH * (time - ramp.seconds)), ramp)


def _to_end(time: float, dt: float, ramp: Ramp) -> float:
    """A step of time in a hold, or a little longer where it then ends the hold."""
    return ramp.end - time if time >= ramp.seconds * (1 - 1e-9) and time + 1.3 * dt > ramp.end else dt


def _share(time: float, ramp: Ramp) -> float:
    """Share of the work that is done: half of it for the ramp."""
    return 0.5 * (min(time / ramp.seconds, 1.0) + (max(time - ramp.seconds, 0.0) / ramp.hold if ramp.hold else 1.0))


def in_step(
    here: Moment, dt: float, depth: float, leash: float, equations: Equations, loading: Loading, newton: Newton, relax: bool
) -> Moment:
    """The moment after a step of time at a depth, mm."""
    now = here.stiffened(equations, loading, dt)
    rests = depth == here.at.depth
    before = here.at if depth > here.at.depth else _relaxed(here.at, here.share_left(dt))
    there, *_ = elastic._step(newton, elastic._increment(equations, now, before, depth, leash), before, relax, rests)
    there = elastic._augmented(equations, now, newton, there, leash)
    there = there.since(here.at, equations.face, ()) if depth > here.at.depth else replace(there, rate=here.at.rate)
    return here.after(dt, there, equations, loading)


def _as_stiff(loading: Loading, factor: float) -> Loading:
    """A loading whose law is a number of times as stiff."""
    return replace(loading, material=cast(Material, _Stiffer(loading.material, factor)), mu=factor * loading.mu)


def _relaxed(at: Equilibrium, share: float) -> Equilibrium:
    """An equilibrium whose tractions and pressures have relaxed to a share."""
    contact = replace(at.contact, pressure=share * at.contact.pressure, friction=share * at.contact.friction)
    return replace(at, pressure=share * at.pressure, contact=contact)


def _elastic(equations: Equations, loading: Loading, at: Equilibrium) -> Array:
    """Elastic isochoric second Piola-Kirchhoff stresses (n_el, n_q, 3, 3), kPa, of an equilibrium."""
    body, fibre = equations.body, loading.fibre
    cauchy = body.stress(at.u, body.state(at.u, fibre), loading.material, np.zeros_like(at.pressure), fibre)
    return pulled_back(cauchy, body.deformation(at.u))


def pulled_back(cauchy: Array, F: Array) -> Array:
    """Second Piola-Kirchhoff stresses (..., 3, 3) of Cauchy stresses (6, ...) at deformation gradients F (..., 3, 3)."""
    sigma, G = np.moveaxis(cauchy, 0, -1)[..., VOIGT], np.linalg.inv(F)
    return np.linalg.det(F)[..., None, None] * (G @ sigma @ np.swapaxes(G, -1, -2))
