"""Tables of scores, and which estimator is best where the intervals support it."""

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas

from suite.case import RECORDED
from suite.linalg import Array
from suite.metrics import Metric, Score
from suite.results import CaseResults, Cell, Results
from suite.statistics import jackknife

BEST, TIED = "best", "tied"
ROUNDING = 1e-6
"""Relative differences below this are rounding between two ways to compute the same thing, whatever their sign."""
COLUMNS = (
    "case", "seed", "estimator", "metric", "block", "value", "low", "high", "unit", "runs", "total", "lost", "failed",
    "standing", "status", "reason", "told",
)  # fmt: skip


def table(results: Results, metrics: Sequence[Metric], cases: Iterable[str], estimators: Iterable[str]) -> pandas.DataFrame:
    """One row per case, estimator, metric and block; refused and failed cells keep a row that says why."""
    cases, estimators = set(cases), set(estimators)
    rows = [row for case in results.cases.values() if case.card.name in cases for row in _case_rows(case, metrics, estimators)]
    return pandas.DataFrame(rows, columns=list(COLUMNS)).astype({"runs": "Int64", "total": "Int64"})


def _case_rows(case: CaseResults, metrics: Sequence[Metric], estimators: set[str]) -> list[dict[str, Any]]:
    rows = []
    marks = standings(case, metrics)
    for label, cell in case.cells.items():
        if label not in estimators:
            continue
        told = cell.meta.get("told", "")
        base = {"case": case.card.name, "seed": case.seed, "estimator": label, "told": told, **status(cell)}
        found = [(m, b, s) for m in metrics for b, s in scores(cell, m).items()]
        if not found:
            rows.append(base)
        for metric, block, score in found:
            standing = marks[metric.name, block].get(label, "")
            values = {"value": score.value, "low": score.low, "high": score.high, "runs": score.runs, "total": score.total}
            rows.append({**base, "metric": metric.name, "block": block, "unit": score.unit, "standing": standing, **values})
    return rows


def scores(cell: Cell, metric: Metric) -> dict[str, Score]:
    """A cell's scores by block; rates on a recording without interval: its runs are of the same data, and may be copies."""
    found = cell.scores(metric)
    if cell.case.card.origin != RECORDED or not metric.binomial:
        return found
    return {block: replace(score, low=math.nan, high=math.nan) for block, score in found.items()}


def status(cell: Cell) -> dict[str, Any]:
    """What became of a cell: done, failures among its runs, refused or not run; with the first reason."""
    if cell.refusal:
        return {"status": "refused", "reason": cell.refusal, "lost": 0, "failed": 0}
    counts = cell.counts
    if not counts:
        reasons = [reason for _, reason, _ in cell.failures]  # a case that does not simulate has failures but no truth
        failed = sum(entry.meta["failed"] for entry in cell.estimates)
        word = "failed" if reasons else "not run"
        return {"status": word, "reason": reasons[0] if reasons else "no run is stored", "lost": 0, "failed": failed}
    lost, failed, total = counts["lost"], counts["failed"], len(cell.runs)
    words = {0: "done", total: "failed" if failed == total else "lost"}
    reason = next((r for s, r in zip(cell.estimate.status, cell.estimate.reason, strict=True) if s != "ok"), "")
    return {"status": words.get(lost + failed, "partly failed"), "reason": reason, "lost": lost, "failed": failed}


def standings(case: CaseResults, metrics: Sequence[Metric]) -> dict[tuple[str, str], dict[str, str]]:
    """For every metric and block, the estimator that is best, or those that tie for it, by label."""
    return {key: _standing(case, *key, metric) for metric in metrics for key in _keys(case, metric)}


def _keys(case: CaseResults, metric: Metric) -> set[tuple[str, str]]:
    return {(metric.name, block) for cell in case.cells.values() for block in cell.scores(metric)}


@dataclass(frozen=True)
class _Candidate:
    label: str
    contributions: Array
    runs: tuple[int, ...]
    loss: float


def _standing(case: CaseResults, name: str, block: str, metric: Metric) -> dict[str, str]:
    """Best: every other estimator is worse beyond the interval of the paired difference. Tied: not so.

    An estimator with a failed or lost run is neither, and one without a rival is not best of anything. Nor is any on a
    recording, whose runs are all of the same data. Scores are turned into losses, see `_loss`.
    """
    if case.card.origin == RECORDED and not metric.timed:
        return {}
    scored = {label: cell for label, cell in case.cells.items() if block in cell.scores(metric)}
    candidates = []
    for label, cell in scored.items():
        score = cell.scores(metric)[block]
        whole = cell.counts.get("lost", 0) + cell.counts.get("failed", 0) == 0
        if whole and np.isfinite(score.value) and score.runs > 1:
            values = cell.contributions(metric)[block]
            runs = tuple(range(values.shape[1])) if metric.timed else tuple(cell.runs)
            candidates.append(_Candidate(label, values, runs, float(_loss(metric, np.array([score.value]))[0])))
    if not candidates or len(scored) < 2:
        return {}
    leader = min(candidates, key=lambda c: c.loss)
    level = [c.label for c in candidates if c is not leader and not _worse(metric, c, leader)]
    return dict.fromkeys([leader.label, *level], TIED) if level else {leader.label: BEST}


def _worse(metric: Metric, other: _Candidate, leader: _Candidate) -> bool:
    """Whether the interval of the paired difference of losses lies above zero."""
    common = sorted(set(other.runs) & set(leader.runs))
    if len(common) < 2:
        return False
    a, b = (c.contributions[:, [c.runs.index(r) for r in common]] for c in (other, leader))

    def difference(weights: Array) -> Array:
        return _loss(metric, metric.average(a)(weights)) - _loss(metric, metric.average(b)(weights))

    _, low, _ = jackknife(difference, len(common))
    return bool(low[0] > ROUNDING) if np.isfinite(leader.loss) else other.loss > leader.loss  # an error of exactly zero


def _loss(metric: Metric, value: Array) -> Array:
    """Smaller is better: the logarithm of the value, its negative, or how many times it misses its target.

    Ratios, not differences: an average over runs that are wild now and then, or over a few timed calls, is skew. A rate
    may be zero and stays as it is.
    """
    if metric.binomial:
        return value
    with np.errstate(divide="ignore"):
        if metric.better == "lower":
            return np.log(value)
        if metric.better == "higher":
            return -np.log(value)
        return np.abs(np.log(value / float(metric.better)))


def to_json(frame: pandas.DataFrame) -> str:
    """The table as a JSON list of objects; numbers that do not exist are null, infinite ones the text 'inf'."""
    records = [{k: _json_value(v) for k, v in record.items()} for record in frame.to_dict("records")]
    return json.dumps(records, indent=1, ensure_ascii=False)


def _json_value(value: Any) -> Any:
    if value is pandas.NA:
        return None
    if isinstance(value, float | np.floating):
        return None if math.isnan(value) else ("inf" if value > 0 else "-inf") if math.isinf(value) else float(value)
    return int(value) if isinstance(value, np.integer) else value
