"""Error against cost: what accuracy takes, particles swept, and which estimators nobody beats in both."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes

from reports import series, svg
from reports.canvas import HEIGHT, axes_of, drawing, dress, joined, log_limits, short, whiskers
from reports.marks import Mark
from reports.plot import Column, Plot
from reports.sentences import first_block
from reports.text import listed, number
from reports.views import PERCENT, CaseView, CellView
from suite.case import with_unit
from suite.linalg import Array
from suite.metrics import METRICS, Score
from suite.score import ROUNDING

FARTHEST = 5.0
"""So many times the median error of those that compete, or below it, the axis reaches."""
MOST_TOLD = 5
"""So many estimators are told one by one, more are counted."""
COSTS = {"latency": "latency of a step (µs)", "throughput": "time of a run-step, several runs together (µs)"}


@dataclass(frozen=True)
class Point:
    """An estimator with its cost and its error, each as value, low, high; competes: whether it may be called best."""

    label: str
    cost: tuple[float, float, float]
    error: tuple[float, float, float]
    competes: bool
    sweep: tuple[object, ...]
    particles: float

    def surely_beats(self, other: "Point") -> bool:
        """Whether it is cheaper and more accurate than another by intervals that do not meet."""
        return self.cost[2] < other.cost[1] and self.error[2] < other.error[1]


def latency(case: CaseView, place: int, labels: Sequence[str], marks: Mapping[str, Mark]) -> Iterator[Plot]:
    """The error of a state block, by its place, against the latency of a step."""
    yield from _figure(case, labels, marks, f"cost-{place}", "latency", case.card.blocks[place].name)


def throughput(case: CaseView, labels: Sequence[str], marks: Mapping[str, Mark]) -> Iterator[Plot]:
    """The error of the first state block against the time of a run-step."""
    yield from _figure(case, labels, marks, "cost-throughput", "throughput", first_block(case)[1])


def points(case: CaseView, labels: Sequence[str], cost: str, block: str) -> list[Point]:
    """The estimators that have both an error and a cost, in the order of the labels."""
    found = []
    for label in labels:
        cell = case.cells[label]
        error, spent = cell.scores.get(("rmse", block)), cell.scores.get((cost, "step"))
        if error and spent and math.isfinite(error.value) and math.isfinite(spent.value) and min(error.value, spent.value) > 0:
            parameters = cell.meta.get("parameters", {})
            particles = parameters.get("particles")
            others = tuple(sorted((name, str(value)) for name, value in parameters.items() if name != "particles"))
            sweep = (label.partition("[")[0], others)
            number = float(particles) if isinstance(particles, int) else math.nan
            found.append(Point(label, _cost(spent, cost), _ends(error), _competes(cell, block), sweep, number))
    return found


def _competes(cell: CellView, block: str) -> bool:
    return cell.competes(METRICS["rmse"]) and cell.scores["rmse", block].runs > 0


def _ends(score: Score) -> tuple[float, float, float]:
    return score.value, score.low, score.high


def _cost(score: Score, cost: str) -> tuple[float, float, float]:
    if cost == "latency":
        return _ends(score)
    with np.errstate(divide="ignore"):
        value, low, high = (1e6 / np.array([score.value, score.high, score.low])).tolist()
    return value, low, high


def front(found: Sequence[Point]) -> list[Point]:
    """Of those that compete the ones that no other is both cheaper and more accurate than, by their values; cheapest first."""
    best, kept = math.inf, []
    for point in sorted((p for p in found if p.competes), key=lambda p: (p.cost[0], p.error[0])):
        if point.error[0] < best * (1 - ROUNDING):
            best = point.error[0]
            kept.append(point)
    return kept


def possible(found: Sequence[Point]) -> list[Point]:
    """Those that compete and that no other competing one surely beats: the intervals let them be on the front."""
    rivals = [p for p in found if p.competes]
    return [p for p in rivals if not any(other.surely_beats(p) for other in rivals)]


def sweeps(found: Sequence[Point]) -> list[list[Point]]:
    """Estimators that differ in the number of particles alone, in its order."""
    groups: dict[tuple[object, ...], list[Point]] = {}
    for point in found:
        if not math.isnan(point.particles):
            groups.setdefault(point.sweep, []).append(point)
    return [sorted(group, key=lambda p: p.particles) for group in groups.values() if len(group) > 1]


def near_others(found: Sequence[Point]) -> list[Point]:
    """Points within the axes: errors far from the usual one of those that compete, or of all, would squeeze the others."""
    usual = float(np.median([p.error[0] for p in found if p.competes] or [p.error[0] for p in found]))
    return [p for p in found if usual / FARTHEST <= p.error[0] <= usual * FARTHEST]


def _figure(
    case: CaseView, labels: Sequence[str], marks: Mapping[str, Mark], name: str, cost: str, block: str
) -> Iterator[Plot]:
    found = points(case, labels, cost, block)
    if not found:
        return
    unit = case.card.block(block).unit
    x, y = COSTS[cost], with_unit(f"RMSE of {block}", unit)
    title = f"Error of {block} against {'latency' if cost == 'latency' else 'time of a run-step'}"
    columns = [Column("estimator", [p.label for p in found])]
    for head, role, over in ((x, "cost", ""), (y, "error", x)):
        ends: list[tuple[float, float, float]] = [getattr(p, role) for p in found]
        columns.append(Column(head, [each[0] for each in ends], over=over))
        columns += [Column(f"{head}, {end}", [each[i] for each in ends], role=end) for i, end in ((1, "low"), (2, "high"))]
    shown = [p.label for p in found]
    image = _draw(found, marks, f"fig-{name}", title, x, with_unit("RMSE", unit))
    caption = _caption(found, x, y, unit)
    best = [p.label for p in front(found)]
    leading = series.first([*best, *(label for label in shown if label not in best)])
    yield Plot(name, title, caption, image, shown, columns, x, y, "xy", first=leading, metrics=["rmse", cost])


def _caption(found: Sequence[Point], x: str, y: str, unit: str) -> str:
    said = f"{y} against {x}; low and left is good. The bars are {PERCENT} intervals over runs and over timed calls."
    if sweeps(found):
        said += " A line joins estimators that differ in the number of particles alone, in its order."
    near = near_others(found)
    beyond = [f"{p.label} at {number(p.error[0])} {unit}".rstrip() for p in found if p not in near]
    if beyond:
        said += f" Beyond the axis: {listed(beyond, MOST_TOLD)}."
    barred = [p.label for p in found if not p.competes]
    if barred:
        said += f" Hollow: {listed(barred, MOST_TOLD)}; lost or failed runs, or a remark, keep {_them(barred)} from any place."
    best = front(found)
    if len(found) - len(barred) < 2:
        return said
    said += f" The grey steps are the Pareto front of the values: {listed([p.label for p in best])}."
    by_name = {p.label for p in best}
    if not all(math.isfinite(end) for p in found for end in (*p.cost, *p.error) if p.competes):
        return f"{said} Without all intervals it cannot be told who else may be on it."
    others = [p.label for p in possible(found) if p.label not in by_name]
    if others:
        return f"{said} The intervals do not exclude from it {listed(others)}."
    return f"{said} Every other one that competes is beaten in both by one whose intervals are apart from its own."


def _them(names: Sequence[str]) -> str:
    return "it" if len(names) == 1 else "them"


def _draw(found: Sequence[Point], marks: Mapping[str, Mark], name: str, title: str, x: str, y: str) -> Markup:
    with drawing():
        axes = axes_of(height=HEIGHT + 0.6)
        axes.set_xscale("log")
        axes.set_yscale("log")
        near = near_others(found)
        axes.set_xlim(log_limits(joined([p.cost for p in near]), 1.6))
        values = np.array([p.error[0] for p in near])
        ends = joined([p.error for p in near])
        axes.set_ylim(log_limits(np.clip(ends, values.min() / 2, values.max() * 2), 1.25))
        best = front(found)
        if len([p for p in found if p.competes]) > 1:
            _steps(axes, best)
        for group in sweeps(found):
            mark = marks[group[0].label]
            (line,) = axes.plot([p.cost[0] for p in group], [p.error[0] for p in group], lw=1.1, color=svg.colour(mark.colour))
            line.set_gid(f"series-{mark.series}-sweep")
        for point in found:
            mark = marks[point.label]
            at = [np.array([value]) for value in (point.cost[0], point.error[0])]
            whiskers(axes, *at, mark, *(np.array(ends[1:])[:, None] for ends in (point.cost, point.error)))
            colour = svg.colour(mark.colour)
            look = {"mfc": colour, "mew": 0} if point.competes else {"mfc": svg.PAPER, "mec": colour, "mew": 1.4}
            (dot,) = axes.plot(*at, mark.marker, color=colour, ms=7, zorder=3, **look)
            dot.set_gid(f"series-{mark.series}-point")
        _names(axes, [*best, *(p for p in found if p not in best)], found, marks)
        axes.set_xlabel(x)
        axes.set_ylabel(y)
        dress(axes)
        return svg.inline(axes.figure, name, title, f"{y} over {x} of {', '.join(p.label for p in found)}")


def _steps(axes: Axes, best: Sequence[Point]) -> None:
    """The border of what the front attains."""
    cost, error = [p.cost[0] for p in best], [p.error[0] for p in best]
    x, y = [cost[0], *cost, axes.get_xlim()[1]], [axes.get_ylim()[1], *error, error[-1]]
    axes.step(x, y, where="post", color=svg.INK, alpha=0.35, lw=2.2, zorder=0.8)


SIGN, LINE = 6.6, 12.0
"""Width of a sign and height of a line of a name in a drawing, in points."""


def _names(axes: Axes, wanted: Sequence[Point], found: Sequence[Point], marks: Mapping[str, Mark]) -> None:
    """Names beside the points, where they meet neither a point nor another name: the legend has them all."""
    box = axes.get_position()
    width, height = axes.figure.get_size_inches() * 72
    inside = np.array([width * box.width, height * box.height])
    to_points = axes.transScale.transform
    low, high = to_points([axes.get_xlim()[0], axes.get_ylim()[0]]), to_points([axes.get_xlim()[1], axes.get_ylim()[1]])

    def placed(point: Point) -> Array:
        return np.asarray((to_points([point.cost[0], point.error[0]]) - low) / (high - low) * inside)

    taken = [np.array([*(placed(p) - 5), *(placed(p) + 5)]) for p in found]
    for point in wanted[: series.SHOWN_FIRST]:
        at, long = placed(point), SIGN * len(short(point.label))
        for dx, dy in ((-long / 2, 11), (-long / 2, -12), (8, 0), (-8 - long, 0)):
            corner = at + np.array([dx, dy - LINE / 2])
            area = np.concatenate([corner, corner + np.array([long, LINE])])
            fits = (area[:2] >= 0).all() and (area[2:] <= inside).all()
            if fits and not any(_meet(area, other) for other in taken):
                taken.append(area)
                text = axes.annotate(
                    short(point.label), (point.cost[0], point.error[0]), (dx, dy), textcoords="offset points",
                    va="center", ha="left", fontsize=9.5, zorder=4,
                )  # fmt: skip
                text.set_gid(f"series-{marks[point.label].series}-name")
                break


def _meet(a: Array, b: Array) -> bool:
    """Whether two areas (left, bottom, right, top) overlap."""
    return bool((a[:2] < b[2:]).all() and (b[:2] < a[2:]).all())
