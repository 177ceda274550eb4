"""What pages say of estimators that are wrong: named, never marked, and the bound and chance bands told as what they are."""

import dataclasses
import re
from html import unescape

import numpy as np
import pytest
from scipy.stats import chi2

from estimators import ESTIMATORS
from reports import series
from reports.frame import Frame
from reports.pages import case
from reports.sentences import against_bound, headline
from reports.views import private, view
from suite import bounds
from suite.case import RECORDED
from suite.diagnosis import Remark
from suite.estimator import Estimate
from suite.metrics import METRICS
from suite.results import CaseResults
from tests.reports.conftest import Scripted, Written, matrix, rendered, small_case
from tests.reports.test_recordings import results, walked


class Exact(Scripted):
    """The Kalman filter, which is right, but for the runs in which it fails."""

    def run(self, model, y, seed):
        estimate, failing = ESTIMATORS["kalman"].run(model, y, seed), super().run(model, y, seed)
        return dataclasses.replace(estimate, status=failing.status, reason=failing.reason)


class Oracle(Scripted):
    """Knows the truth of the small case, but for a hundredth of a unit."""

    def run(self, model, y, seed):
        truth = small_case("easy").simulate(y.shape[2], 1).x
        noise = np.random.default_rng(1).normal(0, 0.01, truth.shape)
        cov = np.broadcast_to(1e-4 * np.eye(4)[:, :, None], (len(truth), 4, 4, y.shape[2])).copy()
        return Estimate(truth + noise, cov)


@pytest.fixture(scope="module")
def faulty(tmp_path_factory):
    """A sound estimator, one that is too good to be true, one that is misled, one that fails in a run and one that refuses."""
    estimators = [
        Exact("near"),
        Oracle("oracle"),
        Scripted("far", shift=500.0),
        Exact("frail", bad=(1,)),
        Scripted("choosy", refusal="too hard"),
    ]
    return Written(tmp_path_factory.mktemp("faulty") / "r").add([small_case("easy")], estimators, runs=8).load()


@pytest.fixture(scope="module")
def page(faulty):
    return rendered(faulty)["case-easy.html"]


@pytest.fixture(scope="module")
def shown(faulty):
    return view(private(faulty.cases["easy"]), faulty.labels)


def plain(markup):
    return " ".join(unescape(re.sub(r"<[^>]*>", " ", markup)).split())


def table(page, family):
    """A family's table: the text of each cell of each row, by estimator."""
    markup = re.search(rf'<table class="scores sortable" id="scores-{family}">.*?</table>', page, re.S)[0]
    rows = re.findall(r"<tr.*?</tr>", markup.partition("<tbody>")[2], re.S)
    found = [[plain(cell) for cell in re.findall(r"<t[hd].*?</t[hd]>", row, re.S)] for row in rows]
    return {cells[0].split()[0]: cells for cells in found}


def test_faults_stand_beside_the_name_and_in_words_below(page):
    rows = table(page, "first")
    assert rows["near"][0] == "near"
    assert rows["oracle"][0].startswith("oracle too good")
    assert "optimistic" in rows["far"][0]
    assert rows["frail"][0] == "frail failed"
    told = plain(re.search(r'<ul class="warned">.*?</ul>', page, re.S)[0])
    assert re.search(r"oracle : too good RMSE of position only \S+ \(\S+ to \S+\) of a bound that no estimator can beat", told)
    assert "frail : failed in 1 of 8 runs. What went wrong: gone (1 run, step 3) ( details )." in told
    assert "near" not in told
    assert 'title="failed in 1 of 8 runs">failed</span>' in page


def test_who_is_barred_is_never_marked_and_the_smallest_value_says_so(page):
    rows = table(page, "first")
    untimed = [cell for label in ("oracle", "frail") for cell in rows[label][:-1]]
    assert all("best" not in cell.split() for cell in untimed)
    assert "smallest, not ranked" in rows["oracle"][2]
    of_errors = [cells[column] for cells in rows.values() for column in (2, 3)]
    assert sum("not ranked" in cell for cell in of_errors) == 2
    assert rows["near"][2].endswith(" best")
    assert "largest, not ranked" in table(page, "bound")["oracle"][3]
    assert "not ranked" not in " ".join(table(page, "cost")["oracle"])
    assert "competes for neither" in plain(page)


