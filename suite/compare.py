"""Estimators beside a reference on the runs that both have: how much better or worse, how surely, and whether it matters."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from suite.case import RECORDED
from suite.diagnosis import in_words, remarks
from suite.differences import (
    NONE,
    Gap,
    Interval,
    effect_sizes,
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
from suite.statistics import LEVEL, Resampled, stacked

ZONE = 0.05
Runs = tuple[int, ...]
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
        pairs = [
            pair
            for reference in [r for r in found if r in held]
            for label in [each for each in said if each != reference]
            for pair in facing(held[label], held[reference], not metric.timed)
        ]
        for c in compared(pairs, zone, not metric.timed, said):
            found[c.reference].append(c)
    return {reference: _adjusted(each) for reference, each in found.items()}


def _adjusted(found: Sequence[Comparison]) -> list[Comparison]:
    """One family of comparisons with its adjusted p and its verdicts."""
    return [_decided(c, p) for c, p in zip(found, holm([c.p for c in found]), strict=True)]


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


def _decided(c: Comparison, adjusted: float) -> Comparison:
    """With a difference taken back that is not significant, and a word on runs that were left out."""
    verdict = UNDECIDED if c.verdict in (BETTER, WORSE) and not adjusted < 1 - LEVEL else c.verdict
    partial = verdict in (BETTER, WORSE, EQUAL) and c.left_out + c.reference_left_out > 0
    return replace(c, holm=adjusted, verdict=verdict + CONDITIONAL if partial else verdict)


def compared(
    pairs: Sequence[tuple[Side, Side]], zone: float, paired: bool, said: Mapping[str, str] = MappingProxyType({})
) -> list[Comparison]:  # fmt: skip
    """All but the adjustment of p, for pairs by one metric on one case; better or worse as far as the values tell.

    paired: whether runs of the same number are of the same truth; calls that are timed are no pairs. said: remarks by label.
    """
    found: list[Comparison] = []
    groups: dict[tuple[Runs, Runs], list[int]] = {}
    for place, (mine, theirs) in enumerate(pairs):
        common = tuple(mine.common(theirs)) if paired else ()
        runs = (common, common) if paired else (tuple(mine.by_run), tuple(theirs.by_run))
        found.append(_untested(mine, theirs, runs, paired, said.get(mine.cell.label, "")))
        if found[place].runs:
            groups.setdefault(runs, []).append(place)
    for runs, places in groups.items():
        tested = _tested([pairs[place] for place in places], [found[place] for place in places], runs, zone, paired)
        for place, c in zip(places, tested, strict=True):
            found[place] = c
    return found


def _untested(mine: Side, theirs: Side, runs: tuple[Runs, Runs], paired: bool, said: str) -> Comparison:
    metric, case = mine.metric, mine.cell.case
    given = [set() if metric.timed else set(side.cell.runs) for side in (mine, theirs)]
    if paired:
        given = [given[0] & given[1]] * 2
    return Comparison(
        case=case.card.name,
        seed=case.seed,
        metric=metric.name,
        block=mine.block,
        estimator=mine.cell.label,
        reference=theirs.cell.label,
        unit=metric.unit_of(case.card, mine.block),
        runs=min(map(len, runs)),
        left_out=len(given[0] - mine.by_run.keys()),
        reference_left_out=len(given[1] - theirs.by_run.keys()),
        verdict=NOTHING,
        remarks=said,
    )


def _tested(
    pairs: Sequence[tuple[Side, Side]], found: Sequence[Comparison], runs: tuple[Runs, Runs], zone: float, paired: bool
) -> list[Comparison]:
    """Comparisons of pairs that have the same runs."""
    metric, case = pairs[0][0].metric, pairs[0][0].cell.case
    mine, theirs = zip(*pairs, strict=True)
    one, other = (stacked([side.over(each) for side in column]) for column, each in ((mine, runs[0]), (theirs, runs[1])))
    flags = [(a.contributions(runs[0]), b.contributions(runs[1])) for a, b in pairs] if metric.binomial else []
    if metric.binomial:
        difference = [(rates_apart if paired else unpaired_rates_apart)(*each) for each in flags]
    else:
        difference = gap(one, other, paired).intervals()
    ratio = gap(one.logarithm, other.logarithm, paired).intervals(np.exp) if metric.by_ratio else [NONE] * len(pairs)
    columns: dict[str, Sequence[object]] = {"value": one.value.tolist(), "reference_value": other.value.tolist()}
    if not metric.timed and case.card.origin == RECORDED:
        columns |= {"difference": [Interval(each.value) for each in difference], "ratio": [Interval(r.value) for r in ratio]}
        return _written(found, columns | {"verdict": [ONE_SAMPLE] * len(pairs)})
    apart = gaps(metric, one, other, paired)
    p, better = np.max([g.p for g in apart], axis=0), np.prod([g.centre for g in apart], axis=0) < 0
    if paired:
        own, others = (np.array([side.losses(runs[0]) for side in column]) for column in (mine, theirs))
        known = ~(np.isnan(own) | np.isnan(others)).any(1)
        more, fewer = wins(own, others)
        for i in np.flatnonzero(known & (metric.binomial | (np.isnan(p) & (len(runs[0]) > 1)))):
            p[i], better[i] = sign_test(int(more[i]), int(fewer[i])), more[i] > fewer[i]
        won = zip(more.tolist(), fewer.tolist(), known.tolist(), strict=True)
        columns["wins"] = [win_probability(m, f, len(runs[0])) if k else NONE for m, f, k in won]
        if not metric.binomial:
            with np.errstate(invalid="ignore", over="ignore"):
                columns["effect"] = effect_sizes(others - own)
    elif metric.binomial:
        p, better = np.array([exact_test(*each) for each in flags]), np.array([each.value < 0 for each in difference])
    verdict = [BETTER if each else WORSE for each in better]
    tested = _written(found, columns | {"difference": difference, "ratio": ratio, "p": p.tolist(), "verdict": verdict})
    return [replace(c, verdict=EQUAL) if _alike(c, case, metric, zone) else c for c in tested]


def _written(found: Sequence[Comparison], columns: Mapping[str, Sequence[object]]) -> list[Comparison]:
    """Comparisons with what was found, by name."""
    rows = zip(*columns.values(), strict=True)
    return [replace(c, **dict(zip(columns, row, strict=True))) for c, row in zip(found, rows, strict=True)]


def _alike(c: Comparison, case: CaseResults, metric: Metric, zone: float) -> bool:
    """Whether both errors are rounding, or the interval lies in the zone."""
    return max(c.value, c.reference_value) <= rounding(case.rounding, metric, c.block) or _negligible(c, metric, zone)


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
    if math.isfinite(c.ratio.low) and math.isfinite(c.ratio.high):
        return 1 / (1 + zone) <= c.ratio.low and c.ratio.high <= 1 + zone
    limit = own_limit(c, metric, zone)
    return -limit <= c.difference.low and c.difference.high <= limit


def own_limit(c: Comparison, metric: Metric, zone: float) -> float:
    """The largest difference in the zone, in the unit, where there is no ratio; see `_negligible`."""
    own_unit = metric.binomial or (metric.signed and not metric.unit.startswith("block"))
    return zone if own_unit else zone * abs(c.reference_value)
