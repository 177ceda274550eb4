"""Figures of benchmarks: beside each other, against rivals, and over the files of a machine."""

import math
from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from reports import svg
from reports.canvas import axes_of, drawing, dress, line, log_limits, whiskers
from reports.dots import Dot, dots
from reports.marks import Mark
from reports.plot import Column, Plot
from reports.text import count, listed, number
from reports.views import PERCENT
from suite.benchmarks import Row
from suite.linalg import Array

AXES = {
    "latency": "time of a step with a single run (µs)",
    "throughput": "throughput (run-steps/s)",
    "duration": "time of the call (s)",
}
FEW = 8
"""Lines that a history draws at most."""
TICKS = 6
"""Files that the axis of a history names at most."""


def moment(date: str) -> str:
    """A date to the minute."""
    return f"{date[:16].replace('T', ' ')}{' UTC' if date.endswith(('+00:00', 'Z')) else ''}"


def commit(row: Row) -> str:
    """The commit of a row, in short, and whether anything was changed since."""
    return f"{row['commit'][:10]}{' and uncommitted changes' if row['dirty'] else ''}"


def spaced(name: str) -> str:
    """A name that is told with underscores, in words."""
    return name.replace("_", " ")


def values(rows: Sequence[Row], labels: Sequence[str], looks: dict[str, Mark], name: str) -> Plot | None:
    """The figures of a group beside each other; None for a single one."""
    if len(rows) < 2:
        return None
    axis = AXES[rows[0]["metric"]]
    title = axis.partition(" (")[0].capitalize()
    shown = [Dot(i, row["value"], row["low"], row["high"], looks[labels[i]]) for i, row in enumerate(rows)]
    caption = f"{title}: median over the rounds of each benchmark. Bars: {PERCENT} intervals of the median"
    missing = sum(math.isnan(row["low"]) for row in rows)
    why = "fewer than six rounds, or a file that does not keep all of them"
    caption += f"; {missing} of {len(rows)} have none ({why})." if missing else "."
    columns = [Column("benchmark", labels)]
    columns += [Column(axis, [row["value"] for row in rows])]
    columns += [Column(end, [row[end] for row in rows], role=end) for end in ("low", "high")]
    drawn = dots(labels, shown, f"fig-{name}", title, axis)
    return Plot(name, title, caption, drawn, (), columns, "benchmark", axis, "y")


def against(rows: Sequence[Row], labels: Sequence[str], names: Sequence[str], looks: dict[str, Mark], name: str) -> Plot:
    """How many times as long as others each benchmark takes."""
    axis, title = "ratio of times", f"Times beside others: {listed(map(spaced, names))}"
    shown = [Dot(i, *ratio, looks[spaced(of)]) for i, row in enumerate(rows) for of, ratio in row["against"].items()]
    ratios = [ratio for row in rows for ratio in row["against"].values()]
    missing = sum(math.isnan(low) for _, low, _ in ratios)
    caption = (
        "Time of each benchmark by that of what it is held against, for the same work: median of the ratios over rounds in "
        "which both were timed one right after the other, so that what else the machine does falls on both. Left of the line "
        f"the benchmark is the faster one. Bars: {PERCENT} intervals"
    )
    caption += f"; {missing} of {len(ratios)} ratios have none (fewer than six rounds, or none recorded)." if missing else "."
    columns = [Column("benchmark", labels)]
    for of in names:
        for place, end in enumerate(("", ", low", ", high")):
            ends = [row["against"].get(of, (math.nan,) * 3)[place] for row in rows]
            columns.append(Column(f"{spaced(of)}{end}", ends, spaced(of), end[2:] or "value"))
    drawn = dots(labels, shown, f"fig-{name}", title, axis, reference=1.0)
    return Plot(name, title, caption, drawn, list(map(spaced, names)), columns, "benchmark", axis, "y")


