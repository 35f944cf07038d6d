"""A fit whose uncertain inputs are coordinates: search, optimum and profiles over parameters and inputs together.

The surrogate is learnt over the ranges of the free parameters and of the inputs that change the solution. Runs at the optimum and
at the ends of the profiles prove its predictions. chi2 counts the residuals of the curves, the inputs under their priors, and the
errors of mesh and surrogate; the intervals are profiles of chi2, and nothing is linear about them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.linalg import block_diag
from scipy.stats import norm, qmc
from scipy.stats import t as student

from indentfit.arrays import Array
from indentfit.inference.discrepancy import LawError
from indentfit.inference.posterior import FINEST, Climber, Curves, Mode, NoiseModel, Posterior
from indentfit.inference.smooth_misfit import under_noise_at
from indentfit.inverse.course import HistoryStep, Proof
from indentfit.inverse.derivatives import evaluate_at_reference
from indentfit.inverse.exploration import Watched
from indentfit.inverse.objective import equation_one
from indentfit.inverse.polynomials import design_points, warp
from indentfit.inverse.problem import InverseProblem
from indentfit.inverse.progress import SILENT, Progress
from indentfit.inverse.stretching import errors_left_out, otherwise_stretched
from indentfit.inverse.surrogate import Surrogate, learn
from indentfit.inverse.wide import UncertainInput
from indentfit.runs.forward import Evaluation

SCANNED = 2048  # places of a scan for starts
STARTS = 8  # searches from the best places of the scan
APART = 0.15  # of the ranges: distance of these places
DRAWN, ALLOWED = 400, 10.0  # places drawn about the optimum; those whose chi2 has grown by less are allowed by the curves
TELLING = 2  # runs of a round beside that of the optimum
ROUNDS = 3  # of prediction and proof; no more follow once the optimum is proved
LIMIT = 10  # largest number of rounds
RIGHT = 0.3  # largest shift of a free parameter, over its standard error, by the error of a prediction that counts as right
OF_INPUTS = 0.3  # what such a shift of an uncertain input counts beside one of a free parameter
AS_GOOD = 2.0  # growth of chi2 up to which a place is as good as the optimum
BEATEN = 0.5  # of the optimum's objective: a run below it is much nearer to the points
FIRST_NOISE = 0.02  # of a curve's largest force: where the search for the noise begins
CONFIDENCE = 0.95
SUPPOSED, SMOOTHLY = 3.0, 0.5  # smooth errors of the surrogate that count beside those of runs; their length, over the depth


@dataclass(frozen=True, eq=False)
class ModelError:
    """Errors of the curves that are not noise, all relative to the forces, in a row of all tests.

    Parameters
    ----------
    correction : array (N,)
        The error of the forces that another mesh shows.
    mesh : array (N, N)
        Covariance of the error that the correction leaves.
    surrogate : array (N, N) or None
        Covariance of the surrogate's errors, from runs that it predicted; None before there are any.
    runs : float
        The number of runs that tell this covariance.
    law : LawError or None
        The law's own misfit, where the case states one.
    """

    correction: Array
    mesh: Array
    surrogate: Array | None = None
    runs: float = np.inf
    law: LawError | None = None

    @classmethod
    def none(cls, size: int, law: LawError | None = None) -> "ModelError":
        """No error of the mesh, and an unknown one of the surrogate."""
        return cls(np.zeros(size), np.zeros((size, size)), law=law)

    def with_surrogate_of(self, other: "ModelError") -> "ModelError":
        """The same errors of the mesh, with the surrogate's error that another one holds."""
        return replace(self, surrogate=other.surrogate, runs=other.runs)


