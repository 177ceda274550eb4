"""Detectors of manoeuvres by their statistic: receiver operating characteristics, and what they do at a threshold.

Scores[2, S, R] are those of manoeuvre-free flight [0] and of manoeuvres [1], by run; NaN where there is none.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtr, betainc

from suite.case import Card, Truth
from suite.estimator import Estimate
from suite.linalg import Array
from suite.statistics import LEVEL, Resampled

Whole = NDArray[np.intp]
SETTLED = 3
"""Step from which on alarms count: estimators settle in the first two."""
TAILS = np.array([(1 - LEVEL) / 2, (1 + LEVEL) / 2])


@dataclass(frozen=True)
class Curve:
    """Shares of the manoeuvre-free scores, and of those of manoeuvres, at or above each threshold [D + 1], infinity first."""

    threshold: Array
    false_alarm: Array
    detection: Array


def curve(scores: Array) -> Curve:
    """The receiver operating characteristic of scores[2, S, R]: a point for every distinct score."""
    quiet, loud = (np.sort(part[~np.isnan(part)]) for part in scores)
    threshold = np.append(np.unique(np.concat([quiet, loud])), np.inf)[::-1]
    false_alarm, detection = (1 - np.searchsorted(part, threshold) / len(part) for part in (quiet, loud))
    return Curve(threshold, false_alarm, detection)


def area(scores: Array) -> Resampled:
    """Area under the curve [1]: how often a manoeuvre's score is the higher of the two, ties half (Mann and Whitney, 1947).

    The pairs won that are left without a run are all but its row and its column, which share those within the run.
    """
    (quiet, loud), (still, moving), count = _ranked(scores)
    runs, span = count.shape[1], 1 + max(quiet.max(initial=0), loud.max(initial=0))
    row = np.bincount(moving, _below(loud, quiet), runs)
    column = np.bincount(still, len(loud) - _below(quiet, loud), runs)
    before = np.cumsum(count[0]) - count[0]  # manoeuvre-free scores of earlier runs
    own = np.bincount(moving, _below(loud + span * moving, quiet + span * still) - before[moving], runs)
    total, pairs = count.sum(1, keepdims=True), row.sum()
    with np.errstate(invalid="ignore"):
        return _of_runs(pairs / total.prod(0), (pairs - row - column + own) / (total - count).prod(0))


def partial_area(scores: Array, limit: float) -> Resampled:
    """Mean detection rate [1] over the false-alarm rates from 0 to limit: the area below that part, by its width."""
    (quiet, loud), (still, moving), count = _ranked(scores)
    runs, last = count.shape[1], max(quiet.max(initial=0), loud.max(initial=0))
    alarms = np.cumsum(np.bincount(last - quiet, minlength=last + 1))
    # Behind the threshold that has so many alarms no curve is below the limit, whatever run it lacks.
    deep = 1 + int(np.searchsorted(alarms, limit * count[0].sum() + count[0].max()))
    rates = []
    for rank, run, each in zip((last - quiet, last - loud), (still, moving), count, strict=True):
        near = rank < deep
        table = np.bincount(rank[near] * runs + run[near], minlength=deep * runs).reshape(deep, runs)
        reached = np.concat([np.zeros((1, runs)), np.cumsum(table, axis=0)])
        whole = reached.sum(1, keepdims=True)
        with np.errstate(invalid="ignore"):
            rates.append(np.concat([whole / each.sum(), (whole - reached) / (each.sum() - each)], axis=1))
    (start, low), (end, high) = ((rates[0][at], rates[1][at]) for at in (slice(-1), slice(1, None)))
    width = np.minimum(end, limit) - np.minimum(start, limit)
    share = np.divide(width, end - start, out=np.zeros_like(width), where=end > start)
    found = (width * (low + share * (high - low) / 2)).sum(0) / limit
    return _of_runs(found[:1], found[1:])


def standardised(mean: Array, limit: float) -> Array:
    """McClish's index (1989) of mean detection rates up to a false-alarm rate: 1 at best, 0.5 by chance, as the whole area."""
    return (1 + (mean - limit / 2) / (1 - limit / 2)) / 2


def _ranked(scores: Array) -> tuple[tuple[Whole, Whole], tuple[Whole, Whole], Whole]:
    """Of both kinds of scores: their ranks among all distinct ones, their runs, and how many each run has [2, R]."""
    known = ~np.isnan(scores)
    _, rank = np.unique(np.concat([scores[0][known[0]], scores[1][known[1]]]), return_inverse=True)
    quiet, loud = np.split(rank, [known[0].sum()])
    return (quiet, loud), (np.nonzero(known[0])[-1], np.nonzero(known[1])[-1]), known.sum(1)


def _below(values: Whole, among: Whole) -> Array:
    """How many of others each value is above, ties half."""
    among = np.sort(among)
    return (np.searchsorted(among, values) + np.searchsorted(among, values, side="right")) / 2


def _of_runs(value: Array, left_out: Array) -> Resampled:
    """Of a single run nothing can be left out."""
    return Resampled(value, left_out[None] if len(left_out) > 1 else np.empty((1, 0)))


def _jeffreys(mean: Array, error: Array, draws: Array | int) -> tuple[Array, Array]:
    """Parameters of the beta law of shares with such a mean and standard error; of so many draws where it is zero."""
    spread = mean * (1 - mean)
    size = np.where((error > 0) & (spread > 0), spread / np.where(error > 0, error, 1.0) ** 2, draws)
    return mean * size + 0.5, (1 - mean) * size + 0.5


