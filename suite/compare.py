"""Estimators beside a reference on the runs that both have: how much better or worse, how surely, and whether it matters."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from suite.case import RECORDED
from suite.diagnosis import in_words, remarks
from suite.differences import (
    NONE,
    Gap,
    Interval,
    effect_size,
    exact_test,
    gap,
    holm,
    rates_apart,
    sign_test,
    unpaired_rates_apart,
    win_probability,
    wins,
)
from suite.errors import BadInput
from suite.metrics import METRICS, Metric
from suite.results import CaseResults
from suite.score import faced, misses, rounding
from suite.sides import Side, facing, sides
from suite.state_tests import TRUTH
from suite.statistics import LEVEL, Resampled

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

    Better or worse: p, adjusted, is below 0.05. Equal, whatever p is: both errors are rounding, or the 95 % interval lies in
    the zone, so what difference there may be is none that matters, see `_negligible`. On a recording, whose runs are all of
    the same data, nothing is tested. Raises BadInput where a zone is not in (0, 1), or by the metric no estimator is better
    than another.
    """
    return compare_each(cases, metric, [reference], labels, zone)[reference]


def compare_each(
    cases: Iterable[CaseResults], metric: Metric, references: Iterable[str], labels: Iterable[str], zone: float = ZONE
) -> dict[str, list[Comparison]]:
    """What `compare` says, for each of several references."""
    if not 0 < zone < 1:
        raise BadInput(f"the zone must be a share between 0 and 1, got {zone:g}")
    if not metric.ranked:
        raise BadInput(f"by {metric.name} no estimator is better than another; name another metric")
    labels = set(labels)
    found: dict[str, list[Comparison]] = {reference: [] for reference in references}
    for case in cases:
        chosen = {label: cell for label, cell in case.cells.items() if label in labels or label in found}
        held = {label: sides(cell, metric) for label, cell in chosen.items()}
        said = {label: in_words(remarks(cell)) for label, cell in chosen.items() if label in labels}
        for reference in [r for r in found if r in held]:
            for label in [each for each in said if each != reference]:
                pairs = facing(held[label], held[reference], not metric.timed)
                found[reference] += [compared(*pair, zone, said[label], not metric.timed) for pair in pairs]
    return {reference: _adjusted(each) for reference, each in found.items()}


def _adjusted(found: Sequence[Comparison]) -> list[Comparison]:
    """One family of comparisons with its adjusted p and its verdicts."""
    adjusted = holm([c.p for c in found])
    return [_decided(replace(c, holm=p)) for c, p in zip(found, adjusted, strict=True)]


def ranking(patterns: Sequence[str]) -> list[Metric]:
    """The metrics that match, but for those by which no estimator is better than another, unless they are named in full.

    Raises BadInput where none is left.
    """
    found = [metric for metric in METRICS.select(patterns) if metric.ranked or metric.name in patterns]
    if not found:
        raise BadInput(f"by no metric that matches {' or '.join(map(repr, patterns))} is an estimator better than another")
    return found


def nothing_to_compare(cases: Sequence[CaseResults], reference: str, labels: Iterable[str]) -> BadInput:
    """Why there is no comparison with a reference, and what to do about it."""
    common = f"{reference} has no run to compare with any other"
    if reference == TRUTH:
        where = _named(cases)
        return BadInput(f"{common}: no chosen estimator has one on {where} that came through; choose others with -e or -c")
    others = set(labels) - {reference}
    held = [case for case in cases if reference in case.cells]
    rivals = [case for case in held if others & case.cells.keys()]
    refused = [case for case in rivals if case.cells[reference].refusal]
    where = _named(held or cases)
    if not held:
        return BadInput(f"{common}: it was not run on {where}; run it there with `filterbench run -e {reference}`")
    if not rivals:
        return BadInput(f"{common}: it is the only estimator chosen on {where}; run or choose another one beside it")
    if len(refused) == len(rivals):
        why = refused[0].cells[reference].refusal
        return BadInput(f"{common}: it refused {_named(refused)} ({why}); name a reference that accepts it")
    return BadInput(f"{common} on {_named(rivals)}; run both on the same case, or name another metric")


def _named(cases: Sequence[CaseResults]) -> str:
    """The name of the first case, and how many others there are."""
    others = len(cases) - 1
    return cases[0].card.name + (f" and {others} other{'s' if others > 1 else ''}" if others else "")


