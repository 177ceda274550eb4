"""Intervals over Monte Carlo runs, for statistics that are computed of all runs and without each run in turn."""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv, ndtri, stdtr, stdtrit

from suite.linalg import Array

LEVEL = 0.95
ROUNDING = 1e-8
"""Scatter of a share that counts as none."""


@dataclass(frozen=True, eq=False)
class Resampled:
    """A statistic of independent runs: its value [S], and left_out[S, R], the same without each run in turn (Tukey, 1958).

    Of a single run nothing can be left out: left_out[S, 0].
    """

    value: Array
    left_out: Array

    def map(self, function: Callable[[Array], Array]) -> "Resampled":
        """A function of the statistic, which may join its components S but not its runs."""
        with np.errstate(all="ignore"):
            return Resampled(function(self.value[:, None])[:, 0], function(self.left_out))

    def __getitem__(self, which: NDArray[np.intp]) -> "Resampled":
        """Some of its components."""
        return Resampled(self.value[which], self.left_out[which])

    def __sub__(self, other: "Resampled") -> "Resampled":
        with np.errstate(invalid="ignore"):
            return Resampled(self.value - other.value, self.left_out - other.left_out)

    @functools.cached_property
    def logarithm(self) -> "Resampled":
        """Its logarithm."""
        return self.map(np.log)

    @functools.cached_property
    def positive(self) -> NDArray[np.bool_]:
        """Whether it is above zero, also without any run: [S]."""
        return (self.value > 0) & (self.left_out > 0).all(1)

    @functools.cached_property
    def centre_and_error(self) -> tuple[Array, Array]:
        """Where infinitely many runs would put the statistic [S], and its standard error [S]; NaN of a single run."""
        runs = self.left_out.shape[1]
        if runs < 2:
            return np.full_like(self.value, np.nan), np.full_like(self.value, np.nan)
        with np.errstate(all="ignore"):
            middle = self.left_out.mean(1)
            error = np.sqrt((runs - 1) / runs * ((self.left_out - middle[:, None]) ** 2).sum(1))
            return runs * self.value - (runs - 1) * middle, error


def stacked(samples: Sequence[Resampled]) -> Resampled:
    """Statistics of as many runs, one below the other."""
    return Resampled(np.concatenate([s.value for s in samples]), np.concatenate([s.left_out for s in samples]))


def means(contributions: Array) -> Resampled:
    """Means over runs of contributions[T, R]: [T]. NaN contributions are left out.

    Sums without a run are those of the runs before and after it: subtracting it from the whole would lose all digits where
    it is far larger than the others, and cannot be done where it is infinite.
    """
    known = ~np.isnan(contributions)
    filled = contributions if known.all() else np.where(known, contributions, 0.0)
    count = known.sum(1, keepdims=True)
    with np.errstate(all="ignore"):
        before, after = np.cumsum(filled, axis=1), np.cumsum(filled[:, ::-1], axis=1)[:, ::-1]
        value = before[:, -1] / count[:, 0]
        if filled.shape[1] < 2:
            return Resampled(value, np.empty((len(value), 0)))
        rest = np.zeros_like(filled)
        rest[:, 1:] += before[:, :-1]
        rest[:, :-1] += after[:, 1:]
        return Resampled(value, rest / (count - known))


def averaged(contributions: Array, link: Callable[[Array], Array] = np.positive) -> Resampled:
    """The mean over time of link(mean over runs) of contributions[T, R]: [1]. What is NaN is left out."""
    complete = not np.isnan(contributions).any()
    if complete and link is np.positive:  # averages over time and over runs commute: average over time once
        return means(contributions.mean(0, keepdims=True))
    return means(contributions).map(lambda steps: _mean_of_known(link(steps)))


def mean_over_time(contributions: Array) -> Array:
    """Mean over time of each run's contributions[T, R], those that are NaN left out: [1, R]."""
    return _mean_of_known(contributions)


