"""What became of one estimator on all cases: what its page needs, and no more, taken from the cases once."""

import dataclasses
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from reports.pages.choices import strict
from reports.sentences import diverged, first_block
from reports.views import CaseView, CellView, Key
from suite.case import RECORDED
from suite.metrics import METRICS, Score
from suite.score import BEST, rounding

RESULTS, COST, HEALTH = (
    ("rmse", "crlb-ratio", "auc"),
    ("latency", "latency-p99", "throughput", "particle-throughput", "memory"),
    ("nees", "ess-share", "least-ess", "ancestors", "acceptance", "loglik-variance"),
)
"""Metrics of the tables on an estimator's page."""
RATES = ("divergence", "lost", "failed")
OF_FIRST = ("rmse", "crlb-ratio")
"""Metrics of which the first block of each case is shown, whatever its name."""


@dataclass(frozen=True)
class Outcome:
    """An estimator on a case, with the scores of its page alone.

    n: dimension of the state. block: the first of the case. strict: whether the bound holds for every estimator. best: the
    smallest RMSE of that block among the estimators that are ranked, NaN without any, or where it is rounding. ranked: whether
    anybody is marked best or as a tie by that RMSE.
    """

    case: str
    n: int
    block: str
    recorded: bool
    known: bool
    strict: bool
    best: float
    ranked: bool
    cell: CellView

    def score(self, metric: str, block: str = "") -> Score | None:
        """A score that has a value, of the first block unless one is named; else None."""
        score = self.cell.scores.get((metric, block or self.block))
        return score if score and not math.isnan(score.value) else None

    @property
    def rmse(self) -> Score | None:
        """The RMSE of the first block."""
        return self.score("rmse")

    @property
    def over_bound(self) -> Score | None:
        """That over the bound, where the bound is strict."""
        return self.score("crlb-ratio") if self.strict else None

    @property
    def over_best(self) -> Score | None:
        """That over the smallest in the row; its interval is that of the RMSE alone."""
        if self.rmse is None or not self.best > 0:
            return None
        value, low, high = (end / self.best for end in (self.rmse.value, self.rmse.low, self.rmse.high))
        return Score(value, low, high, "", self.rmse.runs, self.rmse.total)

    @property
    def mark(self) -> str:
        """Its standing by that RMSE: best, tie or none."""
        return self.cell.mark(("rmse", self.block))

    @property
    def diverged(self) -> int:
        """Runs that diverged, of those whose truth is known."""
        return diverged(self.cell)

    @property
    def wrong(self) -> bool:
        """Whether any run failed, was lost or diverged, or all of it failed."""
        return bool(self.cell.lost or self.cell.failed or self.diverged or self.cell.reasons)


def outcomes(cases: Sequence[CaseView], labels: Sequence[str]) -> dict[str, list[Outcome]]:
    """What became of each estimator on all cases, in their order."""
    found: dict[str, list[Outcome]] = {label: [] for label in labels}
    for case in cases:
        key, best = first_block(case), _smallest(case)
        ranked = bool(case.leaders(key))
        tiny = best <= rounding(case.rounding, METRICS[key[0]], key[1])
        known = len(case.card.state), key[1], case.card.origin == RECORDED, case.known, strict(case)
        for label in labels:
            cell = _needed(case.cells[label], key, ranked)
            found[label].append(Outcome(case.card.name, *known, math.nan if tiny else best, ranked, cell))
    return found


def _smallest(case: CaseView) -> float:
    """The smallest RMSE of the first block among the estimators that compete and of which every run counted."""
    key, metric = first_block(case), METRICS["rmse"]
    scored = [(cell, cell.scores[key]) for cell in case.with_score(key)]
    return min((score.value for cell, score in scored if cell.competes(metric) and score.runs == score.total), default=math.nan)


def _needed(cell: CellView, key: Key, ranked: bool) -> CellView:
    """A cell with the scores and the standing of its estimator's page, and without tracebacks."""
    scores = {k: score for k, score in cell.scores.items() if k[0] in (*RESULTS, *COST, *HEALTH, *RATES) and _wanted(k, key[1])}
    failures = tuple((kind, reason, ()) for kind, reason, _ in cell.failures)
    standing = {key: cell.standing[key]} if ranked and key in cell.standing else {}
    return dataclasses.replace(cell, scores=scores, standing=standing, failures=failures)


def _wanted(key: Key, block: str) -> bool:
    """Errors of the first block alone, and the memory of a call with one run."""
    metric, name = key
    return name == (block if metric in OF_FIRST else "one run" if metric == "memory" else name)


@dataclass(frozen=True)
class Summary:
    """What became of an estimator on all cases, in numbers.

    Cases by what became of them; runs, and how many of them were lost, failed, diverged; untold: those whose truth is not
    known. marked: cases in which it is best or tied, alone: of these, best, ranked: those it ran on in which anybody is.
    ratio: median over `compared` cases of the RMSE over the smallest. latency: shortest, median and longest of `timed` cases.
    """

    ran: int
    refused: int
    broken: int
    idle: int
    runs: int
    lost: int
    failed: int
    diverged: int
    untold: int
    marked: int
    alone: int
    ranked: int
    ratio: float
    compared: int
    latency: tuple[float, float, float]
    timed: int


def summary(of: Sequence[Outcome]) -> Summary:
    """The outcomes of an estimator in numbers."""
    cells = [one.cell for one in of]
    ratios = [one.over_best.value for one in of if one.over_best and one.cell.came_through == one.cell.total]
    times = sorted(score.value for one in of if (score := one.score("latency", "step")))
    median = float(np.median(times)) if times else math.nan
    return Summary(
        ran=sum(cell.ran for cell in cells),
        refused=sum(cell.status == "refused" for cell in cells),
        broken=sum(cell.status == "failed" and not cell.ran for cell in cells),
        idle=sum(cell.status == "not run" for cell in cells),
        runs=sum(cell.total for cell in cells),
        lost=sum(cell.lost for cell in cells),
        failed=sum(cell.failed for cell in cells),
        diverged=sum(one.diverged for one in of),
        untold=sum(one.cell.total for one in of if not one.known),
        marked=sum(bool(one.mark) for one in of),
        alone=sum(BEST in one.cell.standing.values() for one in of),
        ranked=sum(one.ranked and one.cell.ran for one in of),
        ratio=float(np.median(ratios)) if ratios else math.nan,
        compared=len(ratios),
        latency=(times[0], median, times[-1]) if times else (math.nan,) * 3,
        timed=len(times),
    )


def grouped_by_reason(of: Sequence[Outcome], status: str) -> Iterator[tuple[str, list[str]]]:
    """Why cases are refused, or not run, each reason once, with the names of the cases."""
    found = [one for one in of if one.cell.status == status]
    for reason in dict.fromkeys(one.cell.reason for one in found):
        yield reason, [one.case for one in found if one.cell.reason == reason]
