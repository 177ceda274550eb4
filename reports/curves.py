"""Curves of detectors: receiver operating characteristics, and delay of detection against false alarms."""

from collections.abc import Mapping, Sequence

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from reports import svg
from reports.canvas import drawing, dress, finite, joined, line, log_limits, panels, whiskers
from reports.detectors import Detector
from reports.marks import Mark
from reports.plot import Column, Plot
from reports.text import listed
from reports.views import PERCENT
from suite.linalg import Array

PER = {"manoeuvre": "first manoeuvres", "scan": "steps of manoeuvres"}
"""What a detection rate is a share of, by kind of curve."""
OF_NOTHING = {"manoeuvre": "runs before their first manoeuvre", "scan": "steps of nominal motion"}
"""What a false-alarm rate is a share of."""
SMALLEST = 1e-4
"""Where a logarithmic axis of false-alarm rates begins at the earliest."""
NEAR = 0.3
"""Smaller false-alarm rates than this are shown on a logarithmic axis too."""
PIECES = 8
"""Of a slanting part of a curve, which is bent on a logarithmic axis."""


def roc(detectors: Sequence[Detector], kind: str, marks: Mapping[str, Mark], name: str, first: Sequence[str] = ()) -> Plot:
    """The curves per 'manoeuvre' or per 'scan' of the detectors that have one, and once more near small false-alarm rates."""
    curves = {each.label: each.curves[kind] for each in detectors if kind in each.curves}
    title = f"Receiver operating characteristic per {kind}"
    x, y = f"false alarms, share of {OF_NOTHING[kind]}", f"detections, share of {PER[kind]}"
    caption = (
        f"Each point of a curve is a threshold: the share of {PER[kind]} whose statistic rises above it, against the share of "
        f"{OF_NOTHING[kind]} in which it does without cause. The dotted line is chance. "
    )
    if kind == "manoeuvre":
        caption += "Of each stretch of a run the largest statistic counts. "
    caption += "The curves have no intervals; the areas under them, in the tables, have."
    columns = [Column("point", np.arange(max((len(x) for x, _ in curves.values()), default=0)))]
    for label, (alarms, found) in curves.items():
        head = f"{label}, false-alarm rate"
        columns.append(Column(head, _padded(alarms, columns[0]), label))
        columns.append(Column(f"{label}, detection rate", _padded(found, columns[0]), label, over=head))
    image = _roc(curves, marks, f"fig-{name}", title) if curves else None
    if image and _smallest(curves) < NEAR:
        caption += " On the right the same with small false-alarm rates spread out."
    return Plot(name, title, caption, image, list(curves), columns if curves else [], x, y, first=first, metrics=["auc"])


def _padded(values: Sequence[float], like: Column) -> Array:
    return np.append(values, np.full(len(like.values) - len(values), np.nan))


def _smallest(curves: Mapping[str, tuple[Sequence[float], Sequence[float]]]) -> float:
    """The smallest false-alarm rate above zero of any curve, as far as it is shown."""
    alarms = joined([np.asarray(x) for x, _ in curves.values()])
    return max(SMALLEST, float(alarms[alarms > 0].min(initial=1.0)))


def _roc(
    curves: Mapping[str, tuple[Sequence[float], Sequence[float]]], marks: Mapping[str, Mark], name: str, title: str
) -> Markup:
    low = _smallest(curves)
    with drawing():
        sides = panels(2 if low < NEAR else 1, 2, 2.65, gap=0.4)
        for axes, spread in zip(sides, (False, True), strict=False):
            if spread:
                axes.set_xscale("log")
            axes.set_xlim(low if spread else 0, 1)
            axes.set_ylim(0, 1.02)
            rising = np.geomspace(low, 1, 50) if spread else np.array([0.0, 1.0])
            axes.plot(rising, rising, color=svg.INK, lw=0.9, dashes=(2, 2), zorder=1)
            for number, (label, (alarms, found)) in enumerate(curves.items()):
                x, y = _bent(np.asarray(alarms), np.asarray(found)) if spread else (np.asarray(alarms), np.asarray(found))
                line(axes, np.maximum(x, low) if spread else x, y, marks[label], number / len(curves))
            axes.set_xlabel("false-alarm rate")
            axes.tick_params(labelbottom=True)
            dress(axes)
        sides[0].set_ylabel("detection rate")
        return svg.inline(sides[0].figure, name, title, f"Detection rate over false-alarm rate of {', '.join(curves)}")