@dataclass(frozen=True, eq=False)
class JointFit:
    """The end of a joint fit under one alternative.

    Parameters
    ----------
    posterior : Posterior
    mode : Mode
    others : tuple of Mode
        Other places where the density has a maximum, best first.
    freedom : float
        Degrees of freedom of the noise.
    """

    posterior: Posterior
    mode: Mode
    others: tuple[Mode, ...]
    freedom: float
    surrogate: Surrogate
    error: ModelError
    proofs: tuple[Proof, ...] = ()
    history: tuple[HistoryStep, ...] = ()

    @property
    def reached(self) -> bool:
        """Whether the last run at the optimum proved the surrogate's prediction there, and all runs since leave that place as good
        as the optimum."""
        if not self.proofs or not self.proofs[-1].right:
            return False
        return place_growth(self, self.proofs[-1].parameters) <= AS_GOOD

    @property
    def quantiles(self) -> Array:
        """97.5 % quantiles of Student's t, one for each coordinate: the degrees of freedom are those of Welch and Satterthwaite,
        because only the part of a variance that is noise has a size which few points tell; priors and errors of the mesh are
        stated."""
        noise = self.posterior.noise
        of_noise = self._part(noise.covar(self.posterior.curves.slices) - noise.errors)
        return np.asarray(student.ppf((1 + CONFIDENCE) / 2, max(self.freedom, 1.0) / np.maximum(of_noise, 1e-6) ** 2))

    @property
    def of_noise(self) -> Array:
        """The part of each coordinate's variance that the residuals make, noise or smooth, by linear theory, (n,)."""
        noise = self.posterior.noise
        smooth = np.zeros_like(noise.model) if noise.smooth is None else noise.smooth
        return self._part(noise.covar(self.posterior.curves.slices) - noise.errors + smooth)

    def _part(self, covariance: Array) -> Array:
        """The part of each coordinate's variance that a part of the covariance of the curves (N, N) makes, (n,)."""
        climber, covar = Climber(self.posterior), self.mode.covar
        J = climber.residuals(self.mode.z)[1][: climber.rows.size]
        effect = covar @ J.T @ climber.W
        made = np.einsum("ni,ij,nj->n", effect, covariance[np.ix_(climber.rows, climber.rows)], effect)
        return np.asarray(np.clip(made / np.diag(covar), 0.0, 1.0))

    @property
    def doubt(self) -> Array:
        """How much longer standard errors are than standard deviations, because few points tell how large the noise is, (n,)."""
        return self.quantiles / float(norm.ppf((1 + CONFIDENCE) / 2))

    def log_evidence(self) -> float:
        """Logarithm of the density of the curves by Laplace's method, with free parameters uniform over their ranges."""
        curves, z = self.posterior.curves, self.mode.z
        n, log_two_pi = z.size, float(np.log(2 * np.pi))
        priors = 0.0
        for known in curves.inputs:
            low, high = known.ends
            if known.prior.spread is not None:  # normalised over units; the square is in chi2 already
                priors += float(np.log((high - low) / known.prior.spread)) - log_two_pi / 2
        rows = self.posterior.rows.size
        volume = float(np.linalg.slogdet(bounded(self.mode.covar, z))[1])
        return -0.5 * (self.mode.chi2 + self.posterior.log_volume() + rows * log_two_pi) + priors + 0.5 * (n * log_two_pi + volume)


def bounded(covar: Array, z: Array) -> Array:
    """A covariance whose standard deviations do not exceed those of a uniform density over the ranges."""
    sd = np.sqrt(np.diag(covar))
    shrink = np.minimum(1.0, 1 / np.sqrt(2 * np.pi) / sd)
    return covar * np.outer(shrink, shrink)


