"""Intervals over Monte Carlo runs, for smooth functions of run averages."""

from collections.abc import Callable

import numpy as np
from scipy.special import betaincinv, stdtrit

from suite.linalg import Array

LEVEL = 0.95

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


def mean_over_time(contributions: Array) -> Array:
    """Mean over time of each run's contributions[T, R], those that are NaN left out: [1, R]."""
    return weighted_mean(contributions.T, np.ones((1, len(contributions)))).T


def jackknife(statistic: Statistic, runs: int, level: float = LEVEL) -> tuple[Array, Array, Array]:
    """Value [S] of a smooth statistic of independent runs, and its jackknife interval [S], [S] (Tukey, 1958).

    The interval is centred where infinitely many runs would put the statistic: the mean over time of a root over few runs
    is too small, by more than its scatter when there are many steps. It has Student's t for its reach, and is widened to
    hold the value itself. For a plain mean it is the t interval. With a single run there is no interval: NaN.
    """
    value, left_out = _leave_one_out(statistic, runs)
    return value, *_interval(value, left_out, level)


def positive_jackknife(statistic: Statistic, runs: int, level: float = LEVEL) -> tuple[Array, Array, Array]:
    """The jackknife on the scale of logarithms, for a statistic that is never negative: nor is its interval.

    A statistic that is zero, or would be without some run, keeps the plain scale, cut at zero. An infinite one has an
    interval from the smallest value that it would have without some run.
    """
    value, left_out = _leave_one_out(statistic, runs)
    with np.errstate(all="ignore"):
        low, high = (np.exp(end) for end in _interval(np.log(value), np.log(left_out), level))
        plain_low, plain_high = _interval(value, left_out, level)
    zero = (left_out == 0).any(1) | (value == 0)
    low, high = np.where(zero, np.maximum(plain_low, 0.0), low), np.where(zero, plain_high, high)
    endless = np.isposinf(value) & (runs > 1)
    low = np.where(endless, left_out.min(1, initial=np.inf), np.minimum(low, value))
    return value, low, np.where(endless, np.inf, np.maximum(high, value))


def _leave_one_out(statistic: Statistic, runs: int) -> tuple[Array, Array]:
    """The statistic of all runs [S], and of all but each one in turn [S, R] (none when there is a single run)."""
    with np.errstate(all="ignore"):
        value = statistic(np.ones((1, runs)))[:, 0]
        return value, statistic(1.0 - np.eye(runs)) if runs > 1 else np.empty((len(value), 0))


def _interval(value: Array, left_out: Array, level: float) -> tuple[Array, Array]:
    runs = left_out.shape[1]
    if runs < 2:
        return np.full_like(value, np.nan), np.full_like(value, np.nan)
    with np.errstate(all="ignore"):
        middle = left_out.mean(1)
        centre = runs * value - (runs - 1) * middle
        error = np.sqrt((runs - 1) / runs * ((left_out - middle[:, None]) ** 2).sum(1))
        reach = stdtrit(runs - 1, 0.5 + level / 2) * error
        return np.minimum(centre - reach, value), np.maximum(centre + reach, value)


def proportion(count: int, total: int, level: float = LEVEL) -> tuple[float, float]:
    """Exact interval of a binomial proportion (Clopper and Pearson, 1934); NaN when there is nothing to count."""
    if total == 0:
        return float("nan"), float("nan")
    tail = (1 - level) / 2
    low = betaincinv(count, total - count + 1, tail) if count > 0 else 0.0
    high = betaincinv(count + 1, total - count, 1 - tail) if count < total else 1.0
    return float(low), float(high)
