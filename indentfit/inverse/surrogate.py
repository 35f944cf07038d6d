"""A surrogate of the forward model: polynomials in the searched parameters, for whole force curves at once.

Where the material relaxes, the polynomials are those of the elastic forces on grids of depths, which the kernel of the problem maps
to the measured times, exactly in the parameters of the relaxation.

The polynomials are those of `polynomials`. The betas that stretch the ranges, and the degree, are those that best predict each run
from all other runs. Runs near the optimum weigh more; sensitivities, where runs have them, are fitted too.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from indentfit.arrays import Array, Bools, Ints
from indentfit.inverse import polynomials
from indentfit.inverse.derivatives import given_by
from indentfit.inverse.polynomials import OF_SLOPES, warp
from indentfit.inverse.problem import Candidate, InverseProblem
from indentfit.runs.forward import Evaluation, Report
from indentfit.runs.relaxing import BULK

BETAS = (0.0, 3.0, 10.0, 30.0)
DEGREES = range(1, 9)
WIDEST_DEGREE, MOST_COEFFICIENTS = 6, 126  # of a problem that is widened by uncertain inputs: its degree is as high as both allow
SMALLER = 0.3  # of such a problem: expected size of the coefficients of one degree over that of the degree below
UNEXPLAINED = 0.003  # the same: expected error of such a polynomial, over the forces
LEAST_MISFIT = 1e-3  # over the measured forces' root mean square: runs with a smaller misfit all weigh the same
LEAST_MISFIT_WIDE = 0.02  # the same, of a problem that is widened by uncertain inputs
FAILED_NEAR = "the mechanics failed at the nearest point that was run"


@dataclass(frozen=True, eq=False)
class TrainingRun:
    """One run to which a surrogate is fitted.

    Parameters
    ----------
    place : array (d,)
        Searched parameters with which runs change, in units of the ranges.
    curves : array (N,), mN
        Curves of all tests in a row, at the reference scale; elastic ones where the material relaxes.
    slopes : array (N, d), or None
        Derivatives of the curves by the place; a column of NaN for a parameter by which the run has none.
    weight : float
    """

    place: Array
    curves: Array
    slopes: Array | None
    weight: float


@dataclass(frozen=True, eq=False)
class Fitted:
    """A polynomial that was fitted to runs.

    Parameters
    ----------
    betas : array (d,)
        The stretch of each range.
    degree : int
        Total degree.
    coefficients : array (coefficients, N), mN
    error : float
        Root mean square error of the prediction of each run from all others, as a share of max(misfit, floor).
    left_out : array (m, N) or None
        Errors of the predictions of each run from all others, in the same shares.
    shifts : array (m, coefficients, N) or None, mN
        What the coefficients lose where each run is left out.
    """

    betas: Array
    degree: int
    coefficients: Array
    error: float
    left_out: Array | None = None
    shifts: Array | None = None


@dataclass(frozen=True, eq=False)
class Surrogate:
    """Curves of an inverse problem as polynomials: a ForwardModel whose evaluations need no run and have all sensitivities.

    Parameters
    ----------
    problem : InverseProblem
    training : tuple of TrainingRun
    failed : array (m, d)
        Places of the runs that failed, units of the ranges.
    fitted : Fitted
    correction : array (N,) or None
        Factors on the forces at the measured times by the correction for the mesh, where the material relaxes.
    of_measured : bool
        Whether the polynomials are those of the measured forces also where the material relaxes: they are linear then.
    """

    problem: InverseProblem
    training: tuple[TrainingRun, ...]
    failed: Array
    fitted: Fitted
    runs: int = 0  # of the mechanics
    failures: tuple[Evaluation, ...] = ()
    correction: Array | None = None
    of_measured: bool = False

    @property
    def degree(self) -> int:
        """Total degree of the polynomials."""
        return self.fitted.degree

    @property
    def error(self) -> float:
        """Error of the prediction of each run from all others (see `Fitted`)."""
        return self.fitted.error

    def differentiable(self) -> frozenset[str]:
        """All searched parameters."""
        return frozenset(self.problem.searched)

    def evaluate(
        self,
        points: Sequence[Mapping[str, Any]],
        report: Report | None = None,
        sensitivities: Collection[str] = (),
    ) -> list[Evaluation]:
        """Evaluations of points (name -> value), with the sensitivities by all searched parameters where any are asked for."""
        places = np.array([self.problem.place(point) for point in points])
        slopes = self.slopes(places) if sensitivities else [None] * len(points)
        predicted = zip(points, self.curves(places), slopes, self.near_failure(places), strict=True)
        return [self._evaluation(*known) for known in predicted]

    def curves(self, places: Array) -> Array:
        """Curves of all tests in a row, (m, N) mN at the reference scale, at places (m, d) in units of the ranges."""
        if self.problem.kernel is None or self.of_measured:
            return self._runs(places)
        return self.relaxed(self.of_kernel(places), places)

    def of_kernel(self, places: Array) -> Array:
        """Curves of the runs themselves at places (m, d), (m, N_elastic), which `relaxed` takes."""
        return self._runs(self.of_runs(places))

    def relaxed(self, elastic: Array, places: Array) -> Array:
        """Curves at the measured times (m, N), from those of the runs (m, N_elastic), at places (m, d)."""
        rows = [self._relaxed(row, self._values(place)) for row, place in zip(elastic, places, strict=True)]
        return np.array(rows).reshape(len(places), -1)

    def measured(self, rows: Array, values: Mapping[str, float]) -> Array:
        """Rows (..., N) at the measured times of rows of the runs, such as their errors, with the relaxation of `values`."""
        return rows if self.problem.kernel is None or self.of_measured else self._relaxed(rows, values)

    def at_moved(self, place: Array, moves: Sequence[Array], by_offset: Sequence[Array]) -> tuple[Array, Array, Array]:
        """Curves (N,) and slopes (d, N) at one place (d,) where the material relaxes and the elastic curves of each test are moved
        along the depth by operators (n_grid, n_grid), and what further operators make of each test's own, (tests, N)."""
        own, kernel = self.of_runs(place[None]), self.problem.kernel
        assert kernel is not None
        elastic, slopes = self._runs(own)[0], self._slopes_of_runs(own)[0]
        parts = [slice(end - size, end) for end, size in zip(np.cumsum(kernel.sizes), kernel.sizes, strict=True)]
        ahead = np.zeros((len(parts), elastic.size))
        for n, part in enumerate(parts):
            ahead[n, part] = by_offset[n] @ elastic[part]
        moved, moved_slopes = elastic.copy(), slopes.copy()
        for move, part in zip(moves, parts, strict=True):
            moved[part], moved_slopes[:, part] = move @ elastic[part], slopes[:, part] @ move.T
        return self._relaxed_with_slopes(moved, moved_slopes, place, ahead)

    def slopes(self, places: Array) -> Array:
        """Derivatives of the curves by the units, (m, d, N)."""
        if self.problem.kernel is None or self.of_measured:
            return self._slopes_of_runs(places)
        own = self.of_runs(places)
        triples = zip(self._runs(own), self._slopes_of_runs(own), places, strict=True)
        return np.array([self._relaxed_with_slopes(row, slopes, place)[1] for row, slopes, place in triples])

    def of_runs(self, places: Array) -> Array:
        """The columns of places (..., d) by which runs differ."""
        return places[..., : len(self.fitted.betas)]

    def _runs(self, places: Array) -> Array:
        if not self.fitted.betas.size:
            return np.repeat(self.fitted.coefficients, len(places), axis=0)
        return polynomials.values(places, self.fitted.betas, self.degree) @ self.fitted.coefficients

    def spread(self, place: Array) -> Array:
        """The jackknife's errors of the curves at one place (d,), (m, N) mN at the reference scale.

        Each row is what the curves lose where one of the m runs is left out; infinite where a run alone determines a coefficient.
        """
        fitted = self.fitted
        if fitted.shifts is None:
            return np.full((1, sum(test.curve.force.size for test in self.problem.tests)), np.inf)
        lost = polynomials.values(self.of_runs(place)[None], fitted.betas, fitted.degree)[0] @ fitted.shifts
        return lost if self.problem.kernel is None or self.of_measured else self._relaxed(lost, self._values(place))

    def _slopes_of_runs(self, places: Array) -> Array:
        betas, coefficients = self.fitted.betas, self.fitted.coefficients
        if not betas.size:
            return np.zeros((len(places), 0, coefficients.shape[1]))
        rows = np.array([A @ coefficients for A in polynomials.by_units(places, betas, self.degree)])
        return rows.reshape(len(betas), len(places), coefficients.shape[1]).swapaxes(0, 1)

    def at(self, place: Array) -> tuple[Array, Array]:
        """The curves (N,) and slopes (d, N) at one place (d,)."""
        if self.problem.kernel is not None and not self.of_measured:
            own = self.of_runs(place[None])
            return self._relaxed_with_slopes(self._runs(own)[0], self._slopes_of_runs(own)[0], place)[:2]
        if not self.fitted.betas.size:
            return self.curves(place[None])[0], self.slopes(place[None])[0]
        rows = polynomials.at_place(place, self.fitted.betas, self.degree) @ self.fitted.coefficients
        return rows[0], rows[1:]

    def _values(self, place: Array) -> dict[str, float]:
        """The parameters of the relaxation at a place (d,)."""
        problem = self.problem
        values = dict(problem.start)
        for name, unit in zip(problem.searched, place, strict=True):
            values[name] = problem.value(name, unit)
        return values

    def _relaxed(self, elastic: Array, values: Mapping[str, float]) -> Array:
        """Curves (..., N) at the measured times from elastic ones (..., N_elastic)."""
        kernel = self.problem.kernel
        assert kernel is not None
        parts = np.split(elastic, np.cumsum(kernel.sizes)[:-1], axis=-1)
        forces = np.concatenate(kernel.forces(parts, values), axis=-1)
        return forces if self.correction is None else np.asarray(self.correction * forces)

    def _relaxed_with_slopes(
        self, elastic: Array, slopes: Array, place: Array, others: Array | None = None
    ) -> tuple[Array, Array, Array]:
        """The curves (N,), their derivatives (d, N) and other rows (k, N) at a place (d,), from elastic curves (N_elastic,), their
        derivatives (d_runs, N_elastic) and other rows (k, N_elastic)."""
        kernel, problem, values = self.problem.kernel, self.problem, self._values(place)
        assert kernel is not None
        given = [elastic[None], slopes, *([] if others is None else [others])]
        force, rest = np.split(self._relaxed(np.concatenate(given), values), [1])
        rows, beside = list(rest[: len(slopes)]), rest[len(slopes) :]
        names = problem.searched[len(rows) :]
        of_bulk = [BULK] if kernel.bulk is not None and BULK in problem.solved else []
        by_test = kernel.slopes(np.split(elastic, np.cumsum(kernel.sizes)[:-1]), values, [*of_bulk, *names])
        for name in (*of_bulk, *names):
            row = np.concatenate([given[name] for given in by_test]) * problem.per_unit(name, values)
            row = row if self.correction is None else self.correction * row
            if name == BULK:
                rows[problem.searched.index(BULK)] = rows[problem.searched.index(BULK)] + row
            else:
                rows.append(row)
        return force[0], np.array(rows).reshape(-1, force.shape[1]), beside

    def near_failure(self, places: Array) -> Bools:
        """Whether the run nearest to each place failed, (m,)."""
        if not len(self.failed):
            return np.zeros(len(places), dtype=bool)
        places, betas = self.of_runs(places), self.fitted.betas
        known = warp(self.known_places(), betas)
        here, failed = warp(places, betas), warp(self.failed, betas)
        return _nearest(here, failed) < _nearest(here, known)

    def known_places(self) -> Array:
        """Places of the training runs, (m, d_runs), units of the ranges."""
        return np.array([run.place for run in self.training])

    def distance(self, place: Array, others: Array) -> float:
        """The distance of a place (d,) to the nearest of the places of runs (m, d_runs), in units of the ranges; 0 where no
        searched parameter changes a run."""
        own = self.of_runs(place)
        return float(np.abs(others - own).max(axis=1).min()) if own.size else 0.0

    def _evaluation(self, point: Mapping[str, Any], curves: Array, slopes: Array | None, close: bool) -> Evaluation:
        if close:
            return Evaluation(dict(point), None, FAILED_NEAR, 0.0, ())
        problem = self.problem
        ends = np.cumsum([test.curve.force.size for test in problem.tests])[:-1]
        by_test = [
            {name: row / problem.per_unit(name, point) for name, row in zip(problem.searched, part, strict=True)}
            for part in ([] if slopes is None else np.split(slopes, ends, axis=1))
        ]
        return Evaluation(dict(point), tuple(np.split(curves, ends)), None, 0.0, (), tuple(by_test) or None)


