"""Weighted particles: normalisation in the log domain, moments, effective sample size."""

from dataclasses import dataclass

import numpy as np

from suite.linalg import Array


@dataclass(frozen=True)
class Particles:
    """Particles x[n, R, N] with normalised weights w[R, N], and this step's log-likelihood increment loglik[R]."""

    x: Array
    weights: Array
    loglik: Array

    @property
    def ess(self) -> Array:
        """Effective sample size 1 / sum w² [R] (Kong, Liu and Wong, 1994)."""
        return np.asarray(1.0 / (self.weights * self.weights).sum(-1))

    def moments(self) -> tuple[Array, Array]:
        """Weighted mean [n, R] and covariance [n, n, R]."""
        mean = (self.x * self.weights).sum(-1)
        spread = np.moveaxis(np.subtract(self.x, mean[..., None], order="C"), 1, 0)
        cov = np.matmul(spread * self.weights[:, None], np.swapaxes(spread, 1, 2))
        return mean, np.moveaxis((cov + np.swapaxes(cov, 1, 2)) / 2, 0, -1)


def normalise(logw: Array) -> tuple[Array, Array]:
    """Normalised weights [R, N] of log-weights [R, N], and the log of their sum [R].

    A run whose weights are all zero, or any of whose weights is NaN, gets NaN weights: it is lost, and it alone.
    """
    top = logw.max(-1)
    weights = np.exp(logw - top[:, None])
    total = weights.sum(-1)
    weights /= total[:, None]
    return weights, top + np.log(total)
