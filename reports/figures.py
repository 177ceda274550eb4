"""The figures of a case: errors over time, consistency over time, tracks on the ground."""

import contextlib
import warnings
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

from reports import svg
from reports.marks import Mark
from reports.series import Band, Series, Tracks
from reports.text import tick
from suite.case import Card
from suite.linalg import Array

LOG_FROM = 30.0
"""A range of values above which the axis is logarithmic."""
FARTHEST = 1000.0
"""So many times the target an axis reaches, or what is near it could not be told apart."""
MARKERS_ON_A_LINE = 7
BOUND_DASHES = ((5, 2), (1, 1.5))
"""Of the first bound and the second: dashed and dotted."""
GREY: dict[str, Any] = {"color": svg.INK, "alpha": 0.17, "lw": 0.8, "zorder": 0.9}
"""Of the band that chance allows for."""
MANY_STEPS = 300
"""Above so many steps lines are thin, or a noisy one is a blot."""
WIDTH, HEIGHT = 6.6, 3.0
LEFT, RIGHT, TOP, BOTTOM = 0.95, 0.2, 0.12, 0.55
"""Margins in inches. They are fixed: a layout that measures its texts draws every figure twice."""


def over_time(
    series: Sequence[Series],
    marks: Mapping[str, Mark],
    name: str,
    label: str,
    title: str,
    target: float | None = None,
    bounds: Sequence[Array] = (),
    chance: Band | None = None,
) -> Markup | None:
    """Lines over time with their intervals as bands, the bounds[T] below them and the band that chance alone allows for.

    None when there is nothing to draw.
    """
    values = _finite(np.concatenate([s.value for s in series])) if series else np.empty(0)
    if not values.size:
        return None
    shown = [np.where(bound > 0, bound, np.nan) for bound in bounds]
    with _drawing():
        axes = _axes(WIDTH, HEIGHT)
        tops = [] if chance is None else [_finite(chance.high)]
        bottom = _scale(axes, np.concatenate([values, *map(_finite, shown), *tops]), series, target)
        if chance is not None:
            region = axes.fill_between(series[0].time, np.maximum(chance.low, bottom), chance.high, **GREY)
            region.set_gid("chance")
        for number, one in enumerate(series):
            _line(axes, one, marks[one.label], bottom, number / len(series))
        for bound, dashes in zip(shown, BOUND_DASHES, strict=False):
            axes.plot(series[0].time, bound, color=svg.INK, lw=1.2, dashes=dashes, zorder=2.2)
        if target is not None:
            axes.axhline(target, color=svg.INK, lw=0.9, dashes=(2, 2), zorder=1)
        axes.set_xlabel("time (s)")
        axes.set_ylabel(label[:40])
        axes.set_xlim(0, float(series[0].time[-1]) or 1.0)
        _dress(axes)
        return svg.inline(axes.figure, name, title, f"{label} over time (s) of {', '.join(s.label for s in series)}")


def beyond(series: Sequence[Series], target: float | None) -> float:
    """The end of an axis with a target beyond which some of the values lie, though not all; else infinity."""
    values = _finite(np.concatenate([s.value for s in series])) if series else np.empty(0)
    end = FARTHEST * target if target else np.inf
    return end if (values > end).any() and (values <= end).any() else np.inf


def _axes(width: float, height: float) -> Axes:
    """Axes in a figure of that size in inches."""
    figure = Figure(figsize=(width, height))
    box = (LEFT / width, BOTTOM / height, (width - LEFT - RIGHT) / width, (height - TOP - BOTTOM) / height)
    axes = figure.add_axes(box)
    axes.yaxis.set_label_coords(-0.72 / (width - LEFT - RIGHT), 0.5)
    return axes


def _finite(values: Array) -> Array:
    return values[np.isfinite(values)]


@contextlib.contextmanager
def _drawing() -> Iterator[None]:
    """Style for drawing; numbers near the end of floating point make matplotlib warn, and are drawn as well as can be."""
    with warnings.catch_warnings(), matplotlib.rc_context(svg.STYLE):
        warnings.simplefilter("ignore")
        yield


def _scale(axes: Axes, values: Array, series: Sequence[Series], target: float | None) -> float:
    """Choose the limits of the value axis, logarithmic for a wide range; returns the lowest value that can be shown."""
    end = beyond(series, target)
    values = np.minimum(np.append(values, target), end) if target is not None else values
    highest = float(values.max())
    band = float(_finite(np.concatenate([values, *(s.high for s in series)])).max())
    band = min(band, end)
    top = min(band, 3 * highest) if highest > 0 else band  # a band may reach anywhere; the lines are what is compared
    positive = values[values > 0]
    if positive.size and highest > LOG_FROM * np.quantile(positive, 0.02):
        axes.set_yscale("log")
        axes.set_ylim(positive.min() / 1.5, top * 1.5)
        return float(positive.min()) / 1.5
    low = min(0.0, float(values.min()))
    axes.set_ylim(low, max(1.06 * top, low + 1e-12))
    return -np.inf


