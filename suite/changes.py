"""What changed between two result sets: the same estimator on the same case, before and after."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import comb
from typing import Any

import numpy as np
from scipy.special import stdtr, stdtrit

from suite.case import Card, Truth
from suite.compare import BETTER, EQUAL, UNDECIDED, WORSE, ZONE, Comparison, compared, own_limit
from suite.differences import NONE, Interval, gap, holm, rank_test, sign_test, wins
from suite.metrics import METRICS, Metric
from suite.results import CaseResults, Cell
from suite.score import ROUNDING, status
from suite.sides import Side, facing, sides
from suite.statistics import LEVEL, means

IMPROVED = "improved"
PROBLEM = ("steps", "interval", "times", "state", "blocks", "divergence", "modes", "nominal")
"""Parts of a card: where one of them differs, numbers of before and after are not of the same problem."""
DESCRIBED = ("origin", "equations", "assumptions", "landmarks", "regions")
"""Parts of a card that describe the problem in words and figures."""
NORMAL = 0.6745
"""Median size of a normal number in standard deviations."""
EFFICIENCY = 0.37
"""Of the standard deviation of normal numbers from their median size: as sure as the usual one of so many times as many."""
HEAVY = 4
"""Degrees of freedom at most of the law of a machine's hiccups: how heavy its tails are."""


@dataclass(frozen=True, kw_only=True)
class Change:
    """A metric and block of an estimator on a case, before and after.

    difference: after minus before, in the unit. ratio: after over before, of what is never negative. p: two-sided; holm: the
    same adjusted over all changes that are told together. runs, runs_before: those that entered; left_out, left_out_before:
    those that were given and did not. paired: whether they are the same runs of the same truth. size: the difference, in
    widths of the zone within which none matters.
    """

    case: str
    estimator: str
    metric: str
    block: str
    unit: str
    before: float = np.nan
    after: float = np.nan
    difference: Interval = NONE
    ratio: Interval = NONE
    p: float = np.nan
    holm: float = np.nan
    runs_before: int
    runs: int
    left_out_before: int = 0
    left_out: int = 0
    paired: bool
    size: float = np.nan
    verdict: str


@dataclass(frozen=True)
class State:
    """What became of a cell: done, partly failed, lost, failed, refused or not run; how many runs of how many went wrong."""

    status: str
    reason: str = ""
    lost: int = 0
    failed: int = 0
    total: int = 0

    @property
    def ran(self) -> bool:
        """Whether there is a run."""
        return self.total > 0


ABSENT = State("not stored")


@dataclass(frozen=True)
class CaseChanges:
    """What changed on a case that both result sets hold.

    states: of each estimator before and after. changes: all that was compared but is not the same to the bit; unchanged: how
    many scores are, by estimator. common: runs whose truth both sets hold; paired: whether it is the same. seeds, runs: of
    before and after. reason: why nothing is compared. notes: what a reader must know beside the verdicts.
    """

    case: str
    states: dict[str, tuple[State, State]]
    changes: tuple[Change, ...]
    unchanged: dict[str, int]
    common: int
    paired: bool
    seeds: tuple[int, int]
    runs: tuple[int, int]
    reason: str = ""
    notes: tuple[str, ...] = ()


def of_case(before: CaseResults, after: CaseResults, metrics: Sequence[Metric], zone: float = ZONE) -> CaseChanges:
    """Every estimator that both hold, by each of the metrics; p is not adjusted yet, see `settled`."""
    name, truths = after.card.name, (before.truth_of, after.truth_of)
    shared = sorted(truths[0].keys() & truths[1].keys())
    paired = bool(shared) and all(_same(truths[0][run], truths[1][run]) for run in shared)
    labels = dict.fromkeys([*before.cells, *after.cells])
    states = {label: (_state(before.cells.get(label)), _state(after.cells.get(label))) for label in labels}
    reason = _another_problem(before.card, after.card)
    changes: list[Change] = []
    unchanged: dict[str, int] = {}
    ran = [label for label, (was, now) in states.items() if was.ran and now.ran]
    for label in ran if not reason else []:
        old, new = before.cells[label], after.cells[label]
        for metric in metrics:
            if metric.timed and _host(old) != _host(new):
                continue
            for mine, theirs in facing(sides(new, metric), sides(old, metric), paired and not metric.timed):
                if _identical(mine, theirs, paired):
                    unchanged[label] = unchanged.get(label, 0) + 1
                elif mine.by_run and theirs.by_run:  # else it is told by the states
                    changes.append(_change(mine, theirs, zone, paired and not metric.timed))
    notes = tuple(_notes(before, after, shared, paired)) if not reason else ()
    held = (len(truths[0]), len(truths[1]))
    seeds = (before.seed, after.seed)
    return CaseChanges(name, states, tuple(changes), unchanged, len(shared), paired, seeds, held, reason, notes)


