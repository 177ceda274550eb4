"""Two samples beside each other: differences, wins and effect sizes with intervals, p-values, and their adjustment."""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import nctdtrinc, ndtri, stdtr, stdtrit

from suite.linalg import Array
from suite.score import ROUNDING
from suite.statistics import LEVEL, Resampled, proportion


@dataclass(frozen=True)
class Interval:
    """A number with its 95 % interval; NaN what does not exist."""

    value: float = np.nan
    low: float = np.nan
    high: float = np.nan


NONE = Interval()
Counts = NDArray[np.intp]
MOST_PAIRS = 1000
"""Pairs of two samples up to which ranks are tested exactly; beyond, the normal approximation is as good."""


@dataclass(frozen=True, eq=False)
class Gap:
    """Differences [S]: their values, where infinitely many runs would put them, standard errors, t's degrees of freedom."""

    value: Array
    centre: Array
    error: Array
    freedom: Array

    def intervals(self, scale: Callable[[Array], Array] = np.positive) -> list[Interval]:
        """The t intervals, widened to hold the values as that of `suite.statistics.jackknife`; a function of all three."""
        reach = stdtrit(self.freedom, 0.5 + LEVEL / 2) * self.error
        low, high = np.minimum(self.centre - reach, self.value), np.maximum(self.centre + reach, self.value)
        with np.errstate(over="ignore"):
            return intervals(scale(self.value), scale(low), scale(high))

    @property
    def p(self) -> Array:
        """Two-sided, by Student's t; 1 where the difference is rounding."""
        with np.errstate(divide="ignore", invalid="ignore"):
            t = np.abs(self.centre / self.error)
        return np.where(np.abs(self.centre) <= ROUNDING, 1.0, 2 * stdtr(self.freedom, -t))


def gap(one: Resampled, other: Resampled, paired: bool = True) -> Gap:
    """Statistics [S] minus others of the same runs, or of runs that are no pairs (B. L. Welch, Biometrika 34, 1947)."""
    with np.errstate(all="ignore"):
        value = one.value - other.value
        if paired:
            return Gap(value, *(one - other).centre_and_error, np.full(len(value), one.left_out.shape[1] - 1.0))
        (first, mine), (second, theirs) = (each.centre_and_error for each in (one, other))
        error = np.hypot(mine, theirs)
        parts = [(e / error) ** 4 / (each.left_out.shape[1] - 1) for e, each in ((mine, one), (theirs, other))]
        return Gap(value, first - second, error, 1 / (parts[0] + parts[1]))


def intervals(value: Array, low: Array, high: Array) -> list[Interval]:
    """Numbers [S] with their ends."""
    return [Interval(*each) for each in zip(value.tolist(), low.tolist(), high.tolist(), strict=True)]


def rates_apart(one: Array, other: Array) -> Interval:
    """Difference of two rates of the same runs, from flags [1, R]; the interval covers where hardly a run differs, too.

    D. G. Bonett, R. M. Price, Adjusted Wald confidence interval for a difference of binomial proportions based on paired data,
    Journal of Educational and Behavioral Statistics 37(4), 2012, 479-488.
    """
    runs = one.shape[-1]
    more, fewer = int((one > other).sum()), int((one < other).sum())
    first, second = (more + 1) / (runs + 2), (fewer + 1) / (runs + 2)
    centre, value = first - second, (more - fewer) / runs
    reach = float(ndtri(0.5 + LEVEL / 2)) * np.sqrt((first + second - centre**2) / (runs + 2))
    return Interval(value, max(min(centre - reach, value), -1.0), min(max(centre + reach, value), 1.0))


def unpaired_rates_apart(one: Array, other: Array) -> Interval:
    """Difference of two rates of other runs each, from flags [1, R] and [1, S].

    A. Agresti, B. Caffo, Simple and effective confidence intervals for proportions and differences of proportions result from
    adding two successes and two failures, The American Statistician 54(4), 2000, 280-288.
    """
    value = float(one.mean() - other.mean())
    rates, runs = zip(*((float(each.sum() + 1) / (each.size + 2), each.size + 2) for each in (one, other)), strict=True)
    centre = rates[0] - rates[1]
    error = np.sqrt(sum(rate * (1 - rate) / n for rate, n in zip(rates, runs, strict=True)))
    reach = float(ndtri(0.5 + LEVEL / 2) * error)
    return Interval(value, max(min(centre - reach, value), -1.0), min(max(centre + reach, value), 1.0))


