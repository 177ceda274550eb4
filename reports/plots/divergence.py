"""Which share of the runs has diverged, over time."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from markupsafe import Markup

from reports import series, svg
from reports.canvas import axes_of, drawing, dress, line, shade
from reports.figures import MANY_STEPS, time_axis
from reports.marks import Mark
from reports.plot import Column, Plot
from reports.text import count
from reports.views import PERCENT, CaseView
from suite.case import RECORDED
from suite.linalg import Array
from suite.metrics import METRICS, counted
from suite.results import Cell
from suite.statistics import proportion

TITLE = "Share of runs that have diverged"


def figures(case: CaseView, labels: Sequence[str], marks: Mapping[str, Mark]) -> Iterator[Plot]:
    """The share of diverged runs over time of each estimator that ever does; nothing where none does or no truth is known."""
    cells = [case.results.cells[label] for label in labels if label in case.results.cells]
    found = {cell.label: share for cell in cells if (share := over_time(cell)) is not None}
    ever = {label: share for label, share in found.items() if share[0, -1] > 0}
    if not ever:
        return
    rule, time = case.card.divergence, case.card.time
    block = case.card.block(rule.block)
    limit = f"its error of {rule.block} exceeds {rule.limit:g} {block.unit}".rstrip()
    caption = f"A run counts from the step at which {limit} for {count(rule.steps, 'step')} on end, or at which it is lost. "
    if not np.isfinite(rule.limit):
        caption = "The case sets no limit of the error: a run counts from the step at which the estimator loses it. "
    recorded = case.card.origin == RECORDED
    same = "All runs are of the same data, so there is no interval."
    caption += same if recorded else f"The shaded bands are exact binomial {PERCENT} intervals."
    never = len(found) - len(ever)
    caption += f" Of {count(len(found), 'estimator')} {never or 'none'} never diverged{_no_line(never)}."
    columns = [Column("time (s)", time)]
    for label, (value, low, high) in ever.items():
        columns.append(Column(label, value, label))
        if not recorded:
            columns += [Column(f"{label}, low", low, label, "low"), Column(f"{label}, high", high, label, "high")]
    image, first = _draw(time, ever, marks, recorded), series.first(list(ever))
    yield Plot("divergence", TITLE, caption, image, list(ever), columns, y="share of runs", first=first, metrics=["divergence"])


def _no_line(never: int) -> str:
    return "" if not never else " and has no line" if never == 1 else " and have no line"


def over_time(cell: Cell) -> Array | None:
    """Share of the counted runs that are away at each step, with its exact interval [3, T]; None where none counts."""
    flags = cell.contributions(METRICS["divergence"]).get("runs")
    if flags is None or cell.evidence is None or not counted(flags).any():
        return None
    onset = cell.evidence.away[counted(flags)]
    steps = np.arange(1, cell.case.card.steps + 1)
    away = (onset <= steps[:, None]).sum(1)
    known = {n: (n / len(onset), *proportion(n, len(onset))) for n in np.unique(away).tolist()}
    return np.array([known[n] for n in away.tolist()]).T


def _draw(time: Array, found: Mapping[str, Array], marks: Mapping[str, Mark], recorded: bool) -> Markup:
    with drawing():
        axes = axes_of()
        for place, (label, (value, low, high)) in reversed(list(enumerate(found.items()))):
            mark = marks[label]
            if not recorded:
                shade(axes, time, low, high, mark, len(found), step="post")
            offset = place % series.SHOWN_FIRST / series.SHOWN_FIRST
            line(axes, time, value, mark, offset, drawstyle="steps-post", lw=1.1 if len(time) > MANY_STEPS else 1.5)
        time_axis(axes, time)
        axes.set_ylim(0, min(1.02, 1.1 * max(float(np.nanmax(share)) for share in found.values())))
        axes.set_ylabel("share of runs")
        dress(axes)
        return svg.inline(axes.figure, "fig-divergence", TITLE, f"Share of diverged runs over time (s) of {', '.join(found)}")
