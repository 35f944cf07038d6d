"""A surrogate of the forward model: polynomials in the searched parameters, for whole force curves at once.

A total-degree Chebyshev polynomial in warped parameters t: stiffness enters curves by ratios, so each range is stretched
at its lower end, u -> log(1 + beta u) / log(1 + beta). The betas and the degree are those that predict best what was
left out (each run in turn). Runs near the optimum weigh more; sensitivities, where runs brought them, are fitted too.
A Surrogate is asked as a Pool is: the searches cannot tell one from the other.
"""

from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.polynomial import chebyshev
from scipy.stats import qmc

from indentfit.inverse.derivatives import given_by
from indentfit.runs.forward import Evaluation

BETAS = (0.0, 3.0, 10.0, 30.0)
USUAL_BETA = 10.0  # before anything is known
DEGREES = range(1, 9)
SPARE = 1.15  # rows of the fit for each coefficient, at least
OF_SLOPES = 0.3  # weight of a derivative by t against a value
LEAST_MISFIT = 1e-3  # of the measured forces' root mean square: nearer than that all runs weigh the same
FAILED_NEAR = "the mechanics failed at the nearest point that was run"


@dataclass(frozen=True)
class Sample:
    """What one run taught: place u (d,) in units of the ranges, curves (N,) of all tests in a row at the reference
    scale, their derivatives by u (N, d) or None, and its weight."""

    place: np.ndarray
    curves: np.ndarray
    slopes: np.ndarray | None
    weight: float


@dataclass(frozen=True)
class Surrogate:
    """Curves of a Problem as polynomials; `error`: of runs left out one by one, rms, as a share of max(misfit, floor)."""

    problem: object
    samples: tuple[Sample, ...]
    failed: np.ndarray
    betas: np.ndarray
    degree: int
    coefficients: np.ndarray
    error: float
    runs: int = 0  # of the forward model: none, asked by those who count them
    failures: list = field(default_factory=list)

    def evaluate(self, points, progress=None, sensitivities=()):
        """Evaluations of points (name -> value), as a Pool's, always with their sensitivities; none cost anything."""
        places = np.array([[self._unit(name, point) for name in self.problem.searched] for point in points])
        curves, slopes = self.curves(places), self.slopes(places)
        close = self.near_failure(places)
        return [self._evaluation(*one) for one in zip(points, curves, slopes, close, strict=True)]

    def curves(self, places):
        """Curves of all tests in a row, (m, N) mN at the reference scale, at places (m, d) in units of the ranges."""
        return _values(places, self.betas, self.degree) @ self.coefficients

    def slopes(self, places):
        """Their derivatives by the units, (m, d, N)."""
        rows = np.array([A @ self.coefficients for A in _by_units(places, self.betas, self.degree)])
        return rows.reshape(len(self.betas), len(places), self.coefficients.shape[1]).swapaxes(0, 1)

    def near_failure(self, places):
        """Whether the run nearest to each place failed, (m,)."""
        if not len(self.failed):
            return np.zeros(len(places), dtype=bool)
        known = warp(np.array([sample.place for sample in self.samples]), self.betas)
        here, failed = warp(places, self.betas), warp(self.failed, self.betas)
        return _nearest(here, failed) < _nearest(here, known)

    def _unit(self, name, point):
        return (point[name] - self.problem.free[name].min) / self.problem.range(name)

    def _evaluation(self, point, curves, slopes, close):
        if close:
            return Evaluation(dict(point), None, FAILED_NEAR, 0.0, ())
        problem = self.problem
        ends = np.cumsum([test.curve.force.size for test in problem.tests])[:-1]
        by_test = [
            {name: row / problem.range(name) for name, row in zip(problem.searched, part, strict=True)}
            for part in np.split(slopes, ends, axis=1)
        ]
        return Predicted(dict(point), tuple(np.split(curves, ends)), None, 0.0, (), tuple(by_test))


@dataclass(frozen=True)
class Predicted(Evaluation):
    """An Evaluation that a surrogate made; sensitivities: for each test name -> (n,), mN per unit of the parameter."""

    sensitivities: tuple[dict, ...] = ()