def _decided(c: Comparison) -> Comparison:
    """With a difference taken back that is not significant, and a word on runs that were left out."""
    verdict = UNDECIDED if c.verdict in (BETTER, WORSE) and not c.holm < 1 - LEVEL else c.verdict
    partial = verdict in (BETTER, WORSE, EQUAL) and c.left_out + c.reference_left_out > 0
    return replace(c, verdict=verdict + CONDITIONAL if partial else verdict)


def compared(mine: Side, theirs: Side, zone: float, said: str, paired: bool) -> Comparison:
    """All but the adjustment of p; better or worse as far as the values tell.

    paired: whether runs of the same number are of the same truth; calls that are timed are no pairs.
    """
    metric, case = mine.metric, mine.cell.case
    common = mine.common(theirs) if paired else []
    given = [set() if metric.timed else set(side.cell.runs) for side in (mine, theirs)]
    if paired:
        given = [given[0] & given[1]] * 2
    found = Comparison(
        case=case.card.name,
        seed=case.seed,
        metric=metric.name,
        block=mine.block,
        estimator=mine.cell.label,
        reference=theirs.cell.label,
        unit=metric.unit_of(case.card, mine.block),
        runs=len(common) if paired else min(len(mine.by_run), len(theirs.by_run)),
        left_out=len(given[0] - mine.by_run.keys()),
        reference_left_out=len(given[1] - theirs.by_run.keys()),
        verdict=NOTHING,
        remarks=said,
    )
    if not found.runs:
        return found
    runs = [common if paired else list(side.by_run) for side in (mine, theirs)]
    parts = [side.contributions(each) for side, each in zip((mine, theirs), runs, strict=True)]
    one, other = (side.over(each) for side, each in zip((mine, theirs), runs, strict=True))
    found = replace(found, value=float(one.value[0]), reference_value=float(other.value[0]))
    if metric.binomial:
        found = replace(found, difference=(rates_apart if paired else unpaired_rates_apart)(*parts))
    else:
        found = replace(found, difference=gap(one, other, paired).interval)
    if metric.by_ratio:
        logs = gap(one.logarithm, other.logarithm, paired).interval
        with np.errstate(over="ignore"):
            found = replace(found, ratio=Interval(*(float(np.exp(end)) for end in (logs.value, logs.low, logs.high))))
    if not metric.timed and case.card.origin == RECORDED:
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
            with np.errstate(invalid="ignore", over="ignore"):
                effect = NONE if metric.binomial else effect_size(own[1] - own[0])
            found = replace(found, wins=win_probability(more, fewer, len(common)), effect=effect)
    elif metric.binomial:
        p, better = exact_test(*parts), found.difference.value < 0
    largest = max(found.value, found.reference_value)
    alike = largest <= rounding(case.rounding, metric, found.block) or _negligible(found, metric, zone)
    return replace(found, p=p, verdict=EQUAL if alike else BETTER if better else WORSE)


def gaps(metric: Metric, one: Resampled, other: Resampled, paired: bool = True) -> list[Gap]:
    """The differences that must all be sure for one score to be better than another; better if their product is negative.

    What misses a target by less than another does lies between that other and its mirror image, see `faced`.
    """
    mine, theirs = (misses(metric, sample) for sample in (one, other))
    return [gap(mine, each, paired) for each in faced(metric, theirs)]


def _negligible(c: Comparison, metric: Metric, zone: float) -> bool:
    """Whether the interval lies in the zone, where differences do not matter.

    The ratio is within a factor of 1 + zone either way, so that the two may change places. Where there is no ratio, the
    difference is within the zone of the reference's size; of a rate, and of what is signed and counted in a unit of its own,
    such as nats or steps, whose zero is arbitrary or the very target, within the zone of one unit.
    """
    if np.isfinite([c.ratio.low, c.ratio.high]).all():
        return 1 / (1 + zone) <= c.ratio.low and c.ratio.high <= 1 + zone
    limit = own_limit(c, metric, zone)
    return -limit <= c.difference.low and c.difference.high <= limit


def own_limit(c: Comparison, metric: Metric, zone: float) -> float:
    """The largest difference in the zone, in the unit, where there is no ratio; see `_negligible`."""
    own_unit = metric.binomial or (metric.signed and not metric.unit.startswith("block"))
    return zone if own_unit else zone * abs(c.reference_value)
