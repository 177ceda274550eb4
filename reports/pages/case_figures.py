"""The figures of a case's page, with their captions and numbers."""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from reports import figures, series
from reports.marks import Mark
from reports.plot import Column, Plot
from reports.sentences import bound_name, bounded
from reports.series import Band, Series, Tracks
from reports.text import count, listed
from reports.views import PERCENT
from suite.bounds import NONE
from suite.case import RECORDED, with_unit
from suite.case_bounds import BlockBound
from suite.linalg import Array
from suite.metrics import METRICS
from suite.results import CaseResults


def main_figures(results: CaseResults, labels: Sequence[str], marks: Mapping[str, Mark]) -> Iterator[Plot]:
    """The ground, errors, consistency and modes of motion over time."""
    track = series.tracks(results, labels)
    if track:
        yield _ground(results, track, marks)
    errors = series.over_time(results, METRICS["rmse"], labels)
    for i, block in enumerate(results.card.blocks):
        lines = errors.get(block.name, [])
        bounds = [(bound, bound.value[:, i], bound.error[:, i]) for bound in results.bounds]
        if not _unknown(lines):
            title = f"RMSE of {block.name} over time"
            yield _over_time(lines, marks, f"rmse-{i}", title, with_unit("RMSE", block.unit), bounds=bounds)
    lines = series.over_time(results, METRICS["nees"], labels).get("state", [])
    if not _unknown(lines):
        title = "Normalised estimation error squared over time"
        yield _normalised(results, lines, labels, marks, "nees", title, "errors")
    if results.card.modes:
        lines = series.over_time(results, METRICS["brier"], labels).get("modes", [])
        yield _over_time(lines, marks, "brier", "Brier score of the mode probabilities over time", "Brier score")


def more_figures(results: CaseResults, labels: Sequence[str], marks: Mapping[str, Mark]) -> Iterator[Plot]:
    """Errors over a bound that holds for all estimators, and innovations, over time."""
    ratios = series.over_time(results, METRICS["crlb-ratio"], labels) if results.bounds and results.bounds[0].strict else {}
    for i, block in enumerate(results.card.blocks):
        if block.name in ratios and not _unknown(ratios[block.name]):
            title = f"Ratio of the RMSE of {block.name} to the Cramér-Rao bound over time"
            said = " The dotted line is 1: errors at the bound. Over finitely many runs they may fall below it by chance."
            yield _over_time(ratios[block.name], marks, f"ratio-{i}", title, "RMSE / bound", 1.0, said)
    lines = series.over_time(results, METRICS["nis"], labels).get("innovation", [])
    if lines and not _unknown(lines):
        title = "Normalised innovation squared over time"
        yield _normalised(results, lines, labels, marks, "nis", title, "innovations")


def _normalised(
    results: CaseResults,
    lines: Sequence[Series],
    labels: Sequence[str],
    marks: Mapping[str, Mark],
    name: str,
    title: str,
    what: str,
) -> Plot:
    """NEES or NIS over time, with the band that chance allows for."""
    band = series.band(results, METRICS[name], labels)
    said = f" The dotted line is 1, where {what} are as large as the filter says."
    if band is None:
        return _over_time(lines, marks, name, title, name.upper(), 1.0, said)
    whose = "one sample, since all runs are of the same data," if results.card.origin == RECORDED else count(band.runs, "run")
    said += (
        f" It is divided by the number of components, {band.dimension}. At {PERCENT} of the steps the grey band holds the "
        f"average over {whose} of a filter that is right: chi-square of {band.runs} × {band.dimension} degrees of freedom, "
        f"over {band.runs * band.dimension}."
    )
    axis = f"{name.upper()} / {band.dimension}"
    return _over_time(lines, marks, name, title, axis, 1.0, said, band=band)


def _unknown(lines: Sequence[Series]) -> bool:
    """Whether runs came through, and yet nothing is known of them at any step, as where the truth is not."""
    return bool(lines) and all(np.isnan(line.value).all() for line in lines)


