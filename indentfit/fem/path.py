"""Equilibria along the indentation: steps of depth with cutback and regrowth.

A step starts from the tangent prediction u + du/dd * step (one solve with the factor at hand) and is repeated with half its
length when Newton's iteration fails. The curve between the steps is a spline, so the number of steps does not depend on the
requested outputs.
"""

from dataclasses import replace

import numpy as np

from indentfit.arrays import Array
from indentfit.errors import ConvergenceError, IndentfitError
from indentfit.fem.contact_state import Stride
from indentfit.fem.controls import FIRST_STEPS
from indentfit.fem.equations import Equations, Increment, Iterate, Led, Loading
from indentfit.fem.equilibrium import Equilibrium
from indentfit.fem.meshed import require_together
from indentfit.fem.newton import INVERTED, Newton
from indentfit.fem.relaxation import relaxed

WITHHELD, MAX_AUGMENTATIONS = 2e-3, 3  # share of the force that the springs may withhold
STIFFENING_STEPS = 16  # steps to the last depth, at most, of a curve that stiffens
LEASH = 0.03  # largest motion of a point in one iteration, over the last depth
SMALLEST_STEP = 1e-2  # over the last depth; where this is not small enough, other springs or another mesh cost less than halving
SHORT = 0.6  # over the largest step: a shorter step follows a cutback; it may be relaxed, and its springs softened
TURN = 1.15  # ratio of the stiffnesses after and before a step, from which the spline between the steps needs shorter ones
# Steps longer than LONGEST_STEEP of the depth are halved where the force grows, in a step, by the share STEEP more than the power
# CUBE of the depth would: the spline between the steps erred by up to 2 % there, and by 20 % under a Demiray law of b = 20. With
# friction steps are shorter from the start, and still shorter ones make points chatter.
LONGEST_STEEP, CUBE, STEEP = 1 / 23, 3.0, 0.25
CRAWLED = "{iterations} iterations led no further"
EASY, HARD = 6, 10  # iterations below which the step grows, above which it shrinks


def indent(equations: Equations, loading: Loading, newton: Newton, depths: Array) -> list[Equilibrium]:
    """Equilibria from zero to the last depth; the first equilibrium is the untouched sample.

    Parameters
    ----------
    equations : Equations
    loading : Loading
    newton : Newton
    depths : array (n,), mm
        Depths in rising order.

    Returns
    -------
    list of Equilibrium

    Raises
    ------
    ConvergenceError
        Even the smallest step fails, or the iterations of the controls are used up.
    OutOfTime

    The `part` of these errors, and of what the progress function raises, is the tuple of equilibria so far.
    """
    path = [untouched(equations, loading, newton)]
    try:
        _follow(path, equations, loading, newton, float(depths[-1]))
    except IndentfitError as error:
        error.part = tuple(path)
        raise
    return path


def _follow(path: list[Equilibrium], equations: Equations, loading: Loading, newton: Newton, last: float) -> None:
    """Add equilibria to a path up to the last depth."""
    springs, largest = loading.springs, min(newton.controls.max_step, last / newton.controls.first_steps)
    step, begun = largest, newton.controls.first_depth * last
    while path[-1].depth < last * (1 - 1e-12):
        newton.controls.deadline.check()
        here = path[-1]
        if newton.work.iterations > newton.controls.most_iterations:
            raise ConvergenceError(CRAWLED.format(iterations=newton.work.iterations), here.depth, newton.work.steps + 1)
        step = min(step, largest, last - here.depth)
        depth = _target(here.depth, step, begun, largest, last)
        short = step < SHORT * largest
        try:
            increment = _increment(equations, loading, here, depth, LEASH * last)
            there, iterations, ahead = _step(newton, increment, here, short)
        except ConvergenceError as error:
            step, begun = step if depth == begun else (depth - here.depth) / 2, np.inf
            if newton.controls.first_steps < FIRST_STEPS:
                largest = min(largest, last / FIRST_STEPS)  # full steps would leave the path again at its next fold
            loading = loading.softened() if short else loading
            _cut_back(newton, step < SMALLEST_STEP * last, depth, error)
            continue
        newton.work.steps, equations = newton.work.steps + 1, ahead
        springs = equations.face.firm(springs, there.contact, loading.material.shear_modulus)
        loading = loading.stiffened(springs)
        there = _augmented(equations, loading, newton, there, LEASH * last).since(here, equations.face, loading.directions)
        require_together(equations.body, there, newton.work.steps)
        path.append(there)
        if newton.controls.progress is not None:
            newton.controls.progress(depth / last)
        step = _next_step(step, iterations, SMALLEST_STEP * last)
        if largest > LONGEST_STEEP * last and _steep(path[-1], largest):
            largest /= 2
        few = newton.controls.first_steps < FIRST_STEPS
        if few and path[-1].stiffness > TURN * here.stiffness and largest > last / STIFFENING_STEPS:
            largest /= 2
            if len(path) == 2:
                path.pop()  # the first step is taken again, since no shorter one before it carries the spline


