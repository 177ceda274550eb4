"""Error against cost: the Pareto front by values and by intervals, sweeps over particles, and what the caption says."""

import itertools
import math
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from reports.marks import marks
from reports.plots import cost
from reports.plots.cost import Point, front, possible, sweeps
from reports.views import CellView
from suite.metrics import Score


def point(label, spent, error, competes=True, wide=0.0, particles=math.nan, sweep=()):
    ends = [(x, x * (1 - wide), x * (1 + wide)) for x in (spent, error)]
    return Point(label, *ends, competes, sweep or (label,), particles)


def labels(points):
    return [p.label for p in points]


def test_the_front_has_those_that_nobody_beats_in_both():
    """Against the definition, over random points."""
    rng = np.random.default_rng(3)
    for _ in range(50):
        found = [point(str(i), *rng.uniform(1, 9, 2), competes=bool(rng.random() < 0.7)) for i in range(12)]
        rivals = [p for p in found if p.competes]
        wanted = [
            p for p in rivals
            if not any(o.cost[0] <= p.cost[0] and o.error[0] <= p.error[0] and o is not p for o in rivals)
        ]  # fmt: skip
        assert set(labels(front(found))) == set(labels(wanted))
        assert labels(front(found)) == labels(sorted(wanted, key=lambda p: p.cost[0]))


def test_rounding_puts_nobody_on_the_front():
    assert labels(front([point("a", 1, 5.0), point("b", 2, 5.0 * (1 - 1e-9)), point("c", 3, 4.9)])) == ["a", "c"]


def test_what_intervals_do_not_exclude_may_be_on_the_front():
    found = [point("a", 1, 1, wide=0.1), point("near", 1.1, 1.1, wide=0.1), point("far", 5, 5, wide=0.1)]
    assert labels(front(found)) == ["a"]
    assert labels(possible(found)) == ["a", "near"]
    for one_sided in (point("as cheap", 1.1, 5, wide=0.1), point("as good", 5, 1.1, wide=0.1)):
        assert possible([*found, one_sided])[-1] is one_sided  # apart in one of the two alone
    assert labels(possible([*found, point("one", 5, 0.5, wide=0.1)])) == ["a", "near", "one"]


def test_one_that_is_barred_is_on_no_front_and_beats_nobody():
    found = [point("barred", 1, 1, competes=False), point("a", 2, 2), point("b", 3, 1.5)]
    assert labels(front(found)) == ["a", "b"]
    assert labels(possible(found)) == ["a", "b"]


def test_sweeps_join_what_differs_in_particles_alone():
    same, other = ("sir", ()), ("sir", (("scheme", "residual"),))
    found = [
        point("sir[particles=900]", 9, 1, particles=900.0, sweep=same),
        point("sir[particles=10]", 1, 3, particles=10.0, sweep=same),
        point("sir[particles=10,scheme=residual]", 1, 3, particles=10.0, sweep=other),
        point("ekf", 1, 3),
        point("sir[particles=100]", 3, 2, particles=100.0, sweep=same),
    ]
    assert [labels(each) for each in sweeps(found)] == [["sir[particles=10]", "sir[particles=100]", "sir[particles=900]"]]


def cell(label, rmse, latency, throughput=1000.0, bars=(), **parameters):
    def score(value, unit):
        return Score(value, 0.9 * value, 1.1 * value, unit, 5, 5)

    scores = {("rmse", "position"): score(rmse, "m"), ("latency", "step"): score(latency, "µs")}
    scores |= {("throughput", "step"): score(throughput, "run-steps/s")}
    return CellView(label, "done", "", bars[0] if bars else 0, 0, 5, scores, meta={"parameters": parameters})


@pytest.fixture
def drawn(tools):
    """The figure of some cells."""

    def draw(*cells, which=cost.latency):
        card = tools.case()
        case = type("Case", (), {"card": card, "cells": {c.label: c for c in cells}})()
        names = [c.label for c in cells]
        arguments = (case, 0) if which is cost.latency else (case,)
        (plot,) = which(*arguments, names, marks(names))
        return plot

    return draw


def test_the_caption_names_the_front_and_who_else_may_be_on_it(drawn):
    plot = drawn(cell("a", 1, 1), cell("b", 1.05, 1.05), cell("c", 9, 9), cell("d", 0.5, 5))
    assert "the Pareto front of the values: a and d." in plot.caption
    assert "The intervals do not exclude from it b." in plot.caption
    plot = drawn(cell("a", 1, 1), cell("c", 9, 9))
    assert "Every other one that competes is beaten in both by one whose intervals are apart from its own." in plot.caption


def test_of_many_estimators_those_of_the_front_are_shown_at_first(drawn):
    plot = drawn(*(cell(str(i), 2 + i, 9) for i in range(9)), cell("cheap", 30, 1))
    assert plot.labels[-1] == "cheap"
    assert set(plot.first) == {"cheap", *map(str, range(7))}


def test_without_intervals_nothing_is_excluded(drawn):
    alone = cell("a", 1, 1)
    alone.scores["rmse", "position"] = Score(1.0, math.nan, math.nan, "m", 1, 1)
    assert "cannot be told who else" in drawn(alone, cell("c", 9, 9)).caption


def test_one_that_competes_alone_makes_no_front(drawn):
    plot = drawn(cell("a", 1, 1), cell("lost", 9, 9, bars=(2,)))
    assert "front" not in plot.caption
    assert "Hollow: lost;" in plot.caption


def test_errors_far_from_the_usual_are_beyond_the_axis_and_told(drawn):
    plot = drawn(cell("a", 1, 1), cell("b", 2, 2), cell("c", 2, 3), cell("wild", 5000, 3))
    assert "Beyond the axis: wild at 5000 m." in plot.caption
    ticks = [float(text) for text in re.findall(r"<text[^>]*>([\d.]+)</text>", plot.drawing)]
    assert max(ticks) < 100


def test_the_time_of_a_run_step_is_one_over_the_throughput(drawn):
    plot = drawn(cell("a", 1, 1, throughput=2000.0), which=cost.throughput)
    named = {column.head: column.values[0] for column in plot.columns}
    head = "time of a run-step, several runs together (µs)"
    assert named[head] == pytest.approx(500)
    assert named[f"{head}, low"] == pytest.approx(1e6 / 2200)
    assert named[f"{head}, high"] == pytest.approx(1e6 / 1800)


def test_names_in_the_drawing_do_not_overlap_and_stay_text(drawn):
    cells = [cell(f"estimator {i} <b>", 5 + 0.01 * (i % 3), 100 + 3 * i) for i in range(14)]
    plot = drawn(*cells)
    tree = ET.fromstring(plot.drawing)
    texts = [e for e in tree.iter("{http://www.w3.org/2000/svg}text") if (e.text or "").startswith("estimator")]
    places = [(float(t.get("x")), float(t.get("y"))) for t in texts]
    assert len(places) >= 2
    width, height = 5.0 * len("estimator 0 <b>"), 8.0
    for (ax, ay), (bx, by) in itertools.combinations(places, 2):
        assert abs(ax - bx) > width or abs(ay - by) > height


def test_what_has_no_cost_or_no_error_has_no_point(tools):
    free = cell("free", 1, 1)
    del free.scores["latency", "step"]
    case = type("Case", (), {"card": tools.case(), "cells": {"free": free, "zero": cell("zero", 0.0, 1)}})()
    assert cost.points(case, ["free", "zero"], "latency", "position") == []
    assert list(cost.latency(case, 0, ["free", "zero"], marks(["free", "zero"]))) == []