def settled(changes: Sequence[Change], zone: float = ZONE) -> list[Change]:
    """Changes that are told together, with p adjusted by Holm's method over all of them, and their verdicts.

    Improved or worse: p, adjusted, is below 0.05, so that there is any false one among them with that probability at most.
    Running times of two occasions differ by what else the machine did, of which their calls tell nothing: that is taken from
    the spread of all ratios by the same metric. It widens the intervals, and p is the larger one of both tests.
    """
    spread = {
        name: _spread([c for c in changes if c.metric == name]) for name in {c.metric for c in changes} if METRICS[name].timed
    }
    sober = [_of_two_occasions(c, *spread[c.metric], zone) if c.metric in spread else c for c in changes]
    adjusted = holm([c.p for c in sober])
    return [replace(c, holm=p, verdict=_verdict(c, p)) for c, p in zip(sober, adjusted, strict=True)]


def _verdict(c: Change, p: float) -> str:
    if c.verdict not in (BETTER, WORSE):
        return c.verdict
    return UNDECIDED if not p < 1 - LEVEL else IMPROVED if c.verdict == BETTER else WORSE


def _spread(timed: Sequence[Change]) -> tuple[float, float]:
    """Standard deviation of log ratios that are none in truth, from their median size, and its degrees of freedom."""
    logs = np.abs(np.log([c.ratio.value for c in timed if 0 < c.ratio.value < np.inf]))
    return (float(np.median(logs)) / NORMAL, min(EFFICIENCY * len(logs), HEAVY)) if len(logs) > 1 else (np.nan, 0.0)


def _of_two_occasions(c: Change, spread: float, freedom: float, zone: float) -> Change:
    """A ratio of running times with an interval for calls and occasions together."""
    if not spread > 0:
        return replace(c, p=np.nan, verdict=UNDECIDED)
    middle, low, high = (float(np.log(end)) for end in (c.ratio.value, c.ratio.low, c.ratio.high))
    reach = float(stdtrit(freedom, 0.5 + LEVEL / 2)) * spread
    low, high = middle - np.hypot(middle - low, reach), middle + np.hypot(high - middle, reach)
    wide = Interval(c.ratio.value, float(np.exp(low)), float(np.exp(high)))
    p = max(c.p, float(2 * stdtr(freedom, -abs(middle) / spread)))
    better = (middle > 0) == (METRICS[c.metric].better == "higher")
    inside = max(-low, high) <= np.log1p(zone)
    return replace(c, ratio=wide, difference=Interval(c.difference.value), p=p,
                   verdict=EQUAL if inside else BETTER if better else WORSE)  # fmt: skip


def _change(mine: Side, theirs: Side, zone: float, paired: bool) -> Change:
    metric, found = mine.metric, compared([(mine, theirs)], zone, paired)[0]
    return Change(
        case=found.case,
        estimator=found.estimator,
        metric=found.metric,
        block=found.block,
        unit=found.unit,
        before=found.reference_value,
        after=found.value,
        difference=found.difference,
        ratio=found.ratio,
        p=_sober(found, mine, theirs, paired),
        runs_before=found.runs if paired else len(theirs.by_run),
        runs=found.runs if paired else len(mine.by_run),
        left_out_before=found.reference_left_out,
        left_out=found.left_out,
        paired=paired,
        size=_size(found, metric, zone),
        verdict=found.verdict,
    )


