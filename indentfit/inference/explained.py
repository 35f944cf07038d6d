"""The part of a test's noise that the coordinates of a fit can explain, and noise that is correlated in it and apart from it.

Under correlated noise, generalised least squares predicts the noise within the fitted curve from the residuals, which show the
noise beside it. Residuals that are the law's smooth misfit predict nothing, and the fit then leaves the points: an optimum with
twice the RMSE of the best one was "determined". So the noise that the coordinates can explain counts as independent of what they
leave: its size is that of the correlated noise, and the fitted curve is that of least squares (Zyskind 1967, Ann Math Stat 38:1092:
both estimates agree if, and only if, the noise has no correlation between the two). Independent noise has none in any case.
"""

from dataclasses import dataclass

import numpy as np

from indentfit.arrays import Array


@dataclass(frozen=True, eq=False)
class Explained:
    """Independent directions (n, r) of a test's n points that coordinates explain, each in the parts `shares` (r,), between 0 where
    it is known without the test and 1 where the test alone tells it."""

    directions: Array
    shares: Array

    @classmethod
    def none(cls, points: int) -> "Explained":
        """Nothing that is explained."""
        return cls(np.zeros((points, 0)), np.zeros(0))

    def apart(self, correlations: Array) -> Array:
        """Correlations (n, n) without those between what is explained and what is not.

        A direction of the share h is sqrt(h) of the one and sqrt(1 - h) of the other, so correlations of two directions keep the
        part sqrt(h h') + sqrt((1 - h) (1 - h')). White noise stays as it is.
        """
        B, inside, outside = self.directions, np.sqrt(self.shares), np.sqrt(1 - self.shares)
        within = B.T @ correlations @ B
        beside = correlations @ B - B @ within  # of all other directions with these
        others = correlations - beside @ B.T - B @ beside.T - B @ within @ B.T
        kept = np.outer(inside, inside) + np.outer(outside, outside)
        mixed = (beside * outside) @ B.T
        return np.asarray(others + mixed + mixed.T + B @ (within * kept) @ B.T)


def explained(slopes: Array, known: Array) -> Explained:
    """What coordinates explain of a test.

    Parameters
    ----------
    slopes : array (n, p)
        Derivatives of the test's forces by the coordinates, over the standard deviation of its noise.
    known : array (p, p)
        What is known of the coordinates without the test: the inverse of their covariance.
    """
    root = np.linalg.cholesky(known)
    U, sizes, _ = np.linalg.svd(np.linalg.solve(root, slopes.T).T, full_matrices=False)
    return Explained(U, sizes**2 / (1 + sizes**2))