def _bent(x: Array, y: Array) -> tuple[Array, Array]:
    """The same curve with its slanting parts cut into pieces."""
    slanting = (np.diff(x) > 0) & (np.diff(y) > 0)
    pieces = np.where(slanting, PIECES, 1)
    start = np.repeat(np.arange(len(pieces)), pieces)
    place = np.arange(len(start)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    along = start + (place / pieces[start]) ** 2  # finer near small rates
    along = np.append(along, len(pieces))
    return np.interp(along, np.arange(len(x)), x), np.interp(along, np.arange(len(y)), y)


def delay(detectors: Sequence[Detector], marks: Mapping[str, Mark], name: str, first: Sequence[str] = ()) -> Plot | None:
    """Delay against the mean time to a false alarm at the usual levels; None where no runs without manoeuvres are stored."""
    rows = [{"label": each.label, **row} for each in detectors for row in each.points if row["calm_runs"]]
    if not rows:
        return None
    title = "Delay of detection against false alarms"
    x, y = "mean time to a false alarm (s)", "delay of detection (s)"
    usable = [row for row in rows if np.isfinite([row["run_length"], row["delay"]]).all()]
    labels = list(dict.fromkeys(row["label"] for row in usable))
    columns = [Column("detector", [row["label"] for row in rows])]
    for head, key, over in (
        ("false-alarm level", "level", ""),
        (x, "run_length", ""),
        (y, "delay", x),
        ("share of manoeuvres detected", "detection", x),
    ):
        columns.append(Column(head, [row[key] for row in rows], over=over))
        if key != "level":
            columns += [Column(f"{head}, {end}", [row[f"{key}_{end}"] for row in rows], role=end) for end in ("low", "high")]
    caption = (
        "Mean time from the start of a run's first manoeuvre to the alarm, over runs without an alarm before it; a manoeuvre "
        "that is missed counts with its whole duration. Each point is a threshold that was set on the runs of the twin case "
        f"without manoeuvres, where an alarm comes in {listed([f'{100 * level:g}' for level in _levels(rows)])} % of them. "
        f"Fast and quiet is at the lower right. The bars are {PERCENT} intervals at the threshold itself; they leave out the "
        "choice of the threshold."
    )
    lacking = [each.label for each in detectors if each.label not in labels]
    caption += f" Without a point: {listed(lacking)}." if lacking else ""
    image = _delay(usable, labels, marks, f"fig-{name}", title)
    return Plot(name, title, caption, image, labels, columns, x, y, "x", first=first, metrics=["detection-delay"])


def _levels(rows: Sequence[Mapping[str, float]]) -> list[float]:
    return sorted({row["level"] for row in rows})


def _delay(
    rows: Sequence[Mapping[str, float]], labels: Sequence[str], marks: Mapping[str, Mark], name: str, title: str
) -> Markup | None:
    if not rows:
        return None
    with drawing():
        axes = panels(1, 1, 2.65)[0]
        _limits(axes, rows)
        for label in labels:
            mine = sorted((row for row in rows if row["label"] == label), key=lambda row: row["level"])
            found = {key: np.array([row[key] for row in mine]) for key in mine[0] if key != "label"}
            x, y = found["run_length"], found["delay"]
            ends = (np.stack([found[f"{key}_low"], found[f"{key}_high"]]) for key in ("run_length", "delay"))
            whiskers(axes, x, y, marks[label], *ends)
            line(axes, x, y, marks[label], markevery=1)
        axes.set_xlabel("mean time to a false alarm (s)")
        axes.set_ylabel("delay of detection (s)")
        axes.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
        dress(axes)
        return svg.inline(axes.figure, name, title, f"Delay over mean time to a false alarm of {', '.join(labels)}")


def _limits(axes: Axes, rows: Sequence[Mapping[str, float]]) -> None:
    """Room for the points, and for their intervals as far as these do not dwarf them."""
    times, delays = (np.array([row[key] for row in rows]) for key in ("run_length", "delay"))
    reach = finite(np.array([row[f"run_length{end}"] for row in rows for end in ("_low", "_high")]))
    axes.set_xscale("log")
    axes.set_xlim(log_limits(np.clip(np.append(times, reach), times.min() / 3, times.max() * 3)))
    high = finite(np.array([row["delay_high"] for row in rows]))
    axes.set_ylim(0, 1.06 * max(float(delays.max()), float(high.max(initial=0.0)), 1e-9))
