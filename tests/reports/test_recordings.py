"""Figures of recordings: irregular times, and a truth that has gaps or is not known."""

import dataclasses
import re

import numpy as np

from reports import series
from reports.marks import marks
from reports.plots import plane, runs
from suite.case import Card, Divergence, StateBlock, Truth
from suite.estimator import Estimate
from suite.metrics import METRICS
from suite.results import CaseResults, Cell

TIMES = (0.5, 2.0, 2.25, 9.0)
CARD = Card(
    name="mine", title="Mine", summary="", steps=4, interval=1.0, state=("x", "y"),
    blocks=(StateBlock("position", (0, 1), "m"),), divergence=Divergence("position", 5.0, 2), reference="",
    plane=(0, 1), times=TIMES,
)  # fmt: skip
OFF = (7.0, 1.0, 3.0)
"""How far the estimates of three runs are off on each axis."""


def results(x, off=OFF):
    """Results of one estimator on three runs of the truth x[T, n, R], off by so much; from 0 where it is not known."""
    case = CaseResults(CARD, 1, [])
    cell = Cell(case, "ekf", {})
    mean = np.nan_to_num(x) + np.array(off)
    cell.__dict__ |= {
        "runs": [0, 1, 2],
        "truth": Truth(x, np.zeros((4, 1, 3))),
        "estimate": Estimate(mean, np.ones((4, 2, 2, 3))),
    }
    case.__dict__ |= {"truth_of": {r: Truth(x[..., r], np.zeros((4, 1))) for r in range(3)}}
    case.cells["ekf"] = cell
    return case


def walked(*unknown):
    """A truth [T, n, R], with NaN at these steps."""
    x = np.cumsum(np.ones((4, 2, 3)), axis=0) * 100
    x[list(unknown)] = np.nan
    return x


def track(case):
    """The median run on the plane, or the only one that can be told."""
    found = plane.tracks(case, ["ekf"], runs.chosen(case, ["ekf"], CARD.plane))
    return next((each for each in found if each.which == runs.MEDIAN), found[0])


def test_lines_stand_at_the_times_of_the_steps():
    (line,) = series.over_time(results(walked()), METRICS["rmse"], ["ekf"])["position"]
    np.testing.assert_array_equal(line.time, TIMES)
    even = results(walked())
    even.card = dataclasses.replace(CARD, times=())
    (line,) = series.over_time(even, METRICS["rmse"], ["ekf"])["position"]
    np.testing.assert_array_equal(line.time, [1, 2, 3, 4])


def test_steps_of_unknown_truth_are_gaps_in_a_line():
    (line,) = series.over_time(results(walked(1)), METRICS["rmse"], ["ekf"])["position"]
    np.testing.assert_array_equal(np.isnan(line.value), [False, True, False, False])
    assert line.hidden == 1


def test_the_median_run_is_found_by_the_steps_that_are_known():
    assert track(results(walked(1))).run == 2
    assert track(results(walked(1), (3.0, 7.0, 1.0))).run == 0


def test_runs_of_unknown_truth_have_no_part_in_the_median():
    x = walked()
    x[..., 1] = np.nan
    assert track(results(x)).run == 2  # of 7 and 3 the lower
    assert track(results(walked(0, 1, 2, 3))).run == 0
    far = track(results(walked(), (1e200, 1e200, 1e200)))  # squares overflow, and are known to be large
    assert (far.run, far.known) == (1, True)


def test_a_place_is_known_by_both_its_coordinates():
    x = walked()
    x[:, 0], x[2, 0], x[2, 1] = np.nan, 3.0, np.nan
    assert not track(results(x)).known
    x[2, 1] = 4.0
    assert track(results(x)).known


def test_without_a_truth_the_estimates_are_drawn_where_they_are():
    found = track(results(walked(0, 1, 2, 3), (500.0, 500.0, 500.0)))
    found = dataclasses.replace(found, estimates={"ekf": found.estimates["ekf"] + np.arange(4.0)})
    drawing = str(plane.draw(found, CARD, marks(["ekf"]), "fig", "Plane"))
    ticks = [float(t) for t in re.findall(r"<text[^>]*>([\d.]+)</text>", drawing)]
    assert min(ticks) > 400
    assert max(ticks) < 600
    assert "start" in drawing
    nothing = dataclasses.replace(found, estimates={"ekf": np.full((2, 4), np.nan)})
    assert plane.draw(nothing, CARD, marks(["ekf"]), "fig", "Plane") is None


def test_a_truth_with_gaps_is_framed_where_it_is_known(monkeypatch):
    seen, frame = [], plane.frame
    monkeypatch.setattr(plane, "frame", lambda places, sites: seen.append(places) or frame(places, sites))
    plane.draw(track(results(walked(0, 2))), CARD, marks(["ekf"]), "fig", "Plane")
    np.testing.assert_array_equal(seen, [[[200, 400], [200, 400]]])
