"""What the pages show of a case: scores, standings and states of its cells, taken from the results once."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from reports.detectors import Detector, detectors
from reports.text import Quantity, quantity
from suite.case import RECORDED
from suite.diagnosis import Remark, barred, remarks
from suite.metrics import METRICS, SURVIVING, Metric, Score
from suite.plan import PROFILES, TIMING
from suite.published import Finding
from suite.published import Key as FigureKey
from suite.results import CaseResults, Cell
from suite.score import BEST, ROUNDING, TIED, all_survived, loss, scores, standings, status
from suite.statistics import LEVEL
from suite.verdicts import Verdict, measured

Key = tuple[str, str]
"""A metric and a block."""
AS_PAPERS_DO = ("mean-error", "absolute-error", "maximum-error", "mse", "pooled-rmse", "run-rmse", "run-rmse-sd")
DETAILS = ("pit",)
SHOWN = [metric for name, metric in METRICS.items() if name not in (*AS_PAPERS_DO, *DETAILS)]
"""Metrics of the pages' tables; the others measure as one paper or the other does, or each component of the state apart."""
WITHOUT_TRUTH = ("nis", "whiteness", "loglik")
"""Metrics of consistency that need no truth."""
PERCENT = f"{100 * LEVEL:g} %"


@dataclass(frozen=True)
class CellView:
    """An estimator on a case: what became of it and its scores."""

    label: str
    status: str
    reason: str
    lost: int = 0
    failed: int = 0
    total: int = 0
    scores: dict[Key, Score] = field(default_factory=dict)
    standing: dict[Key, str] = field(default_factory=dict)
    failures: tuple[tuple[str, str, tuple[str, ...]], ...] = ()
    meta: dict[str, Any] = field(default_factory=dict)
    remarks: tuple[Remark, ...] = ()

    def competes(self, metric: Metric) -> bool:
        """Whether it may be called best by a metric: all runs came through and, but for running times, no remark bars it."""
        return not (self.lost or self.failed or barred(self.remarks, metric))

    @property
    def ran(self) -> bool:
        """Whether there is anything of it: it was neither refused nor left out, and did not fail before any run."""
        return self.status not in ("refused", "not run") and not (self.status == "failed" and not self.total)

    @property
    def came_through(self) -> int:
        """Runs that were neither lost nor failed."""
        return self.total - self.lost - self.failed

    @property
    def told(self) -> str:
        """The nominal mode of a case with several modes, where the estimator was told that one alone; else nothing."""
        return str(self.meta.get("told", ""))

    @property
    def reasons(self) -> list[str]:
        """What went wrong, each reason once."""
        return list(dict.fromkeys(f"{'while timed: ' if kind == TIMING else ''}{why}" for kind, why, _ in self.failures))

    @property
    def tracebacks(self) -> list[str]:
        """The tracebacks of what went wrong, each once."""
        return list(dict.fromkeys(text for *_, texts in self.failures for text in texts))

    @property
    def timing_failure(self) -> str:
        """Why there are no running times, when timing it failed."""
        return next((reason for kind, reason, _ in self.failures if kind == TIMING), "")

    def mark(self, key: Key) -> str:
        """Its standing by a metric in a word: best, tie, or none."""
        return {BEST: "best", TIED: "tie"}.get(self.standing.get(key, ""), "")

    def quantity(self, key: Key) -> Quantity:
        """A score in words."""
        return quantity(self.scores[key], METRICS[key[0]])


@dataclass(frozen=True)
class CaseView:
    """A case with its cells, one for every estimator of the results, run or not; known: whether anything is of its truth.

    rounding: by state block, the size of an error up to which it is rounding. measured: the score that measures each of the
    card's published figures, None where there is none. detectors: what is known of the cells that have a decision statistic.
    """

    results: CaseResults
    cells: dict[str, CellView]
    keys: tuple[Key, ...]
    runs: int
    known: bool
    rounding: Mapping[str, float] = field(default_factory=dict)
    measured: tuple[Score | None, ...] = ()
    detectors: tuple[Detector, ...] = ()

    @property
    def card(self) -> Any:
        """The case's card."""
        return self.results.card

    def verdicts(self, findings: Mapping[FigureKey, Finding]) -> list[Verdict]:
        """The card's published figures with what was found of them before, and what these results measure."""
        name = self.card.name
        return [
            Verdict(name, published, findings.get((name, published.estimator, published.quantity)), score)
            for published, score in zip(self.card.published, self.measured, strict=True)
        ]

    def with_score(self, key: Key) -> list[CellView]:
        """The cells that have a finite score of that metric and block."""
        return [c for c in self.cells.values() if key in c.scores and math.isfinite(c.scores[key].value)]

    def leaders(self, key: Key) -> list[CellView]:
        """The cell that is best, or those that tie for it."""
        return [c for c in self.cells.values() if c.standing.get(key)]

    def ahead(self, key: Key) -> list[CellView]:
        """The cells that compete for no place and have better values than all that do, the best first.

        None where nobody is ranked anyway.
        """
        metric, scored = METRICS[key[0]], self.with_score(key)
        one_sample = self.card.origin == RECORDED and not metric.timed
        if not metric.ranked or one_sample or key[1].endswith(SURVIVING) or len(scored) < 2:
            return []
        losses = {c.label: float(loss(metric, np.asarray(c.scores[key].value))) for c in scored if c.scores[key].runs > 1}
        best = min((losses[c.label] for c in scored if c.label in losses and c.competes(metric)), default=math.inf)
        outside = [c for c in scored if not c.competes(metric) and losses.get(c.label, math.inf) < best - ROUNDING]
        return sorted(outside, key=lambda c: losses[c.label])


