"""What all drawings share: size and margins, grid and numbers at ticks, and how the line of an estimator is marked."""

import contextlib
import warnings
from collections.abc import Iterator, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import Formatter, LogLocator, MaxNLocator, NullLocator

from reports import svg
from reports.marks import Mark
from reports.text import scientific, tick
from suite.linalg import Array

MARKERS_ON_A_LINE = 7
WIDTH, HEIGHT = 6.6, 3.0
"""Of a figure in inches."""
LEFT, RIGHT, TOP, BOTTOM = 1.02, 0.2, 0.12, 0.55
"""Margins in inches. They are fixed: a layout that measures its texts draws every figure twice."""
GAP = 0.18
"""Between the panels of a figure, in inches."""
MOST_SIGNS = 40
"""Of a name in a drawing; longer ones would leave it."""
FEW = 3
"""Up to so many bands are drawn as strong as one; of more, on top of each other, nothing would be seen."""


@contextlib.contextmanager
def drawing() -> Iterator[None]:
    """Style for drawing; numbers near the end of floating point make matplotlib warn, and are drawn as well as can be."""
    with warnings.catch_warnings(), matplotlib.rc_context(svg.STYLE):
        warnings.simplefilter("ignore")
        yield


def axes_of(width: float = WIDTH, height: float = HEIGHT) -> Axes:
    """Axes in a figure of that size in inches."""
    return panels(1, 1, height - TOP - BOTTOM, width)[0]


def panels(count: int, columns: int, height: float, width: float = WIDTH, head: float = 0.0, gap: float = GAP) -> list[Axes]:
    """Axes [count] side by side in so many columns, each with a height in inches and room for a head above it.

    Those within a row have the ticks of the value axis on the first one alone, and so have those of a column at its foot.
    """
    rows = -(-count // columns)
    whole = TOP + BOTTOM + rows * (height + head) + (rows - 1) * gap
    figure = Figure(figsize=(width, whole))
    wide = (width - LEFT - RIGHT - (columns - 1) * gap) / columns
    found = []
    for place in range(count):
        row, column = divmod(place, columns)
        left, bottom = LEFT + column * (wide + gap), whole - TOP - head - height - row * (height + head + gap)
        axes = figure.add_axes((left / width, bottom / whole, wide / width, height / whole))
        axes.yaxis.set_label_coords(-0.82 / wide, 0.5)
        axes.xaxis.set_label_coords(0.5, -0.31 / height)
        axes.tick_params(labelleft=column == 0, labelbottom=place + columns >= count)
        found.append(axes)
    return found


def line(axes: Axes, x: Array, y: Array, mark: Mark, offset: float = 0.0, part: str = "line", **style: Any) -> Line2D:
    """A line of an estimator, with markers set apart from those of others by `offset`, from 0 to 1."""
    spacing = max(1, len(x) // MARKERS_ON_A_LINE)
    every = (int(offset * spacing), spacing)
    look: dict[str, Any] = {"lw": 1.5, "marker": mark.marker, "ms": 5.5, "mew": 0, "markevery": every}
    (drawn,) = axes.plot(x, y, color=svg.colour(mark.colour), **(look | style))
    if mark.dash:
        drawn.set_dashes(list(mark.dash))
    drawn.set_gid(f"series-{mark.series}-{part}")
    return drawn


def shade(axes: Axes, x: Array, low: Array, high: Array, mark: Mark, many: int, **style: Any) -> None:
    """The interval of an estimator's line as a band, one of `many`."""
    alpha = 0.16 if many <= FEW else 0.07
    band = axes.fill_between(x, low, high, color=svg.colour(mark.colour), alpha=alpha, lw=0, **style)
    band.set_gid(f"series-{mark.series}-band")


def whiskers(axes: Axes, x: Array, y: Array, mark: Mark, xerr: Array | None = None, yerr: Array | None = None) -> None:
    """Intervals [2, N] about points as faint bars: xerr along x, yerr along y, both as ends, cut at the limits of the axes."""
    bars = [] if xerr is None else [(np.clip(xerr, *axes.get_xlim()), np.stack([y, y]))]
    bars += [] if yerr is None else [(np.stack([x, x]), np.clip(yerr, *axes.get_ylim()))]
    if bars and len(x):
        # All bars are one line, broken between them: a collection of lines takes several times as long.
        breaks = np.full((1, len(x)), np.nan)
        path = [np.concatenate([np.vstack([ends, breaks]).T.ravel() for ends in each]) for each in zip(*bars, strict=True)]
        (drawn,) = axes.plot(*path, color=svg.colour(mark.colour), alpha=0.5, lw=1.0, solid_capstyle="butt")
        drawn.set_gid(f"series-{mark.series}-whiskers")


class Ticks(Formatter):
    """Numbers at the ticks of an axis: all plain, or all with powers of ten where one of them is far from 1."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """The number alone."""
        return tick(x)

    def format_ticks(self, values: Sequence[float]) -> list[str]:
        """The numbers at all ticks, of which those outside the view do not count."""
        low, high = sorted(self.axis.get_view_interval())
        sizes = [abs(x) for x in values if x and low <= x <= high]
        plain = all(1e-4 <= size <= 1e5 for size in sizes)
        return [f"{x:.6g}".replace("-", "−") if plain else scientific(x) if x and np.isfinite(x) else tick(x) for x in values]


def dress(axes: Axes) -> None:
    """Grid and number format alike on all figures."""
    axes.grid(True, lw=0.6)
    axes.set_axisbelow(True)
    for axis, scale, limits in (
        (axes.xaxis, axes.get_xscale(), axes.get_xlim()),
        (axes.yaxis, axes.get_yscale(), axes.get_ylim()),
    ):
        if scale == "log":
            decades = np.log10(limits[1] / limits[0]) if limits[0] > 0 else 1.0
            usual = LogLocator(subs=(1.0, 2.0, 5.0) if decades < 2.2 else (1.0,), numticks=9)
            axis.set_major_locator(usual if decades > 0.8 else MaxNLocator(6, steps=[1, 2, 5, 10]))
            axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(Ticks())


def log_limits(values: Array, room: float = 1.3) -> tuple[float, float]:
    """Limits of a logarithmic axis with room about positive values."""
    low, high = float(values.min()) / room, float(values.max()) * room
    return max(low, 1e-300), min(max(high, 2 * low), 1e300)


def finite(values: Array) -> Array:
    """Those of the values that are finite, in a row."""
    return values[np.isfinite(values)]


def joined(parts: Sequence[Array]) -> Array:
    """All the finite values of several arrays in a row."""
    return finite(np.concatenate([np.ravel(part) for part in parts])) if parts else np.empty(0)


def short(name: str) -> str:
    """A name as far as a drawing has room for it."""
    return name if len(name) <= MOST_SIGNS else f"{name[: MOST_SIGNS - 1]}…"
