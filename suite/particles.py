"""Weighted particles: normalisation in the log domain, moments, effective sample size, resampling."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from suite.estimator import Readout
from suite.linalg import Array
from suite.noise import Noise
from suite.random import Generators
from suite.resampling import Indices, Scheme, select

CACHE = 16_384
"""Particles of all runs that are carried together, so that their arrays stay in the processor's cache."""


@dataclass(frozen=True)
class Particles:
    """Particles x[n, R, N] with log-weights logw[R, N], normalised so that their exponentials `weights` sum to one.

    loglik[R] is this step's estimate of log p(y_k | y_1..y_{k-1}); ancestors[R], how many particles of the step before
    have offspring here; acceptance[R], the share of particles that were moved since, NaN in a run where none was tried.
    """

    x: Array
    logw: Array
    weights: Array
    loglik: Array
    ancestors: Array
    acceptance: Array | None = None

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

    def read(self) -> Readout:
        """The weighted particles as a readout: the estimate is taken before any resampling."""
        mean, cov = self.moments()
        return Readout(mean, cov, self.loglik, self.ess, self.ancestors, self.acceptance)


def runs_at_once(particles: int) -> int:
    """How many runs of so many particles to carry together."""
    return max(1, CACHE // particles)


def drawn(prior: Noise, rng: Generators, count: int) -> Particles:
    """`count` equally weighted draws from the prior for each run."""
    x = prior.sample(rng, (rng.runs, count))
    return weighted(x, np.full(x.shape[1:], -np.log(count)), all_of(rng.runs, count))


def weighted(x: Array, logw: Array, parents: Indices, acceptance: Array | None = None) -> Particles:
    """Particles with log-weights [R, N] that are not normalised yet; the log of their sum is this step's log-likelihood.

    A run whose weights are all zero, or any of whose weights is NaN, gets NaN weights: it is lost, and it alone.
    """
    top = logw.max(-1)
    weights = np.exp(logw - top[:, None])
    total = weights.sum(-1)
    loglik = top + np.log(total)
    ancestors = 1.0 + (np.diff(parents, axis=1) != 0).sum(1)
    return Particles(x, logw - loglik[:, None], weights / total[:, None], loglik, ancestors, acceptance)


def all_of(runs: int, count: int) -> Indices:
    """The indices [R, N] of all particles: each its own and only offspring."""
    return np.broadcast_to(np.arange(count), (runs, count))


@dataclass(frozen=True)
class Resampled:
    """Particles x[n, R, N] after the decision to resample: their log-weights [R, N], parents [R, N], and which runs were."""

    x: Array
    logw: Array
    parents: Indices
    runs: NDArray[np.intp]


def resample(particles: Particles, scheme: Scheme, threshold: float, rng: Generators) -> Resampled:
    """Resample the runs whose effective sample size is below threshold · N.

    Runs with equal weights are left as they are, also with a threshold of 1: resampling them would bring noise and nothing
    else. Random numbers are drawn for those runs alone that are resampled, so that a run's stream does not depend on its
    neighbours.
    """
    runs, count = particles.weights.shape
    chosen = ~(particles.ess >= min(threshold, 1 - 1e-9) * count)
    which = np.flatnonzero(chosen)
    if not len(which):
        return Resampled(particles.x, particles.logw, all_of(runs, count), which)
    parents = np.array(all_of(runs, count))
    parents[which] = scheme(particles.weights[which], rng.of(which))
    logw = np.where(chosen[:, None], -np.log(count), particles.logw)
    return Resampled(select(particles.x, parents), logw, parents, which)


def metropolis(x: Array, candidates: Array, log_ratio: Array, rng: Generators) -> tuple[Array, Array]:
    """One Metropolis-Hastings step for each particle: x[n, R, N] after it, and the share of candidates accepted [R]."""
    uniform = rng.random((1, *log_ratio.shape))[0]
    accepted = np.log(uniform) < log_ratio
    return np.where(accepted, candidates, x), accepted.mean(-1)
