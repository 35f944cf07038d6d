"""The force that a fit predicts of other tests, at another depth or under another indenter: bands by parameters, law and noise.

The model is run in the middle of the fit's draws, and at both ends of each direction in which they spread (their principal
components). A polynomial of second order in each direction goes through these runs, and gives the force F of the law at every draw;
two further runs, at draws, state what it errs. These forces are corrected for the mesh where those of the fit were. The force of a
draw is F / (1 - e), where e is the law's misfit. Where a test of the
same name was fitted with the same indenter and sample, e goes on from the misfit of the draw there; otherwise it is another draw of
the process (`inference.discrepancy`), as much larger or smaller as the strains are than those of the fitted tests. Bands are
quantiles of all draws.

Beyond the fitted depth no force tells how the misfit goes on. Under the process it bends back towards the law, but the laws of
tissues mostly part further as strains grow. So it bends back in one half of the draws; in the other it goes on as it ends, straight
in its size relative to the strains. What the process leaves open grows there with the square of the depth.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np

from indentfit.arrays import Array, Ints
from indentfit.axes import INDENTATION, Axes
from indentfit.case import Case, Test
from indentfit.case.specimen import axes_of
from indentfit.errors import CaseError
from indentfit.fem.result import ForceError, TestResult
from indentfit.inference.discrepancy import covariances, growth
from indentfit.inference.law_misfit import LawMisfit, PosteriorDraws
from indentfit.inference.quantiles import normal_quantiles
from indentfit.inference.result import FitResult
from indentfit.inverse.problem import scale_of
from indentfit.runs.forward import simulate
from indentfit.runs.points import case_at

ENDS = 1.5  # standard deviations of the draws, at which the model is run
SPREAD = 1e-6  # of the values: directions in which draws spread less need no run
PROVING = 2  # further runs, at single draws
MOST = 0.9  # share of the force that the misfit of the law can be
BAND = 1.96  # standard deviations of the stated error of a mesh
TIMES = 10  # misfits that go with each draw
GOES_ON, GROWS = 0.5, 2.0  # share of draws whose misfit goes on as it ends; power of the depth with which the others' errors grow
STEP = 1e-3  # of the largest fitted depth: where the slope at the end is taken
NEEDS = (
    "the fit has no term for the misfit of its law, without which a band would be too narrow; fit again with --set "
    "fit.discrepancy.scale=unknown, and predict from that"
)


@dataclass(frozen=True)
class PredictedTest:
    """One predicted test; all rows (n,), mm and mN, or strain and kPa where the test shows these.

    Parameters
    ----------
    displacement
    force, low, high
        Median of the sample's force, and its 95 % band by parameters, inputs, the law's misfit and the mesh.
    measured_low, measured_high
        The 95 % band of a measured force: with the noise of the fitted tests.
    law
        The law's own force, median.
    continued : bool
        Whether the misfit goes on from that of the fitted test of the same name.
    known_to : float or None
        Largest displacement of that fitted test, mm or strain; None where the misfit does not go on from one. Farther on, the band
        presumes how the misfit goes on, and no curve tells whether it holds 95 %.
    strained : float or None
        Largest strain over that of the fitted tests, of which the least counts, where the misfit does not go on from one. Above 1,
        the band presumes that the misfit grows in proportion.
    axes : Axes
        The quantities that `displacement` and the forces are.
    """

    displacement: tuple[float, ...]
    force: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    measured_low: tuple[float, ...]
    measured_high: tuple[float, ...]
    law: tuple[float, ...]
    continued: bool
    known_to: float | None = None
    strained: float | None = None
    axes: Axes = INDENTATION


@dataclass(frozen=True)
class Prediction:
    """What a fit predicts of the tests of a case.

    Parameters
    ----------
    title : str
    tests : dict of test -> PredictedTest
    runs : int
        Sets of parameters and inputs at which the model was run.
    off : float
        By what runs at single draws differ from the polynomial, largest relative difference; it widens the bands.
    """

    FORMAT: ClassVar[str] = "indentfit.prediction/2"

    title: str
    tests: dict[str, PredictedTest]
    runs: int
    off: float

    def as_json(self) -> dict[str, Any]:
        """The stable keys of `predict --json`, under the tag `format`."""
        return {"format": self.FORMAT, **asdict(self)}

    def summary(self) -> str:
        """The prediction in words, as the command prints it."""
        from indentfit.report.prediction import prediction_lines

        return "\n".join(prediction_lines(self))


def predict(result: FitResult, case: Case, progress: Callable[[float, str], object] | None = None) -> Prediction:
    """The forces that a fit predicts of the tests of a case.

    Parameters
    ----------
    result : FitResult
        Of a case with [fit.discrepancy]; with its case.
    case : Case
        The fitted case with other tests, or another indenter or sample.
    progress : function
        Called with the share of the work that is done, and a note.

    Returns
    -------
    Prediction

    Raises
    ------
    CaseError
        The fit cannot be used for this.
    ConvergenceError
        A run failed.
    """
    known, fitted = result.law_misfit, result.case
    if known is None or fitted is None:
        raise CaseError([NEEDS])
    _require_same_law(fitted, case)
    rng, draws = np.random.default_rng(result.seed), known.draws
    points = [dict(zip(draws.names, row, strict=True)) for row in draws.values]
    forces: dict[str, Array] = {test.name: np.zeros((len(points), case.outputs(test).size)) for test in case.tests}
    errors = {name: np.zeros(rows.shape) for name, rows in forces.items()}
    runs, off = 0, 0.0
    for number, changes in enumerate(draws.changes):
        own = [n for n, alternative in enumerate(draws.alternative) if alternative == number]
        if own:
            laws = _Laws(case_at(case, changes), [points[n] for n in own], bool(fitted.fit.uncertain.mesh), progress)
            rows, difference = laws.forces()
            runs, off = runs + laws.runs, max(off, difference)
            for name, part in rows.items():
                forces[name][own], errors[name][own] = part, laws.errors[name] * np.abs(part)
    tests = {
        test.name: _band(test, forces[test.name], errors[test.name], _Beside(known, fitted, case, off), rng) for test in case.tests
    }
    return Prediction(case.title, tests, runs, off)


def _require_same_law(fitted: Case, case: Case) -> None:
    if case.law.parameters.keys() != fitted.law.parameters.keys() or case.material.model != fitted.material.model:
        raise CaseError([f"material: the fit is one of {fitted.material.model or 'another law'}; predict with the same law"])
    if case.relaxation is not None:
        raise CaseError(["material.relaxation: forces are predicted of elastic materials; remove the table"])
    kinds = {test.kind for test in fitted.tests}
    for test in case.tests:
        if test.kind not in kinds:
            said = f"the fit knows the misfit of its law in {', '.join(sorted(kinds))} only; predict tests of that kind"
            raise CaseError([f"test.{test.name}.kind = {test.kind!r}: {said}"])


class _Laws:
    """The law's forces at draws of one alternative, from a few runs."""

    def __init__(
        self, case: Case, points: Sequence[dict[str, float]], corrects: bool, progress: Callable[[float, str], object] | None
    ) -> None:
        self.case, self.corrects, self.progress = case, corrects, progress
        self.names = list(points[0])
        self.scale = scale_of(case)[0]
        self.values = np.array([[point[name] for name in self.names] for point in points])
        self.middle = self.values.mean(axis=0)
        self.runs, self.places, self.rows = 0, [], []  # type: ignore[var-annotated]
        self.errors: dict[str, Array] = {}  # standard deviations of the forces by the mesh, relative
        self.corrections: dict[str, Array] = {}  # relative
        moving = [n for n, name in enumerate(self.names) if name != self.scale]
        spread = self.values.std(axis=0)
        self.moving = [n for n in moving if spread[n] > SPREAD * max(abs(self.middle[n]), SPREAD)]
        self.spread = spread[self.moving]
        apart = (self.values[:, self.moving] - self.middle[self.moving]) / np.maximum(self.spread, 1e-300)
        _, sizes, directions = np.linalg.svd(apart, full_matrices=False) if self.moving else (None, np.zeros(0), np.zeros((0, 0)))
        counted = sizes > 1e-3 * max(sizes.max(initial=0.0), 1e-300)
        self.directions, self.sizes = directions[counted], sizes[counted] / np.sqrt(len(points))
        self.t = apart @ self.directions.T / np.maximum(self.sizes, 1e-300) if self.moving else np.zeros((len(points), 0))

    def forces(self) -> tuple[dict[str, Array], float]:
        """Forces of each test at every draw, (draws, n), and the largest relative difference of a run from them."""
        k = self.t.shape[1]
        steps = [np.zeros(k), *(side * ENDS * np.eye(k)[n] for n in range(k) for side in (-1, 1))]
        total = len(steps) + (min(PROVING, len(self.values)) if k else 0)
        for number, step in enumerate(steps):
            self._run(self._at(step), number, total)
        places = np.array(self.places)
        columns = np.hstack([np.ones((len(places), 1)), places, places**2])
        wanted = np.hstack([np.ones((len(self.t), 1)), self.t, self.t**2])
        weights = wanted @ np.linalg.pinv(columns)
        at_draws = {name: weights @ np.array([row[name] for row in self.rows]) for name in self.rows[0]}
        off, far = 0.0, np.argsort(-np.abs(self.t).sum(axis=1))[: total - len(steps)].tolist()
        for number, n in enumerate(far, start=len(steps)):
            exact = self._forces_at(self.values[n], number, total)
            off = max(off, *(_largest(at_draws[name][n], force) for name, force in exact.items()))
        return {name: rows * self._factors()[:, None] for name, rows in at_draws.items()}, off

    def _at(self, step: Array) -> Array:
        """Values at steps along the principal components, within the range of the draws."""
        values = self.middle.copy()
        values[self.moving] += self.spread * ((step * self.sizes) @ self.directions)
        return np.clip(values, self.values.min(axis=0), self.values.max(axis=0))

    def _factors(self) -> Array:
        """The scale of each draw over that of the runs, (draws,)."""
        if self.scale not in self.names:
            return np.ones(len(self.values))
        n = self.names.index(self.scale)
        return np.asarray(self.values[:, n] / self.middle[n])

    def _run(self, values: Array, number: int, total: int) -> None:
        self.rows.append(self._forces_at(values, number, total))
        apart = (values[self.moving] - self.middle[self.moving]) / np.maximum(self.spread, 1e-300)
        self.places.append(apart @ self.directions.T / np.maximum(self.sizes, 1e-300) if self.moving else np.zeros(0))

    def _forces_at(self, values: Array, number: int, total: int) -> dict[str, Array]:
        """Forces at values, with the scale in the middle; the first run states the error of the mesh too."""
        if self.progress is not None:
            self.progress(number / total, f"run {number + 1} of {total}")
        point = dict(zip(self.names, values.tolist(), strict=True))
        if self.scale in point:
            point[self.scale] = float(self.middle[self.names.index(self.scale)])
        there = case_at(self.case, point)
        own = {name: point.get(name, start) for name, start in there.start_values().items()}
        made = simulate(there, own, mesh_error=not self.runs)
        self.runs += 1
        if not self.errors:
            for test in made.tests:
                self.corrections[test.name], self.errors[test.name] = self._mesh(test)
        return {test.name: test.force * (1 + self.corrections[test.name]) for test in made.tests}

    def _mesh(self, test: TestResult) -> tuple[Array, Array]:
        """The correction for the mesh, and the standard deviation of what is left, both relative to the force, (n,)."""
        none, error = np.zeros(test.force.size), test.mesh_error
        if not isinstance(error, ForceError):
            return none, none
        if self.corrects:
            return error.correction, error.left
        return none, error.band / BAND / np.maximum(np.abs(test.force), 1e-300)


