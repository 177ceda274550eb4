"""Intervals over Monte Carlo runs, for smooth functions of run averages."""

import functools
from collections.abc import Callable

import numpy as np
from scipy.special import betaincinv, ndtr, ndtri

from suite.linalg import Array

LEVEL = 0.95
RESAMPLES = 2000

Statistic = Callable[[Array], Array]
"""From weights of runs W[B, R], each row summing to R, to the statistics [S, B] of the runs so weighted."""


def weighted_mean(contributions: Array, weights: Array) -> Array:
    """Mean over runs of contributions[T, R] under each row of weights[B, R]: [T, B].

    NaN contributions are left out; infinite ones make the mean infinite wherever their weight is not zero.
    """
    if np.isfinite(contributions).all():
        return np.asarray(contributions @ weights.T / weights.sum(1))
    known = (~np.isnan(contributions)).astype(float) @ weights.T
    endless = np.isposinf(contributions).astype(float) @ weights.T > 0
    mean = np.nan_to_num(contributions, nan=0.0, posinf=0.0, neginf=-np.inf) @ weights.T / known
    return np.where(endless, np.inf, mean)


def bca(statistic: Statistic, runs: int, level: float = LEVEL) -> tuple[Array, Array, Array]:
    """Value [S] of a statistic of independent runs, and its BCa bootstrap interval [S], [S] (Efron, 1987).

    The bootstrap resamples whole runs. All statistics of the same number of runs see the same resamples, so that
    differences between estimators stay paired. With a single run there is no interval: NaN.
    """
    with np.errstate(all="ignore"):
        value = statistic(np.ones((1, runs)))[:, 0]
        if runs < 2:
            return value, np.full_like(value, np.nan), np.full_like(value, np.nan)
        replicates = np.sort(statistic(_resamples(runs)), axis=1)
        jackknife = statistic(1.0 - np.eye(runs))
        spread = jackknife.mean(1, keepdims=True) - jackknife
        skewness = (spread**3).sum(1) / (6.0 * (spread**2).sum(1) ** 1.5)
        below = (replicates < value[:, None]).mean(1) + 0.5 * (replicates == value[:, None]).mean(1)
        bias = ndtri(np.clip(below, 0.5 / RESAMPLES, 1 - 0.5 / RESAMPLES))
        z = ndtri(0.5 - level / 2)
        low, high = (
            _quantile(replicates, ndtr(bias + (bias + side) / (1.0 - np.nan_to_num(skewness) * (bias + side))))
            for side in (z, -z)
        )
    return value, low, high


def proportion(count: int, total: int, level: float = LEVEL) -> tuple[float, float]:
    """Exact interval of a binomial proportion (Clopper and Pearson, 1934); NaN when there is nothing to count."""
    if total == 0:
        return float("nan"), float("nan")
    tail = (1 - level) / 2
    low = betaincinv(count, total - count + 1, tail) if count > 0 else 0.0
    high = betaincinv(count + 1, total - count, 1 - tail) if count < total else 1.0
    return float(low), float(high)


@functools.lru_cache(maxsize=16)
def _resamples(runs: int) -> Array:
    """Weights [B, R] of the bootstrap resamples of a number of runs, the same at every call."""
    rng = np.random.Generator(np.random.SFC64(runs))
    return rng.multinomial(runs, np.full(runs, 1 / runs), size=RESAMPLES).astype(float)


def _quantile(ordered: Array, probability: Array) -> Array:
    """Quantiles of each row of ordered[S, B] at its own probability [S]."""
    place = np.clip(probability, 0, 1) * (ordered.shape[1] - 1)
    lower = np.floor(place).astype(np.intp)
    upper = np.minimum(lower + 1, ordered.shape[1] - 1)
    rows = np.arange(len(ordered))
    share = place - lower
    between = ordered[rows, lower] * (1 - share) + ordered[rows, upper] * share
    return np.asarray(np.where(share > 0, between, ordered[rows, lower]))  # zero times infinity is no number