def _over_time(
    lines: Sequence[Series],
    marks: Mapping[str, Mark],
    name: str,
    title: str,
    axis: str,
    target: float | None = None,
    said: str = "",
    bounds: Sequence[tuple[BlockBound, Array, Array]] = (),
    band: Band | None = None,
) -> Plot:
    drawing = figures.over_time(lines, marks, f"fig-{name}", axis, title, target, [value for _, value, _ in bounds], band)
    runs = {s.runs for s in lines}
    unit = axis.partition(" (")
    caption = f"{title[: -len(' over time')]}{''.join(unit[1:])} against time (s), " + (
        f"over {count(runs.pop(), 'run')} of each estimator." if len(runs) == 1 else "over the runs of each that came through."
    )
    caption += f" The shaded bands are {PERCENT} intervals over runs." if any(s.runs > 1 for s in lines) else ""
    if lines:
        end = figures.beyond(lines, target)
        caption += said + (f" Values above {end:g} are beyond the axis." if math.isfinite(end) else "")
        caption += _same(lines) + bounded(bounds) + _hidden(lines)
    columns = [Column("time (s)", lines[0].time)] if lines else []
    for line in lines:
        columns += [
            Column(line.label, line.value, line.label),
            Column(f"{line.label}, low", line.spread(line.low), line.label, "low"),
            Column(f"{line.label}, high", line.spread(line.high), line.label, "high"),
        ]
    columns += [Column(bound_name(each), value) for each, value, _ in bounds if each.kind != NONE and lines]
    columns += [Column("band, low", band.low), Column("band, high", band.high)] if band and lines else []
    return Plot(
        name, title, caption, drawing, [s.label for s in lines], columns, y=axis, whole=lines[0].at.tolist() if lines else ()
    )


def _hidden(lines: Sequence[Series]) -> str:
    """Says at how many steps lines are not drawn, those that lack as many together."""
    lacking = Counter(line.hidden for line in lines if line.hidden)
    if len(lines) > 1 and lacking == {lines[0].hidden: len(lines)}:
        return f" {count(lines[0].hidden, 'step')} of {len(lines[0].value)} without a finite value, not drawn."
    told = ""
    for n in lacking:
        names = listed([line.label for line in lines if line.hidden == n])
        told += f" {names}: {count(n, 'step')} of {len(lines[0].value)} without a finite value, not drawn."
    return told


def _same(lines: Sequence[Series]) -> str:
    """Says which lines cannot be told apart, since one then hides the other."""
    groups: list[list[Series]] = []
    for line in lines:
        home = next((g for g in groups if _close(g[0], line)), None)
        if home is None:
            groups.append([line])
        else:
            home.append(line)
    alike = [listed([s.label for s in g]) for g in groups if len(g) > 1]
    return "".join(f" The lines of {names} lie on top of each other." for names in alike)


def _close(a: Series, b: Series) -> bool:
    return len(a.value) == len(b.value) and all(
        x == y or math.isclose(x, y, rel_tol=1e-3) for x, y in zip(a.value.tolist(), b.value.tolist(), strict=True)
    )


def _ground(results: CaseResults, track: Tracks, marks: Mapping[str, Mark]) -> Plot:
    card = results.card
    assert card.plane is not None
    x, y = (card.state[i] for i in card.plane)
    title = "Truth and estimates on the ground plane" if track.known else "Estimates on the ground plane"
    drawing = figures.ground(track, card, marks, "fig-ground", title)
    caption = (
        f"Run {track.run}, the one whose error on this plane is the median of the runs of {track.chosen_by}. "
        "The circle marks the start, the thin line without marks the truth."
        if track.known
        else f"Run {track.run}, the first of {track.chosen_by} that came through. The truth is not known; "
        f"the circle marks the first estimate of {track.chosen_by}."
    )
    if card.landmarks:
        caption += f" Triangles: {listed([name for name, *_ in card.landmarks], 8)}."
    if track.missing:
        caption += f" Not drawn: {listed(track.missing)}, which did not come through this run."
    places = [*([("truth", track.truth)] if track.known else []), *track.estimates.items()]
    columns = [Column("time (s)", card.time)]
    for name, place in places:
        columns += [Column(f"{name} {words}", row, name) for words, row in zip((x, y), place, strict=True)]
    axis = with_unit(y, next((b.unit for b in card.blocks if card.plane[1] in b.components), ""))
    return Plot("ground", title, caption, drawing, list(track.estimates), columns, y=axis)