def _largest(predicted: Array, force: Array) -> float:
    return float(np.max(np.abs(predicted - force)) / np.max(np.abs(force)))


@dataclass(frozen=True, eq=False)
class _Beside:
    """What a prediction needs beside the law's forces: the fitted misfit and case, and the error of the polynomial."""

    known: LawMisfit
    fitted: Case
    case: Case
    off: float

    def continued(self, test: Test) -> Test | None:
        """The fitted test of the same name with the same indenter, sample and fibres."""
        for other in self.fitted.tests:
            if other.name == test.name and other.name in self.known.draws.errors and _alike(self.fitted, other, self.case, test):
                return other
        return None


def _alike(fitted: Case, other: Test, case: Case, test: Test) -> bool:
    if other.kind != "indentation":
        dropped = {"curve": None, "points": None, "strain": None, "weight": None, "depth": None}
        return other.model_copy(update=dropped) == test.model_copy(update=dropped)
    mine = case.sample_of(test), case.indenter_of(test), case.fibres_of(test)
    return (fitted.sample_of(other), fitted.indenter_of(other), fitted.fibres_of(other)) == mine


def _band(test: Test, law: Array, error: Array, beside: _Beside, rng: np.random.Generator) -> PredictedTest:
    """The band of forces law (draws, n), whose errors by the mesh have standard deviations (draws, n)."""
    depth, draws = np.abs(beside.case.outputs(test)), beside.known.draws
    which = np.repeat(np.arange(len(law)), TIMES)
    other, strained = beside.continued(test), None
    if other is not None:
        misfit = _continued(test, other, depth, beside, which, rng)
    else:
        strained = _strained(test, float(depth.max()), beside)
        covar = strained**2 * covariances(depth / depth.max(), depth / depth.max(), growth(beside.case, test), beside.known.length)
        misfit = _drawn(covar, draws, which, rng)
    force = law[which] / (1 - np.clip(misfit, -MOST, MOST))
    sd = np.hypot(error[which], beside.off * np.abs(force))
    of_point = np.array(draws.noise.get(test.name) or np.sqrt(np.mean(np.square(list(draws.noise.values())), axis=0)))
    low, middle, high = normal_quantiles(force, sd)
    measured_low, _, measured_high = normal_quantiles(force, np.hypot(sd, of_point[which][:, None]))
    return PredictedTest(
        displacement=_row(beside.case.outputs(test)),
        force=_row(middle),
        low=_row(low),
        high=_row(high),
        measured_low=_row(measured_low),
        measured_high=_row(measured_high),
        law=_row(np.median(law, axis=0)),
        continued=other is not None,
        known_to=None if other is None else float(np.abs(beside.fitted.outputs(other)).max()),
        strained=strained,
        axes=axes_of(test),
    )