def learn(problem, evaluations):
    """Surrogate of an InverseProblem from Evaluations at its reference scale, failed ones among them; None where too few ran. Those
    of other settings (another mesh, another base) teach nothing."""
    evaluations = [one for one in evaluations if one.parameters.keys() == problem.start.keys()]
    good = {_key(problem, one): one for one in evaluations if one.forces is not None}
    failed = [_place(problem, one.parameters) for one in evaluations if one.forces is None]
    d = len(problem.searched)
    if len(good) < 2 or not d:
        return None
    samples = _samples(problem, list(good.values()))
    found = _fit_of_all(samples, d)
    if found is None:
        return None
    error, betas, degree, coefficients = found
    return Surrogate(problem, samples, np.array(failed).reshape(-1, d), betas, degree, coefficients, error)


def linearised(problem, candidate, derivatives):
    """Surrogate whose curves are linear in the searched parameters around a Candidate, and exact in the scale; derivatives:
    of its curves, mN per range, (n, n_free) for each test."""
    whole, ahead = np.concatenate(candidate.forces), np.concatenate(derivatives)
    factor = candidate.parameters[problem.scale] / problem.reference if problem.scale else 1.0
    d, names = len(problem.searched), list(problem.free)
    half = ahead[:, [names.index(name) for name in problem.searched]].T / 2  # by t = 2 u - 1, (d, N)
    place = 2 * _place(problem, candidate.parameters) - 1
    by_powers = [half[np.argmax(powers)] if any(powers) else whole - place @ half for powers in _powers(d, 1)]
    return Surrogate(problem, (), np.zeros((0, d)), np.zeros(d), 1, np.array(by_powers) / factor, np.nan)


def design_points(d, slopes, seed, degree=None):
    """Places (n, d) of the first runs, in units of the ranges: those that determine a polynomial best (D-optimal)."""
    degree = degree or (4 if slopes and d < 3 else 3)
    wanted = _size(d, degree)
    n = int(np.ceil(SPARE * wanted)) if not slopes else int(np.ceil(1.5 * wanted / (1 + d)))
    levels = (1 - np.cos(np.pi * np.arange(5) / 4)) / 2
    grid = np.array(list(product(levels, repeat=d))) if d < 5 else np.zeros((0, d))
    places = np.concatenate([grid, qmc.Sobol(d, seed=seed).random(128)])
    plain = np.zeros(d)  # the polynomial's own variable; turned into units at the end
    blocks = np.stack(
        [_values(places, plain, degree), *([OF_SLOPES * A / 2 for A in _by_units(places, plain, degree)] if slopes else [])], axis=1
    )
    chosen, M = [], 1e-6 * np.eye(wanted)
    for _ in range(n):
        inverse = np.linalg.inv(M)
        gains = [np.linalg.slogdet(np.eye(block.shape[0]) + block @ inverse @ block.T)[1] for block in blocks]
        gains = [-np.inf if n in chosen else gain for n, gain in enumerate(gains)]
        chosen.append(int(np.argmax(gains)))
        M += blocks[chosen[-1]].T @ blocks[chosen[-1]]
    return unwarp(2 * places[chosen] - 1, np.full(d, USUAL_BETA))