def _mean_of_known(values: Array) -> Array:
    """Mean over the first axis of values[T, R], those that are NaN left out: [1, R]."""
    unknown = np.isnan(values)
    if not unknown.any():
        return np.asarray(values.mean(0, keepdims=True))
    with np.errstate(invalid="ignore"):
        return np.asarray(np.where(unknown, 0.0, values).sum(0, keepdims=True) / (~unknown).sum(0, keepdims=True))


def jackknife(sample: Resampled, level: float = LEVEL) -> tuple[Array, Array]:
    """The jackknife interval [S], [S] of a smooth statistic.

    It is centred where infinitely many runs would put the statistic: the mean over time of a root over few runs
    is too small, by more than its scatter when there are many steps. It has Student's t for its reach, and is widened to
    hold the value itself. For a plain mean it is the t interval. With a single run there is no interval: NaN.
    """
    centre, error = sample.centre_and_error
    with np.errstate(all="ignore"):
        reach = stdtrit(sample.left_out.shape[1] - 1, 0.5 + level / 2) * error
        return np.minimum(centre - reach, sample.value), np.maximum(centre + reach, sample.value)


def positive_jackknife(sample: Resampled, level: float = LEVEL) -> tuple[Array, Array]:
    """The jackknife on the scale of logarithms, for a statistic that is never negative: nor is its interval.

    A statistic that is zero, or would be without some run, keeps the plain scale, cut at zero. An infinite one has an
    interval from the smallest value that it would have without some run.
    """
    value, left_out = sample.value, sample.left_out
    with np.errstate(over="ignore"):
        low, high = (np.exp(end) for end in jackknife(sample.logarithm, level))
    plain_low, plain_high = jackknife(sample, level)
    zero = (left_out == 0).any(1) | (value == 0)
    low, high = np.where(zero, np.maximum(plain_low, 0.0), low), np.where(zero, plain_high, high)
    endless = np.isposinf(value) & (left_out.shape[1] > 0)
    low = np.where(endless, left_out.min(1, initial=np.inf), np.minimum(low, value))
    return low, np.where(endless, np.inf, np.maximum(high, value))


def below_zero(sample: Resampled) -> Array:
    """One-sided p-values [S] of a statistic that is in truth zero or more, by Student's t: small where it is below zero."""
    centre, error = sample.centre_and_error
    with np.errstate(all="ignore"):
        t = np.where(error > 0, centre / error, np.sign(centre) * np.inf)
        return np.where(centre == 0, 0.5, stdtr(sample.left_out.shape[1] - 1, t))


def bounded(sample: Resampled, level: float = LEVEL) -> tuple[float, float]:
    """Interval of a single statistic between 0 and 1, such as a share of steps, that stays within these.

    The exact binomial one of as many trials as would give the statistic the standard error that it has over runs, fewer for
    the few runs that tell of it (Korn and Graubard, 1998). At 0 and 1, where runs have no scatter, it is that of as many trials
    as runs. NaN of a single run.
    """
    value, runs = float(sample.value[0]), sample.left_out.shape[1]
    error = float(sample.centre_and_error[1][0])
    if runs < 2 or not np.isfinite(error):
        return float("nan"), float("nan")
    if value in (0.0, 1.0):
        return proportion(value * runs, runs, level)
    if error < ROUNDING:
        return value, value
    tail = (1 - level) / 2
    trials = value * (1 - value) / error**2 * (ndtri(tail) / stdtrit(runs - 1, tail)) ** 2
    return proportion(value * trials, trials, level)


def proportion(count: float, total: float, level: float = LEVEL) -> tuple[float, float]:
    """Exact interval of a binomial proportion (Clopper and Pearson, 1934); NaN when there is nothing to count."""
    if total == 0:
        return float("nan"), float("nan")
    tail = (1 - level) / 2
    low = betaincinv(count, total - count + 1, tail) if count > 0 else 0.0
    high = betaincinv(count + 1, total - count, 1 - tail) if count < total else 1.0
    return float(low), float(high)
