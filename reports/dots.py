"""Dot plots: values with their intervals on a logarithmic axis, a row a thing that they are of, its name above it.

Names above their rows, not beside, leave a figure so narrow that it can be read on a telephone.
"""

import itertools
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from reports import svg
from reports.canvas import BOTTOM, RIGHT, TOP, drawing, dress, log_limits
from reports.marks import Mark
from reports.text import listed

WIDE, ROW = 4.2, 0.32
"""Width of the figure, height of a row in inches."""
SIZE = 10
"""Of texts in points."""
NAME, BAND = -0.44, (-0.18, 0.3)
"""Where the middle of a row's name is, and the ends of what is left to its dots, from their line down, in rows."""
LONGEST = 46
"""Signs of a row's name that are shown; of a longer one the middle is left out."""
REACH = 1e3
"""A value farther from the reference than so many times is an arrow at the edge, or the others could not be told apart."""
TALL = 15
"""Rows above which the axis is numbered at the head as well."""


@dataclass(frozen=True)
class Dot:
    """A value with its interval (NaN where there is none) in a row; hollow: of another kind than the filled ones.

    mark: that of its estimator, None for one that has none.
    """

    row: int
    value: float
    low: float
    high: float
    mark: Mark | None = None
    hollow: bool = False


def dots(
    rows: Sequence[str],
    shown: Sequence[Dot],
    name: str,
    title: str,
    axis: str,
    reference: float | None = None,
    bands: Sequence[tuple[int, float, float]] = (),
) -> Markup | None:
    """Values above zero in their rows, the first row at the top; None when there is none.

    reference: where a line is drawn; what is `REACH` times off is an arrow at the edge. bands: (row, low, high), drawn grey.
    """
    finite = [dot for dot in shown if drawable(dot.value)]
    if not finite:
        return None
    low, high = _limits(finite, reference, bands)
    with drawing():
        figure, axes = _axes([_shortened(row) for row in rows])
        every = np.arange(len(rows))
        axes.set_xscale("log")
        axes.set_xlim(low, high)
        for row, start, end in bands:
            wide, tall = min(end, high) - max(start, low), BAND[1] - BAND[0]
            axes.barh(row + BAND[0], wide, tall, max(start, low), align="edge", color=svg.INK, alpha=0.14, lw=0)
        if reference is not None:  # a piece in each row, since a whole line would cross the names
            axes.vlines(np.full(len(rows), reference), every + BAND[0], every + BAND[1], color=svg.INK, lw=0.9, zorder=1)
        filled, hollow = ({dot.row for dot in finite if dot.hollow is kind} for kind in (False, True))
        for _, group in itertools.groupby(sorted(finite, key=_look), _look):
            _series(axes, list(group), filled & hollow, low, high)
        axes.set_xlabel(axis, fontsize=SIZE)
        dress(axes)
        drawn = svg.inline(figure, name, title, f"{axis} of {listed(rows, 8)}")
        return Markup('<svg class="rows" ') + drawn.removeprefix("<svg ")


def drawable(value: float) -> bool:
    """Whether a value has a place on a logarithmic axis."""
    return math.isfinite(value) and value > 0


def beyond(shown: Sequence[Dot], reference: float) -> list[Dot]:
    """The values that an arrow at the edge stands for."""
    return [dot for dot in shown if drawable(dot.value) and not reference / REACH <= dot.value <= reference * REACH]


def _look(dot: Dot) -> tuple[int, bool]:
    return dot.mark.series if dot.mark else -1, dot.hollow


def _shortened(name: str) -> str:
    half = (LONGEST - 1) // 2
    return name if len(name) <= LONGEST else f"{name[:half]}…{name[-half:]}"


def _limits(shown: Sequence[Dot], reference: float | None, bands: Sequence[tuple[int, float, float]]) -> tuple[float, float]:
    """Ends of the axis: all values, and their intervals and bands as far as they leave the values apart."""
    values = np.array([dot.value for dot in shown] + ([] if reference is None else [reference]))
    if reference is not None:
        values = np.clip(values, reference / REACH, reference * REACH)
    ends = np.array([end for dot in shown for end in (dot.low, dot.high)] + [end for band in bands for end in band[1:]])
    ends = ends[np.isfinite(ends) & (ends > 0)]
    return log_limits(np.append(values, np.clip(ends, values.min() / 3, values.max() * 3)))


def _axes(names: Sequence[str]) -> tuple[Figure, Axes]:
    """Axes with a row for each name."""
    height = ROW * (len(names) + 0.3)
    head = 0.3 if len(names) > TALL else TOP
    whole = head + BOTTOM + height
    figure = Figure(figsize=(WIDE, whole))
    axes = figure.add_axes((RIGHT / WIDE, BOTTOM / whole, 1 - 2 * RIGHT / WIDE, height / whole))
    axes.set_ylim(len(names) - 0.5, -0.8)
    axes.set_yticks([])  # a tick takes as long to draw as ten lines
    axes.tick_params(axis="x", labeltop=len(names) > TALL, labelsize=SIZE)
    axes.spines["left"].set_visible(False)
    beside = axes.get_yaxis_transform()
    axes.hlines(range(len(names)), 0, 1, transform=beside, color=svg.FAINT, lw=0.6, zorder=0.5)
    for row, name in enumerate(names):
        axes.text(0, row + NAME, name, transform=beside, va="center", fontsize=SIZE)
    return figure, axes


def _series(axes: Axes, shown: Sequence[Dot], paired: Collection[int], low: float, high: float) -> None:
    """The dots of an estimator of one kind, with their intervals."""
    mark, hollow = shown[0].mark, shown[0].hollow
    colour, marker = (svg.colour(mark.colour), mark.marker) if mark else (svg.INK, "o")
    aside = np.array([(0.12 if hollow else -0.12) if dot.row in paired else 0.0 for dot in shown])
    rows = np.array([dot.row for dot in shown]) + aside
    values, lows, highs = (np.array([getattr(dot, name) for dot in shown]) for name in ("value", "low", "high"))
    spread = ~np.isnan(lows) & ~np.isnan(highs) & (lows < high) & (highs > low)
    group = f"series-{mark.series}-" if mark else "dots-"
    ends = np.clip(lows[spread], low, high), np.clip(highs[spread], low, high)
    axes.hlines(rows[spread], *ends, colors=colour, lw=1.4, alpha=0.6).set_gid(f"{group}whiskers")
    look: dict[str, Any] = {
        "ls": "",
        "color": colour,
        "mfc": svg.PAPER if hollow else colour,
        "mew": 1.3,
        "zorder": 3,
        "clip_on": False,
    }
    for which, shape, kind in ((values < low, "<", "below"), (values > high, ">", "above"), (None, marker, "dots")):
        chosen = (values >= low) & (values <= high) if which is None else which
        if chosen.any():
            (drawn,) = axes.plot(np.clip(values[chosen], low, high), rows[chosen], marker=shape, ms=6, **look)
            drawn.set_gid(f"{group}{kind}")
