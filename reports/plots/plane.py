"""Truth and estimates of single runs on the plane."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup
from matplotlib.ticker import MaxNLocator

from reports import series, svg
from reports.canvas import BOTTOM, LEFT, RIGHT, TOP, WIDTH, axes_of, drawing, dress, line, short
from reports.marks import Mark
from reports.plot import Column, Plot
from reports.plots.runs import BEST, MEDIAN, WORST
from reports.text import count, listed
from reports.views import CaseView
from suite.case import Card, with_unit
from suite.linalg import Array
from suite.results import CaseResults

WIDER = 0.3
"""Part of its size by which a picture is widened on each side at most, for estimates beside the truth."""
MOST_TOLD = 4
"""So many estimators are told one by one, more are counted."""


@dataclass(frozen=True)
class Tracks:
    """A run on the plane: truth[2, T], NaN where it is not known, and the estimates[2, T] by label.

    which: best, median or worst; empty where that is not known. missing: estimators that did not come through the run.
    """

    run: int
    which: str
    truth: Array
    estimates: dict[str, Array]
    missing: tuple[str, ...]

    @property
    def known(self) -> bool:
        """Whether a place of the truth is known."""
        return bool(np.isfinite(self.truth).all(0).any())


def figures(case: CaseView, labels: Sequence[str], marks: Mapping[str, Mark], picked: Mapping[str, int]) -> list[Plot]:
    """A figure for the best, the median and the worst run; one alone where the truth is not known."""
    return [_figure(case.card, track, marks) for track in tracks(case.results, labels, picked)]


def tracks(case: CaseResults, labels: Sequence[str], picked: Mapping[str, int]) -> list[Tracks]:
    """The runs that are picked; where no error is known, the first that any estimator came through. None without a plane."""
    cells = [case.cells[label] for label in labels if label in case.cells and case.cells[label].runs]
    if case.card.plane is None:
        return []
    through = [cell.runs[place] for cell in cells for place in np.flatnonzero(cell.estimate.ok)]
    plane = list(case.card.plane)
    found = []
    for which, run in picked.items() or [("", run) for run in sorted(through)[:1]]:
        estimates = {}
        for cell in cells:
            place = cell.runs.index(run) if run in cell.runs else None
            if place is not None and cell.estimate.ok[place]:
                estimates[cell.label] = cell.estimate.mean[:, plane, place].T
        missing = tuple(cell.label for cell in cells if cell.label not in estimates)
        found.append(Tracks(run, which, case.truth_of[run].x[:, plane].T, estimates, missing))
    return found


def _figure(card: Card, track: Tracks, marks: Mapping[str, Mark]) -> Plot:
    assert card.plane is not None
    x, y = (card.state[i] for i in card.plane)
    name = f"plane-{track.which}" if track.which else "plane"
    title = "Truth and estimates on the plane" if track.known else "Estimates on the plane"
    title += f": the {track.which} run, {track.run}" if track.which else f": run {track.run}"
    view = View.of(track, card)
    caption = _caption(card, track, view)
    image = draw(track, card, marks, f"fig-{name}", title)
    places = [*([("truth", track.truth)] if track.known else []), *track.estimates.items()]
    columns = [Column("time (s)", card.time)]
    for label, place in places:
        along = f"{label} {x}"
        mark = label if label in marks else ""
        columns += [Column(along, place[0], mark), Column(f"{label} {y}", place[1], mark, over=along)]
    units = [next((b.unit for b in card.blocks if i in b.components), "") for i in card.plane]
    labels = list(track.estimates)
    axes = [with_unit(words, unit) for words, unit in zip((x, y), units, strict=True)]
    return Plot(name, title, caption, image, labels, columns, *axes, first=series.first(labels))


RULE = {
    BEST: "the run with the smallest errors",
    MEDIAN: "the run whose errors are the median",
    WORST: "the run with the largest errors",
}


def _caption(card: Card, track: Tracks, view: "View | None") -> str:
    if track.known:
        said = "The circle marks the start, the thin line without marks the truth."
        if track.which:
            said = (
                f"Run {track.run}, {RULE[track.which]}: root mean square error on this plane, of each estimator over its own "
                f"median, and of these the median over the estimators that came through the run. {said}"
            )
    else:
        (by, *_) = track.estimates
        said = f"Run {track.run}, the first that came through. The truth is not known; "
        said += f"the circle marks the first estimate of {by}."
    if card.landmarks:
        said += f" Triangles: {listed([name for name, *_ in card.landmarks], MOST_TOLD)}."
    if card.regions:
        said += f" Grey areas: {listed([region.name for region in card.regions], MOST_TOLD)}."
    gone = [(label, n) for label, place in track.estimates.items() if view and (n := view.outside(place))]
    if gone:
        names = [f"{label} at {count(n, 'step')}" for label, n in gone]
        said += f" Outside the picture: {listed(names, MOST_TOLD)}."
    if track.missing:
        said += f" Not drawn: {listed(track.missing)}, which did not come through this run."
    return said


@dataclass(frozen=True)
class View:
    """The part of the plane that a drawing shows: its corners low[2] and high[2], and the height of its panel in inches."""

    low: Array
    high: Array
    height: float

    @classmethod
    def of(cls, track: Tracks, card: Card) -> "View | None":
        """Truth and landmarks with room about them, and what is usual of the estimates; one that flies off does not widen it.

        Where nothing is known of the truth, the first estimator stands in for it. None without a place.
        """
        shown = _places(_leading(track))
        if not shown.size:
            return None
        low, high = frame(shown, np.array([[x, y] for _, x, y in card.landmarks], float).reshape(-1, 2).T)
        nearby = [_places(place) for place in list(track.estimates.values())[: series.SHOWN_FIRST]]
        ends = [np.quantile(place, [0.05, 0.95], axis=1) for place in nearby if place.size]
        most = WIDER * (high - low).max()
        low = np.maximum(np.min([low, *(end[0] for end in ends)], axis=0), low - most)
        high = np.minimum(np.max([high, *(end[1] for end in ends)], axis=0), high + most)
        wide, tall = high - low
        # A panel of the same proportions as the ground, within reason; the ground is then widened to fill it.
        panel = np.array([WIDTH - LEFT - RIGHT, np.clip((WIDTH - LEFT - RIGHT) * tall / wide, 1.8, 5.0)])
        centre, half = (low + high) / 2, 0.5 * panel * ((high - low) / panel).max()
        return cls(centre - half, centre + half, float(panel[1]))

    def outside(self, place: Array) -> int:
        """Steps at which a track [2, T] is outside."""
        with np.errstate(invalid="ignore"):
            return int(((place < self.low[:, None]) | (place > self.high[:, None])).any(0).sum())


def _leading(track: Tracks) -> Array:
    return track.truth if track.known or not track.estimates else next(iter(track.estimates.values()))


def _places(track: Array) -> Array:
    """The finite places [2, S] of a track [2, T]."""
    return track[:, np.isfinite(track).all(0)]


def frame(places: Array, sites: Array) -> tuple[Array, Array]:
    """Corners of the part of the plane to show: places [2, S] and sites [2, L], with room about them."""
    points = np.concatenate([places, sites], axis=1) if sites.size else places
    low, high = points.min(1), points.max(1)
    extent, away = float((high - low).max()), float(np.abs(points).max())
    size = extent if extent > 1e-9 * max(away, 1.0) else 1e-3 * max(away, 1.0)
    centre, half = (low + high) / 2, np.maximum((high - low) / 2, 0.15 * size) + 0.07 * size
    return centre - half, centre + half


def draw(track: Tracks, card: Card, marks: Mapping[str, Mark], name: str, title: str) -> Markup | None:
    """Truth and estimates of one run on the plane; None when there is no finite place to draw."""
    view = View.of(track, card)
    if card.plane is None or view is None:
        return None
    unit, factor = _unit(card, view)
    low, high = view.low / factor, view.high / factor
    reach = 10 * (high - low)[:, None]  # far outside the view all is the same
    with drawing():
        axes = axes_of(height=view.height + TOP + BOTTOM)
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        for region in card.regions:
            axes.fill(*(np.array(region.corners).T / factor), color=svg.INK, alpha=0.08, lw=0, zorder=0.5)
        for place, (label, track_of) in reversed(list(enumerate(track.estimates.items()))):
            at = np.clip(track_of / factor, low[:, None] - reach, high[:, None] + reach)
            offset = place % series.SHOWN_FIRST / series.SHOWN_FIRST
            line(axes, *at, marks[label], offset, "track", lw=1.4, zorder=2.1)
        (path,) = axes.plot(*(track.truth / factor), color=svg.INK, lw=1.1, zorder=2.4)
        path.set_gid("truth")
        start = _places(_leading(track))[:, 0] / factor
        axes.plot(*start[:, None], "o", ms=9, mfc="none", mec=svg.INK, mew=1.6, zorder=5)
        axes.annotate("start", start, (8, 8), textcoords="offset points", zorder=6)
        for site, *at in card.landmarks:
            place = np.array(at) / factor
            axes.plot(*place[:, None], "^", ms=7, color=svg.INK, zorder=4)
            side = {"ha": "right"} if place[0] > (low[0] + high[0]) / 2 else {}
            axes.annotate(short(site), place, (-7 if side else 7, -4), textcoords="offset points", annotation_clip=True, **side)
        axes.set_xlabel(short(card.state[card.plane[0]]) + f" ({unit})" * bool(unit))
        axes.set_ylabel(short(card.state[card.plane[1]]) + f" ({unit})" * bool(unit))
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(MaxNLocator(7, steps=[1, 2, 5, 10]))
        dress(axes)
        return svg.inline(axes.figure, name, title, f"{title}, of {', '.join(track.estimates)}")


def _unit(card: Card, view: View) -> tuple[str, float]:
    """Unit of the plane's axes and what to divide by: kilometres for wide tracks in metres."""
    assert card.plane is not None
    unit = next((b.unit for b in card.blocks if card.plane[0] in b.components), "")
    wide = unit == "m" and (view.high - view.low).max() > 3000
    return ("km", 1000.0) if wide else (unit, 1.0)