def warp(u, betas):
    """Places in units of the ranges, (..., d), as the polynomials' variables, -1..1."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return 2 * np.where(betas > 0, np.log1p(betas * u) / np.log1p(betas), u) - 1


def unwarp(t, betas):
    """The inverse of `warp`."""
    half = (t + 1) / 2
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(betas > 0, np.expm1(half * np.log1p(betas)) / betas, half)


# The fit


def _samples(problem, evaluations):
    candidates = [problem.judge_best_scale(one.parameters, one.forces) for one in evaluations]
    misfits = np.array([np.sqrt(candidate.sum_of_squares) for candidate in candidates])
    size = np.sqrt(np.mean(np.concatenate([test.curve.force for test in problem.tests if test.weight]) ** 2))
    floor = max(LEAST_MISFIT * size, misfits.min())
    return tuple(
        Sample(_place(problem, one.parameters), np.concatenate(one.forces), _slopes(problem, one), 1 / max(misfit, floor))
        for one, misfit in zip(evaluations, misfits, strict=True)
    )


def _slopes(problem, evaluation):
    if len(given_by(problem, evaluation)) < len(problem.searched):
        return None
    by_test = evaluation.sensitivities
    return np.column_stack([np.concatenate([one[name] for one in by_test]) * problem.range(name) for name in problem.searched])


def _fit_of_all(samples, d):
    """(error, betas, degree, coefficients) that predict best what is left out; betas are tried one parameter at a time."""
    best = None
    betas = np.full(d, USUAL_BETA)
    for _ in range(2 if d > 1 else 1):
        for n in range(d):
            for beta in BETAS:
                trial = betas.copy()
                trial[n] = beta
                for degree in DEGREES:
                    found = _fit(samples, trial, degree)
                    if found and (best is None or found[0] < best[0]):
                        best = (found[0], trial, degree, found[1])
            betas = best[1] if best else betas
    return best


def _fit(samples, betas, degree):
    """(error of what is left out, coefficients), or None where the runs are too few for the degree."""
    d = len(betas)
    places = np.array([sample.place for sample in samples])
    values, by_t = _values(places, betas, degree), _by_t(places, betas, degree)
    stretch = _stretch(places, betas)  # dt/du, (m, d)
    A, b, owners = [], [], []
    for n, sample in enumerate(samples):
        A.append(sample.weight * values[n])
        b.append(sample.weight * sample.curves)
        if sample.slopes is not None:
            A += [OF_SLOPES * sample.weight * by_t[k][n] for k in range(d)]
            b += [OF_SLOPES * sample.weight * sample.slopes[:, k] / stretch[n, k] for k in range(d)]
        owners += [n] * (1 if sample.slopes is None else 1 + d)
    if len(A) < SPARE * values.shape[1] or len(samples) < 2:
        return None
    A, b, owners = np.array(A), np.array(b), np.array(owners)
    Q, R = np.linalg.qr(A)
    if np.abs(np.diag(R)).min() < 1e-8 * np.abs(np.diag(R)).max():
        return None
    coefficients = np.linalg.solve(R, Q.T @ b)
    return _left_out(Q, b - A @ coefficients, owners), coefficients


def _left_out(Q, residuals, owners):
    """Error at each run predicted without it, weighted rms, from the projection on the fit's columns."""
    errors = []
    for n in range(owners[-1] + 1):
        rows = np.flatnonzero(owners == n)
        kept = np.eye(rows.size) - Q[rows] @ Q[rows].T
        if np.linalg.eigvalsh(kept)[0] < 1e-6:
            return np.inf  # this run alone determines a coefficient: nothing is known of the error
        errors.append(np.linalg.solve(kept, residuals[rows])[0])
    return float(np.sqrt(np.mean(np.square(errors))))


# The polynomials


def _size(d, degree):
    return len(_powers(d, degree))


def _powers(d, degree):
    return [powers for powers in product(range(degree + 1), repeat=d) if sum(powers) <= degree]


def _values(places, betas, degree):
    """(m, coefficients)."""
    vanders = chebyshev.chebvander(warp(places, betas), degree)  # (m, d, degree + 1)
    return _products(vanders, len(betas), degree)


def _by_t(places, betas, degree):
    """Derivatives by each t, a list of (m, coefficients)."""
    vanders = chebyshev.chebvander(warp(places, betas), degree)
    D = np.zeros((degree + 1, degree + 1))
    D[:, :-1] = chebyshev.chebder(np.eye(degree + 1)).T if degree else 0
    found = []
    for k in range(len(betas)):
        turned = vanders.copy()
        turned[:, k] = vanders[:, k] @ D.T
        found.append(_products(turned, len(betas), degree))
    return found


def _by_units(places, betas, degree):
    stretch = _stretch(places, betas)
    return [stretch[:, [k]] * A for k, A in enumerate(_by_t(places, betas, degree))]


def _stretch(places, betas):
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(betas > 0, 2 * betas / ((1 + betas * places) * np.log1p(betas)), 2.0)


def _products(vanders, d, degree):
    powers = np.array(_powers(d, degree))
    found = np.ones((len(vanders), len(powers)))
    for k in range(d):
        found *= vanders[:, k, powers[:, k]]
    return found


def _place(problem, parameters):
    return np.array([(parameters[name] - problem.free[name].min) / problem.range(name) for name in problem.searched])


def _key(problem, evaluation):
    return tuple(evaluation.parameters[name] for name in problem.searched)


def _nearest(here, others):
    return np.sqrt(((here[:, None] - others[None]) ** 2).sum(axis=2)).min(axis=1)
