"""Figures over time: lines with their intervals, bounds, the band of chance, and an axis that no outlier flattens."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes

from reports import svg
from reports.canvas import axes_of, drawing, dress, joined, line, shade, short
from reports.marks import Mark
from reports.series import SHOWN_FIRST, Band, Series
from suite.linalg import Array

LOG_FROM = 30.0
"""A range of values above which the axis is logarithmic."""
FARTHEST = 30.0
"""So many times the peak of a typical line an axis reaches at most, or the others could not be told apart."""
ROOM = 1.5
"""So many times what the estimators that are shown at first need, an axis makes room for the others."""
BOUND_DASHES = ((5, 2), (1, 1.5))
"""Of the first bound and the second: dashed and dotted."""
GREY: dict[str, Any] = {"color": svg.INK, "alpha": 0.17, "lw": 0.8, "zorder": 0.9}
"""Of the band that chance allows for."""
MANY_STEPS = 300
"""Above so many steps lines are thin, or a noisy one is a blot."""
LARGEST = 1e308
STRETCHES = 120
"""Of a long line; what is between the extremes of one a screen would not show."""


@dataclass(frozen=True)
class Axis:
    """The value axis of a figure: its ends, and whether it is logarithmic."""

    low: float
    high: float
    log: bool


def value_axis(
    series: Sequence[Series],
    target: float | None = None,
    bounds: Sequence[Array] = (),
    chance: Band | None = None,
    most: float = np.inf,
) -> Axis | None:
    """An axis for the lines that are shown at first, the target and the bounds[T]; None without a finite value.

    Lines that rise far above the typical one leave it: they would flatten all others. most: what no value is above, if that
    is known; the axis is then linear.
    """
    leading = [s for s in series if np.isfinite(s.peak)][:SHOWN_FIRST]
    if not leading:
        return None
    peaks = np.sort([s.peak for s in leading])
    far = FARTHEST * max(float(peaks[len(peaks) // 2]), target or 0.0)
    levels = [bound[np.isfinite(bound) & (bound > 0)] for bound in bounds]
    known = joined([peaks, [target] if target is not None else [], *levels, [] if chance is None else chance.high])
    needed = float(known[known <= far].max(initial=peaks[0]))
    top = max((s.peak for s in series if needed < s.peak <= ROOM * needed), default=needed)
    values = joined([*(s.value for s in leading), *levels, [] if target is None else [target]])
    values = values[values <= top]
    # A band may reach anywhere; the lines are what is compared.
    reach = min(max(float(joined([s.high for s in leading]).max(initial=top)), top), 1.4 * max(top, 0.0) or top, most, LARGEST)
    positive = values[values > 0]
    if most == np.inf and positive.size and top / LOG_FROM > np.quantile(positive, 0.02):
        rounding = max(s.negligible for s in series)
        low = max(float(positive.min()), float(np.quantile(positive, 0.02)) / LOG_FROM, rounding)
        return Axis(min(low, top) / 1.5, reach * 1.3, True)
    low = min(0.0, float(values.min(initial=0.0)))
    return Axis(low, max(low + 1.06 * (reach - low), low + 1e-300), False)


def over_time(
    series: Sequence[Series],
    marks: Mapping[str, Mark],
    name: str,
    label: str,
    title: str,
    target: float | None = None,
    bounds: Sequence[Array] = (),
    chance: Band | None = None,
    most: float = np.inf,
) -> Markup | None:
    """Lines over time with their intervals as bands, the bounds[T] below them and the band that chance alone allows for.

    None when there is nothing to draw.
    """
    axis = value_axis(series, target, bounds, chance, most)
    if axis is None:
        return None
    with drawing():
        axes = axes_of()
        axes.set_yscale("log" if axis.log else "linear")
        axes.set_ylim(axis.low, axis.high)
        if chance is not None:
            region = axes.fill_between(series[0].time, np.maximum(chance.low, axis.low), chance.high, **GREY)
            region.set_gid("chance")
        for place, one in reversed(list(enumerate(series))):
            mark, ends = marks[one.label], (axis.low / 10 if axis.log else axis.low - axis.high, 10 * axis.high)
            # Far outside the axis matplotlib would lose its digits.
            value, low, high = (np.clip(np.where(np.isfinite(x), x, np.nan), *ends) for x in (one.value, one.low, one.high))
            if place < SHOWN_FIRST:
                shade(axes, one.time[one.at], low, high, mark, len(series))
            thin = {"lw": 1.1} if len(value) > MANY_STEPS else {}
            line(axes, *extremes(one.time, value), mark, place % SHOWN_FIRST / SHOWN_FIRST, **thin)
        for bound, dashes in zip(bounds, BOUND_DASHES, strict=False):
            axes.plot(series[0].time, np.where(bound > 0, bound, np.nan), color=svg.INK, lw=1.2, dashes=dashes, zorder=2.2)
        if target is not None:
            axes.axhline(target, color=svg.INK, lw=0.9, dashes=(2, 2), zorder=1)
        time_axis(axes, series[0].time)
        axes.set_ylabel(short(label))
        dress(axes)
        return svg.inline(axes.figure, name, title, f"{label} over time (s) of {', '.join(s.label for s in series)}")


def time_axis(axes: Axes, time: Array) -> None:
    """The time axis of a case, from zero to the last step."""
    axes.set_xlabel("time (s)")
    axes.set_xlim(0, float(time[-1]) or 1.0)


def extremes(time: Array, value: Array) -> tuple[Array, Array]:
    """The same line where it is short; else of each stretch of it the lowest and the highest value."""
    if len(value) <= MANY_STEPS:
        return time, value
    kept = {0, len(value) - 1}
    for stretch in np.array_split(np.arange(len(value)), STRETCHES):
        part = value[stretch]
        if np.isnan(part).any():
            kept.update(stretch.tolist())  # a gap stays as it is
        else:
            kept.update((int(stretch[part.argmin()]), int(stretch[part.argmax()])))
    at = sorted(kept)
    return time[at], value[at]