def learn(problem: InverseProblem, evaluations: Iterable[Evaluation], exact: bool = False) -> Surrogate | None:
    """The Surrogate that is fitted to evaluations.

    Parameters
    ----------
    problem : InverseProblem
    evaluations : iterable of Evaluation
        Runs at the reference scale, failed runs among them. Runs with other settings (another mesh, another base) are ignored, and
        those with another value of what is not free.
    exact : bool
        Whether one run makes a surrogate where nothing is searched beside the scale.

    Returns
    -------
    Surrogate or None
        None where too few runs succeeded.
    """
    fixed = {name: value for name, value in problem.start.items() if name not in problem.free}.items()
    evaluations = [known for known in evaluations if known.parameters.keys() == problem.start.keys()]
    own = [known for known in evaluations if fixed <= known.parameters.items()]
    runs = problem.elastic
    good = {_key(runs, known): known for known in own if known.forces is not None}
    failed = [runs.place(known.parameters) for known in own if known.forces is None]
    d = len(runs.searched)
    if (exact or problem.kernel is not None) and not d and good:
        return _of_one_run(problem, next(iter(good.values())))
    if len(good) < 2 or not d:
        return None
    training = _training(problem, list(good.values()))
    fitted = _best_fit(training, runs)
    if fitted is None:
        return None
    correction = _correction(next(iter(good.values())))
    return Surrogate(problem, training, np.array(failed).reshape(-1, d), fitted, correction=correction)