def joint_fit(
    problem: InverseProblem,
    inputs: tuple[UncertainInput, ...],
    model: Watched,
    error: ModelError,
    seed: int,
    progress: Progress = SILENT,
    rounds: int = LIMIT,
    earlier: JointFit | None = None,
) -> JointFit | None:
    """The optimum of parameters and inputs together, proved by runs; None where too few runs succeed.

    Rounds of prediction and proof go on while the optimum is not proved.

    Parameters
    ----------
    problem : InverseProblem
        Widened by the inputs (`inverse.wide`).
    inputs : tuple of UncertainInput
    model : Watched
    error : ModelError
    seed : int
    progress : Progress
    rounds : int
        The largest number of rounds.
    earlier : JointFit or None
        A fit of the same problem that was not proved under other errors of the model; its rounds count.

    Returns
    -------
    JointFit or None
    """
    first_runs(problem, model, seed, progress.part(0, 0.6))
    proofs: list[Proof] = list(earlier.proofs) if earlier else []
    history: list[HistoryStep] = list(earlier.history) if earlier else []
    error = error.with_surrogate_of(earlier.error) if earlier else replace(error, surrogate=None)
    while True:
        surrogate = learn(problem, model.known, exact=True)
        if surrogate is None:
            return None
        if len(proofs) >= ROUNDS and not proofs[-1].right:
            surrogate = otherwise_stretched(surrogate, model.known)
            problem = surrogate.problem
        progress(0.6 + 0.4 * min(len(proofs) / ROUNDS, 1.0), f"surrogate of {len(surrogate.training)} runs")
        fit = replace(fitted(problem, inputs, surrogate, error, seed), proofs=tuple(proofs), history=tuple(history))
        enough = settled(fit)
        if len(proofs) >= rounds or (fit.reached and (enough or (len(proofs) >= ROUNDS and not beaten(fit)))):
            return fit
        proof, errors = proved(fit, model, () if enough else telling(fit, seed))
        proofs.append(proof)
        error = held_out(error, errors)
        history.append(HistoryStep("joint", len(proofs), objective_of(fit), model.runs))


def first_runs(problem: InverseProblem, model: Watched, seed: int, progress: Progress = SILENT) -> None:
    """Run the start values and the places that determine a polynomial best."""
    d = len(problem.solved)
    known = len([name for name in problem.solved if name not in problem.differences and name in model.differentiable()])
    places = design_points(d, known, seed, betas=problem.betas[:d]) if d else ()
    points = [_parameters(problem, place) for place in places]
    evaluate_at_reference(problem, model, [problem.start, *points], progress.of_runs("first runs"))


def _parameters(problem: InverseProblem, place: Array) -> dict[str, float]:
    x = problem.units(problem.start)
    x[problem.searched_numbers[: len(problem.solved)]] = place
    return problem.parameters(x)


def fitted(
    problem: InverseProblem,
    inputs: tuple[UncertainInput, ...],
    surrogate: Surrogate,
    error: ModelError,
    seed: int,
    used: Sequence[bool] | None = None,
) -> JointFit:
    """The optimum on a surrogate, with the noise that its residuals show.

    Parameters
    ----------
    problem, inputs, surrogate, error, seed
    used : sequence of bool
        Whether each test counts; by default all with a weight.

    Returns
    -------
    JointFit
    """
    curves = Curves.of(problem, surrogate, inputs, error.correction)
    counted = tuple(used) if used is not None else tuple(test.weight > 0 for test in problem.tests)
    force = curves.measured()
    sizes = np.array([np.abs(force[rows]).max() for rows in curves.slices])
    if error.surrogate is None:
        of_surrogate, runs = left_out_covar(curves)
        error = replace(error, surrogate=of_surrogate, runs=runs)
    model = (error.mesh + next_error(error, problem)) * np.outer(force, force)
    trust = tuple(test.curve.trust for test in problem.tests)
    stated = np.array([test.curve.stated_noise for test in problem.tests])
    posterior = Posterior(curves, NoiseModel(FIRST_NOISE * sizes, np.zeros(len(sizes)), model, trust, stated, error.law), counted)
    modes = _modes(posterior, seed)
    for _ in range(3):
        posterior = under_noise_at(posterior, modes[0].z)
        modes = _climbed(posterior, [mode.z for mode in modes])
    if posterior.noise.smooth is not None:
        modes = _nearest_first(posterior, modes)
    return JointFit(posterior, modes[0], tuple(modes[1:]), freedom_of(posterior, modes[0]), surrogate, error)


