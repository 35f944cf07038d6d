"""The next experiment: which further test would determine the worst parameter best, from Fisher's information.

At given parameters every test tells sum (dF/dtheta)^2 / sigma^2 of what it would determine; information of tests adds up.
Each candidate is one further test that differs from the case in one thing, at either angle and at several depths. The
parameters' ranges count as a weak prior, uniform over them, so that nothing is infinite.
"""

from dataclasses import dataclass

import numpy as np

from indentfit.case import Test
from indentfit.curve import Curve
from indentfit.errors import DesignError, IndentfitError
from indentfit.inverse.derivatives import Underivable, curve_derivatives, evaluate_at_reference
from indentfit.inverse.objective import Target
from indentfit.inverse.problem import InverseProblem, differences_of, scale_of
from indentfit.runs.pool import RunPool

NOISE = 0.01  # of the largest force, where no noise is given
DEPTHS = (0.5, 1.0, 1.5)  # of the case's largest depth
DEEPEST = 0.2  # of the thickness: equilibria beyond are not sure to be found
POINTS = 24  # of each further test
ANGLES = (0, 90)


@dataclass(frozen=True)
class FurtherTest:
    """One further test: what of the case it changes ("" for nothing), its angle, depth in mm; stderr: of every free
    parameter with it and the case's tests together; None with a cause where it could not be computed."""

    change: str
    angle: int
    depth: float
    stderr: dict[str, float] | None
    cause: str | None = None


@dataclass(frozen=True)
class Design:
    """parameters: where the information was taken; noise: sigma, mN; stderr: of the case's own tests; worst: the parameter
    with the largest one relative to its value; candidates: best for it first, failed ones last; runs: of the model."""

    parameters: dict[str, float]
    noise: float
    stderr: dict[str, float]
    worst: str
    candidates: tuple[FurtherTest, ...]
    runs: int

    def as_json(self):
        """The stable keys of `design --json`."""
        return {
            "parameters": self.parameters,
            "noise_mN": self.noise,
            "stderr": self.stderr,
            "worst": self.worst,
            "candidates": [vars(one) for one in self.candidates],
            "runs": self.runs,
        }


def design(case, parameters=None, noise=None, progress=None):
    """Design for the free parameters of a case, at given parameters (name -> value) or at its start values.

    noise: sigma of a force, mN; by default 1 % of the largest of the case's tests. progress: called with (share, note).
    Raises DesignError where the case's own tests have no derivatives.
    """
    parameters = parameters or case.start_values()
    progress = progress or (lambda share, note: None)
    variants = list(_variants(case))
    own, forces, runs = _own(case, parameters)
    noise = noise or NOISE * max(float(force.max()) for force in forces)
    names = list(case.free)
    prior = np.diag([12 / (bounds.max - bounds.min) ** 2 for bounds in case.free.values()])
    known = prior + sum(J.T @ J for J in own) / noise**2
    now = _stderr(names, known)
    worst = max(names, key=lambda name: now[name] / (abs(parameters[name]) or case.free[name].max))
    found = []
    for n, (change, variant) in enumerate(variants):
        progress(n / len(variants), change or "as the case is")
        rows, used = _candidates(change, variant, parameters, known, noise)
        found += rows
        runs += used
    found.sort(key=lambda one: one.stderr[worst] if one.stderr else np.inf)
    return Design(dict(parameters), noise, now, worst, tuple(found), runs)


def _variants(case):
    """(what is changed, the case so changed), one thing at a time."""
    yield "", case
    for key, value in case.indenter.geometry.variants(case.sample.geometry.outline.extent):
        yield _changed(case, key, value)
    for friction in (0.0, "stick"):
        if case.indenter.friction != friction:
            yield _changed(case, "friction", friction)


def _changed(case, key, value):
    said = f"{key} {value:g} mm" if key != "friction" else "no friction" if value == 0 else "sticking"
    return said, case.model_copy(update={"indenter": case.indenter.model_copy(update={key: value})})


def _own(case, parameters):
    """Derivatives of the case's own tests, their forces, and the number of runs."""
    with RunPool(case) as pool:
        problem = _problem(case, parameters)
        slopes = _slopes(problem, pool, parameters)
        evaluation = evaluate_at_reference(problem, pool, [parameters])[0]
        return slopes, problem.scaled(parameters, evaluation.forces), pool.runs


def _candidates(change, variant, parameters, known, noise):
    """The further tests of one variant: both angles, all depths, from one run each to the deepest."""
    deepest = max(float(variant.outputs(test)[-1]) for test in variant.tests)
    allowed = [factor for factor in DEPTHS if factor * deepest <= DEEPEST * variant.sample.thickness] or [DEPTHS[0]]
    cause, used = "", 0
    while allowed:
        tests = tuple(Test(name=f"{angle}", angle=angle, depth=allowed[-1] * deepest, points=6 * POINTS) for angle in ANGLES)
        tried = variant.model_copy(update={"tests": tests, "curves": (None,) * len(tests)})
        try:
            with RunPool(tried) as pool:
                slopes = _slopes(_problem(tried, parameters), pool, parameters)
                used += pool.runs
            return list(_rows(change, tried, slopes, allowed, deepest, known, noise)), used
        except IndentfitError as error:
            cause = str(error)
            allowed = allowed[:-1]  # shallower, equilibrium may be found
    return [FurtherTest(change, angle, deepest, None, cause) for angle in ANGLES], used


def _rows(change, case, slopes, allowed, deepest, known, noise):
    names = list(case.free)
    for test, J in zip(case.tests, slopes, strict=True):
        depths = case.outputs(test)
        for factor in allowed:
            within = depths <= factor * deepest * (1 + 1e-9)
            rows = np.linspace(0, np.count_nonzero(within) - 1, POINTS).round().astype(int)
            more = J[within][rows]
            yield FurtherTest(change, test.angle, factor * deepest, _stderr(names, known + more.T @ more / noise**2))


def _slopes(problem, pool, parameters):
    """dF/dtheta of every test, (n, n_free), mN per unit of a parameter. Raises DesignError."""
    ranges = np.array([problem.range(name) for name in problem.free])
    try:
        return [J / ranges for J in curve_derivatives(problem, pool, problem.units(parameters))]
    except Underivable as failure:
        raise DesignError(f"no design without derivatives: {failure}") from failure


def _problem(case, parameters):
    """An InverseProblem whose tests have only displacements: enough for derivatives."""
    tests = tuple(Target(test.name, Curve(case.outputs(test), case.outputs(test)), 1.0) for test in case.tests)
    scale, reference = scale_of(case)
    return InverseProblem(tests, dict(parameters), case.free, scale, reference, differences_of(case))


def _stderr(names, information):
    return dict(zip(names, np.sqrt(np.diag(np.linalg.inv(information))).tolist(), strict=True))