def _of_one_run(problem: InverseProblem, evaluation: Evaluation) -> Surrogate:
    """The Surrogate of a problem whose searched parameters change no run: it is exact."""
    curves = np.concatenate(evaluation.run.forces or ())
    training = (TrainingRun(np.zeros(0), curves, None, 1.0),)
    fitted = Fitted(np.zeros(0), 0, curves[None], 0.0)
    return Surrogate(problem, training, np.zeros((0, 0)), fitted, correction=_correction(evaluation))


def _correction(evaluation: Evaluation) -> Array | None:
    return None if evaluation.correction is None else np.concatenate(evaluation.correction)


def linearised(problem: InverseProblem, candidate: Candidate, derivatives: Sequence[Array]) -> Surrogate:
    """Surrogate whose curves are linear in the searched parameters around a Candidate, and exact in the scale.

    Parameters
    ----------
    problem : InverseProblem
    candidate : Candidate
    derivatives : sequence of arrays (n, n_free), mN per range of a parameter
        Derivatives of the candidate's curves, one array for each test.

    Returns
    -------
    Surrogate
    """
    whole, ahead = np.concatenate(candidate.forces), np.concatenate(derivatives)
    factor = problem.factor(candidate.parameters)
    d = len(problem.searched)
    half = ahead[:, problem.searched_numbers].T / 2  # by t = 2 u - 1, (d, N)
    place = 2 * problem.place(candidate.parameters) - 1
    by_powers = [half[np.argmax(powers)] if any(powers) else whole - place @ half for powers in polynomials.powers(d, 1)]
    fitted = Fitted(np.zeros(d), 1, np.array(by_powers) / factor, np.nan)
    return Surrogate(problem, (), np.zeros((0, d)), fitted, of_measured=True)


