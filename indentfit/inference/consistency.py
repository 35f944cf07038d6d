"""Tests against each other: each test is predicted from the others, and the measured curve compared with the prediction.

The statistic is the growth of the weighted squares that follows from one set of parameters for all tests, in place of one for the
test and one for the others (the parameter goodness of fit of Maltoni and Schwetz 2003, Phys Rev D 68:033020): it is free of the
misfit of each test by itself, and of parameters that a test leaves open. Its reference is an F distribution; where that calls the
curves unlikely, draws of the test's curve from its posterior predictive distribution decide.

The residuals of a test have the size and smoothness that they have in a fit to that test alone; errors common to all forces of a
test, by the mesh, the load cell and uncertain inputs, are added to their covariance, as if independent from test to test.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import least_squares
from scipy.stats import chi2
from scipy.stats import f as fisher

from indentfit.arrays import Array, Ints
from indentfit.inference.agreement import TestPrediction
from indentfit.inference.many import ManyCurves, Problems
from indentfit.inference.noise import correlations, errors
from indentfit.inference.reconciled import reconciled
from indentfit.inverse.exploration import FINEST
from indentfit.inverse.problem import InverseProblem
from indentfit.inverse.surrogate import Surrogate

UNCLEAR = 0.1  # probability by the F distribution below which draws decide
DRAWS = 99  # draws of a test's curve, at most
ENOUGH = 3  # draws as far from the prediction as the measured curve, after which drawing ends (Besag and Clifford 1991)
PROPOSED = 4000  # sets of parameters from which those of the draws are chosen
WIDER = 2.0  # the variance of the proposed parameters over that by linear theory
SEEN = np.sqrt(12)  # change of the whitened curves over the range of a parameter from which a direction counts as seen


def predictions(
    problem: InverseProblem, surrogate: Surrogate, x: Array, common: Sequence[Sequence[Array]], seed: int
) -> dict[str, TestPrediction]:
    """Each test predicted from the others.

    Parameters
    ----------
    problem : InverseProblem
    surrogate : Surrogate
    x : array (n_free,), units of the ranges
        The fit to all tests.
    common : for each test a sequence of arrays (n,), mN
        Changes of the curve by one standard deviation of errors that are common to all of its forces.
    seed : int

    Returns
    -------
    dict of test -> TestPrediction
        Empty where fewer than two tests have a weight.
    """
    heavy = [n for n, test in enumerate(problem.tests) if test.weight]
    if len(heavy) < 2:
        return {}
    whole = _Whitened.of(problem, surrogate, heavy, x, common)
    together = _Split.of(whole, heavy, x)
    return {problem.tests[n].name: together.prediction(n, seed) for n in heavy}


def agreement(
    problem: InverseProblem,
    surrogate: Surrogate,
    x: Array,
    common: Sequence[Sequence[Array]],
    predicted: Mapping[str, TestPrediction],
    pressed: Sequence[bool],
) -> str:
    """What would make tests agree that contradict each other, in a sentence (`reconciled`); empty where none do.

    Parameters
    ----------
    problem, surrogate, x, common
        As of `predictions`.
    predicted : dict of test -> TestPrediction
    pressed : for each test whether it is an indentation
    """
    heavy = [n for n, test in enumerate(problem.tests) if test.weight]
    wrong = [n for n in heavy if predicted[problem.tests[n].name].contradicts] if predicted else []
    if not wrong:
        return ""
    whole = _Whitened.of(problem, surrogate, heavy, x, common)
    alone = sum(whole.best((n,), [x, np.full(x.size, 0.5)])[1] for n in heavy)

    def least(curves: list[Array]) -> float:
        return replace(whole, measured=tuple(curves)).best(heavy, [x])[1]

    return reconciled(problem.tests, wrong, pressed, least, alone)


@dataclass(frozen=True, eq=False)
class _Whitened:
    """The tests of a problem on a surrogate, with the covariance of each test's errors: its root (n, n), the inverse of the root,
    and the degrees of freedom of its size."""

    problem: InverseProblem
    surrogate: Surrogate
    measured: tuple[Array, ...]
    roots: tuple[Array, ...]
    inverses: tuple[Array, ...]
    freedom: tuple[float, ...]

    @property
    def many(self) -> ManyCurves:
        """The curves at many places."""
        return ManyCurves(self.problem, self.surrogate)

    @classmethod
    def of(
        cls, problem: InverseProblem, surrogate: Surrogate, heavy: Sequence[int], x: Array, common: Sequence[Sequence[Array]]
    ) -> "_Whitened":
        measured = tuple(test.curve.force for test in problem.tests)
        plain = tuple(np.eye(force.size) for force in measured)
        first = cls(problem, surrogate, measured, plain, plain, tuple(np.inf for _ in measured))
        roots, freedom = list(plain), list(first.freedom)
        for n in heavy:
            roots[n], freedom[n] = first._errors_of(n, x, common[n])
        return cls(
            problem, surrogate, measured, tuple(roots), tuple(np.asarray(np.linalg.inv(root)) for root in roots), tuple(freedom)
        )

    def _errors_of(self, n: int, x: Array, common: Sequence[Array]) -> tuple[Array, float]:
        """The root of the covariance of one test's errors, and the degrees of freedom of its size, from a fit to the test alone."""
        alone, _ = self.best((n,), [x, np.full(x.size, 0.5)])
        force, slopes = self.curves(alone)[n], self.slopes(alone)[n]
        curve = self.problem.tests[n].curve
        scaled, residuals = curve.trust[:, None] * slopes, curve.trust * (force - self.measured[n])
        (noise,), known = errors([scaled], [residuals], [1.0], [curve.stated_noise])
        finest = FINEST * float(np.sqrt(np.mean(self.measured[n] ** 2)))
        size = max(noise.sigma if noise.sigma is not None and np.isfinite(noise.sigma) else 0.0, finest) ** 2
        own = size * correlations(force.size, noise.autocorrelation)
        own = (own + noise.stated**2 * np.eye(force.size)) / np.outer(curve.trust, curve.trust)
        covariance = own + sum((np.outer(row, row) for row in common), np.zeros_like(own))
        return np.asarray(np.linalg.cholesky(covariance)), max(float(known.freedom.max()), 1.0)

    def curves(self, x: Array) -> list[Array]:
        """The curves of all tests at x."""
        problem = self.problem
        return self._split(problem.factor(problem.parameters(x)) * self.surrogate.at(x[problem.searched_numbers])[0])

    def slopes(self, x: Array) -> list[Array]:
        """Their derivatives by the free parameters in units of the ranges, (n, n_free) for each test."""
        problem, (curves, slopes) = self.problem, self.surrogate.at(x[self.problem.searched_numbers])
        factor, J = problem.factor(problem.parameters(x)), np.zeros((sum(force.size for force in self.measured), x.size))
        J[:, problem.searched_numbers] = factor * slopes.T
        if problem.scale is not None:
            J[:, problem.number(problem.scale)] = problem.range(problem.scale) / problem.reference * curves
        return self._split(J)

    def _split(self, rows: Array) -> list[Array]:
        return np.split(rows, np.cumsum([force.size for force in self.measured])[:-1])

    def best(self, tests: Sequence[int], starts: Sequence[Array]) -> tuple[Array, float]:
        """The parameters that follow some tests best, and the squares that are left."""
        measured = self.measured

        def residuals(x: Array) -> Array:
            curves = self.curves(x)
            return np.concatenate([self.inverses[n] @ (curves[n] - measured[n]) for n in tests])

        def jacobian(x: Array) -> Array:
            slopes = self.slopes(x)
            return np.concatenate([self.inverses[n] @ slopes[n] for n in tests])

        ends = [
            least_squares(
                residuals, np.clip(start, 0, 1), jacobian, bounds=(0, 1), method="dogbox", xtol=1e-5, ftol=1e-5, max_nfev=40
            )
            for start in starts
        ]
        best = min(ends, key=_cost)
        return best.x, float(2 * best.cost)

    def best_of_many(self, tests: Sequence[int], starts: Array, n: int, drawn: Array) -> Array:
        """The squares (m,) that are left of the best fits to some tests, with the rows of `drawn` (m, n_rows) as the curve of test
        n; starts: (m, n_free)."""
        rows = np.split(np.arange(sum(force.size for force in self.measured)), np.cumsum([f.size for f in self.measured])[:-1])
        roots = block_diag(*(self.inverses[k] for k in tests))
        own = np.concatenate([rows[k] for k in tests])
        measured = np.tile(np.concatenate(self.measured), (len(drawn), 1))
        measured[:, rows[n]] = drawn

        def residuals(places: Array, numbers: Ints) -> Array:
            return (self.many.curves(places) - measured[numbers])[:, own] @ roots.T

        def slopes(places: Array, numbers: Ints) -> Array:
            return np.asarray(roots @ self.many.slopes(places)[:, own])

        return Problems(residuals, slopes).minimised(starts)[1]

    def squares(self, tests: Sequence[int], x: Array) -> Array:
        """The weighted squares (m,) of some tests at many sets of parameters, (m, n_free)."""
        rows = np.cumsum([0, *(force.size for force in self.measured)])
        curves = self.many.curves(x)
        left = [(curves[:, rows[n] : rows[n + 1]] - self.measured[n]) @ self.inverses[n].T for n in tests]
        return np.sum([np.sum(part**2, axis=1) for part in left], axis=0)