def _nearest_first(posterior: Posterior, modes: Sequence[Mode]) -> list[Mode]:
    """Maxima of the density of smooth residuals, where the least squares, under white noise of the same size, are as good as the
    best with these as the first: smooth residuals leave the level of several tests nearly free, and the best of nearly equal places
    may be twice as far from the points."""
    noise = posterior.noise
    white = replace(posterior, noise=replace(noise, rho=np.zeros_like(noise.rho), explained=(), smooth=None))
    least, climber = _climbed(white, [mode.z for mode in modes])[0], Climber(posterior)
    residuals = climber.residuals(least.z)[0]
    chi2 = float(residuals @ residuals)
    if not 0 < chi2 - modes[0].chi2 <= AS_GOOD:
        return list(modes)
    return [Mode(least.z, chi2, climber.covar(least.z)), *modes]


def next_error(error: ModelError, problem: InverseProblem) -> Array:
    """Covariance (N, N) of the surrogate's relative error at the next place, where few runs tell it: a smooth error of a curve,
    of the same size, counts as SUPPOSED further runs, and a variance that few runs tell is larger, as that of Student's t is."""
    known = error.surrogate
    assert known is not None  # `fitted` has set it
    if not np.isfinite(error.runs) or not known.any():
        return known
    depths = [test.curve.displacement for test in problem.tests]
    smooth = block_diag(*(np.exp(-0.5 * (np.subtract.outer(d, d) / (SMOOTHLY * np.abs(d).max())) ** 2) for d in depths))
    total = error.runs * known + SUPPOSED * float(np.mean(np.diag(known))) * smooth
    return np.asarray(total / (error.runs + SUPPOSED - 2))


def left_out_covar(curves: Curves) -> tuple[Array, float]:
    """Covariance of the surrogate's relative errors, (N, N), from the predictions of each run near the optimum from all others, and
    the effective number of these runs."""
    surrogate = curves.surrogate
    known = errors_left_out(surrogate)
    if known is None:
        return np.zeros((curves.measured().size,) * 2), np.inf
    left_out, shares = known
    forces, start = np.array([run.curves for run in surrogate.training]), curves.problem.start
    errors = _relative(*(surrogate.measured(rows, start) for rows in (left_out, forces)))
    return np.asarray(np.einsum("m,mi,mj->ij", shares, errors, errors)), float(1 / np.sum(shares**2))


def _relative(error: Array, force: Array) -> Array:
    """Errors over forces; 0 where there is no force."""
    return np.divide(error, force, out=np.zeros_like(error), where=force != 0)


def place_growth(fit: JointFit, point: Mapping[str, Any]) -> float:
    """The growth of chi2, beside that of the optimum, at parameters and inputs that change the solution; inputs of single tests and
    the scale are fitted."""
    curves = fit.posterior.curves
    z = fit.mode.z.copy()
    z[curves.solved_numbers] = curves.place(point)[curves.solved_numbers]
    return Climber(fit.posterior).climb(z, curves.solved_numbers)[1] - fit.mode.chi2


def _modes(posterior: Posterior, seed: int) -> list[Mode]:
    """Maxima of the density from the best places of a scan, best first."""
    curves = posterior.curves
    places = qmc.Sobol(curves.size, seed=seed).random(SCANNED)
    centres = [known.unit_of(known.prior.value(known.prior.center)) for known in curves.inputs]
    for n, (known, centre) in enumerate(zip(curves.inputs, centres, strict=True), start=len(curves.free)):
        if not known.point:
            places[:, n] = centre
    climber = Climber(posterior)
    values = _scanned(climber, places)
    chosen: list[Array] = []
    for n in np.argsort(values):
        if len(chosen) < STARTS and all(np.abs(places[n] - other).max() > APART for other in chosen):
            chosen.append(places[n])
    return _climbed(posterior, chosen)