def private(case: CaseResults) -> CaseResults:
    """A copy whose cells, and those of its calm twin, forget what they read when the copy goes: estimates are large."""
    copy = _copied(case)
    copy.calm = _copied(case.calm) if case.calm else None
    return copy


def _copied(case: CaseResults) -> CaseResults:
    copy = dataclasses.replace(case, cells={})
    copy.cells = {label: dataclasses.replace(cell, case=copy) for label, cell in case.cells.items()}
    return copy


def view(case: CaseResults, labels: Sequence[str]) -> CaseView:
    """What the pages show of a case, for the estimators `labels`."""
    ranked = standings(case, SHOWN)
    cells = {label: _cell(case.cells.get(label), label, case.card) for label in labels}
    keys = _keys(case, cells)
    for key in keys:
        # With a single estimator that has a score there is nobody to be better than.
        if sum(key in c.scores and math.isfinite(c.scores[key].value) for c in cells.values()) < 2:
            continue
        for label, standing in ranked.get(key, {}).items():
            if label in cells:
                cells[label].standing[key] = standing
    truths = case.truth_of.values()
    known = not truths or any(np.isfinite(truth.x).any() for truth in truths)
    figures = tuple(measured(case, published) for published in case.card.published)
    return CaseView(case, cells, keys, len(truths), known, case.rounding, figures, tuple(detectors(case)))


def _keys(case: CaseResults, cells: dict[str, CellView]) -> tuple[Key, ...]:
    """Metrics and blocks of which any cell has a value, be it infinite, in the order of the metrics and of the blocks."""
    found = {key for cell in cells.values() for key, score in cell.scores.items() if not math.isnan(score.value)}
    if all_survived({(c.label, *key): score.runs for c in cells.values() for key, score in c.scores.items()}):
        found = {key for key in found if not key[1].endswith(SURVIVING)}
    place = {block.name: i for i, block in enumerate(case.card.blocks)}
    order = list(METRICS)
    return tuple(sorted(found, key=lambda k: (order.index(k[0]), place.get(k[1], len(place)), k[1])))


def _cell(cell: Cell | None, label: str, card: Any) -> CellView:
    if cell is None:
        return CellView(label, "not run", _not_run(label, card))
    state = status(cell)
    failures = tuple((kind, reason, tuple(tracebacks)) for kind, reason, tracebacks in cell.failures)
    if state["status"] == "not run" and failures:  # without a truth no run counts, but it was tried
        state |= {"status": "failed", "reason": failures[0][1]}
    return CellView(
        label,
        state["status"],
        state["reason"],
        state["lost"],
        state["failed"],
        len(cell.runs),
        _scores(cell, SHOWN),
        {},
        failures,
        cell.meta,
        tuple(remarks(cell)),
    )


def _not_run(label: str, card: Any) -> str:
    """Why there is nothing of an estimator, as far as it can be told: what has parameters of its own is always named."""
    if "[" not in label and PROFILES["quick"].left_out(label, card):
        return "the quick profile leaves it out for the time it takes; the profile whole runs it"
    return "no run of it is stored"


def _scores(cell: Cell, metrics: Any) -> dict[Key, Score]:
    return {(metric.name, block): score for metric in metrics for block, score in scores(cell, metric).items()}


def times_worse(metric: Metric, value: float, best: float) -> float:
    """How many times a value is worse than the best one; for a metric with a target, how many times it misses it."""
    if not isinstance(metric.better, str):
        return max(value / metric.better, metric.better / value) if value > 0 else math.inf
    ratio = (best, value) if metric.better == "higher" else (value, best)
    if ratio[0] == ratio[1]:
        return 1.0
    return ratio[0] / ratio[1] if ratio[1] > 0 else math.inf
