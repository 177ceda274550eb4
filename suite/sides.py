"""One estimator's side of a comparison: what each of its runs contributes to a score, and the score over some of them."""

import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from suite.linalg import Array
from suite.metrics import SURVIVING, Metric, counted
from suite.results import Cell
from suite.score import ROUNDING, loss
from suite.statistics import Resampled, mean_over_time

TRIED = 10
"""After so many runs without a value of their own no other is looked for: some statistics are of many runs together."""


def facing(mine: Mapping[str, "Side"], theirs: Mapping[str, "Side"], paired: bool) -> Iterator[tuple["Side", "Side"]]:
    """Sides of all blocks that both have, those over surviving runs only where they say something new."""
    for block in theirs:
        whole = block.removesuffix(f", {SURVIVING}")
        if block not in mine or (whole != block and not paired):
            continue
        if whole == block or mine[block].common(theirs[block]) != mine[whole].common(theirs[whole]):
            yield mine[block], theirs[block]


@dataclass(frozen=True, eq=False)
class Side:
    """One estimator's contributions to a block, of the runs that count."""

    metric: Metric
    cell: Cell
    block: str

    @functools.cached_property
    def by_run(self) -> dict[int, Array]:
        """Contributions [...] of each run that counts, by its number."""
        values = self.cell.contributions(self.metric)[self.block]
        numbers = range(values.shape[-1]) if self.metric.timed else self.cell.runs
        return {numbers[i]: values[..., i] for i in np.flatnonzero(counted(values))}

    def common(self, other: "Side") -> list[int]:
        """Numbers of the runs that count for both."""
        return sorted(self.by_run.keys() & other.by_run.keys())

    @functools.cached_property
    def together(self) -> Array:
        """Contributions [..., R] of all runs that count."""
        return np.stack(list(self.by_run.values()), axis=-1)

    @functools.cached_property
    def whole(self) -> Resampled:
        """The metric over all runs that count."""
        return self.metric.resampled(self.together)

    def contributions(self, runs: Sequence[int]) -> Array:
        """Contributions [..., R] of some runs."""
        return self.together if self._has_only(runs) else np.stack([self.by_run[run] for run in runs], axis=-1)

    def over(self, runs: Sequence[int]) -> Resampled:
        """The metric over some runs."""
        return self.whole if self._has_only(runs) else self.metric.resampled(self.contributions(runs))

    def losses(self, runs: Sequence[int]) -> list[float]:
        """The loss of each of some runs."""
        return [self.loss_of_run[run] for run in runs]

    def _has_only(self, runs: Sequence[int]) -> bool:
        return list(runs) == list(self.by_run)

    @functools.cached_property
    def loss_of_run(self) -> dict[int, float]:
        """The loss by the metric of each run alone; NaN where it has no value of a single run.

        A spread over runs has none: of one run it is zero, to rounding.
        """
        with np.errstate(all="ignore"):
            size = np.abs(self.whole.value[0])
            values = self._values_of_runs(self.together)
        losses = loss(self.metric, values) if np.abs(values).max() >= ROUNDING * size else np.full(len(values), np.nan)
        return dict(zip(self.by_run, losses.tolist(), strict=True))

    def _values_of_runs(self, together: Array) -> Array:
        """The metric of each run alone [R], from contributions [..., R]; NaN where a run has none."""
        if self.metric.statistic is None:
            return np.asarray(mean_over_time(self.metric.link(together))[0])
        found = np.full(together.shape[-1], np.nan)
        for run in range(len(found)):
            if run >= TRIED and np.isnan(found[:run]).all():
                break
            found[run] = self.metric.resampled(together[..., [run]]).value[0]
        return found


def sides(cell: Cell, metric: Metric) -> dict[str, Side]:
    """What a cell has of a metric, by block."""
    return {block: Side(metric, cell, block) for block in cell.contributions(metric)}