def test_errors_below_the_bound_are_flagged(page):
    assert "below the bound: too good" in table(page, "bound")["oracle"][1]
    assert "below the bound" not in " ".join(table(page, "bound")["near"])


def test_chance_below_the_bound_is_called_so(faulty, monkeypatch):
    """Where nothing is sure, an interval below one may be chance; where the bound is none, it is nothing."""
    monkeypatch.setattr("reports.views.remarks", lambda cell: [Remark("optimistic", "too sure of itself", True)])
    assert "below the bound: chance, or too good" in table(rendered(faulty)["case-easy.html"], "bound")["oracle"][1]
    stored = faulty.cases["easy"].bounds[0]
    monkeypatch.setattr(CaseResults, "bounds", [dataclasses.replace(stored, reason="a given track")])
    loose = rendered(faulty)["case-easy.html"]
    assert "below the bound" not in plain(loose)
    assert "Ratios below 1 mean nothing here: a given track." in plain(loose)
    assert 'id="ratio-0"' not in loose


def test_a_bound_is_told_above_its_table(faulty):
    stored = faulty.cases["easy"].bounds[0]

    def told(kind, reason=""):
        return against_bound([dataclasses.replace(stored, kind=kind, reason=reason)])

    assert told(bounds.POSTERIOR).endswith("a ratio whose interval lies below 1 is flagged.")
    assert told(bounds.KNOWN_MODES).startswith(
        "Errors are held against the Cramér-Rao bound of filters that are told the modes. In"
    )
    assert told(bounds.CONDITIONAL, "no noise").endswith("(no bound). Ratios below 1 mean nothing here: no noise.")
    assert told(bounds.BEST_FIT).endswith("Ratios below 1 mean nothing here.")
    assert told(bounds.NONE, "no noise") == "There is no bound: no noise."
    assert against_bound([]) == "No bound is stored for this case."


def test_each_family_has_its_table_and_the_first_has_all_that_were_tried(page, faulty):
    families = re.findall(r'<table class="scores sortable" id="scores-([a-z]+)">', page)
    assert families[:2] == ["first", "error"]
    assert {"bound", "consistency", "robustness", "cost"} <= set(families)
    assert list(table(page, "first")) == [label for label in faulty.labels if label != "choosy"]
    assert all("choosy" not in table(page, family) for family in families)
    assert plain(page).count("Refused (too hard): choosy") == 1
    for label in faulty.labels:
        assert page.count(f'id="{label}"') == 1
    folded = re.findall(r'<details class="family" id="family-([a-z]+)">', page)
    assert folded == families[1:]


def test_estimators_without_any_score_of_a_family_are_named_below_its_table(tools, tmp_path):
    loaded = tools.written(tmp_path / "r").add([tools.case()], [tools.scripted("a"), tools.scripted("b")]).load()
    cell = loaded.cases["easy"].cells["b"]
    cell.timings = []
    page = case.files(Frame.of(loaded), loaded.cases["easy"], {})["case-easy.html"]
    assert list(table(page, "cost")) == ["a"]
    assert "Without any of these: b." in plain(page)