def _line(axes: Axes, one: Series, mark: Mark, bottom: float, offset: float) -> None:
    """A line with markers set apart from those of the others, so that lines on top of each other are all seen."""
    colour = svg.colour(mark.colour)
    spacing = max(1, len(one.time) // MARKERS_ON_A_LINE)
    value = np.where(np.isfinite(one.value), one.value, np.nan)
    low, high = (np.maximum(np.where(np.isfinite(x), x, np.nan), bottom) for x in (one.low, one.high))
    band = axes.fill_between(one.time[one.at], low, high, color=colour, alpha=0.16, lw=0)
    band.set_gid(f"series-{mark.series}-band")
    (line,) = axes.plot(
        one.time,
        value,
        color=colour,
        lw=1.1 if len(value) > MANY_STEPS else 1.5,
        marker=mark.marker,
        ms=5.5,
        mew=0,
        markevery=(int(offset * spacing), spacing),
    )
    if mark.dash:
        line.set_dashes(list(mark.dash))
    line.set_gid(f"series-{mark.series}-line")


def _dress(axes: Axes) -> None:
    """Grid and number format alike on all figures."""
    axes.grid(True, lw=0.6)
    axes.set_axisbelow(True)
    axes.xaxis.set_major_formatter(FuncFormatter(tick))
    if axes.get_yscale() == "log":
        low, high = axes.get_ylim()
        decades = np.log10(high / low) if low > 0 else 1.0
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if decades < 2.2 else (1.0,), numticks=9))
        axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(FuncFormatter(tick))


def ground(track: Tracks, card: Card, marks: Mapping[str, Mark], name: str, title: str) -> Markup | None:
    """Truth and estimates of one run on the ground plane; None when there is no finite place to draw.

    Where nothing is known of the truth, the estimator by which the run was chosen stands in for it: its start, its extent.
    """
    shown = _places(track.truth if track.known else track.estimates[track.chosen_by])
    if card.plane is None or not shown.size:
        return None
    unit, factor = _ground_unit(card, shown)
    sites = np.array([[x, y] for _, x, y in card.landmarks], float).reshape(-1, 2).T / factor
    truth, shown = track.truth / factor, shown / factor
    low, high = frame(shown, sites)
    width, height = high - low
    # A panel of the same proportions as the ground, within reason; the ground is then widened to fill it.
    panel = np.array([WIDTH - LEFT - RIGHT, np.clip((WIDTH - LEFT - RIGHT) * height / width, 1.8, 5.4)])
    centre, half = (low + high) / 2, 0.5 * panel * ((high - low) / panel).max()
    low, high = centre - half, centre + half
    with _drawing():
        axes = _axes(WIDTH, float(panel[1]) + TOP + BOTTOM)
        for number, (label, place) in enumerate(track.estimates.items()):
            _track(axes, place / factor, marks[label], low, high, number / len(track.estimates))
        (line,) = axes.plot(*truth, color=svg.INK, lw=1.1, zorder=1.9)
        line.set_gid("truth")
        axes.plot(*shown[:, :1], "o", ms=9, mfc="none", mec=svg.INK, mew=1.6, zorder=5)
        axes.annotate("start", shown[:, 0], (8, 8), textcoords="offset points", zorder=6)
        for (site, *_), at in zip(card.landmarks, sites.T, strict=True):
            axes.plot(*at[:, None], "^", ms=7, color=svg.INK, zorder=4)
            axes.annotate(site[:40], at, (7, -4), textcoords="offset points", annotation_clip=True)
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        axes.set_xlabel(f"{card.state[card.plane[0]]} ({unit})"[:80])
        axes.set_ylabel(f"{card.state[card.plane[1]]} ({unit})"[:80])
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(MaxNLocator(7, steps=[1, 2, 5, 10]))
        _dress(axes)
        return svg.inline(axes.figure, name, title, f"{title}, of {', '.join(track.estimates)}")


def _places(track: Array) -> Array:
    """The finite places [2, S] of a track [2, T]."""
    return track[:, np.isfinite(track).all(0)]


def _ground_unit(card: Card, truth: Array) -> tuple[str, float]:
    """Unit of the plane's axes and what to divide by: kilometres for wide tracks in metres."""
    assert card.plane is not None
    unit = next((b.unit for b in card.blocks if card.plane[0] in b.components), "")
    wide = unit == "m" and np.ptp(truth, axis=1).max() > 3000
    return ("km", 1000.0) if wide else (unit, 1.0)


def frame(truth: Array, sites: Array) -> tuple[Array, Array]:
    """Corners of the part of the plane to show: truth and landmarks; an estimate that flies off does not widen it."""
    points = np.concatenate([truth, sites], axis=1) if sites.size else truth
    low, high = points.min(1), points.max(1)
    size = max(float((high - low).max()), 1e-9 * float(np.abs(points).max()), 1e-9)
    centre, half = (low + high) / 2, np.maximum((high - low) / 2, 0.15 * size) + 0.07 * size
    return centre - half, centre + half


def _track(axes: Axes, place: Array, mark: Mark, low: Array, high: Array, offset: float) -> None:
    spacing = max(1, place.shape[1] // MARKERS_ON_A_LINE)
    reach = 10 * (high - low)[:, None]  # far outside the frame all is the same
    place = np.clip(place, low[:, None] - reach, high[:, None] + reach)
    every = (int(offset * spacing), spacing)
    (line,) = axes.plot(
        *place, color=svg.colour(mark.colour), lw=1.4, marker=mark.marker, ms=5.5, mew=0, markevery=every, zorder=2.1
    )
    if mark.dash:
        line.set_dashes(list(mark.dash))
    line.set_gid(f"series-{mark.series}-track")
