"""Figures of divergence, calibration, modes and detectors, against scores and against counts written out."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import binomtest

from reports import curves, series
from reports.detectors import Detector
from reports.marks import marks
from reports.plots import calibration, divergence, modes, over_time
from reports.views import view
from suite.case import RECORDED
from suite.metrics import METRICS
from suite.metrics.calibration import pit_histogram

TIME = 0.5 * np.arange(1, 13)


@pytest.fixture(scope="module")
def drawn(variety):
    """A case with its view, the labels in their order and their marks."""
    case = variety.cases["easy/one"]
    seen = view(case, variety.labels)
    return case, seen, series.ranked(seen), marks(variety.labels)


def column(plot, head):
    return next(np.asarray(c.values, float) for c in plot.columns if c.head == head)


def test_estimators_are_ranked_by_place_then_by_value_and_behind_them_those_that_do_the_same(drawn):
    _, _, labels, _ = drawn
    assert labels[:3] == ["plain", "frail", "shifted"]  # one lost a run, the other is too sure of itself, and worse
    assert labels[3] == "twin"  # its errors are those of the first
    assert set(labels[4:]) == {"choosy", "broken"}


def test_only_figures_of_many_estimators_show_some_at_first():
    names = [str(i) for i in range(9)]
    assert series.first(names) == tuple(names[:8])
    assert series.first(names[:8]) == ()


def test_errors_at_the_level_of_rounding_are_told_and_not_drawn(drawn):
    case, _, _, look = drawn
    cell = case.cells["plain"]
    level = 1e-9 * np.linalg.norm(np.abs(cell.truth.x).max((0, 2))[[0, 2]])
    (line, *_) = series.over_time(case, METRICS["rmse"], ["plain"])["position"]
    assert line.negligible == pytest.approx(level)
    assert not line.rounding
    tiny = dataclasses.replace(line, value=np.full(12, 0.5 * level))
    plot = over_time._plot([tiny, dataclasses.replace(line, label="twin")], look, "x", "RMSE over time", "RMSE (m)", "rmse")
    assert "The errors of plain are rounding," in plot.caption
    assert plot.labels == ["twin"]
    assert 'data-series="0"' not in plot.drawing
    zero = dataclasses.replace(tiny, value=np.zeros(12))
    nothing = over_time._plot([tiny, zero], look, "x", "RMSE over time", "RMSE (m)", "rmse")
    assert (nothing.drawing, nothing.nothing) == (None, "all errors are at the level of rounding.")
    never = dataclasses.replace(line, value=np.zeros(12), negligible=0.0)
    all_zero = over_time._plot([never], look, "x", "RMSE over time", "RMSE (m)", "rmse")
    assert "The errors of all are zero" in all_zero.caption
    assert not dataclasses.replace(never, negligible=-np.inf).rounding  # such as a score of modes that is 0 at best


def test_the_share_of_diverged_runs_counts_those_that_are_away(drawn, monkeypatch):
    case, *_ = drawn
    cell = case.cells["plain"]
    away = np.array([np.inf, 3.0, 7.0, 3.0])
    monkeypatch.setitem(cell.evidence.__dict__, "away", away)
    value, low, high = divergence.over_time(cell)
    counts = [sum(a <= k for a in away) for k in range(1, 13)]
    np.testing.assert_allclose(value, np.array(counts) / 4)
    exact = [binomtest(n, 4).proportion_ci(0.95, "exact") for n in counts]
    np.testing.assert_allclose(low, [e.low for e in exact], atol=1e-12)
    np.testing.assert_allclose(high, [e.high for e in exact])


def test_the_last_share_of_diverged_runs_is_the_score(drawn):
    case, seen, labels, look = drawn
    (plot,) = divergence.figures(seen, labels, look)
    score = case.cells["frail"].scores(METRICS["divergence"])["runs"]
    assert score.value == 0.25
    assert plot.labels == ["frail"]
    ends = [column(plot, head)[-1] for head in ("frail", "frail, low", "frail, high")]
    assert ends == pytest.approx([score.value, score.low, score.high])
    assert "Of 4 estimators 3 never diverged" in plot.caption


def test_where_nothing_diverged_there_is_no_figure(drawn):
    _, seen, _, look = drawn
    assert not list(divergence.figures(seen, ["plain", "twin"], look))


def test_coverage_equals_its_scores(drawn):
    case, seen, labels, look = drawn
    (plot,) = calibration.coverage(seen, labels, look)
    for label in ("plain", "shifted", "frail"):
        for percent in (50, 90, 95):
            score = case.cells[label].scores(METRICS[f"coverage-{percent}"])["state"]
            at = column(plot, "probability").tolist().index(percent / 100)
            found = [column(plot, head)[at] for head in (label, f"{label}, low", f"{label}, high")]
            assert found == pytest.approx([score.value, score.low, score.high], abs=1e-12)


def test_histograms_are_those_of_the_transform(drawn):
    case, seen, labels, look = drawn
    (plot,) = calibration.histograms(seen, labels, look)
    for label in ("plain", "shifted", "frail"):
        for component, shares in pit_histogram(case.cells[label].evidence).items():
            np.testing.assert_allclose(column(plot, f"{label}, {component}"), shares)
    assert column(plot, "shifted, x").sum() == pytest.approx(1)


def test_a_recording_has_no_intervals_of_shares(drawn):
    case, seen, labels, look = drawn
    recorded = dataclasses.replace(case, card=dataclasses.replace(case.card, origin=RECORDED))
    recorded.cells = {name: dataclasses.replace(cell, case=recorded) for name, cell in case.cells.items()}
    seen = dataclasses.replace(seen, results=recorded)
    for made in (calibration.coverage, calibration.histograms):
        (plot,) = made(seen, labels, look)
        assert all(np.isnan(np.asarray(c.values, float)).all() for c in plot.columns if c.role in ("low", "high"))
        assert "no interval" in plot.caption


def test_a_mode_is_in_force_from_the_step_before_its_first_one_on():
    mode = np.array([0, 1, 1, 0, 1] + [0] * 7)
    spans = modes._spans(TIME, mode == 1)
    covered = np.concatenate([np.arange(begin, begin + length, 0.125) for begin, length in spans])
    for step, end in enumerate(TIME):
        inside = ((covered >= end - 0.5) & (covered < end)).sum()
        assert inside == (4 if mode[step] == 1 else 0)


def detector(label, alarms, found, **row):
    point = {"level": 0.1, "run_length": 90.0, "delay": 4.0, "detection": 0.8, "calm_runs": 20, "runs": 20} | row
    for name in ("run_length", "delay", "detection"):
        point |= {f"{name}_low": 0.5 * point[name], f"{name}_high": 2 * point[name]}
    return Detector(label, {"manoeuvre": (alarms, found)}, [point])


def test_curves_keep_their_points_and_slanting_parts_are_bent():
    x, y = np.array([0.0, 0.0, 0.5, 1.0]), np.array([0.0, 0.4, 0.4, 1.0])
    a, b = curves._bent(x, y)
    for corner in zip(x, y, strict=True):
        assert corner in set(zip(a.tolist(), b.tolist(), strict=True))
    along = a > 0.5
    np.testing.assert_allclose(b[along], 0.4 + 0.6 * (a[along] - 0.5) / 0.5)
    assert along.sum() == curves.PIECES
    assert (np.diff(a) >= 0).all()


def test_a_figure_of_curves_has_each_curve_over_its_own_rates():
    found = [detector("a", [0.0, 0.2, 1.0], [0.0, 0.9, 1.0]), detector("b", [0.0, 1.0], [0.0, 1.0])]
    plot = curves.roc(found, "manoeuvre", marks(["a", "b"]), "roc")
    rates = next(c for c in plot.columns if c.head == "a, detection rate")
    assert rates.over == "a, false-alarm rate"
    np.testing.assert_array_equal(rates.values, [0, 0.9, 1])
    np.testing.assert_array_equal(column(plot, "b, detection rate"), [0, 1, np.nan])
    assert "small false-alarm rates spread out" in plot.caption
    coarse = [detector("a", [0.0, 0.5, 1.0], [0.0, 0.9, 1.0])]
    assert "spread out" not in curves.roc(coarse, "manoeuvre", marks(["a"]), "roc").caption


def test_delay_is_drawn_where_thresholds_were_set_on_runs_without_manoeuvres():
    found = [detector("a", [0.0], [0.0]), detector("b", [0.0], [0.0], run_length=np.nan), detector("c", [0.0], [0.0])]
    plot = curves.delay(found, marks(["a", "b", "c"]), "delay")
    assert plot.labels == ["a", "c"]
    assert "Without a point: b." in plot.caption
    assert "an alarm comes in 10 % of them" in plot.caption
    assert column(plot, "delay of detection (s)").tolist() == [4, 4, 4]
    assert curves.delay([detector("a", [0.0], [0.0], calm_runs=0)], marks(["a"]), "delay") is None