def test_the_overview_names_faults_and_neither_marks_nor_shades_them(faulty):
    files = rendered(faulty)
    data = matrix(files)
    timed = tuple(metric.title for metric in METRICS.values() if metric.timed)
    marked = 0
    for choice, (near, oracle, far, frail, _) in zip(data["choices"], data["cells"][0], strict=True):
        if choice["title"].startswith(timed):
            assert {cell[0] for cell in (near, oracle, far)} <= {"done", "absent"}
            assert frail[0] in ("barred", "absent")  # it failed in a run
            continue
        marked += near[4] != ""
        for cell in (oracle, far, frail):
            assert cell[0] != "done"
            assert cell[4] == cell[6] == ""
    assert marked
    assert data["cells"][0][0][0][6] == "shade-0"  # of those that compete near is the smallest
    cells = re.findall(r"<td class=.*?</td>", files["index.html"], re.S)
    assert '<span class="tag bars">too good</span>' in cells[1]
    assert any(data["texts"][i].startswith("too good: RMSE of position only") for i in data["said"][0][1])
    assert "tag" not in cells[0]


def test_the_headline_names_who_is_left_out_and_counts_faults(shown):
    accuracy, runs, _ = headline([shown])
    assert re.fullmatch(
        r"On easy, near has the smallest RMSE of position \(.* m\), leaving out oracle \(too good\) and frail \(failed\)\.",
        accuracy,
    )
    assert "In 2 of 4 combinations that ran, scores show a fault of the estimator (" in runs
    assert "too good in 1" in runs
    many = [dataclasses.replace(shown) for _ in range(4)]
    assert "in 4 cases one that is not ranked, for its failures or faults, has a smaller value" in headline(many)[0]


def test_nobody_is_ahead_where_nobody_is_ranked(shown):
    assert [cell.label for cell in shown.ahead(("rmse", "position"))] == ["oracle", "frail"]
    assert shown.ahead(("latency", "step")) == []
    assert shown.ahead(("rmse", "no such block")) == []
    recorded = dataclasses.replace(shown.results, card=dataclasses.replace(shown.card, origin=RECORDED))
    assert dataclasses.replace(shown, results=recorded).ahead(("rmse", "position")) == []


def test_the_figure_of_consistency_has_the_band_of_chance(page):
    figure = re.search(r'<figure id="nees".*?</figure>', page, re.S)[0]
    assert figure.count('class="chance"') == 1
    assert "NEES / 4" in figure
    assert "average over 8 runs of a filter that is right: chi-square of 8 × 4 degrees of freedom, over 32." in plain(figure)
    low, high = chi2.ppf([0.025, 0.975], 32) / 32
    assert plain(re.findall(r"<tr>.*?</tr>", figure, re.S)[1]).split()[-2:] == [f"{low:.3f}", f"{high:.2f}"]
    assert 'class="chance"' not in re.search(r'<figure id="rmse-0".*?</figure>', page, re.S)[0]


def test_the_band_is_of_the_runs_and_components_that_count():
    nees = METRICS["nees"]
    band = series.band(results(walked()), nees, ["ekf"])
    np.testing.assert_allclose(band.low, np.full(4, chi2.ppf(0.025, 6) / 6))
    assert (band.runs, band.dimension) == (3, 2)
    gap = walked()
    gap[1, :, 0] = np.nan
    np.testing.assert_allclose(series.band(results(gap), nees, ["ekf"]).high[:2], chi2.ppf(0.975, [6, 4]) / [6, 4])
    recorded = results(walked())
    recorded.card = dataclasses.replace(recorded.card, origin=RECORDED)
    np.testing.assert_allclose(series.band(recorded, nees, ["ekf"]).high, np.full(4, chi2.ppf(0.975, 2) / 2))
    assert series.band(results(walked()), METRICS["nis"], ["ekf"]) is None


def test_the_band_of_innovations_counts_what_was_measured():
    """Two components at the first step, one at the second; none is told where runs differ, or nothing was measured."""
    case = results(walked())
    innovation = np.ones((4, 2, 3))
    innovation[1, 0] = innovation[2, 0, 0] = innovation[3] = np.nan
    case.cells["ekf"].estimate.innovation = innovation
    band = series.band(case, METRICS["nis"], ["ekf"])
    np.testing.assert_allclose(band.low, [*chi2.ppf(0.025, [6, 3]) / [6, 3], np.nan, np.nan])
    assert (band.runs, band.dimension) == (3, 2)
