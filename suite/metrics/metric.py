"""What a metric is: contributions of each run, averaged over runs, then over time; and scores with intervals."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from suite.case import Card, Truth
from suite.estimator import LOST, OK, Estimate
from suite.linalg import Array
from suite.statistics import Statistic, positive_jackknife, proportion, weighted_mean

Contributions = dict[str, Array]
"""Contributions [T, R] of each run at each step (or [1, R]), by state block or by a name such as 'state'."""


@dataclass(frozen=True)
class Score:
    """A metric's value with its 95 % interval; `runs` of `total` runs entered it, NaN where nothing could."""

    value: float
    low: float
    high: float
    unit: str
    runs: int
    total: int

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.value:.4g}{unit} [{self.low:.4g}, {self.high:.4g}] ({self.runs} of {self.total} runs)"


@dataclass(frozen=True)
class Metric:
    """A figure of merit: the mean over time of link(mean over runs of a run's contributions).

    unit: the unit, or 'block' for the unit of the state block, or 'block, squared'. better: 'lower', 'higher', or the value to
    be hit. formula: LaTeX. timed: whether it looks at running times, measured apart, rather than at errors.
    Values are never negative. fn(case, truth, estimate) gives the contributions of all runs; runs that failed are left out
    afterwards.
    """

    name: str
    title: str
    unit: str
    better: str | float
    formula: str
    words: str
    reference: str
    fn: Callable[[Card, Truth, Estimate], Contributions]
    link: Callable[[Array], Array] = np.positive
    binomial: bool = False
    timed: bool = False

    def __call__(self, case: Card, truth: Truth, estimate: Estimate) -> dict[str, Score]:
        """Scores by state block (or 'state', 'runs', 'step'), with 95 % intervals over runs."""
        total = estimate.mean.shape[-1]
        return {
            block: self.score(contributions, self.unit_of(case, block), total)
            for block, contributions in self.contributions(case, truth, estimate).items()
        }

    def contributions(self, case: Card, truth: Truth, estimate: Estimate) -> Contributions:
        """Contributions [T, R'] of the runs that count: those that came through, and for a rate also those lost."""
        accepted = (OK, LOST) if self.binomial else (OK,)
        used = np.array([status in accepted for status in estimate.status], bool)
        with np.errstate(all="ignore"):  # errors of any size, and NaN in runs that are left out next
            found = self.fn(case, truth, estimate)
        return found if self.timed else {block: values[:, used] for block, values in found.items()}

    def unit_of(self, case: Card, block: str) -> str:
        """The unit of the score of a block."""
        if not self.unit.startswith("block"):
            return self.unit
        unit = case.block(block.partition(", ")[0]).unit
        return f"({unit})²" if unit and self.unit != "block" else unit

    def score(self, contributions: Array, unit: str, total: int) -> Score:
        """Value and interval from the contributions [T, R] of the runs that count, out of `total`."""
        contributions = contributions[:, ~np.isnan(contributions).all(0)]
        runs = contributions.shape[1]
        total = runs if self.timed else total
        if runs == 0:
            return Score(np.nan, np.nan, np.nan, unit, 0, total)
        if self.binomial:
            count = int(contributions.sum())
            return Score(count / runs, *proportion(count, runs), unit, runs, total)
        value, low, high = positive_jackknife(self.average(contributions), runs)
        return Score(float(value[0]), float(low[0]), float(high[0]), unit, runs, total)

    def average(self, contributions: Array) -> Statistic:
        """The metric as a statistic of weighted runs; steps at which no run contributes are left out."""
        complete = not np.isnan(contributions).any()
        if complete and self.link is np.positive:  # averages over time and over runs commute: average over time once
            contributions = contributions.mean(0, keepdims=True)
        over_steps = np.mean if complete else np.nanmean
        return lambda weights: over_steps(self.link(weighted_mean(contributions, weights)), axis=0)[None]

    def over_time(self, contributions: Array) -> tuple[Array, Array, Array]:
        """The metric at each step, with its interval: [T], [T], [T]."""
        return positive_jackknife(lambda weights: self.link(weighted_mean(contributions, weights)), contributions.shape[1])