def history(
    rows: Sequence[Row], newest: Sequence[Row], labels: Sequence[str], looks: dict[str, Mark], name: str
) -> Plot | None:
    """The newest benchmarks over the files of their machine; None where no other file has any of them."""
    files = {row["date"]: row for row in sorted(rows, key=lambda row: row["date"])}
    held = {(row["name"], row["date"]): row for row in rows}
    alike = {key: row for row in newest for key in held if key[0] == row["name"] and _work(held[key]) == _work(row)}
    found = {}
    for row, label in zip(newest, labels, strict=True):
        points = [held[row["name"], date] if (row["name"], date) in alike else None for date in files]
        if sum(point is not None for point in points) > 1:
            ends = [[point[end] if point else math.nan for point in points] for end in ("value", "low", "high")]
            found[label] = np.array(ends, float)
    if not found:
        return None
    axis = AXES[newest[0]["metric"]]
    title = f"{axis.partition(' (')[0].capitalize()}, over {count(len(files), 'file')}"
    columns = [Column("date", [moment(date) for date in files]), Column("commit", [commit(row) for row in files.values()])]
    drawn = dict(sorted(found.items(), key=lambda item: -abs(np.log(_change(item[1]))))[:FEW])
    for label, (value, low, high) in drawn.items():
        columns.append(Column(label, value, label))
        columns += [Column(f"{label}, low", low, label, "low"), Column(f"{label}, high", high, label, "high")]
    caption = (
        f"{title}, the oldest on the left, all of this machine. Bars: {PERCENT} intervals of the median over rounds, where "
        f"there are any. {_changes(found)}"
    )
    caption += f" Of {len(found)} benchmarks the {FEW} are drawn that changed most." if len(found) > FEW else ""
    if len({row["python"] for row in files.values()}) > 1:
        caption += " The files are of different versions of Python."
    names = {row["name"] for row in newest}
    other = sum(key[0] in names and key not in alike for key in held)
    caption += f" {count(other, 'older timing')} of other numbers of runs or steps left out." if other else ""
    ticks = [f"{date[:10]}\n{row['commit'][:7]}" for date, row in files.items()]
    image = _over_files(drawn, ticks, axis, looks, f"fig-{name}", title)
    return Plot(name, title, caption, image, list(drawn), columns, "file", axis, "y")


def _work(row: Row) -> list[object]:
    """What must be the same for two timings to be compared."""
    return [row["told"].get("runs"), row["told"].get("steps")]


def _change(values: Array) -> float:
    """The last of a benchmark's values by the first, both above zero; 1 where one is not."""
    first, *_, last = values[0][~np.isnan(values[0])]
    return float(last / first) if first > 0 and last > 0 else 1.0


def _changes(found: dict[str, Array]) -> str:
    """Says of which benchmarks the interval in the first of their files and that in the last lie apart."""
    parted, told = [], 0
    for label, values in found.items():
        known = np.flatnonzero(~np.isnan(values[0]))
        (_, *before), (_, *after) = values[:, known[0]], values[:, known[-1]]
        told += not np.isnan([*before, *after]).any()
        if after[0] > before[1] or after[1] < before[0]:
            parted.append(f"{label} (the last is {number(_change(values))} times the first)")
    if not told:
        return "Without intervals nothing can be said of a change."
    lacking = len(found) - told
    rest = f" {count(lacking, 'benchmark')} without intervals." if lacking else ""
    rest += " What else the machine had to do at the time is in no interval."
    if not parted:
        return f"From the first file to the last all intervals overlap.{rest}"
    return f"From the first file to the last the intervals lie apart of {listed(parted, 12)}.{rest}"


def _over_files(
    found: dict[str, Array], ticks: Sequence[str], axis: str, looks: dict[str, Mark], name: str, title: str
) -> Markup | None:
    positive = np.concatenate([value for value, *_ in found.values()])
    positive = positive[np.isfinite(positive) & (positive > 0)]
    if not positive.size:
        return None
    x = np.arange(1.0, len(ticks) + 1)
    with drawing():
        axes = axes_of(height=3.2)
        axes.set_yscale("log")
        axes.set_ylim(log_limits(positive))
        axes.set_xlim(0.7, len(ticks) + 0.3)
        for label, (value, low, high) in found.items():
            known = ~np.isnan(value)
            spread = known & ~np.isnan(low)
            line(axes, x[known], value[known], looks[label], markevery=1)
            whiskers(axes, x[spread], value[spread], looks[label], yerr=np.stack([low[spread], high[spread]]))
        axes.set_ylabel(axis)
        dress(axes)
        at = np.unique(np.linspace(0, len(ticks) - 1, min(TICKS, len(ticks))).round().astype(int))
        axes.set_xticks(x[at], [ticks[i] for i in at])
        return svg.inline(axes.figure, name, title, f"{axis} of {', '.join(found)}")