def _row(values: Array) -> tuple[float, ...]:
    return tuple(values.tolist())


def _continued(test: Test, other: Test, depth: Array, beside: _Beside, which: Ints, rng: np.random.Generator) -> Array:
    """The relative misfit (m, n) that goes with draws of the numbers which (m,), given that of the fitted test at some depths."""
    draws, length = beside.known.draws, beside.known.length
    deepest = float(np.abs(beside.fitted.outputs(other)).max())
    there, q = np.array(draws.places[other.name]), growth(beside.case, test)
    x, known = depth / deepest, np.array(draws.errors[other.name])[which]
    inverse = np.linalg.pinv(covariances(there, there, q, length), rcond=1e-8, hermitian=True)
    across = covariances(x, there, q, length) @ inverse
    left = covariances(x, x, q, length) - across @ covariances(there, x, q, length)
    mean, beyond = known @ across.T, x > 1
    ends = np.array([1 - STEP, 1.0])
    before, last = (known @ (covariances(ends, there, q, length) @ inverse).T / ends**q).T
    straight = (last[:, None] + (last - before)[:, None] / STEP * (x - 1)) * x**q
    goes_on = rng.random(len(which)) < GOES_ON
    mean = np.where(goes_on[:, None] & beyond, straight, mean)
    return np.asarray(mean + _drawn(left, draws, which, rng) * np.maximum(x, 1.0) ** GROWS)


def _strained(test: Test, deepest: float, beside: _Beside) -> float:
    """The largest strain of a test over the least one of the fitted tests of its kind."""
    fitted, known = beside.fitted, beside.known
    least = min(
        strain_of(fitted, other, float(np.abs(fitted.outputs(other)).max()))
        for other in fitted.tests
        if other.kind == test.kind and other.name in known.draws.errors
    )
    return strain_of(beside.case, test, deepest) / least


def strain_of(case: Case, test: Test, depth: float) -> float:
    """A measure of the strains at a depth: the depth over the contact's half-width, or the thickness where that is less."""
    if test.kind != "indentation":
        return depth
    width = case.indenter_of(test).geometry.partition(depth).half_width
    return depth / min(width, case.sample_of(test).thickness or width)


def _drawn(covar: Array, draws: PosteriorDraws, which: Ints, rng: np.random.Generator) -> Array:
    """Draws of a process of this covariance (n, n) at scale 1, times the scale of the draws of the numbers which (m,), (m, n)."""
    values, vectors = np.linalg.eigh(covar)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    scales = np.array(draws.scale)[which][:, None]
    return np.asarray(scales * (rng.standard_normal((len(which), len(covar))) @ root.T))