@dataclass(frozen=True)
class Onsets:
    """The first manoeuvre of each run, where nominal steps on which alarms count lie before it; in other runs NaN.

    before[R]: the largest statistic on those steps. risen[T, R]: the largest statistic of the manoeuvre so far. lasts[T, R],
    of all runs: how long a step of the manoeuvre lasts in s, 0 where there is none.
    """

    before: Array
    risen: Array
    lasts: Array

    @property
    def scores(self) -> Array:
        """The largest statistic before and in the manoeuvre, as scores[2, 1, R]."""
        return np.stack([self.before, self.risen[-1]])[:, None]

    def detected(self, threshold: Array) -> Array:
        """1 where a manoeuvre is detected, else 0 [C, R], at thresholds[C]; NaN where there is an alarm before it."""
        return self._unless_before(threshold, self.risen[-1] > threshold[:, None])

    def delay(self, threshold: Array) -> Array:
        """Time in s from the first step of a manoeuvre to the alarm [C, R]; its duration where it is missed; NaN as above."""
        waited = np.zeros((len(threshold), len(self.before)))
        for at in np.flatnonzero(self.lasts.any(1)):
            waited += self.lasts[at] * ~(self.risen[at] > threshold[:, None])
        return self._unless_before(threshold, waited)

    def _unless_before(self, threshold: Array, found: Array) -> Array:
        return np.where(self.before <= threshold[:, None], found, np.nan)


def onsets(case: Card, truth: Truth, estimate: Estimate) -> Onsets | None:
    """The first manoeuvres of all runs; None without a statistic, or where no manoeuvre is known of."""
    manoeuvring = manoeuvres(case, truth)
    if estimate.statistic is None or manoeuvring is None:
        return None
    began = np.logical_or.accumulate(manoeuvring)
    inside = began & ~np.logical_or.accumulate(began & ~manoeuvring)
    step = np.arange(1, len(began) + 1)[:, None]
    before = np.fmax.reduce(np.where(~began & (step >= SETTLED), estimate.statistic, np.nan))
    risen = np.fmax.accumulate(np.where(inside, estimate.statistic, np.nan))
    used = ~np.isnan(before) & ~np.isnan(risen[-1])
    lasts = np.diff(case.time, append=case.time[-1] + case.interval)[:, None] * inside
    return Onsets(np.where(used, before, np.nan), np.where(used, risen, np.nan), lasts)


def manoeuvres(case: Card, truth: Truth) -> NDArray[np.bool_] | None:
    """Whether a mode other than the nominal one is in force [T, R]; None where that never is, or is not known."""
    if truth.mode is None or case.nominal not in case.modes:
        return None
    found = np.asarray(truth.mode) != case.modes.index(case.nominal)
    return found if found.any() else None


def peaks(calm: Estimate | None) -> Array:
    """The largest statistic of each manoeuvre-free run that came through, on the steps on which alarms count; largest first.

    Above the j-th of C such a further run rises with probability j / (C + 1), whatever the law of the statistic; less than
    that where it is not continuous. The probability itself, over sets of C runs, is beta with parameters j and C + 1 - j.
    """
    if calm is None or calm.statistic is None:
        return np.empty(0)
    found = np.fmax.reduce(calm.statistic[SETTLED - 1 :, calm.ok], initial=np.nan)
    return np.sort(found[~np.isnan(found)])[::-1]


def place(level: float, count: int) -> int:
    """Which of `count` peaks is the threshold for a false-alarm level, 1 for the largest; 0 where they are too few."""
    return int(level * (count + 1) + 1e-9)


def calibrated(values: Array, level: float) -> tuple[float, float, float]:
    """Mean of values[C + 1, R] within 0 to 1 at the threshold for a level, and its interval; row j is that at the j-th peak.

    Row 0 is that at an infinite threshold. The threshold that truly has the level is above all but i peaks, i binomial: it is
    between rows i and i + 1. At each the mean has Jeffreys' law, and of their mixture the interval holds the middle 95 %,
    whichever of the two rows is taken. So it covers chance in the manoeuvre-free runs too; where they are fewer than
    log 0.025 / log(1 - level), 36 for 0.1, the threshold may well be above all they show, and the interval says so.
    """
    known = ~np.isnan(values)
    draws = known.sum(1)
    with np.errstate(invalid="ignore"):
        mean = np.where(known, values, 0.0).sum(1) / draws
        error = np.sqrt(np.where(known, (values - mean[:, None]) ** 2, 0.0).sum(1)) / draws
    a, b = _jeffreys(np.where(draws, mean, 0.5), np.where(draws, error, 0.0), draws)
    count = len(values) - 1
    weight = np.diff(bdtr(np.arange(count + 1), count, level), prepend=0.0)
    row = np.flatnonzero(weight > 1e-9)
    rows = np.stack([row, np.minimum(row + 1, count)])[:, None]
    low, high = np.zeros((2, 2)), np.ones((2, 2))
    for _ in range(30):
        middle = (low + high) / 2
        below = (weight[row] * betainc(a[rows], b[rows], middle[..., None])).sum(-1) < TAILS
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    value = float(mean[place(level, count)])
    return value, float(np.minimum(low.min(), value)), float(np.maximum(high.max(), value))
