"""Errors, their ratio to the bound, consistency and mode probabilities over time."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from reports import figures, series
from reports.figures import Axis, value_axis
from reports.marks import Mark
from reports.plot import Column, Plot
from reports.sentences import bound_name, bounded
from reports.series import ALIKE, SHOWN_FIRST, Band, Series
from reports.text import count, listed, number
from reports.views import PERCENT, CaseView
from suite.bounds import NONE
from suite.case import RECORDED, with_unit
from suite.case_bounds import BlockBound
from suite.linalg import Array
from suite.metrics import METRICS

MOST_TOLD = 3
"""So many estimators beyond an axis are told one by one, more are counted."""
MOST_ALIKE = 5
"""So many estimators are named whose lines lie on top of each other, more are counted."""


def errors(case: CaseView, labels: Sequence[str], marks: Mapping[str, Mark]) -> Iterator[Plot]:
    """The RMSE of each state block, above its bounds."""
    results = case.results
    found = series.over_time(results, METRICS["rmse"], labels)
    for i, block in enumerate(results.card.blocks):
        lines = found.get(block.name, [])
        bounds = [(bound, bound.value[:, i], bound.error[:, i]) for bound in results.bounds]
        if not _unknown(lines):
            axis = with_unit("RMSE", block.unit)
            yield _plot(lines, marks, f"rmse-{i}", f"RMSE of {block.name} over time", axis, "rmse", bounds=bounds)


def ratios(case: CaseView, labels: Sequence[str], marks: Mapping[str, Mark]) -> Iterator[Plot]:
    """The RMSE of each state block over a bound that holds for all estimators."""
    results = case.results
    strict = bool(results.bounds) and results.bounds[0].strict
    found = series.over_time(results, METRICS["crlb-ratio"], labels) if strict else {}
    for i, block in enumerate(results.card.blocks):
        if block.name in found and not _unknown(found[block.name]):
            title = f"Ratio of the RMSE of {block.name} to the Cramér-Rao bound over time"
            said = " The dotted line is 1: errors at the bound. Over finitely many runs they may fall below it by chance."
            yield _plot(found[block.name], marks, f"ratio-{i}", title, "RMSE / bound", "crlb-ratio", 1.0, said)


def squares(case: CaseView, name: str, labels: Sequence[str], marks: Mapping[str, Mark]) -> Iterator[Plot]:
    """NEES or NIS over time, with the band that chance allows for."""
    results = case.results
    block, what, full = {
        "nees": ("state", "errors", "estimation error"),
        "nis": ("innovation", "innovations", "innovation"),
    }[name]
    lines = series.over_time(results, METRICS[name], labels).get(block, [])
    if _unknown(lines) or (name == "nis" and not lines):
        return
    title = f"Normalised {full} squared over time"
    band = series.band(results, METRICS[name], labels)
    said = f" The dotted line is 1, where {what} are as large as the filter says."
    if band is None:
        yield _plot(lines, marks, name, title, name.upper(), name, 1.0, said)
        return
    whose = "one sample, since all runs are of the same data," if results.card.origin == RECORDED else count(band.runs, "run")
    said += (
        f" It is divided by the number of components, {band.dimension}. At {PERCENT} of the steps the grey band holds the "
        f"average over {whose} of a filter that is right: chi-square of {band.runs} × {band.dimension} degrees of freedom, "
        f"over {band.runs * band.dimension}."
    )
    yield _plot(lines, marks, name, title, f"{name.upper()} / {band.dimension}", name, 1.0, said, band=band)


def brier(case: CaseView, labels: Sequence[str], marks: Mapping[str, Mark]) -> Iterator[Plot]:
    """The Brier score of the mode probabilities."""
    if case.card.modes:
        lines = series.over_time(case.results, METRICS["brier"], labels).get("modes", [])
        said = " It is the squared distance of the mode probabilities from the mode in force: 0 at best, 2 at worst."
        if not _unknown(lines):
            title = "Brier score of the mode probabilities over time"
            yield _plot(lines, marks, "brier", title, "Brier score", "brier", said=said, most=2.0)


def _unknown(lines: Sequence[Series]) -> bool:
    """Whether runs came through, and yet nothing is known of them at any step, as where the truth is not."""
    return bool(lines) and all(np.isnan(line.value).all() for line in lines)


def _plot(
    lines: Sequence[Series],
    marks: Mapping[str, Mark],
    name: str,
    title: str,
    label: str,
    metric: str,
    target: float | None = None,
    said: str = "",
    bounds: Sequence[tuple[BlockBound, Array, Array]] = (),
    band: Band | None = None,
    most: float = np.inf,
) -> Plot:
    shown = [line for line in lines if not line.rounding]
    values = [value for _, value, _ in bounds]
    drawing = figures.over_time(shown, marks, f"fig-{name}", label, title, target, values, band, most)
    axis = value_axis(shown, target, values, band, most)
    runs = {s.runs for s in lines}
    unit = label.partition(" (")
    caption = f"{title[: -len(' over time')]}{''.join(unit[1:])} against time (s), " + (
        f"over {count(runs.pop(), 'run')} of each estimator." if len(runs) == 1 else "over the runs of each that came through."
    )
    some = f", of the first {SHOWN_FIRST} of the legend; the CSV file has all" if len(shown) > SHOWN_FIRST else ""
    caption += f" The shaded bands are {PERCENT} intervals over runs{some}." if any(s.runs > 1 for s in shown) else ""
    if lines:
        caption += said + _rounding(lines, unit[2].rstrip(")"))
        caption += (beyond(shown, axis, unit[2].rstrip(")")) if axis else "") + _same(shown) + bounded(bounds) + _hidden(shown)
    columns = [Column("time (s)", lines[0].time)] if lines else []
    for line in lines:
        columns += [
            Column(line.label, line.value, line.label),
            Column(f"{line.label}, low", line.spread(line.low), line.label, "low"),
            Column(f"{line.label}, high", line.spread(line.high), line.label, "high"),
        ]
    columns += [Column(bound_name(each), value) for each, value, _ in bounds if each.kind != NONE and lines]
    columns += [Column("band, low", band.low), Column("band, high", band.high)] if band and lines else []
    whole = lines[0].at.tolist() if lines else ()
    labels = [s.label for s in shown]
    log = "y" if axis and axis.log else ""
    nothing = "all errors are at the level of rounding." if lines and not shown else ""
    first = series.first(labels)
    how = {"log": log, "whole": whole, "first": first, "nothing": nothing, "metrics": [metric]}
    return Plot(name, title, caption, drawing, labels, columns, y=label, **how)


def _rounding(lines: Sequence[Series], unit: str) -> str:
    """Says whose errors are nothing but rounding."""
    found = [line for line in lines if line.rounding]
    if not found:
        return ""
    peak = number(max(line.peak for line in found)) + (f" {unit}" if unit else "")
    names = "all" if len(found) == len(lines) else listed([line.label for line in found])
    said = f"rounding, {peak} at most" if max(line.peak for line in found) else "zero"
    return f" The errors of {names} are {said}, and are not drawn."


def beyond(lines: Sequence[Series], axis: Axis, unit: str = "") -> str:
    """Says which lines leave the axis, from when on or for how long, and how far they go; the farthest first."""
    over = [line for line in lines if line.peak > axis.high]
    told = []
    for line in sorted(over, key=lambda s: -s.peak)[:MOST_TOLD]:
        out = np.flatnonzero(line.value > axis.high)
        after = line.value[out[0] :]
        stays = bool((after[np.isfinite(after)] > axis.high).all())
        when = "at all times" if stays and out[0] == 0 else f"from {line.time[out[0]]:g} s on" if stays else "at times"
        told.append(f"{line.label} {when}, up to {number(line.peak)}")
    rest = f"; and {count(len(over) - MOST_TOLD, 'other')}" if len(over) > MOST_TOLD else ""
    end = f"{number(axis.high)} {unit}".rstrip()
    return f" The axis ends at {end}. Beyond it: {'; '.join(told)}{rest}." if told else ""


def _hidden(lines: Sequence[Series]) -> str:
    """Says at how many steps lines are not drawn, those that lack as many together."""
    lacking = Counter(line.hidden for line in lines if line.hidden)
    if len(lines) > 1 and lacking == {lines[0].hidden: len(lines)}:
        return f" {count(lines[0].hidden, 'step')} of {len(lines[0].value)} without a finite value, not drawn."
    told = [f"{listed([s.label for s in lines if s.hidden == n])} at {count(n, 'step')}" for n in lacking]
    return f" Of {count(len(lines[0].value), 'step')} without a finite value, not drawn: {'; '.join(told)}." if told else ""


def _same(lines: Sequence[Series]) -> str:
    """Says which lines cannot be told apart, since one then hides the other."""
    groups: list[list[Series]] = []
    for line in lines:
        home = next((g for g in groups if _close(g[0], line)), None)
        if home is None:
            groups.append([line])
        else:
            home.append(line)
    alike = [listed([s.label for s in g], MOST_ALIKE) for g in groups if len(g) > 1]
    return f" The lines of {'; those of '.join(alike)} lie on top of each other." if alike else ""


def _close(a: Series, b: Series) -> bool:
    return len(a.value) == len(b.value) and np.allclose(a.value, b.value, rtol=ALIKE, atol=0.0, equal_nan=True)