def _training(problem: InverseProblem, evaluations: list[Evaluation]) -> tuple[TrainingRun, ...]:
    runs = problem.elastic
    candidates = [problem.judge_best_scale(known.parameters, known.forces or ()) for known in evaluations]
    misfits = np.array([np.sqrt(candidate.sum_of_squares) for candidate in candidates])
    size = np.sqrt(np.mean(np.concatenate([test.scale * test.curve.force for test in problem.tests if test.weight]) ** 2))
    floor = max((LEAST_MISFIT_WIDE if problem.warps else LEAST_MISFIT) * size, misfits.min())
    return tuple(
        TrainingRun(
            runs.place(known.parameters), np.concatenate(known.run.forces or ()), _slopes(runs, known.run), 1 / max(misfit, floor)
        )
        for known, misfit in zip(evaluations, misfits, strict=True)
    )


def _slopes(problem: InverseProblem, evaluation: Evaluation) -> Array | None:
    by_test, known = evaluation.sensitivities, given_by(problem, evaluation)
    if by_test is None or not known:
        return None
    unknown = np.full(sum(force.size for force in evaluation.forces or ()), np.nan)
    columns = [
        np.concatenate([given[name] for given in by_test]) * problem.range(name) if name in known else unknown
        for name in problem.searched
    ]
    return np.column_stack(columns)


