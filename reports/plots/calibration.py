"""Whether the truth lies where an estimator's Gaussian says: histograms of the probability integral transform, coverage."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from scipy.special import gammainc

from reports import series, svg
from reports.canvas import drawing, dress, line, panels, shade, short
from reports.marks import Mark
from reports.plot import Column, Plot
from reports.text import count, listed
from reports.views import PERCENT, CaseView
from suite.case import RECORDED
from suite.linalg import Array
from suite.metrics import METRICS, counted
from suite.metrics.calibration import BINS
from suite.metrics.metric import share
from suite.results import Cell
from suite.statistics import jackknife, means

MOST_PANELS = 6
"""Components of the state that are drawn; the file has all."""
MOST_OUTLINES = 4
"""Estimators in a histogram; of more none could be followed."""
LEVELS = np.array([0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99])
"""Probabilities of the regions whose coverage is drawn."""
EDGES = np.arange(BINS + 1) / BINS


def histograms(case: CaseView, labels: Sequence[str], marks: Mapping[str, Mark]) -> Iterator[Plot]:
    """The histogram of the probability integral transform of each component, of the estimators that come first."""
    found: dict[str, dict[str, Array]] = {}
    for label in labels[:MOST_OUTLINES]:
        for component, shares in _histograms(case.results.cells.get(label)).items():
            found.setdefault(component, {})[label] = shares
    if not found:
        return
    shown = list(found)[:MOST_PANELS]
    names = [label for label in labels if any(label in each for each in found.values())]
    title = "Where the truth lies within what each filter says"
    caption = (
        "Probability integral transform of each component of the state: the share of steps at which the truth lies in each "
        "tenth of the filter's Gaussian. 0.1 each (dotted) for a filter that knows its errors; high at both ends for one that "
        "is too sure, in the middle for one that is too cautious, at one end for one that is off to a side."
    )
    caption += _intervals(case)
    if len(names) < sum(1 for label in labels if label in case.results.cells):
        caption += f" Shown {'is' if len(names) == 1 else 'are'} {listed(names)}."
    if len(found) > len(shown):
        caption += f" {count(len(shown), 'component')} of {len(found)} are drawn; the CSV file has all."
    columns = [Column("from", EDGES[:-1]), Column("to", EDGES[1:], role="end")]
    for component, each in found.items():
        for label, (value, low, high) in each.items():
            head = f"{label}, {component}"
            columns.append(Column(head, value, label))
            columns += [Column(f"{head}, low", low, label, "low"), Column(f"{head}, high", high, label, "high")]
    image = _draw({name: found[name] for name in shown}, marks, names, title)
    x, y = "tenths of the filter's Gaussian", "share of steps"
    yield Plot("pit", title, caption, image, names, columns, x, y, metrics=["pit"])


def _intervals(case: CaseView) -> str:
    if case.card.origin == RECORDED:
        return " All runs are of the same data, so there is no interval."
    return f" The shaded bands are {PERCENT} intervals over runs." if case.runs > 1 else " Of one run there is no interval."


def _histograms(cell: Cell | None) -> dict[str, Array]:
    """Shares in the bins, with intervals over runs [3, 10], by component of which anything is known."""
    found = {}
    for component, values in (cell.contributions(METRICS["pit"]) if cell else {}).items():
        values = values[:, counted(values)]
        if values.shape[1]:
            sample = means(values)
            low, high = jackknife(sample)
            shares = np.stack([sample.value, np.maximum(low, 0.0), np.minimum(high, 1.0)])
            found[component] = _without_interval(shares) if cell and cell.case.card.origin == RECORDED else shares
    return found


def _draw(found: Mapping[str, Mapping[str, Array]], marks: Mapping[str, Mark], names: Sequence[str], title: str) -> Markup:
    top = max(float(shares[0].max()) for each in found.values() for shares in each.values())
    with drawing():
        boxes = panels(len(found), 2 if len(found) in (2, 4) else min(len(found), 3), 1.25, head=0.28)
        for axes, (component, each) in zip(boxes, found.items(), strict=True):
            for label in reversed(names):
                if label in each:
                    _outline(axes, each[label], marks[label], names.index(label) / len(names), len(names))
            axes.axhline(1 / BINS, color=svg.INK, lw=0.9, dashes=(2, 2), zorder=1)
            axes.set_xlim(0, 1)
            axes.set_ylim(0, min(1.0, max(0.25, 1.1 * top)))
            axes.set_xticks([0, 0.5, 1])
            axes.set_title(short(component), fontsize=10.5, pad=4)
            dress(axes)
        boxes[0].figure.supylabel("share of steps", x=0.012, fontsize=11)
        boxes[0].figure.supxlabel("place of the truth in the filter's Gaussian (probability)", y=0.012, fontsize=11)
        return svg.inline(boxes[0].figure, "fig-pit", title, f"Histograms of the transform of {', '.join(names)}")


def _outline(axes: Axes, shares: Array, mark: Mark, offset: float, many: int) -> None:
    value, low, high = shares[:, np.minimum(np.arange(BINS + 1), BINS - 1)]
    shade(axes, EDGES, low, high, mark, many, step="post")
    line(axes, EDGES, value, mark, offset, drawstyle="steps-post", lw=1.3, ms=4.5)


def coverage(case: CaseView, labels: Sequence[str], marks: Mapping[str, Mark]) -> Iterator[Plot]:
    """How often the truth is inside the regions that hold it with a stated probability, of the estimators that come first."""
    cells = [case.results.cells[label] for label in labels[: series.SHOWN_FIRST] if label in case.results.cells]
    found = {cell.label: shares for cell in cells if (shares := _coverage(cell)) is not None}
    if not found:
        return
    title = "Coverage of the filter's regions"
    x, y = "probability that the region should hold", "share of runs and steps inside"
    caption = (
        "Share of runs and steps at which the true state lies inside the ellipsoid that should hold it with a probability, for "
        "several probabilities. On the dotted diagonal a filter knows its errors; below it is too sure of itself, above too "
        "cautious."
    )
    caption += _intervals(case)
    columns = [Column("probability", LEVELS)]
    for label, (value, low, high) in found.items():
        columns.append(Column(label, value, label))
        columns += [Column(f"{label}, low", low, label, "low"), Column(f"{label}, high", high, label, "high")]
    with drawing():
        axes = panels(1, 1, 2.65)[0]
        axes.plot([0, 1], [0, 1], color=svg.INK, lw=0.9, dashes=(2, 2), zorder=1)
        for place, (label, (value, low, high)) in reversed(list(enumerate(found.items()))):
            mark = marks[label]
            shade(axes, LEVELS, low, high, mark, len(found))
            line(axes, LEVELS, value, mark, place / len(found))
        axes.set_xlim(0, 1)
        axes.set_ylim(0, 1.02)
        axes.set_xlabel(x)
        axes.set_ylabel("share inside")
        dress(axes)
        image = svg.inline(axes.figure, "fig-coverage", title, f"{y} over {x} of {', '.join(found)}")
    yield Plot("coverage", title, caption, image, list(found), columns, x, y, metrics=["coverage-95"])


def _coverage(cell: Cell) -> Array | None:
    """Share inside at each of the levels, with its interval over runs [3, L]; None where no distance is known."""
    evidence = cell.evidence
    if evidence is None:
        return None
    with np.errstate(invalid="ignore"):
        inside = gammainc(evidence.dimension / 2, evidence.distance / 2)  # probability of the region that ends at the truth
    inside = inside[:, cell.estimate.ok]
    if np.isnan(inside).all():
        return None
    found = np.array([share(np.where(np.isnan(inside), np.nan, inside <= level)) for level in LEVELS]).T
    return _without_interval(found) if cell.case.card.origin == RECORDED else found


def _without_interval(shares: Array) -> Array:
    """Shares without their ends: runs of a recording are of the same data."""
    return np.vstack([shares[:1], np.full((2, shares.shape[1]), np.nan)])
