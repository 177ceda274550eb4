"""The overview: all cases against all estimators, by a metric that the reader chooses."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from reports.text import listed, slugs
from reports.views import WITHOUT_TRUTH, CaseView, CellView, Key, loss
from suite.metrics import METRICS, Metric
from suite.score import BEST

FIRST = "first block of each case"
STEPS = (1.1, 1.5, 3.0, 10.0)
"""Upper ends of the classes of shading, as ratios to the best of the row; what lies above is the last class."""
NOMINAL = "nominal mode"
"""What is said of an estimator that was told one of a case's modes alone."""
RATES = (0.02, 0.1, 0.25, 0.5)
"""The same for rates, as they stand: a ratio to a rate of zero says nothing."""


@dataclass(frozen=True)
class Choice:
    """A metric and block that a reader can choose; block None stands for the first block of each case."""

    id: str
    metric: Metric
    block: str | None
    title: str
    better: str
    legend: tuple[str, ...]

    def key(self, case: CaseView) -> Key:
        """The metric and block to show of a case."""
        return self.metric.name, self.block if self.block is not None else case.card.blocks[0].name if case.card.blocks else ""


@dataclass(frozen=True)
class Shown:
    """What a cell of the matrix shows: state, value, interval, standing, count of runs, class of shading, remark."""

    state: str
    value: str
    unit: str = ""
    interval: str = ""
    mark: str = ""
    runs: str = ""
    shade: str = ""
    note: str = ""


def choices(cases: Sequence[CaseView]) -> list[Choice]:
    """All metrics and blocks that any case has, in the order of the metrics; the default one is the first.

    That is the RMSE of each case's first block, unless the truth of no case is known.
    """
    keys = list(dict.fromkeys(key for metric in METRICS for case in cases for key in case.keys if key[0] == metric))
    ids = slugs([f"{metric} {block}" for metric, block in keys])
    found = [
        Choice(ids[f"{metric} {block}"], METRICS[metric], block, _title(METRICS[metric], block), *_reading(METRICS[metric]))
        for metric, block in keys
    ]
    if found and not any(case.known for case in cases):
        return found
    rmse = METRICS["rmse"]
    firsts = list(dict.fromkeys(case.card.blocks[0].name for case in cases if case.card.blocks))
    words = f"RMSE: {FIRST}" + (f" ({listed(firsts, 3)})" if firsts else "")
    return [Choice("first", rmse, None, words, *_reading(rmse)), *found]


def _title(metric: Metric, block: str) -> str:
    if metric.unit == "block":
        return f"RMSE: {block}" if metric.name == "rmse" else f"{metric.title}: {block}"
    return metric.title


def _reading(metric: Metric) -> tuple[str, tuple[str, ...]]:
    """How to read a metric, and the words of the classes of shading."""
    if metric.binomial:
        ends = [f"{100 * r:g} %" for r in RATES]
        return "lower is better", (f"up to {ends[0]}", *(f"up to {e}" for e in ends[1:]), "more")
    if not isinstance(metric.better, str):
        target = f"{metric.better:g}"
        steps = [f"within a factor {s:g} of {target}" for s in STEPS]
        return f"{target} is best", (*steps, "further off")
    low = metric.better == "lower"
    thing = "smallest" if low else "largest"
    steps = [f"up to {s:g} times" if low else f"down to 1/{s:g} of" for s in STEPS[1:]]
    return f"{metric.better} is better", (f"within {100 * (STEPS[0] - 1):.0f} % of the row's {thing}", *steps, "further off")


