"""What a metric is: contributions of each run, joined over runs and time; and scores with intervals."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from suite.case import Card, Truth
from suite.estimator import OK, Estimate
from suite.linalg import Array
from suite.metrics.evidence import Evidence
from suite.statistics import Resampled, averaged, bounded, jackknife, means, positive_jackknife, proportion

Contributions = dict[str, Array]
"""Contributions [T, R] of each run at each step (or [1, R]), by state block or by a name such as 'state'."""
FAMILIES = {
    "error": "Errors",
    "bound": "Against the bound",
    "consistency": "Consistency",
    "modes": "Modes of motion",
    "detection": "Detection of manoeuvres",
    "robustness": "Robustness",
    "particles": "Particles",
    "cost": "Cost",
}
"""Families of metrics, in report order, with their headings; each is a module of that name."""
SURVIVING = "surviving runs"
"""Behind the name of a block: over the runs that did not diverge."""


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
    """A figure of merit: the mean over time of link(mean over runs of a run's contributions), or another `statistic` of them.

    family: one of `FAMILIES`. unit: the unit, or 'block' for the unit of the state block, or 'block, squared'. better: 'lower',
    'higher', or the value to be hit. formula: LaTeX. fn(evidence) gives the contributions of all runs; those of runs whose
    status is not accepted are left out afterwards. statistic: from contributions [..., R] to the value of all runs and without
    each in turn. exact: from contributions to the value and its interval, where another than the jackknife's is known. signed:
    whether values may be negative. binomial: whether it is a share of runs. timed: whether it looks at running times, measured
    apart, rather than at estimates. ranked: whether one estimator can be better than another by it.
    """

    name: str
    family: str
    title: str
    unit: str
    better: str | float
    formula: str
    words: str
    reference: str
    fn: Callable[[Evidence], Contributions]
    link: Callable[[Array], Array] = np.positive
    statistic: Callable[[Array], Resampled] | None = None
    exact: Callable[[Array], tuple[float, float, float]] | None = None
    accepted: Sequence[str] = (OK,)
    signed: bool = False
    binomial: bool = False
    timed: bool = False
    ranked: bool = True

    @property
    def by_ratio(self) -> bool:
        """Whether values are compared by their ratio: those that are never negative, but for shares."""
        return not (self.binomial or self.signed)

    def __call__(self, case: Card, truth: Truth, estimate: Estimate, **more: Any) -> dict[str, Score]:
        """Scores by state block (or 'state', 'runs', 'step'), with 95 % intervals over runs; more: the rest of `Evidence`."""
        total = estimate.mean.shape[-1]
        return {
            block: self.score(contributions, self.unit_of(case, block), total)
            for block, contributions in self.contributions(Evidence(case, truth, estimate, **more)).items()
        }

    def contributions(self, evidence: Evidence) -> Contributions:
        """Contributions [..., R] of all runs: NaN where a run does not count, such as one that did not come through.

        Errors come once more over the runs that did not diverge.
        """
        with np.errstate(all="ignore"):  # errors of any size, and NaN in runs that are left out next
            found = self.fn(evidence)
            if self.timed:
                return found
            used = np.array([status in self.accepted for status in evidence.estimate.status], bool)
            if not used.all():
                found = {block: np.where(used, values, np.nan) for block, values in found.items()}
            if self.family == "error":
                survived = np.isinf(evidence.away)
                found |= {f"{block}, {SURVIVING}": np.where(survived, values, np.nan) for block, values in found.items()}
        return found

    def unit_of(self, case: Card, block: str) -> str:
        """The unit of the score of a block, or of a component of the state."""
        if not self.unit.startswith("block"):
            return self.unit
        name = block.partition(", ")[0]
        if name in case.state:
            unit = next((b.unit for b in case.blocks if case.state.index(name) in b.components), "")
        else:
            unit = case.block(name).unit
        if not unit or self.unit == "block":
            return unit
        return f"{unit}²" if unit.isalpha() else f"({unit})²"

    def score(self, contributions: Array, unit: str, total: int) -> Score:
        """Value and interval from the contributions [..., R] of the runs, out of `total`."""
        contributions = contributions[..., counted(contributions)]
        runs = contributions.shape[-1]
        total = runs if self.timed else total
        if runs == 0:
            return Score(np.nan, np.nan, np.nan, unit, 0, total)
        if self.binomial:
            count = int(contributions.sum())
            return Score(count / runs, *proportion(count, runs), unit, runs, total)
        if self.exact:
            return Score(*self.exact(contributions), unit, runs, total)
        sample = self.resampled(contributions)
        low, high = jackknife(sample) if self.signed else positive_jackknife(sample)
        return Score(float(sample.value[0]), float(low[0]), float(high[0]), unit, runs, total)

    def resampled(self, contributions: Array) -> Resampled:
        """The metric [1] from the contributions [..., R] of runs that count, and without each run in turn."""
        return self.statistic(contributions) if self.statistic else averaged(contributions, self.link)

    def over_time(self, contributions: Array) -> tuple[Array, Array, Array]:
        """The metric at each step, with its interval: [T], [T], [T]."""
        sample = means(contributions).map(self.link)
        return sample.value, *(jackknife(sample) if self.signed else positive_jackknife(sample))


def share(contributions: Array, link: Callable[[Array], Array] = np.positive) -> tuple[float, float, float]:
    """The mean over time of link(mean over runs) of contributions [T, R], a share, and its interval within 0 and 1."""
    sample = averaged(contributions, link)
    return float(sample.value[0]), *bounded(sample)


def counted(contributions: Array) -> Any:
    """Which runs count [R]: those that contribute anything to contributions[..., R]."""
    return ~np.isnan(contributions).all(axis=tuple(range(contributions.ndim - 1)))