def _steep(there: Equilibrium, step: float) -> bool:
    """Whether the force grows too steeply for a spline through such steps: like an exponential, faster than any layer's powers."""
    return there.force > 0 and (there.stiffness * there.depth / there.force - CUBE) * step / there.depth > STEEP


def _target(here: float, step: float, begun: float, largest: float, last: float) -> float:
    """The depth to which the next step goes: the first to where the path has begun, and the second to the end of a usual first."""
    if here + 1.01 * step > last:
        return last
    if here == 0 and begun < step:
        return begun
    return largest if here == begun and begun < step == largest else here + step


def untouched(equations: Equations, loading: Loading, newton: Newton) -> Equilibrium:
    """The state before indentation, with the motion and stiffness at the start of indentation."""
    body, face = equations.body, equations.face
    u = np.zeros(body.n_dofs)
    at = Iterate(u, body.pressure(body.state(u, loading.fibre), loading.volumetric))
    increment = Increment(equations, loading, 0.0, face.rest(), tuple(face.no_change() for _ in loading.directions))
    return newton.settled(increment.linearised(at), at_rest=True)


def _increment(equations: Equations, loading: Loading, here: Equilibrium, depth: float, leash: float) -> Increment:
    """The increment that leads from an equilibrium to a depth: its contact's multipliers follow their rates."""
    stride = Stride(depth - here.depth, here.step, equations.face.ahead)
    history = here.contact.advanced(here.rate, stride)
    changes = None if here.derivatives is None else here.derivatives.advanced(here.contact, here.rate, stride)
    return Increment(equations, loading, depth, history, changes, leash)


def _step(
    newton: Newton, increment: Increment, here: Equilibrium, relax: bool, rests: bool = False
) -> tuple[Equilibrium, int, Equations]:
    """The equilibrium of an increment from the tangent prediction, by Newton's iteration or relaxation, the iterations, and its
    equations, whose layers lie where the path leads them; rests: whether the indenter does not move."""
    at, increment = _predicted(increment, here), _laid(increment, here)
    try:
        return *newton.equilibrium(increment, at, rests=here if rests else None), increment.equations
    except ConvergenceError as first:
        if not relax:
            raise
        newton.solver.forget()
        try:
            return *relaxed(newton, increment, at), increment.equations
        except ConvergenceError as error:
            raise (first if INVERTED in first.cause else error) from None  # the first error says more than the last residual


def _laid(increment: Increment, here: Equilibrium) -> Increment:
    """The increment with layers that slide laid on each other where the secant of the last step leads."""
    equations, ahead = increment.equations, increment.depth - here.depth
    if not equations.follow:
        return increment
    u, led = here.u + ahead * here.course, None
    if increment.changes and here.derivatives is not None:
        moves, courses = here.derivatives.moves, here.derivatives.courses
        assert moves is not None
        led = Led(u, moves if courses is None else moves + ahead * courses)
    return replace(increment, equations=equations.sliding_on(u), led=led)


def _predicted(increment: Increment, here: Equilibrium) -> Iterate:
    """The iterate on the path's tangent; the step is shortened where it would turn an element inside out."""
    body, fibre = increment.equations.body, increment.loading.fibre
    for share in (1.0, 0.5, 0.25, 0.0):
        u = here.u + share * (increment.depth - here.depth) * (here.course if here.wild else here.motion)
        if body.state(u, fibre).valid:
            return Iterate(u, here.pressure + increment.linear_pressure(body.dilatation_map(here.u), u - here.u))
    raise ConvergenceError(INVERTED, increment.depth)


def _cut_back(newton: Newton, too_short: bool, depth: float, error: ConvergenceError) -> None:
    """Count a step that failed. Raises ConvergenceError where half of it would be too short."""
    newton.work.cutbacks += 1
    newton.solver.forget()
    if too_short:
        raise ConvergenceError(error.cause, depth, newton.work.steps + 1, error.iteration) from error


def _augmented(equations: Equations, loading: Loading, newton: Newton, there: Equilibrium, leash: float) -> Equilibrium:
    """The step solved again at its depth with its own multipliers while the springs withhold too much of the force."""
    for _ in range(MAX_AUGMENTATIONS):
        if abs(there.penalty_error) <= WITHHELD * abs(there.force):
            break
        try:
            there, *_ = _step(newton, _increment(equations, loading, there, there.depth, leash), there, relax=True)
        except ConvergenceError:
            break  # the larger penalty error is reported
    return there


def _next_step(step: float, iterations: int, smallest: float) -> float:
    if iterations <= EASY:
        return 1.5 * step
    return max(step / 1.5, smallest) if iterations >= HARD else step
