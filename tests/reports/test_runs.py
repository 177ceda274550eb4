"""The runs of a case one by one: which are drawn on the plane, and the table of their errors."""

import re

import numpy as np
import pandas
import pytest

from reports.marks import marks
from reports.pages.case_figures import case_figures
from reports.plots import plane, runs
from reports.views import view
from suite.metrics import METRICS
from tests.reports.conftest import Scripted, Written, small_case


@pytest.fixture(scope="module")
def several(tmp_path_factory):
    """A case with seven runs of three estimators, one of which is lost in run 3, and its figures."""
    folder = tmp_path_factory.mktemp("several") / "results"
    estimators = [Scripted("plain"), Scripted("shifted", shift=30.0), Scripted("frail", bad=(3,), status="lost")]
    loaded = Written(folder).add([small_case()], estimators, runs=7).load()
    case = loaded.cases["easy"]
    return case, case_figures(view(case, loaded.labels), marks(loaded.labels))


def error_of(cell, place):
    """The root mean square error on the plane of one run, written out."""
    error = (cell.estimate.mean - cell.truth.x)[:, [0, 2], place]
    return np.sqrt(np.mean(np.sum(error**2, axis=1)))


def test_the_best_the_median_and_the_worst_run_are_those_of_the_usual_estimator(several):
    """Each error is over the estimator's own median, so that one with large errors has no more say than another."""
    case, _ = several
    relative = {run: [] for run in range(7)}
    for cell in case.cells.values():
        errors = {run: error_of(cell, run) for run in range(7) if cell.estimate.status[run] == "ok"}
        usual = np.quantile(list(errors.values()), 0.5, method="inverted_cdf")
        for run, error in errors.items():
            relative[run].append(error / usual)
    order = sorted(relative, key=lambda run: np.median(relative[run]))
    found = runs.chosen(case, list(case.cells), (0, 2))
    assert found == {"best": order[0], "median": order[3], "worst": order[6]}


def test_each_of_them_has_its_figure_that_says_which_run_it_is(several):
    case, drawn = several
    picked = runs.chosen(case, list(case.cells), (0, 2))
    assert [plot.id for plot in drawn.planes] == ["plane-best", "plane-median", "plane-worst"]
    for plot, run in zip(drawn.planes, picked.values(), strict=True):
        assert plot.caption.startswith(f"Run {run}, the run ")
        truth = next(column for column in plot.columns if column.head == "truth y")
        np.testing.assert_array_equal(truth.values, case.truth_of[run].x[:, 2])
        assert truth.over == "truth x"
    lost = next(plot for plot, run in zip(drawn.planes, picked.values(), strict=True) if run != 3)
    assert "frail" in lost.labels


def test_an_estimator_that_did_not_come_through_a_run_is_named_there(several):
    case, _ = several
    (track,) = plane.tracks(case, list(case.cells), {"worst": 3})
    assert track.missing == ("frail",)
    assert "frail" not in track.estimates


def test_what_leaves_the_picture_is_counted(several):
    case, _ = several
    (track,) = plane.tracks(case, ["plain"], {"worst": 0})
    shown = plane.View.of(track, case.card)
    inside = track.truth.copy()
    assert shown.outside(inside) == 0
    inside[0, 2], inside[1, 5] = 1e9, -1e9
    inside[:, 7] = np.nan
    assert shown.outside(inside) == 2


def test_two_runs_are_the_best_and_the_worst_and_one_is_both(tools, tmp_path):
    for count, which in ((2, ["best", "worst"]), (1, ["median"])):
        loaded = tools.written(tmp_path / str(count)).add([tools.case()], [tools.scripted()], runs=count).load()
        assert list(runs.chosen(loaded.cases["easy"], ["plain"], (0, 2))) == which


def test_the_table_of_runs_has_the_errors_that_the_metric_averages(several):
    case, drawn = several
    table = drawn.runs
    assert [run for run, *_ in table.rows] == list(range(7))
    for place, label in enumerate(table.labels):
        values = case.cells[label].contributions(METRICS["run-rmse"])["position"][0]
        for run, _, cells in table.rows:
            value, wrong = cells[place]
            if label == "frail" and run == 3:
                assert (value, wrong) == ("", "lost")
            else:
                assert float(value) == pytest.approx(values[run], rel=5e-3)
                assert wrong == ""


def test_a_run_that_diverged_is_marked(tools, tmp_path):
    loaded = tools.written(tmp_path / "r").add([tools.case()], [tools.scripted("off", shift=5000.0)], runs=3).load()
    table = runs.table(view(loaded.cases["easy"], ["off"]), ["off"], {})
    assert [cells[0][1] for _, _, cells in table.rows] == ["diverged"] * 3


def test_many_runs_are_cut_and_it_is_said(several, monkeypatch):
    monkeypatch.setattr(runs, "MOST_RUNS", 5)
    case, _ = several
    table = runs.table(view(case, list(case.cells)), list(case.cells), {"worst": 6})
    assert len(table.rows) == 5
    assert table.left == 2
    assert table.example == 0


def test_the_lines_that_load_a_run_give_that_run(several, monkeypatch):
    case, drawn = several
    monkeypatch.chdir(case.truths[0].path.parents[3])
    said = {}
    exec(drawn.runs.load, said)
    run = drawn.runs.example
    assert run == runs.chosen(case, list(case.cells), (0, 2))["median"]
    np.testing.assert_array_equal(np.stack(said["truth"]["truth"].to_list()), case.truth_of[run].x)
    mean = said["estimates"].get_group("plain")["mean"]
    cell = case.cells["plain"]
    np.testing.assert_array_equal(np.stack(mean.to_list()), cell.estimate.mean[:, :, cell.runs.index(run)])
    assert isinstance(said["rows"], pandas.DataFrame)
    assert set(said["estimates"].groups) == {"plain", "shifted", "frail"}


def test_each_row_of_the_page_can_be_linked_to(site):
    page = (site / "case-easy-one.html").read_text(encoding="utf-8")
    assert re.findall(r'<tr id="run-(\d+)"', page) == ["0", "1", "2", "3"]
    assert page.count('class="picked"') == 3
