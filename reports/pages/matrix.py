"""The matrix of cases and estimators: what its cells show of a choice."""

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields, replace
from typing import Any

import numpy as np

from reports.pages.choices import RATES, STEPS, Choice, strict
from reports.text import listed
from reports.views import WITHOUT_TRUTH, CaseView, CellView, times_worse
from suite.score import ROUNDING, loss, rounding


@dataclass(frozen=True)
class Shown:
    """What a cell of the matrix shows, and by what it is coloured and sorted.

    shade, bound: classes of shading by the best of the row and by the bound, -1 for none. note: why there is no value.
    number: the value; ratio: to the best of the row, over: to the bound, NaN for none; place: 1 for the best, 0 for none.
    """

    state: str
    value: str
    unit: str = ""
    interval: str = ""
    mark: str = ""
    runs: str = ""
    shade: int = -1
    bound: int = -1
    note: str = ""
    number: float = math.nan
    ratio: float = math.nan
    over: float = math.nan
    place: int = 0


NOTE = [field.name for field in fields(Shown)].index("note")


@dataclass(frozen=True)
class Row:
    """A case in the matrix: the block that is shown of it, the unit if all values have the same, and what each cell shows.

    A cell is None where nothing depends on the choice: its estimator was refused, or not run.
    """

    block: str
    unit: str
    cells: tuple[Shown | None, ...]


def row(case: CaseView, choice: Choice) -> Row:
    """What a choice shows of a case."""
    best = _best(case, choice)
    cells = [_shown(case, cell, choice, best) for cell in case.cells.values()]
    limit = rounding(case.rounding, choice.metric, choice.key(case)[1])
    cells = [shown and _unranked(shown, limit) for shown in cells] if best <= limit else _placed(case, choice, cells)
    units = {shown.unit for shown in cells if shown and not math.isnan(shown.number)}
    unit = units.pop() if len(units) == 1 else ""
    return Row(choice.key(case)[1], unit, tuple(shown and replace(shown, unit="") if unit else shown for shown in cells))


def _best(case: CaseView, choice: Choice) -> float:
    """The best value among the cells of a row that compete and in which every run counted."""
    key = choice.key(case)
    scored = [c for c in case.with_score(key) if c.scores[key].runs == c.scores[key].total and c.competes(choice.metric)]
    return (max if choice.metric.better == "higher" else min)((c.scores[key].value for c in scored), default=math.nan)


def _shown(case: CaseView, cell: CellView, choice: Choice, best: float) -> Shown | None:
    if cell.status in ("refused", "not run"):
        return None
    key, metric = choice.key(case), choice.metric
    score = cell.scores.get(key)
    if score is None or (metric.timed and math.isnan(score.value)):
        return _absent(case, cell, choice)
    if cell.status in ("failed", "lost") and not (metric.timed or metric.binomial):
        return Shown(cell.status, cell.status, runs=f"0 of {cell.total} runs")
    if math.isnan(score.value):
        return _absent(case, cell, choice)
    words = cell.quantity(key)
    whole = score.runs == score.total
    runs = "" if whole else f"{score.runs} of {score.total} runs"
    state = "done" if whole and (cell.status == "done" or metric.timed) else "partly"
    if metric.binomial and cell.status != "done":
        runs = f"{cell.came_through} of {cell.total} runs came through"
    if state == "done" and not cell.competes(metric):
        state = "barred"
    shown = Shown(state, words.value, words.unit, words.interval, cell.mark(key), runs, number=score.value)
    over = _over_bound(case, cell, choice)
    if state in ("done", "barred") and choice.legend and not metric.binomial:
        shown = replace(shown, ratio=times_worse(metric, score.value, best), over=over)
    if state != "done" or score.runs < 2:
        return shown
    return replace(shown, shade=_shade(score.value if metric.binomial else shown.ratio, choice), bound=_class(over, STEPS))


