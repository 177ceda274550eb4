"""Tables of scores, and which estimator is best where the intervals support it."""

import itertools
import json
import math
import multiprocessing
from collections.abc import Collection, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas
from numpy.typing import NDArray

from suite.case import RECORDED
from suite.diagnosis import barred, in_words, remarks
from suite.linalg import Array
from suite.metrics import METRICS, SURVIVING, Metric, Score, counted
from suite.results import CaseResults, Cell, Results
from suite.statistics import LEVEL, Resampled, below_zero, stacked

BEST, TIED = "best", "tied"
ROUNDING = 1e-6
"""Relative differences below this are rounding between two ways to compute the same thing, whatever their sign."""
COLUMNS = (
    "case", "seed", "estimator", "metric", "block", "value", "low", "high", "unit", "runs", "total", "lost", "failed",
    "standing", "status", "reason", "told", "remarks",
)  # fmt: skip


def table(
    results: Results, metrics: Sequence[Metric], cases: Iterable[str], estimators: Iterable[str], jobs: int = 1
) -> pandas.DataFrame:
    """One row per case, estimator, metric and block; refused and failed cells keep a row that says why."""
    cases, estimators = set(cases), set(estimators)
    chosen = [case for case in results.cases.values() if case.card.name in cases]
    wanted = [metric.name for metric in metrics], estimators
    if jobs > 1 and len(chosen) > 1:
        with ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
            found = list(pool.map(_case_rows, chosen, *map(itertools.repeat, wanted)))
    else:
        found = [_case_rows(case, *wanted) for case in chosen]
    rows = itertools.chain.from_iterable(found)
    return pandas.DataFrame(rows, columns=list(COLUMNS)).astype({"runs": "Int64", "total": "Int64"})


def _case_rows(case: CaseResults, names: Sequence[str], estimators: set[str]) -> list[dict[str, Any]]:
    rows, metrics = [], [METRICS[name] for name in names]
    marks = standings(case, metrics)
    for label, cell in case.cells.items():
        if label not in estimators:
            continue
        told = cell.meta.get("told", "")
        said = in_words(remarks(cell))
        base = {"case": case.card.name, "seed": case.seed, "estimator": label, "told": told, "remarks": said, **status(cell)}
        found = [(m, b, s) for m in metrics for b, s in scores(cell, m).items()]
        if not found:
            rows.append(base)
        for metric, block, score in found:
            standing = marks.get((metric.name, block), {}).get(label, "")
            values = {"value": score.value, "low": score.low, "high": score.high, "runs": score.runs, "total": score.total}
            rows.append({**base, "metric": metric.name, "block": block, "unit": score.unit, "standing": standing, **values})
    return rows


def scores(cell: Cell, metric: Metric) -> dict[str, Score]:
    """A cell's scores by block; shares on a recording without interval: its runs are of the same data, and may be copies."""
    found = cell.scores(metric)
    if cell.case.card.origin != RECORDED or metric.timed or not (metric.binomial or metric.exact):
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


def all_survived(runs: Mapping[tuple[str, str, str], int]) -> bool:
    """Whether scores over surviving runs say nothing new, from the runs behind each estimator's metrics and blocks."""
    behind = f", {SURVIVING}"
    return all(
        n == runs[label, metric, block.removesuffix(behind)]
        for (label, metric, block), n in runs.items()
        if block.endswith(behind)
    )


def standings(case: CaseResults, metrics: Sequence[Metric]) -> dict[tuple[str, str], dict[str, str]]:
    """For every metric and block by which estimators are ranked, the one that is best, or those that tie for it, by label."""
    said = {label: remarks(cell) for label, cell in case.cells.items()}
    keys = {(m.name, block): m for m in metrics if m.ranked for cell in case.cells.values() for block in cell.scores(m)}
    return {
        key: _standing(case, key[1], metric, {label for label, found in said.items() if barred(found, metric)})
        for key, metric in keys.items()
    }


def rounding(sizes: Mapping[str, float], metric: Metric, block: str) -> float:
    """The value up to which a score is rounding, from the sizes of errors of state blocks; minus infinity of all else."""
    power = {"block": 1, "block, squared": 2}.get(metric.unit)
    size = sizes.get(block) if power and metric.better == "lower" else None
    return -math.inf if size is None or power is None else size**power


@dataclass(frozen=True)
class _Candidate:
    label: str
    contributions: Array
    runs: tuple[int, ...]

    def over(self, metric: Metric, runs: Sequence[int]) -> Resampled:
        """The metric over some of its runs."""
        whole = tuple(runs) == self.runs
        return metric.resampled(self.contributions if whole else self.contributions[..., [self.runs.index(r) for r in runs]])