def _sober(c: Comparison, mine: Side, theirs: Side, paired: bool) -> float:
    """p, but no less than that of the single runs' own losses, nor than that of a permutation where nothing scatters.

    By the jackknife a mean that hangs on two wild runs seems sure, and shares of steps may be alike in a few runs by chance.
    Runs of the same truth: Student's t of the differences of losses; other runs: Mann and Whitney's test of their ranks. 1
    where the score is better and the mean loss of a run is worse; NaN where single runs have no value.
    """
    if np.isnan(c.p) or mine.metric.timed or mine.metric.binomial:
        return c.p
    runs = [mine.common(theirs)] * 2 if paired else [list(mine.by_run), list(theirs.by_run)]
    own, other = (np.array(side.losses(each)) for side, each in zip((mine, theirs), runs, strict=True))
    if paired:
        known = ~np.isnan(own + other)
        own, other = own[known], other[known]
    else:
        own, other = own[~np.isnan(own)], other[~np.isnan(other)]
    if min(len(own), len(other)) < 2:
        return np.nan
    if c.verdict != EQUAL and (c.verdict == BETTER) != (own.mean() < other.mean()):
        return 1.0
    if not paired:
        return max(c.p, rank_test(own, other), 2 / comb(len(own) + len(other), len(own)))
    scatter = c.difference.high - c.difference.low > ROUNDING * abs(c.difference.value)
    if np.isfinite([own, other]).all():
        alone = float(gap(means(own[None]), means(other[None])).p[0])
    else:
        alone = sign_test(*(int(count) for count in wins(own, other)))
    return max(c.p, alone, 0.0 if scatter else 2.0 ** (1 - len(own)))


def _size(c: Comparison, metric: Metric, zone: float) -> float:
    if 0 < c.ratio.value < np.inf:
        return abs(float(np.log(c.ratio.value) / np.log1p(zone)))
    limit = own_limit(c, metric, zone)
    return abs(c.difference.value) / limit if limit > 0 else np.nan if np.isnan(c.difference.value) else np.inf


def _identical(mine: Side, theirs: Side, paired: bool) -> bool:
    """Whether every run or call that both were given contributes the same bits, or on both sides nothing."""
    if not (paired or mine.metric.timed):
        return False
    old, new = theirs.by_run, mine.by_run
    if mine.metric.timed:
        given = old.keys() | new.keys()
    else:
        given = set(mine.cell.runs) & set(theirs.cell.runs)
        if not given:
            return False
    old, new = ({run: values for run, values in each.items() if run in given} for each in (old, new))
    return old.keys() == new.keys() and all(_equal(old[run], new[run]) for run in old)


def _same(one: Truth, other: Truth) -> bool:
    """Whether two truths are the same to the bit, measurements included."""
    pairs: list[tuple[Any, Any]] = [(one.x, other.x), (one.y, other.y), (one.mode, other.mode)]
    return all(mine is theirs or _equal(mine, theirs) for mine, theirs in pairs)


def _equal(mine: Any, theirs: Any) -> bool:
    return mine is not None and theirs is not None and np.array_equal(mine, theirs, equal_nan=True)


def _state(cell: Cell | None) -> State:
    return State(**status(cell), total=len(cell.runs)) if cell else ABSENT


def _host(cell: Cell) -> object:
    return cell.timings[-1].meta.get("host") if cell.timings else None


def _another_problem(before: Card, after: Card) -> str:
    """In which parts two cards of the same name are not of the same problem, in words; nothing where they are."""
    apart = [name for name in PROBLEM if getattr(before, name) != getattr(after, name)]
    return f"before and after are not the same problem: they differ in {', '.join(apart)}" if apart else ""


def _notes(before: CaseResults, after: CaseResults, shared: Sequence[int], paired: bool) -> Iterator[str]:
    if shared and not paired and before.seed == after.seed:
        yield (
            "The seed is the same and the truth is not: the case or its random numbers were changed, so that what differs "
            "may be the problem rather than the estimators."
        )
    apart = [name for name in DESCRIBED if getattr(before.card, name) != getattr(after.card, name)]
    if apart:
        yield f"The case is described in other words or figures than before: see its {', '.join(apart)}."
    moved = [label for label, cell in after.cells.items() if label in before.cells and _moved(before.cells[label], cell)]
    if moved:
        yield "Running times are not compared: they were measured on different machines."
    elif any(cell.timings for cell in after.cells.values()) != any(cell.timings for cell in before.cells.values()):
        yield "Running times are stored on one side only."


def _moved(old: Cell, new: Cell) -> bool:
    """Whether both were timed, on machines that differ."""
    return bool(old.timings and new.timings) and _host(old) != _host(new)