def _over_bound(case: CaseView, cell: CellView, choice: Choice) -> float:
    """How many times the bound an error is, where there is one that no estimator can beat."""
    score = cell.scores.get(("crlb-ratio", choice.key(case)[1]))
    return score.value if score and choice.bound and strict(case) else math.nan


def _shade(size: float, choice: Choice) -> int:
    return _class(size, RATES if choice.metric.binomial else STEPS) if choice.legend else -1


def _class(size: float, steps: Sequence[float]) -> int:
    return -1 if math.isnan(size) else sum(size > step * (1 + 1e-9) for step in steps)


def _unranked(shown: Shown, limit: float) -> Shown:
    """A cell of a row whose best error is rounding: nothing is better than another there, and no ratio says anything."""
    plain = replace(shown, mark="", shade=-1, bound=-1, ratio=math.nan, over=math.nan)
    if not shown.number <= limit:
        return plain
    note = f"an error of {shown.value} {shown.unit}".strip() + " is rounding; nobody is ranked by it"
    return replace(plain, state="negligible", value="negligible", unit="", interval="", note=note)


def _placed(case: CaseView, choice: Choice, cells: Sequence[Shown | None]) -> list[Shown | None]:
    """Cells with their places by value among those that compete, where anybody is ranked."""
    if not case.leaders(choice.key(case)):
        return list(cells)
    numbers = [c.number if c and c.state == "done" and not c.runs else math.nan for c in cells]
    losses = [float(loss(choice.metric, np.asarray(number))) for number in numbers]
    places = [0 if math.isnan(mine) else 1 + sum(other < mine - ROUNDING for other in losses) for mine in losses]
    return [shown and replace(shown, place=place) for shown, place in zip(cells, places, strict=True)]


def _absent(case: CaseView, cell: CellView, choice: Choice) -> Shown:
    """Why a cell that was run has no such score."""
    if choice.metric.timed and cell.timing_failure:
        return Shown("failed", "failed", note=f"timing it failed: {cell.timing_failure}")
    if cell.status in ("failed", "lost"):
        return Shown(cell.status, cell.status)
    if choice.metric.timed:
        return Shown("absent", "not timed", note="no running times are stored for this estimator on this case")
    known = [block.name for block in case.card.blocks]
    if choice.of_state and choice.block is not None and choice.block not in known:
        return Shown("absent", "no such block", note=f"this case has no {choice.block}; its state blocks are {listed(known)}")
    untold = not case.known and choice.metric.family != "particles" and choice.metric.name not in WITHOUT_TRUTH
    why = ": the truth is not known" if untold else ""
    return Shown("absent", "none", note=f"it has no {choice.metric.title} on this case{why}")


def said(cell: CellView) -> list[str]:
    """What is to be said of a cell whatever is chosen: why it was refused or what failed, what it was told, its remarks."""
    reason = [cell.reason] if cell.status != "done" and cell.reason else []
    told = [f"told the nominal mode, {cell.told}, alone"] if cell.told and cell.ran else []
    return [*reason, *told, *(f"{remark.kind}: {remark.words}" for remark in cell.remarks)]


def payload(rows: Sequence[Row]) -> dict[str, Any]:
    """The rows of a choice as plain data, notes once; numbers to six digits, what a cell has not at the end of it left out."""
    notes: dict[str, int] = {"": 0}
    encoded = []
    for each in rows:
        cells = [_encoded(shown, notes) if shown else 0 for shown in each.cells]
        encoded.append({"block": each.block, "unit": each.unit, "cells": cells})
    return {"notes": list(notes), "rows": encoded}


def _encoded(shown: Shown, notes: dict[str, int]) -> list[Any]:
    found = [_number(value) for value in astuple(shown)]
    found[NOTE] = notes.setdefault(shown.note, len(notes))
    while found[-1] in (0, None):
        found.pop()
    return found


def _number(value: Any) -> Any:
    if not isinstance(value, float):
        return value
    return None if math.isnan(value) else float(f"{value:.6g}")