def shown(case: CaseView, cell: CellView, choice: Choice, best: float) -> Shown:
    """What the matrix shows of a cell; `best` is the best value in its row."""
    key = choice.key(case)
    if cell.status in ("refused", "not run"):
        return Shown(cell.status, cell.status, note=cell.reason)
    score = cell.scores.get(key)
    if score is None or (choice.metric.timed and math.isnan(score.value)):
        return _absent(case, cell, choice)
    if cell.status in ("failed", "lost") and not (choice.metric.timed or choice.metric.binomial):
        return Shown(cell.status, cell.status, runs=f"0 of {cell.total} runs", note=cell.reason)
    if math.isnan(score.value):
        return _absent(case, cell, choice)
    words = cell.quantity(key)
    whole = score.runs == score.total
    runs = "" if whole else f"{score.runs} of {score.total} runs"
    state = "done" if whole and (cell.status == "done" or choice.metric.timed) else "partly"
    if choice.metric.binomial and cell.status != "done":
        runs = f"{cell.came_through} of {cell.total} runs came through"
    if cell.told:
        runs = "; ".join(filter(None, [runs, NOMINAL]))
    notes = [cell.reason if state == "partly" else "", f"told the nominal mode, {cell.told}, alone" if cell.told else ""]
    shade = _shade(choice.metric, score.value, best) if state == "done" and score.runs > 1 else ""
    standing = cell.standing.get(key, "")
    mark = {"": ""}.get(standing, "best" if standing == BEST else "tie")
    return Shown(state, words.value, words.unit, words.interval, mark, runs, shade, "; ".join(filter(None, notes)))


def _absent(case: CaseView, cell: CellView, choice: Choice) -> Shown:
    """Why a cell that was run has no such score."""
    if choice.metric.timed and cell.timing_failure:
        return Shown("failed", "failed", note=f"timing it failed: {cell.timing_failure}")
    if cell.status in ("failed", "lost"):
        return Shown(cell.status, cell.status, note=cell.reason)
    if choice.metric.timed:
        return Shown("absent", "not timed", note="no running times are stored for this estimator on this case")
    if choice.key(case) in cell.scores:
        why = "" if case.known or choice.metric.name in WITHOUT_TRUTH else ": the truth is not known"
        return Shown("absent", "none", note=f"it has no {choice.metric.title} on this case{why}")
    if choice.metric.unit != "block":
        return Shown("absent", "none", note=f"it has no {choice.metric.title} on this case")
    names = listed([b.name for b in case.card.blocks])
    return Shown("absent", "no such block", note=f"this case has no {choice.block}; its state blocks are {names}")


def _shade(metric: Metric, value: float, best: float) -> str:
    if math.isnan(value):
        return ""
    size, steps = (value, RATES) if metric.binomial else (loss(metric, value, best), STEPS)
    return f"shade-{sum(size > step * (1 + 1e-9) for step in steps)}"


def _best(case: CaseView, choice: Choice) -> float:
    """The best value among the cells of a row in which every run counted."""
    key = choice.key(case)
    values = [c.scores[key].value for c in case.with_score(key) if c.scores[key].runs == c.scores[key].total]
    return (max if choice.metric.better == "higher" else min)(values, default=math.nan)


def context(cases: Sequence[CaseView], labels: Sequence[str], pages: Mapping[str, str]) -> dict[str, Any]:
    """What the overview's template needs."""
    offered = choices(cases)
    rows = []
    for case in cases:
        by_choice = [[shown(case, case.cells[label], c, _best(case, c)) for label in labels] for c in offered]
        rows.append({"case": case, "page": pages[case.card.name], "cells": by_choice[0], "all": by_choice})
    fields = ("state", "value", "unit", "interval", "mark", "runs", "shade", "note")
    data = {
        "choices": [{"id": c.id, "better": c.better, "legend": c.legend, "title": c.title} for c in offered],
        # One list a cell, in the order of `fields`: the names would be most of the page.
        "cells": [[[[asdict(s)[f] for f in fields] for s in row] for row in r["all"]] for r in rows],
    }
    told = any(cell.told for case in cases for cell in case.cells.values())
    return {"rows": rows, "choices": offered, "data": data, "nominal": NOMINAL if told else ""}