def _scanned(climber: Climber, places: Array) -> Array:
    """chi2 at places, each at its best scale, which is put into the place."""
    curves = climber.curves
    problem = curves.problem
    units = np.array([curves._units(z)[0] for z in places])
    forces = curves.surrogate.curves(units[:, problem.searched_numbers]) * (1 + curves.mesh)
    forces = forces[:, climber.rows] @ climber.W.T
    target = climber.W @ climber.y
    if problem.scale is not None:
        factor = np.clip(forces @ target / np.maximum(np.sum(forces**2, axis=1), 1e-300), *problem.factor_bounds())
        bounds = problem.free[problem.scale]
        places[:, curves.free.index(problem.scale)] = (factor * problem.reference - bounds.min) / (bounds.max - bounds.min)
        forces = factor[:, None] * forces
    priors = places @ climber.P.T - climber.centre
    values: Array = np.sum((forces - target) ** 2, axis=1) + np.sum(priors**2, axis=1)
    return np.where(curves.surrogate.near_failure(units[:, problem.searched_numbers]), np.inf, values)


def _climbed(posterior: Posterior, starts: Sequence[Array]) -> list[Mode]:
    """Different maxima of the density near starts, best first."""
    climber = Climber(posterior)
    ends = sorted((climber.climb(z) for z in starts), key=_chi2)
    modes: list[Mode] = []
    for z, chi2 in ends:
        if all(np.abs(z - mode.z).max() > 0.02 for mode in modes):
            modes.append(Mode(z, chi2, climber.covar(z)))
    return modes


def _chi2(end: tuple[Array, float]) -> float:
    return end[1]


def freedom_of(posterior: Posterior, mode: Mode) -> float:
    """Degrees of freedom: independent points, without the coordinates that the curves determine."""
    climber = Climber(posterior)
    J = climber.residuals(mode.z)[1][: climber.rows.size]
    determined = float(np.trace(J @ mode.covar @ J.T))
    points = 0.0
    for rows, rho, used in zip(posterior.curves.slices, posterior.noise.rho, posterior.used, strict=True):
        n = rows.stop - rows.start
        points += n * (1 - rho) / (1 + rho) if used else 0.0
    return max(points - determined, 1.0)


def telling(fit: JointFit, seed: int) -> list[dict[str, float]]:
    """Points that the curves allow, far from each other and from all runs, so that a run there tells the surrogate most."""
    curves, problem = fit.posterior.curves, fit.posterior.curves.problem
    climber, rng = Climber(fit.posterior), np.random.default_rng(seed)
    draws = fit.mode.z + rng.standard_normal((DRAWN, curves.size)) @ np.linalg.cholesky(bounded(fit.mode.covar, fit.mode.z)).T
    draws = np.clip(draws, 0, 1)
    values = _scanned(climber, draws)
    places = draws[values <= max(fit.mode.chi2 + ALLOWED, np.quantile(values, 0.1))]
    points = [curves.point(z) for z in places]
    betas = fit.surrogate.fitted.betas
    own = fit.surrogate.of_runs
    here = np.array([warp(own(problem.place(point)), betas) for point in points])
    known = warp(np.vstack([fit.surrogate.known_places(), own(problem.place(curves.point(fit.mode.z)))[None]]), betas)
    chosen = []
    for _ in range(min(TELLING, len(points))):
        n = int(np.argmax(np.abs(here[:, None] - known[None]).max(axis=2).min(axis=1)))
        chosen.append(points[n])
        known = np.vstack([known, here[n]])
    return chosen