def exact_test(one: Array, other: Array) -> float:
    """Fisher's exact two-sided p-value of two rates being equal, from flags [1, R] and [1, S] of other runs each."""
    from scipy.stats import fisher_exact  # takes a second to import

    counts = np.array([[int(each.sum()), int(each.size - each.sum())] for each in (one, other)])
    return float(fisher_exact(counts).pvalue)


def rank_test(one: Array, other: Array) -> float:
    """Mann and Whitney's two-sided p-value of two samples [R] and [S] of one law, exact where none are tied."""
    from scipy.stats import mannwhitneyu  # takes a second to import

    both = np.concatenate([one, other])
    exact = len(np.unique(both)) == len(both) and len(one) * len(other) <= MOST_PAIRS
    return float(mannwhitneyu(one, other, method="exact" if exact else "asymptotic").pvalue)


def wins(mine: Array, theirs: Array) -> tuple[Counts, Counts]:
    """In how many runs the first of two losses [..., R] is the smaller one, and the larger one, beyond rounding: [...]."""
    with np.errstate(invalid="ignore"):
        apart = np.where(mine == theirs, 0.0, mine - theirs)  # infinite ones may be alike
    return np.asarray((apart < -ROUNDING).sum(-1)), np.asarray((apart > ROUNDING).sum(-1))


@functools.lru_cache(maxsize=4096)
def win_probability(more: int, fewer: int, runs: int) -> Interval:
    """Wins and half the ties among all runs, with Clopper and Pearson's interval; half a win is rounded outwards."""
    twice = runs + more - fewer
    return Interval(twice / 2 / runs, proportion(twice // 2, runs)[0], proportion(-(-twice // 2), runs)[1])


def effect_sizes(gained: Array) -> list[Interval]:
    """Mean over standard deviation of differences [S, R] (d_z of Cohen, 1988), each with its interval for normal ones.

    That is by noncentral t. NaN where the differences are all alike, or not finite.
    """
    runs = gained.shape[1]
    if runs < 2:
        return [NONE] * len(gained)
    with np.errstate(all="ignore"):
        spread, largest = gained.std(1, ddof=1), np.abs(gained).max(1)
        usable = np.isfinite(gained).all(1) & np.isfinite(spread) & (largest > ROUNDING) & (spread > ROUNDING * largest)
        t = np.where(usable, gained.mean(1) / spread * np.sqrt(runs), np.nan)
    low, high = (nctdtrinc(runs - 1, 0.5 + side * LEVEL / 2, t) for side in (1, -1))
    return intervals(*(end / np.sqrt(runs) for end in (t, low, high)))


@functools.lru_cache(maxsize=4096)
def sign_test(more: int, fewer: int) -> float:
    """Exact two-sided p-value of as many wins and losses where both are as likely: of rates, McNemar's test."""
    from statsmodels.stats.contingency_tables import mcnemar  # type: ignore[import-untyped]  # takes a second to import

    return float(mcnemar([[0, more], [fewer, 0]], exact=True).pvalue)


def holm(p: Sequence[float]) -> list[float]:
    """p-values adjusted by Holm's method (S. Holm, 1979); those that are NaN are no part of the family.

    Not statsmodels' own, which collects garbage at every call: a tenth of a second for what takes microseconds.
    """
    order = np.argsort(p)  # NaN last
    count = int((~np.isnan(p)).sum())
    adjusted = np.full(len(p), np.nan)
    falling = np.maximum.accumulate(np.asarray(p, float)[order[:count]] * np.arange(count, 0, -1))
    adjusted[order[:count]] = np.minimum(falling, 1.0)
    return adjusted.tolist()