def _standing(case: CaseResults, block: str, metric: Metric, aside: Collection[str]) -> dict[str, str]:
    """Best: every other estimator is worse beyond chance. Tied: the runs cannot tell which of the marked ones is best.

    The marked ones hold the best with 95 % confidence: each of the others is worse than one of them by a two-sided paired
    test at 5 % divided by the number of rivals. Two-sided, so that a single best one among several that are in truth equal
    is found in no more than 5 of 100 cases either. An estimator with a failed or lost run, or with a remark that bars it,
    competes for no place, and one without a rival is not best of anything. Nor is any on a recording, whose runs are all of
    the same data, or among the runs that survived, since those are not the same for all. Nor is any where the best error is
    rounding.
    """
    if (case.card.origin == RECORDED and not metric.timed) or block.endswith(f", {SURVIVING}"):
        return {}
    scored = {label: cell for label, cell in case.cells.items() if block in cell.scores(metric)}
    candidates = []
    for label, cell in scored.items():
        score = cell.scores(metric)[block]
        whole = cell.counts.get("lost", 0) + cell.counts.get("failed", 0) == 0
        if whole and label not in aside and np.isfinite(score.value) and score.runs > 1:
            values = cell.contributions(metric)[block]
            numbers = np.arange(values.shape[-1]) if metric.timed else np.asarray(cell.runs)
            known = counted(values)
            candidates.append(_Candidate(label, values[..., known], tuple(numbers[known].tolist())))
    smallest = min((scored[one.label].scores(metric)[block].value for one in candidates), default=math.nan)
    if not candidates or len(scored) < 2 or smallest <= rounding(case.rounding, metric, block):
        return {}
    beaten = _beaten(metric, candidates, (1 - LEVEL) / 2 / max(len(candidates) - 1, 1))
    best = [one.label for one in candidates if one.label not in beaten]
    return dict.fromkeys(best, TIED) if len(best) > 1 else dict.fromkeys(best, BEST)


def _beaten(metric: Metric, candidates: Sequence[_Candidate], level: float) -> set[str]:
    """Those that are worse than another one on the runs that both have; groups that have the same runs are tested at once."""
    groups: dict[tuple[int, ...], list[_Candidate]] = {}
    for one in candidates:
        groups.setdefault(one.runs, []).append(one)
    found: set[str] = set()
    for (runs, group), (others_runs, others) in itertools.product(groups.items(), repeat=2):
        common = runs if runs == others_runs else tuple(sorted(set(runs) & set(others_runs)))
        if len(common) > 1:
            mine, theirs = (stacked([one.over(metric, common) for one in each]) for each in (group, others))
            pairs = np.indices((len(group), len(others))).reshape(2, -1)
            worse = _worse(metric, mine[pairs[0]], theirs[pairs[1]], level).reshape(len(group), len(others))
            found |= {group[i].label for i in np.flatnonzero(worse.any(1))}
    return found


def _worse(metric: Metric, mine: Resampled, theirs: Resampled, level: float) -> NDArray[np.bool_]:
    """Whether scores [S] are worse than others of the same runs, beyond chance at this one-sided level.

    What misses a target by more is beyond all of `faced`, on whichever side of the target it is.
    """
    ratio = mine.positive & theirs.positive
    mine, theirs = (misses(metric, sample, ratio) for sample in (mine, theirs))
    sign = np.ones(len(mine.value)) if isinstance(metric.better, str) else np.where(mine.value > 0, 1.0, -1.0)
    found = np.ones(len(mine.value), bool)
    for other in faced(metric, theirs):
        gap = (other - mine).map(lambda rest: sign[:, None] * rest)
        found &= (gap.centre_and_error[0] < -ROUNDING) & (below_zero(gap) < level)
    return found


def faced(metric: Metric, theirs: Resampled) -> list[Resampled]:
    """What a score is tested against, as misses: another score, and where there is a target its mirror image about that too.

    Sizes of misses are not tested: they have a corner where the jackknife fails, at scores that hit the target.
    """
    return [theirs] if isinstance(metric.better, str) else [theirs, theirs.map(np.negative)]


def loss(metric: Metric, value: Array) -> Array:
    """Smaller is better: the logarithm of the value, its negative, or how far it misses its target."""
    with np.errstate(all="ignore"):
        found = _missed(metric, np.log(value) if metric.by_ratio else value, metric.by_ratio)
    return found if isinstance(metric.better, str) else np.abs(found)


def misses(metric: Metric, sample: Resampled, ratio: NDArray[np.bool_] | None = None) -> Resampled:
    """What scores [S] are above their target, or the scores, or their negatives where more is better; also without each run.

    Ratios, not differences, of what is never negative: an average over runs that are wild now and then, or over a few timed
    calls, is skew. A rate may be zero and stays as it is; so do those for which `ratio` is false, when two are compared.
    """
    if not metric.by_ratio:
        return sample.map(lambda scaled: _missed(metric, scaled, False))
    found = sample.logarithm.map(lambda scaled: _missed(metric, scaled, True))
    if ratio is None or ratio.all():
        return found
    plain = sample.map(lambda scaled: _missed(metric, scaled, False))
    return Resampled(np.where(ratio, found.value, plain.value), np.where(ratio[:, None], found.left_out, plain.left_out))


def _missed(metric: Metric, scaled: Array, ratio: bool) -> Array:
    if isinstance(metric.better, str):
        return scaled if metric.better == "lower" else -scaled
    return scaled - (math.log(metric.better) if ratio else metric.better)


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
