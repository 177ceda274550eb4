"""The page of running times: of the calls that the results hold, and of the benchmarks of files."""

import math
from collections.abc import Iterator, Mapping, Sequence
from statistics import median
from typing import Any

from reports.dots import Dot, dots
from reports.frame import Frame
from reports.inputs import Site
from reports.marks import Mark
from reports.pages import benches
from reports.part import Part
from reports.plot import Column, Plot, data_files
from reports.text import Quantity, count, quantity
from reports.views import PERCENT, CaseView, CellView
from suite.benchmarks import Row
from suite.metrics import METRICS, Score
from suite.results import Cell

Timed = tuple[CaseView, CellView]
FIGURES = {
    "latency": ("latency", "step", "latency of a step (µs)"),
    "tail": ("latency-p99", "step", "99th percentile of the time of a step (µs)"),
    "throughput": ("throughput", "step", "throughput (run-steps/s)"),
    "particle-step": ("particle-throughput", "step", "time per particle-step (ns)"),
    "memory": ("memory", "one run", "peak memory with one run (MiB)"),
}
"""By the name of each figure: metric, block and axis."""
STEM = "timing"


def parts(site: Site) -> Iterator[Part]:
    """The page of running times."""
    rows = [row | {"source": row["source"].replace("\\", "/").rpartition("/")[2]} for row in site.inputs.benchmarks]
    hosts = [(case.card.name, label, _machine(cell)) for case in site.cases for label, cell in case.results.cells.items()]
    yield Part(STEM, site.depends(rows, hosts), files, (site.frame, site.cases, rows))


def files(frame: Frame, cases: Sequence[CaseView], rows: Sequence[Row]) -> dict[str, str]:
    """The page's files."""
    machines = [_of_machine(frame, name, timed, place) for place, (name, timed) in enumerate(by_machine(cases).items())]
    benched = benches.machines(frame, rows)
    plots = [*(plot for each in machines for plot in each["plots"]), *(plot for each in benched for plot in each.plots)]
    context = {
        "machines": machines,
        "failures": [(case.card.name, c) for case in cases for c in case.cells.values() if c.timing_failure],
        "untimed": sum(c.ran and not _timed(c) for case in cases for c in case.cells.values()),
        "files": benches.sources(rows),
        "benched": benched,
        "marks": benches.all_marks(frame, rows),
        "anchors": benches.all_anchors(frame, rows),
    }
    return {"timing.html": frame.page("timing", **context), **dict(data_files(STEM, plots))}


def by_machine(cases: Sequence[CaseView]) -> dict[str, list[Timed]]:
    """The cells that have a running time, by the machine that they were timed on."""
    found: dict[str, list[Timed]] = {}
    for case in cases:
        for label, cell in case.cells.items():
            if _timed(cell):
                found.setdefault(_machine(case.results.cells.get(label)), []).append((case, cell))
    return found


def _timed(cell: CellView) -> bool:
    return any(METRICS[name].timed and math.isfinite(score.value) for (name, _), score in cell.scores.items())


def _machine(cell: Cell | None) -> str:
    """The machine that a cell was timed on; several are named as such."""
    hosts = {_words(entry.meta.get("host", {})) for entry in cell.timings} if cell else set()
    return " together with ".join(sorted(hosts)) or "a machine that is not recorded"


def _words(host: Mapping[str, str]) -> str:
    known = [host.get("processor", ""), host.get("system", ""), f"node {host['node']}" if host.get("node") else ""]
    return ", ".join(filter(None, known)) or "a machine that is not recorded"


def _of_machine(frame: Frame, name: str, timed: Sequence[Timed], place: int) -> dict[str, Any]:
    """What the page shows of one machine: its name, a row for each estimator, the figures."""
    plots = [_plot(frame.labels, frame.marks, timed, figure, place) for figure in FIGURES]
    labels = [label for label in frame.labels if any(cell.label == label for _, cell in timed)]
    rows = [(label, sum(cell.label == label for _, cell in timed), _summary(timed, label)) for label in labels]
    return {"name": name, "plots": [plot for plot in plots if plot.drawing], "rows": rows}


def _summary(timed: Sequence[Timed], label: str) -> list[Quantity | None]:
    """For each figure the median over the cases, and the smallest and largest; None where it has no value."""
    found = []
    for figure in FIGURES:
        values = [score.value for _, cell in timed if cell.label == label and (score := _score(cell, figure))]
        spread = Score(median(values), min(values), max(values), _unit(figure), 2, 2) if values else None
        found.append(quantity(spread, METRICS[FIGURES[figure][0]]) if spread else None)
    return found


def _unit(figure: str) -> str:
    return "ns" if figure == "particle-step" else METRICS[FIGURES[figure][0]].unit


def _score(cell: CellView, figure: str) -> Score | None:
    """The finite score that a figure shows of a cell, where it has one; of particles the time instead of the throughput."""
    metric, block, _ = FIGURES[figure]
    score = cell.scores.get((metric, block))
    if not score or not 0 < score.value < math.inf:
        return None
    if figure != "particle-step":
        return score
    value, high, low = (1e9 / x if x > 0 else math.inf for x in (score.value, score.low, score.high))
    return Score(value, low, high, "ns", score.runs, score.total)


def _plot(labels: Sequence[str], marks: Mapping[str, Mark], timed: Sequence[Timed], figure: str, place: int) -> Plot:
    """A dot for each case in the row of each estimator that has the score."""
    metric, _, axis = FIGURES[figure]
    scored = [(case.card.name, cell.label, score) for case, cell in timed if (score := _score(cell, figure))]
    rows = [label for label in labels if any(label == other for _, other, _ in scored)]
    shown = [Dot(rows.index(label), s.value, s.low, s.high, marks[label]) for _, label, s in scored]
    name, title = f"{figure}-{place}" if place else figure, f"{axis[:1].upper()}{axis[1:].partition(' (')[0]}"
    names = list(dict.fromkeys(case for case, *_ in scored))
    held = {(case, label): score for case, label, score in scored}
    columns = [Column("case", names)]
    for label in rows:
        found = [held.get((case, label)) for case in names]
        for end, role in (("value", "value"), ("low", "low"), ("high", "high")):
            head = label if end == "value" else f"{label}, {end}"
            values = [math.nan if score is None else getattr(score, end) for score in found]
            if role == "value" or not all(map(math.isnan, values)):
                columns.append(Column(head, values, label, role))
    words = METRICS[metric].words
    if figure == "particle-step":
        words = "Time of a step by the number of its runs and by the number of particles that the estimator is set to. " + words
    spread = "" if figure == "memory" else f" Bars: {PERCENT} intervals."
    caption = f"{title}: each dot is one of {count(len(names), 'case')}, each row an estimator.{spread} {words}"
    drawing = dots(rows, shown, f"fig-{name}", title, axis)
    return Plot(name, title, caption, drawing, (), columns, "case", axis, "y", metrics=[metric])