def _cost(ended: object) -> float:
    return float(ended.cost)  # type: ignore[attr-defined]  # of scipy's OptimizeResult


@dataclass(frozen=True, eq=False)
class _Split:
    """The tests that have a weight, and the fit to all of them: its parameters and squares."""

    whitened: _Whitened
    heavy: tuple[int, ...]
    x: Array

    @classmethod
    def of(cls, whitened: _Whitened, heavy: Sequence[int], x: Array) -> "_Split":
        return cls(whitened, tuple(heavy), whitened.best(heavy, [x])[0])

    def prediction(self, n: int, seed: int) -> TestPrediction:
        """Test n predicted from the others."""
        whitened, others = self.whitened, [k for k in self.heavy if k != n]
        theirs, left = whitened.best(others, [self.x, np.full(self.x.size, 0.5)])
        statistic = self._growth(n, [self.x, theirs], left)
        predicted, measured = whitened.curves(theirs)[n][-1], whitened.measured[n][-1]
        off = float(measured / predicted - 1) if predicted else 0.0
        p = self._by_fisher(n, others, statistic)
        if p < UNCLEAR:
            p = self._by_draws(n, others, theirs, left, statistic, np.random.default_rng(seed))
        return TestPrediction(p, off)

    def _growth(self, n: int, starts: Sequence[Array], left: float) -> float:
        """The growth of the squares by one set of parameters for all tests."""
        own, alone = self.whitened.best((n,), starts)
        _, all_together = self.whitened.best(self.heavy, [*starts, own])
        return max(all_together - alone - left, 0.0)

    def _by_fisher(self, n: int, others: Sequence[int], statistic: float) -> float:
        """The probability of the statistic, or more, by linear theory."""
        slopes = self.whitened.slopes(self.x)
        rows = {k: self.whitened.inverses[k] @ slopes[k] for k in self.heavy}
        shared = _rank(rows[n]) + _rank(np.concatenate([rows[k] for k in others])) - _rank(np.concatenate(list(rows.values())))
        if shared <= 0:
            return 1.0
        freedom = sum(self.whitened.freedom[k] for k in self.heavy)
        if not np.isfinite(freedom):  # stated deviations
            return float(chi2.sf(statistic, shared))
        return float(fisher.sf(statistic / shared, shared, freedom))

    def _by_draws(
        self, n: int, others: Sequence[int], theirs: Array, left: float, statistic: float, rng: np.random.Generator
    ) -> float:
        """The share of curves of test n, drawn from their distribution given the others, that are as far from the prediction."""
        whitened, freedom, starts, drawn = self.whitened, self.whitened.freedom[n], self._drawn(others, theirs, left, rng), []
        for x in starts:
            size = np.sqrt(freedom / rng.chisquare(freedom)) if np.isfinite(freedom) else 1.0
            noise = size * whitened.roots[n] @ rng.standard_normal(len(whitened.roots[n]))
            drawn.append(whitened.curves(x)[n] + noise)
        alone, together = (whitened.best_of_many(tests, starts, n, np.array(drawn)) for tests in ((n,), self.heavy))
        far = np.maximum(together - alone - left, 0.0) >= statistic
        if far.sum() < ENOUGH:
            return float((1 + far.sum()) / (1 + DRAWS))
        return ENOUGH / float(1 + np.flatnonzero(far)[ENOUGH - 1])

    def _drawn(self, others: Sequence[int], theirs: Array, left: float, rng: np.random.Generator) -> Array:
        """DRAWS sets of parameters from their distribution given the other tests, uniform within the bounds before these tests:
        sampling by importance from a Gaussian that is wider than linear theory's."""
        slopes = self.whitened.slopes(theirs)
        J = np.concatenate([self.whitened.inverses[k] @ slopes[k] for k in others])
        precision = (J.T @ J + 12 * np.eye(theirs.size)) / WIDER
        root = np.linalg.inv(np.linalg.cholesky(precision)).T
        z = rng.standard_normal((PROPOSED, theirs.size))
        z = np.concatenate([np.zeros((1, theirs.size)), z])
        proposed = theirs + z @ root.T
        within = np.all((proposed >= 0) & (proposed <= 1), axis=1)
        within[0] = True
        proposed, z = np.clip(proposed[within], 0, 1), z[within]
        freedom = sum(self.whitened.freedom[k] for k in others)
        growth = np.maximum(self.whitened.squares(others, proposed) - left, 0.0)
        by_growth = -0.5 * growth
        if np.isfinite(freedom):
            by_growth = -(freedom + theirs.size) / 2 * np.log1p(growth / freedom)
        weights = by_growth + 0.5 * np.sum(z**2, axis=1)
        weights = np.exp(weights - weights.max())
        return proposed[rng.choice(len(proposed), DRAWS, p=weights / weights.sum())]


def _rank(rows: Array) -> int:
    """The number of directions of the parameters that whitened derivatives see within the ranges."""
    return int(np.sum(np.linalg.svd(rows, compute_uv=False) > SEEN))