def _best_fit(training: tuple[TrainingRun, ...], problem: InverseProblem) -> Fitted | None:
    """The polynomial that best predicts each run from all others; betas are tried one parameter at a time.

    The few runs of a widened problem lie at the corners of its ranges, where leaving one out says little: its betas and its degree
    are given, and its coefficients are expected to be small.
    """
    best: Fitted | None = None
    betas, d, rows = problem.betas, len(problem.searched), _Rows.of(training)
    if problem.warps:
        return _fit_rows(rows, betas, widest_degree(d), expected=True)
    tried: set[tuple[float, ...]] = set()
    for _ in range(2 if d > 1 else 1):
        for n in range(d):
            for beta in BETAS:
                trial = betas.copy()
                trial[n] = beta
                if tuple(trial) in tried:
                    continue
                tried.add(tuple(trial))
                for degree in DEGREES:
                    fitted = _fit_rows(rows, trial, degree, with_shifts=False)
                    if fitted and (best is None or fitted.error < best.error):
                        best = fitted
            betas = best.betas if best else betas
    return best and _fit_rows(rows, best.betas, best.degree)


def widest_degree(d: int) -> int:
    """The degree of a widened problem of d searched parameters."""
    return max((p for p in range(1, WIDEST_DEGREE + 1) if len(polynomials.powers(d, p)) <= MOST_COEFFICIENTS), default=1)


def fit_polynomial(training: Sequence[TrainingRun], betas: Array, degree: int, expected: bool = False) -> Fitted | None:
    """The polynomial of a degree that fits runs best; None where the runs are too few for the degree.

    With `expected`, coefficients are expected to be the smaller the higher their degree (SMALLER): runs then may be few, and a
    polynomial does not run away where there are none.
    """
    return _fit_rows(_Rows.of(training), betas, degree, expected)


def _fit_rows(rows: "_Rows", betas: Array, degree: int, expected: bool = False, with_shifts: bool = True) -> Fitted | None:
    d = len(betas)
    if (len(rows.owners) < polynomials.SPARE * len(polynomials.powers(d, degree)) and not expected) or len(rows.places) < 2:
        return None
    A, b = rows.weighted(betas, degree)
    if expected:
        A = np.vstack([A, np.diag(_expected(rows, d, degree))])
        b = np.vstack([b, np.zeros((A.shape[1], b.shape[1]))])
    Q, R = np.linalg.qr(A)
    if np.abs(np.diag(R)).min() < 1e-8 * np.abs(np.diag(R)).max():
        return None
    coefficients = np.linalg.solve(R, Q.T @ b)
    left_out = _left_out(Q, b - A @ coefficients, rows.owners)
    if left_out is None:
        return Fitted(betas, degree, coefficients, np.inf)
    errors, shifts = left_out
    kept = np.linalg.solve(R, shifts) if with_shifts else None
    return Fitted(betas, degree, coefficients, float(np.sqrt(np.mean(np.square(errors)))), errors, kept)


