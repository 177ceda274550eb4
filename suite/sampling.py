"""Sampling until intervals are narrow: how many more runs each case needs."""

import itertools
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

from suite.errors import BadInput
from suite.metrics import METRICS, SURVIVING, Metric, Score
from suite.results import CaseResults, Cell

LEAST = 20
"""Runs below which no interval is trusted to be narrow: that of a few runs may be so by luck."""
MARGIN = 1.1
"""So many times the runs that the present interval asks for."""
GROWTH = 4
"""The runs of a case grow by this factor at most before the interval is looked at again."""
HEADER = ("case", "estimator", "metric", "value", "interval", "allowed", "runs", "verdict")


@dataclass(frozen=True)
class Goal:
    """Scores of a metric, on the blocks that match a pattern, whose intervals shall reach no further than `width`.

    Half the interval counts, in units of the score, or relative to its value.
    """

    metric: Metric
    block: str
    width: float
    relative: bool

    def times_too_wide(self, score: Score) -> float:
        """The half-width of a score's interval over the one allowed; NaN without an interval."""
        half = (score.high - score.low) / 2
        allowed = self.width * abs(score.value) if self.relative else self.width
        return half / allowed if allowed > 0 else (0.0 if half == 0 else math.inf)

    def __str__(self) -> str:
        return f"{self.metric.name}:{self.block}"


@dataclass(frozen=True)
class Reach:
    """How far the score of an estimator is from its goal."""

    case: str
    estimator: str
    goal: Goal
    block: str
    score: Score

    @property
    def excess(self) -> float:
        """How many times too wide the interval is; NaN where there is none."""
        return self.goal.times_too_wide(self.score) if self.score.runs else math.nan

    @property
    def reached(self) -> bool:
        """Whether the interval is narrow enough, of runs enough to believe it."""
        return self.excess <= 1 and self.score.total >= LEAST


def goal(what: str, width: str) -> Goal:
    """The goal of two words such as 'rmse:position' and '5%'. Raises BadInput."""
    name, _, block = what.partition(":")
    metric = METRICS[name]
    if metric.timed:
        raise BadInput(f"--until {what}: running times are not averaged over runs; name a metric of accuracy")
    match = re.fullmatch(r"\s*([0-9.eE+-]+)\s*(%?)\s*", width)
    try:
        size = float(match[1]) if match else math.nan
    except ValueError:
        size = math.nan
    if not (match and 0 < size < math.inf):
        raise BadInput(f"--until {what}: the width must be such as 5% or 0.02 (in the unit of the score), got {width!r}")
    if match[2] and not metric.by_ratio:
        raise BadInput(f"--until {what}: {name} may be zero, of which no share is a width; name one in its unit, such as 0.02")
    return Goal(metric, block or "*", size / 100 if match[2] else size, bool(match[2]))


def reaches(case: CaseResults, estimators: Iterable[str], goals: Sequence[Goal]) -> list[Reach]:
    """How far the scores of a case are from the goals. Raises BadInput when none is meant by a goal."""
    cells = [case.cells[label] for label in estimators if label in case.cells and case.cells[label].runs]
    found = []
    for each in goals:
        meant = [(cell, *pair) for cell in cells for pair in _meant(cell, each)]
        if cells and not meant:
            blocks = sorted({block for cell in cells for block in cell.scores(each.metric) if SURVIVING not in block})
            said = f"it has {', '.join(blocks)}" if blocks else "no estimator has any"
            raise BadInput(f"--until {each}: {case.card.name} has no such score; {said}")
        found += [Reach(case.card.name, cell.label, each, block, score) for cell, block, score in meant]
    return found


def _meant(cell: Cell, goal: Goal) -> list[tuple[str, Score]]:
    return [(b, s) for b, s in cell.scores(goal.metric).items() if fnmatchcase(b, goal.block) and SURVIVING not in b]


def needed(found: Sequence[Reach], runs: int, most: int) -> int:
    """Runs that a case needs for all its scores to reach their goals, as far as so many runs can tell; `most` at most.

    An interval narrows with the root of the runs. A score without an interval, such as one of which all runs failed, asks for
    nothing.
    """
    excess = [1.0 if reach.excess <= 1 else reach.excess for reach in found if not math.isnan(reach.excess)]
    if not excess or all(reach.reached or math.isnan(reach.excess) for reach in found):
        return runs
    wanted = MARGIN * runs * max(excess) ** 2 if max(excess) > 1 else runs
    return max(runs, min(most, max(LEAST, math.ceil(min(wanted, GROWTH * runs)))))


def summary(found: Iterable[Sequence[Reach]], most: int) -> list[tuple[str, ...]]:
    """Rows under `HEADER` that tell how wide each score's interval is, of how many runs, and whether that is narrow enough."""
    rows: list[tuple[str, ...]] = []
    for s in itertools.chain.from_iterable(found):
        scale, unit = (100.0, " %") if s.goal.relative else (1.0, f" {s.score.unit}".rstrip())
        allowed, width = f"± {scale * s.goal.width:g}{unit}", f"± {scale * s.goal.width * s.excess:.3g}{unit}"
        verdict = "narrow enough" if s.reached else f"stopped at {most} runs"
        if math.isnan(s.excess):
            width, verdict = "none", "has no interval"
        value = f"{s.score.value:.4g} {s.score.unit}".strip() if s.score.runs else "none"
        runs = f"{s.score.runs} of {s.score.total}"
        rows.append((s.case, s.estimator, f"{s.goal.metric.name}:{s.block}", value, width, allowed, runs, verdict))
    return rows
