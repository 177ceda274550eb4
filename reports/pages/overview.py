"""The overview: all cases against all estimators, by a metric that the reader chooses."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from reports.frame import Frame
from reports.inputs import Site
from reports.part import Part
from reports.sentences import headline
from reports.text import listed, slugs
from reports.views import WITHOUT_TRUTH, CaseView, CellView, Key, times_worse
from suite.metrics import FAMILIES, METRICS, Metric

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

    @property
    def listed(self) -> list[str]:
        """Its fields in this order, as the script expects them."""
        return [self.state, self.value, self.unit, self.interval, self.mark, self.runs, self.shade, self.note]


def choices(cases: Sequence[CaseView]) -> list[Choice]:
    """What can be shown of all cases at once, family by family; the default is the first.

    Of a metric of state blocks that of each case's first block, since their names differ from case to case; of the RMSE, which
    comes first unless the truth of no case is known, that of every block as well.
    """
    ordered = [name for family in FAMILIES for name, metric in METRICS.items() if metric.family == family]
    keys = dict.fromkeys(key for name in ordered for case in cases for key in case.keys if key[0] == name)
    of_blocks = {name for name in METRICS if all(_of_block(case, key) for case in cases for key in case.keys if key[0] == name)}
    offered: dict[tuple[str, str | None], None] = {}
    if not keys or any(case.known for case in cases):
        offered["rmse", None] = None
    for metric, block in keys:
        offered |= {(metric, None if metric in of_blocks else block): None}
        if metric == "rmse":
            offered[metric, block] = None
    ids = slugs([f"{metric} {block or 'first'}" for metric, block in offered])
    several = [metric for metric in METRICS if sum(key[0] == metric for key in offered) > 1]
    return [
        Choice(
            "first" if (name, block) == ("rmse", None) else ids[f"{name} {block or 'first'}"],
            METRICS[name],
            block,
            _title(METRICS[name], block, cases, name in several),
            *_reading(METRICS[name]),
        )
        for name, block in offered
    ]


def _of_block(case: CaseView, key: Key) -> bool:
    return key[1].partition(", ")[0] in [block.name for block in case.card.blocks]


def _title(metric: Metric, block: str | None, cases: Sequence[CaseView], several: bool) -> str:
    head = "RMSE" if metric.name == "rmse" else metric.title
    if block is not None:
        return f"{head}: {block}" if several else head
    firsts = list(dict.fromkeys(case.card.blocks[0].name for case in cases if case.card.blocks))
    return f"{head}: {FIRST}" + (f" ({listed(firsts, 3)})" if firsts and metric.name == "rmse" else "")


def _reading(metric: Metric) -> tuple[str, tuple[str, ...]]:
    """How to read a metric, and the words of the classes of shading: none where a ratio to the best says nothing."""
    if not metric.ranked:
        return "by which nobody is ranked", ()
    if metric.binomial:
        ends = [f"{100 * r:g} %" for r in RATES]
        return "lower is better", (f"up to {ends[0]}", *(f"up to {e}" for e in ends[1:]), "more")
    better = f"{metric.better} is better" if isinstance(metric.better, str) else f"{metric.better:g} is best"
    if metric.signed:
        return better, ()
    if not isinstance(metric.better, str):
        return better, (*(f"within a factor {s:g} of {metric.better:g}" for s in STEPS), "further off")
    low = metric.better == "lower"
    thing = "smallest" if low else "largest"
    steps = [f"up to {s:g} times" if low else f"down to 1/{s:g} of" for s in STEPS[1:]]
    return better, (f"within {100 * (STEPS[0] - 1):.0f} % of the row's {thing}", *steps, "further off")


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
    if state == "done" and not cell.competes(choice.metric):
        state = "barred"
    shade = _shade(choice, score.value, best) if state == "done" and score.runs > 1 else ""
    return Shown(state, words.value, words.unit, words.interval, cell.mark(key), runs, shade, "; ".join(filter(None, notes)))


def _absent(case: CaseView, cell: CellView, choice: Choice) -> Shown:
    """Why a cell that was run has no such score."""
    if choice.metric.timed and cell.timing_failure:
        return Shown("failed", "failed", note=f"timing it failed: {cell.timing_failure}")
    if cell.status in ("failed", "lost"):
        return Shown(cell.status, cell.status, note=cell.reason)
    if choice.metric.timed:
        return Shown("absent", "not timed", note="no running times are stored for this estimator on this case")
    if choice.key(case) in cell.scores:
        untold = not case.known and choice.metric.family != "particles" and choice.metric.name not in WITHOUT_TRUTH
        why = ": the truth is not known" if untold else ""
        return Shown("absent", "none", note=f"it has no {choice.metric.title} on this case{why}")
    if choice.block is None or choice.metric.name != "rmse":
        return Shown("absent", "none", note=f"it has no {choice.metric.title} on this case")
    names = listed([b.name for b in case.card.blocks])
    return Shown("absent", "no such block", note=f"this case has no {choice.block}; its state blocks are {names}")


def _shade(choice: Choice, value: float, best: float) -> str:
    if math.isnan(value) or not choice.legend:
        return ""
    binomial = choice.metric.binomial
    size, steps = (value, RATES) if binomial else (times_worse(choice.metric, value, best), STEPS)
    return f"shade-{sum(size > step * (1 + 1e-9) for step in steps)}"


def _best(case: CaseView, choice: Choice) -> float:
    """The best value among the cells of a row that compete and in which every run counted."""
    key = choice.key(case)
    scored = [c for c in case.with_score(key) if c.scores[key].runs == c.scores[key].total and c.competes(choice.metric)]
    return (max if choice.metric.better == "higher" else min)((c.scores[key].value for c in scored), default=math.nan)


def parts(site: Site) -> Iterator[Part]:
    """The overview."""
    yield Part("overview", site.depends(), files, (site.frame, site.cases))


def files(frame: Frame, cases: Sequence[CaseView]) -> dict[str, str]:
    """The overview's files."""
    matrix = context(cases, frame.labels, frame.cases)
    return {"index.html": frame.page("overview", **matrix, headline=headline(cases), cases=cases)}


def context(cases: Sequence[CaseView], labels: Sequence[str], pages: Mapping[str, str]) -> dict[str, Any]:
    """What the overview's template needs."""
    offered = choices(cases)
    rows: list[dict[str, Any]] = []
    for case in cases:
        bests = [_best(case, choice) for choice in offered]
        by_choice = [[shown(case, case.cells[label], *pair) for label in labels] for pair in zip(offered, bests, strict=True)]
        rows.append({"case": case, "page": pages[case.card.name], "cells": by_choice[0], "all": by_choice})
    place: dict[Shown, int] = {}  # most cells show what others do: that they are refused, and why
    cells = [[[place.setdefault(one, len(place)) for one in row] for row in r["all"]] for r in rows]
    data = {
        "choices": [{"id": c.id, "better": c.better, "legend": c.legend, "title": c.title} for c in offered],
        "shown": [one.listed for one in place],
        "cells": cells,
    }
    groups = [(FAMILIES[name], list(group)) for name, group in itertools.groupby(offered, lambda c: c.metric.family)]
    told = any(cell.told for case in cases for cell in case.cells.values())
    return {"rows": rows, "choices": offered, "groups": groups, "data": data, "nominal": NOMINAL if told else ""}
