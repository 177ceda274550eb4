"""Weighted particles: normalisation in the log domain, moments, effective sample size, resampling."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from suite.estimator import Readout
from suite.linalg import Array
from suite.noise import Noise
from suite.random import Generators
from suite.resampling import Indices, Scheme, select

BLOCK = 32768
"""Particles, of all runs carried together or of one alone, whose arrays stay in the processor's cache."""


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

    @cached_property
    def ess(self) -> Array:
        """Effective sample size 1 / sum w² [R] (Kong, Liu and Wong, 1994)."""
        return np.asarray(1.0 / np.vecdot(self.weights, self.weights))

    @cached_property
    def mean(self) -> Array:
        """Weighted mean [n, R]."""
        return np.asarray(np.vecdot(self.x, self.weights))

    @cached_property
    def moments(self) -> tuple[Array, Array]:
        """Weighted mean [n, R] and covariance [n, n, R]."""
        mean, (n, runs, count) = self.mean, self.x.shape
        cov = np.zeros((n, n, runs))
        for part in blocks(count):
            spread = self.x[..., part] - mean[..., None]
            heavy = spread * self.weights[:, part]
            for i in range(n):
                cov[i, : i + 1] += np.vecdot(heavy[: i + 1], spread[i])
        for i in range(n):
            cov[:i, i] = cov[i, :i]
        return mean, cov

    def read(self) -> Readout:
        """The weighted particles as a readout: the estimate is taken before any resampling."""
        return Readout(*self.moments, self.loglik, self.ess, self.ancestors, self.acceptance)


def runs_at_once(particles: int) -> int:
    """How many runs of so many particles to carry together."""
    return max(1, BLOCK // particles)


def blocks(count: int) -> list[slice]:
    """Slices of at most BLOCK particles."""
    return [slice(s, s + BLOCK) for s in range(0, count, BLOCK)]


def blockwise(function: Callable[..., tuple[Array, ...]], *arrays: NDArray[Any]) -> tuple[Array, ...]:
    """What a function of arrays [..., N] gives, computed for at most BLOCK particles at a time.

    The function returns arrays [..., N] and may draw random numbers; the blocks are fixed, so the numbers are too.
    """
    count = arrays[0].shape[-1]
    if count <= BLOCK:
        return function(*arrays)
    whole: list[Array] = []
    for part in blocks(count):
        found = function(*(a[..., part] for a in arrays))
        whole = whole or [np.empty((*a.shape[:-1], count)) for a in found]
        for into, a in zip(whole, found, strict=True):
            into[..., part] = a
    return tuple(whole)


def drawn(prior: Noise, rng: Generators, count: int) -> Particles:
    """`count` equally weighted draws from the prior for each run."""
    x = prior.sample(rng, (rng.runs, count))
    return weighted(x, np.full(x.shape[1:], -np.log(count)), all_of(rng.runs, count))


def weighted(x: Array, logw: Array, parents: Indices, acceptance: Array | None = None) -> Particles:
    """Particles with log-weights [R, N] that are not normalised yet; the log of their sum is this step's log-likelihood.

    A particle whose log-weight is NaN is impossible, as one of weight zero, and so is one whose state has left the numbers;
    that state becomes zero. A run in which all are impossible gets NaN weights and a log-likelihood of minus infinity: it is
    lost, and it alone.
    """
    logw = np.fmax(logw, -np.inf)
    top = logw.max(-1)
    rest = logw - top[:, None]  # first of all: next to a huge log-likelihood the log of the sum would be lost
    weights = np.exp(rest)
    total = weights.sum(-1)
    weights /= total[:, None]
    loglik = np.where(top == -np.inf, top, top + np.log(total))
    ancestors = 1.0 + np.count_nonzero(parents[:, 1:] != parents[:, :-1], axis=1)
    made = Particles(x, rest - np.log(total)[:, None], weights, loglik, ancestors, acceptance)
    if np.isfinite(made.mean).all():
        return made
    gone = ~np.isfinite(x).all(0)
    if not gone.any():
        return made
    return weighted(np.where(gone, 0.0, x), np.where(gone, -np.inf, logw), parents, acceptance)


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
    if len(which) == runs:
        parents, logw = scheme(particles.weights, rng), np.full((runs, count), -np.log(count))
    else:
        parents, logw = np.array(all_of(runs, count)), particles.logw.copy()
        parents[which] = scheme(particles.weights[which], rng.of(which))
        logw[which] = -np.log(count)
    return Resampled(select(particles.x, parents), logw, parents, which)
