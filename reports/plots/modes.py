"""What estimators hold of the modes of motion in one run, beside the mode that was in force."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from reports import series, svg
from reports.canvas import drawing, dress, line, panels, short
from reports.figures import GREY, MANY_STEPS
from reports.marks import Mark
from reports.plot import Column, Plot
from reports.plots import runs
from reports.text import listed
from reports.views import CaseView
from suite.linalg import Array

MOST_PANELS = 8
"""Modes that are drawn."""
MOST_TOLD = 5
"""So many estimators without probabilities are told one by one, more are counted."""
TITLE = "Mode probabilities over time"


def figures(case: CaseView, labels: Sequence[str], marks: Mapping[str, Mark], picked: Mapping[str, int]) -> Iterator[Plot]:
    """The probability of each mode in the median run; nothing where no estimator has any or no mode is known of."""
    results, names = case.results, case.card.modes
    run = picked.get(runs.MEDIAN, picked.get(runs.BEST))
    if not names or run is None or (mode := results.truth_of[run].mode) is None:
        return
    found = {}
    for label in labels:
        cell = results.cells.get(label)
        if cell and run in cell.runs and cell.estimate.mode is not None and cell.estimate.ok[cell.runs.index(run)]:
            found[label] = cell.estimate.mode[:, :, cell.runs.index(run)]
    if not found:
        return
    mode, time = np.asarray(mode), case.card.time
    which = "median" if run == picked.get(runs.MEDIAN) else "best"
    caption = (
        f"Probability that each estimator gives to each mode in run {run}, the {which} one by its errors; shaded where the "
        "mode is in force."
    )
    without = [label for label, cell in results.cells.items() if cell.runs and label not in found]
    if without:
        caption += f" Without any in this run: {listed(without, MOST_TOLD)}."
    if len(names) > MOST_PANELS:
        caption += f" Drawn are {listed(names[:MOST_PANELS])}; the CSV file has all {len(names)}."
    columns = [Column("time (s)", time), Column("mode in force", [names[int(m)] for m in mode])]
    for label, given in found.items():
        columns += [Column(f"{label}, {name}", given[:, i], label) for i, name in enumerate(names)]
    image = _draw(time, mode, found, names[:MOST_PANELS], marks)
    first = series.first(list(found))
    yield Plot("modes", TITLE, caption, image, list(found), columns, y="probability", first=first)


def _spans(time: Array, flags: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Begin and length of the times at which flags[T] hold: the mode of a step is in force from the step before it on."""
    begin = np.append(0.0, time[:-1])
    return [(float(start), float(end - start)) for start, end, flag in zip(begin, time, flags, strict=True) if flag]


def _draw(time: Array, mode: Array, found: Mapping[str, Array], names: Sequence[str], marks: Mapping[str, Mark]) -> Markup:
    with drawing():
        boxes = panels(len(names), 1 if len(names) < 4 else 2, 0.95, head=0.26, gap=0.12)
        for number, (axes, name) in enumerate(zip(boxes, names, strict=True)):
            axes.broken_barh(_spans(time, mode == number), (0, 1), **{**GREY, "lw": 0})
            for place, (label, given) in reversed(list(enumerate(found.items()))):
                offset = place % series.SHOWN_FIRST / series.SHOWN_FIRST
                line(axes, time, given[:, number], marks[label], offset, lw=0.9 if len(time) > MANY_STEPS else 1.3, ms=4.5)
            axes.set_xlim(0, float(time[-1]) or 1.0)
            axes.set_ylim(0, 1)
            axes.set_yticks([0, 0.5, 1])
            axes.set_title(short(name), fontsize=10.5, pad=3, loc="left")
            dress(axes)
        boxes[0].figure.supylabel("probability", x=0.012, fontsize=11)
        boxes[0].figure.supxlabel("time (s)", y=0.012, fontsize=11)
        return svg.inline(
            boxes[0].figure, "fig-modes", TITLE, f"Probabilities of the modes over time (s) of {', '.join(found)}"
        )
