"""Estimators beside a reference on the runs that both have: how much better or worse, how surely, and whether it matters."""

import functools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from suite.case import RECORDED
from suite.diagnosis import in_words, remarks
from suite.differences import NONE, Gap, Interval, effect_size, gap, holm, rates_apart, sign_test, win_probability, wins
from suite.errors import BadInput
from suite.linalg import Array
from suite.metrics import SURVIVING, Metric, counted
from suite.results import CaseResults, Cell
from suite.score import ROUNDING, faced, loss, miss
from suite.statistics import LEVEL, Resampled, mean_over_time

ZONE = 0.05
BETTER, WORSE, EQUAL, UNDECIDED = "better", "worse", "equal", "undecided"
ONE_SAMPLE, NOTHING = "one sample", "no common run"
CONDITIONAL = " where both came through"
"""Behind a verdict on fewer runs than both were given: to leave out what failed favours the fragile."""


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """An estimator beside a reference by one metric and block, over the runs that count for both.

    difference: its value minus the reference's, in the unit. ratio: its value over the reference's, of what is never negative.
    wins: share of common runs in which it is the better one by that run's own value, ties half. effect: mean over runs of the
    reference's own loss minus its own, over their standard deviation: above zero where it is better. p: two-sided, of the
    paired t (unpaired, of running times), of rates McNemar's, of what is zero or infinite the sign test on wins; holm: the same
    adjusted over all comparisons by the metric that were made together. runs: common ones, of running times the calls of the
    side that has fewer. left_out, reference_left_out: runs given to both that do not count for it, and for the reference.
    """

    case: str
    seed: int
    metric: str
    block: str
    estimator: str
    reference: str
    unit: str
    value: float = np.nan
    reference_value: float = np.nan
    difference: Interval = NONE
    ratio: Interval = NONE
    wins: Interval = NONE
    effect: Interval = NONE
    p: float = np.nan
    holm: float = np.nan
    runs: int
    left_out: int
    reference_left_out: int
    verdict: str
    remarks: str


def compare(
    cases: Iterable[CaseResults], metric: Metric, reference: str, labels: Iterable[str], zone: float = ZONE
) -> list[Comparison]:
    """Every labelled estimator beside the reference on each case that has both; one call is one family of Holm's.

    Better or worse: p, adjusted, is below 0.05. Equal, whatever p is: the 95 % interval lies in the zone, so what difference
    there may be is none that matters; see `_negligible`. On a recording, whose runs are all of the same data, nothing is
    tested. Raises BadInput where a zone is not in (0, 1), or by the metric no estimator is better than another.
    """
    if not 0 < zone < 1:
        raise BadInput(f"the zone must be a share between 0 and 1, got {zone:g}")
    if not metric.ranked:
        raise BadInput(f"by {metric.name} no estimator is better than another; name another metric")
    labels = set(labels) - {reference}
    found = [c for case in cases if reference in case.cells for c in _of_case(case, metric, reference, labels, zone)]
    adjusted = holm([c.p for c in found])
    return [_decided(replace(c, holm=p)) for c, p in zip(found, adjusted, strict=True)]


def _decided(c: Comparison) -> Comparison:
    """With a difference taken back that is not significant, and a word on runs that were left out."""
    verdict = UNDECIDED if c.verdict in (BETTER, WORSE) and not c.holm < 1 - LEVEL else c.verdict
    partial = verdict in (BETTER, WORSE, EQUAL) and c.left_out + c.reference_left_out > 0
    return replace(c, verdict=verdict + CONDITIONAL if partial else verdict)


def _of_case(case: CaseResults, metric: Metric, reference: str, labels: set[str], zone: float) -> Iterator[Comparison]:
    """All blocks that both have, those over surviving runs only where they say something new."""
    blocks = case.cells[reference].contributions(metric)
    theirs = {block: _Side(metric, case.cells[reference], block) for block in blocks}
    for label, cell in case.cells.items():
        if label not in labels:
            continue
        said = in_words(remarks(cell))
        mine = {block: _Side(metric, cell, block) for block in blocks if block in cell.contributions(metric)}
        for block, side in mine.items():
            whole = block.removesuffix(f", {SURVIVING}")
            if whole == block or side.common(theirs[block]) != mine[whole].common(theirs[whole]):
                yield _compared(side, theirs[block], zone, said)