def _expected(rows: "_Rows", d: int, degree: int) -> Array:
    """Weights of the expectation that each coefficient is 0, (coefficients,)."""
    totals = np.array([sum(powers) for powers in polynomials.powers(d, degree)])
    return np.asarray(rows.weights.max() * UNEXPLAINED / SMALLER**totals)


@dataclass(frozen=True, eq=False)
class _Rows:
    """The equations of a fit to runs: of each run (`owners`) its curve (`kinds` 0), and its slopes by each parameter k (k + 1)."""

    places: Array
    weights: Array
    owners: Ints
    kinds: Ints
    targets: Array  # curves and slopes by the place, (1 + d, m, N)

    @classmethod
    def of(cls, training: Sequence[TrainingRun]) -> "_Rows":
        places, curves = np.array([run.place for run in training]), np.array([run.curves for run in training])
        none = np.full((*curves.shape[1:], places.shape[1]), np.nan)
        slopes = np.array([none if run.slopes is None else run.slopes for run in training])
        owners, kinds = np.nonzero(np.column_stack([np.ones(len(places), dtype=bool), np.isfinite(slopes[:, 0])]))
        targets = np.concatenate([curves[None], np.moveaxis(slopes, 2, 0)])
        return cls(places, np.array([run.weight for run in training]), owners, kinds, targets)

    def weighted(self, betas: Array, degree: int) -> tuple[Array, Array]:
        """The weighted equations of a polynomial: matrix (R, coefficients) and right sides (R, N)."""
        ahead = polynomials.stretch(self.places, betas)  # dt/du, (m, d)
        blocks = np.stack([polynomials.values(self.places, betas, degree), *polynomials.by_t(self.places, betas, degree)])
        # where friction has no effect, its derivative by t is mostly chatter
        chatter = np.where((betas > -1) & (betas < 0), np.minimum(1.0, ahead), 1.0)
        shares = self.weights * np.concatenate([np.ones((1, len(self.weights))), OF_SLOPES * chatter.T])
        per_t = shares / np.concatenate([np.ones((1, len(self.weights))), ahead.T])
        at = self.kinds, self.owners
        return shares[at][:, None] * blocks[at], per_t[at][:, None] * self.targets[at]


def _left_out(Q: Array, residuals: Array, owners: Ints) -> tuple[Array, Array] | None:
    """Weighted errors of the prediction of each run from all others, (m, N), and what R times the coefficients loses without it,
    (m, coefficients, N), from the projection on the columns of the fit Q R; None where a run alone determines a coefficient."""
    counts = np.bincount(owners)
    errors, first = np.empty((len(counts), residuals.shape[1])), np.searchsorted(owners, np.arange(len(counts)))
    shifts = np.empty((len(counts), Q.shape[1], residuals.shape[1]))
    for count in np.unique(counts):
        runs = np.flatnonzero(counts == count)
        rows = first[runs][:, None] + np.arange(count)
        kept = np.eye(count) - Q[rows] @ np.swapaxes(Q[rows], 1, 2)
        if np.linalg.eigvalsh(kept)[:, 0].min() < 1e-6:
            return None
        unpredicted = np.linalg.solve(kept, residuals[rows])
        errors[runs], shifts[runs] = unpredicted[:, 0], np.swapaxes(Q[rows], 1, 2) @ unpredicted
    return errors, shifts


def _key(problem: InverseProblem, evaluation: Evaluation) -> tuple[float, ...]:
    return tuple(evaluation.parameters[name] for name in problem.searched)


def _nearest(here: Array, others: Array) -> Array:
    return np.sqrt(((here[:, None] - others[None]) ** 2).sum(axis=2)).min(axis=1)