def proved(fit: JointFit, model: Watched, others: Sequence[dict[str, float]] = ()) -> tuple[Proof, Array]:
    """The prediction at the optimum, compared with a run there: it is right if its error shifts no coordinate by much, or is as
    small as the waves of computed curves. Other points are run together with it; the array holds the relative errors of all
    predictions, a row for each run."""
    curves, z = fit.posterior.curves, fit.mode.z
    points = [curves.point(z), *others]
    ran = evaluate_at_reference(curves.problem, model, points)
    errors = prediction_errors(fit, points, ran)
    if ran[0].forces is None:
        return Proof(dict(points[0]), None, None), errors
    error = errors[0] * curves.measured()
    climber = Climber(without_surrogate(fit))
    J, covar = climber.residuals(z)[1][: climber.rows.size], climber.covar(z)
    shift = covar @ J.T @ climber.W @ error[climber.rows]
    counts = np.where(np.arange(z.size) < len(curves.free), 1.0, OF_INPUTS)
    worst = float(np.max(counts * np.abs(shift) / np.sqrt(np.diag(covar)) / fit.doubt))
    size = float(np.sqrt(np.mean(error**2)))
    squares = [test.curve.force.size * np.abs(test.curve.force).max() ** 2 for test in curves.problem.tests]
    waves = FINEST * float(np.sqrt(sum(squares) / error.size))  # no surrogate predicts the waves of computed curves
    return Proof(dict(points[0]), size, max(size * RIGHT / worst if worst > 0 else size, waves)), errors


def prediction_errors(fit: JointFit, points: Sequence[dict[str, float]], ran: Sequence[Evaluation]) -> Array:
    """Relative errors of the surrogate's predictions at points that were run, (k, N); a run that failed has no row."""
    problem, rows = fit.posterior.curves.problem, []
    for point, run in zip(points, ran, strict=True):
        if run.forces is not None:
            true = np.concatenate(run.forces)
            rows.append(_relative(fit.surrogate.curves(problem.place(point)[None])[0] - true, true))
    return np.array(rows).reshape(len(rows), fit.error.correction.size)


def held_out(error: ModelError, errors: Array, earlier: int = 0) -> ModelError:
    """The errors of the model, with the surrogate's from predictions that were compared with runs, a row (N,) for each; those known
    so far count as `earlier` rows."""
    if not len(errors):
        return error
    counted = earlier * (error.surrogate is not None)
    before = 0.0 if error.surrogate is None else counted * error.surrogate
    return replace(error, surrogate=(before + errors.T @ errors) / (counted + len(errors)), runs=float(counted + len(errors)))


def without_surrogate(fit: JointFit) -> Posterior:
    """The posterior as if the surrogate were exact."""
    noise = fit.posterior.noise
    force = fit.posterior.curves.measured()
    assert fit.error.surrogate is not None  # `fitted` has set it
    return replace(fit.posterior, noise=replace(noise, model=fit.error.mesh * np.outer(force, force)))


def settled(fit: JointFit) -> bool:
    """Whether the surrogate's error is below what the noise leaves of the curves' smooth parts."""
    curves, noise = fit.posterior.curves, fit.posterior.noise
    force = curves.measured()
    assert fit.error.surrogate is not None  # `fitted` has set it
    errors = np.diag(fit.error.surrogate) * force**2
    left = np.concatenate(
        [np.full(part.stop - part.start, sigma**2) for part, sigma in zip(curves.slices, noise.sigma, strict=True)]
    )
    return bool(np.mean(errors[fit.posterior.rows]) <= np.mean(left[fit.posterior.rows]) * curves.size / fit.posterior.rows.size)


def beaten(fit: JointFit) -> bool:
    """Whether a run comes much nearer to the points than the optimum: the surrogate's error is so large, or the residuals are so
    smooth, that the optimum is only one of the places that they allow."""
    curves, start = fit.posterior.curves, fit.posterior.curves.problem.start
    rows = [fit.surrogate.measured(run.curves, start) * (1 + curves.mesh) for run in fit.surrogate.training]
    runs = curves.problem.judge_best_scales([start] * len(rows), [[row[part] for part in curves.slices] for row in rows])
    return min(run.objective for run in runs) < BEATEN * objective_of(fit)


def objective_of(fit: JointFit) -> float:
    """Equation (1) at the optimum of a fit, mN."""
    curves = fit.posterior.curves
    force = curves.at(fit.mode.z)[0]
    parts = [force[rows] for rows in curves.slices]
    return equation_one(curves.problem.tests, parts)