@dataclass(frozen=True, eq=False)
class _Side:
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

    def common(self, other: "_Side") -> list[int]:
        """Numbers of the runs that count for both; of running times there are none, since calls are no pairs."""
        return [] if self.metric.timed else sorted(self.by_run.keys() & other.by_run.keys())

    def contributions(self, runs: Iterable[int]) -> Array:
        """Contributions [..., R] of some runs."""
        return np.stack([self.by_run[run] for run in runs], axis=-1)

    @functools.cached_property
    def loss_of_run(self) -> dict[int, float]:
        """The loss by the metric of each run alone; NaN where it has no value of a single run.

        A spread over runs has none: of one run it is zero, to rounding.
        """
        together = self.contributions(self.by_run)
        with np.errstate(all="ignore"):
            size = np.abs(self.metric.resampled(together).value[0])
            values = self._values_of_runs(together)
        losses = loss(self.metric, values) if np.abs(values).max() >= ROUNDING * size else np.full(len(values), np.nan)
        return dict(zip(self.by_run, losses.tolist(), strict=True))

    def _values_of_runs(self, together: Array) -> Array:
        """The metric of each run alone [R], from contributions [..., R]; all NaN where some run has none."""
        if self.metric.statistic is None:
            return np.asarray(mean_over_time(self.metric.link(together))[0])
        found = np.full(together.shape[-1], np.nan)
        for run in range(len(found)):
            found[run] = self.metric.resampled(together[..., [run]]).value[0]
            if np.isnan(found[run]):
                return np.full_like(found, np.nan)
        return found


def _compared(mine: _Side, theirs: _Side, zone: float, said: str) -> Comparison:
    """All but the adjustment of p; better or worse as far as the values tell."""
    metric, case, paired = mine.metric, mine.cell.case, not mine.metric.timed
    common = mine.common(theirs)
    given = set(mine.cell.runs) & set(theirs.cell.runs) if paired else set()
    found = Comparison(
        case=case.card.name,
        seed=case.seed,
        metric=metric.name,
        block=mine.block,
        estimator=mine.cell.label,
        reference=theirs.cell.label,
        unit=metric.unit_of(case.card, mine.block),
        runs=len(common) if paired else min(len(mine.by_run), len(theirs.by_run)),
        left_out=len(given - mine.by_run.keys()),
        reference_left_out=len(given - theirs.by_run.keys()),
        verdict=NOTHING,
        remarks=said,
    )
    if not found.runs:
        return found
    parts = [side.contributions(common if paired else side.by_run) for side in (mine, theirs)]
    one, other = (metric.resampled(part) for part in parts)
    found = replace(found, value=float(one.value[0]), reference_value=float(other.value[0]))
    found = replace(found, difference=rates_apart(*parts) if metric.binomial else gap(one, other, paired).interval)
    if not (metric.signed or metric.binomial):
        logs = gap(one.map(np.log), other.map(np.log), paired).interval
        found = replace(found, ratio=Interval(*(float(np.exp(end)) for end in (logs.value, logs.low, logs.high))))
    if paired and case.card.origin == RECORDED:
        alone = Interval(found.difference.value), Interval(found.ratio.value)
        return replace(found, difference=alone[0], ratio=alone[1], verdict=ONE_SAMPLE)
    apart = gaps(metric, one, other, paired)
    p, better = float(np.max([g.p for g in apart])), bool(np.prod([g.centre for g in apart]) < 0)
    if paired:
        own = [np.array([side.loss_of_run[run] for run in common]) for side in (mine, theirs)]
        if not np.isnan(own).any():
            more, fewer = wins(*own)
            if metric.binomial or (np.isnan(p) and len(common) > 1):
                p, better = sign_test(more, fewer), more > fewer
            with np.errstate(invalid="ignore"):
                effect = NONE if metric.binomial else effect_size(own[1] - own[0])
            found = replace(found, wins=win_probability(more, fewer, len(common)), effect=effect)
    return replace(found, p=p, verdict=EQUAL if _negligible(found, metric, zone) else BETTER if better else WORSE)


def gaps(metric: Metric, one: Resampled, other: Resampled, paired: bool = True) -> list[Gap]:
    """The differences that must all be sure for one score to be better than another; better if their product is negative.

    What misses a target by less than another does lies between that other and its mirror image, see `faced`.
    """
    mine, theirs = (sample.map(lambda value: miss(metric, value)) for sample in (one, other))
    return [gap(mine, each, paired) for each in faced(metric, theirs)]


def _negligible(c: Comparison, metric: Metric, zone: float) -> bool:
    """Whether the interval lies in the zone, where differences do not matter.

    The ratio is within a factor of 1 + zone either way, so that the two may change places. Where there is no ratio, the
    difference is within the zone of the reference's size; of a rate, and of what is signed and counted in a unit of its own,
    such as nats or steps, whose zero is arbitrary or the very target, within the zone of one unit.
    """
    if np.isfinite([c.ratio.low, c.ratio.high]).all():
        return 1 / (1 + zone) <= c.ratio.low and c.ratio.high <= 1 + zone
    own_unit = metric.binomial or (metric.signed and not metric.unit.startswith("block"))
    limit = zone if own_unit else zone * abs(c.reference_value)
    return -limit <= c.difference.low and c.difference.high <= limit
