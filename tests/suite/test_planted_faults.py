"""Filters with planted faults, run, scored and reported as a user would: each fault is named, none is marked."""

import contextlib
import html
import io
import json
import re

import pandas
import pytest

import cases
import suite.cli
import suite.run
from estimators.kalman import Kalman
from suite.metrics import METRICS
from suite.score import BEST, TIED
from tests.conftest import PLUGINS, InlinePool
from tests.plugins.planted import GATE

FAULTS = {
    "sign-error": {
        "diverges": "diverged in 100 of 100 runs",
        "misled": "larger than without any measurement",
        "optimistic": "times what its covariance says",
    },
    "oracle": {"too good": "of a bound that no estimator can beat"},
    "one-step-late": {"late": "steps behind the truth", "optimistic": "times what its covariance says"},
    "overconfident": {"optimistic": "times what its covariance says"},
    "timid": {"pessimistic": "of what its covariance says"},
    "fragile": {"failed": "failed in"},
}
"""What is said of each: in the words of the page's tags, and of its sentences."""
RUNS = 100
TIMED = [name for name, metric in METRICS.items() if metric.timed]


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """The folder of results of all planted faults, with two right filters beside them."""
    folder = tmp_path_factory.mktemp("planted")
    names = ["kalman", "ukf", *FAULTS]
    command = ["run", "--plugin", PLUGINS / "planted.py", "-c", "linear-gaussian", "-e", *names]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(suite.run, "ProcessPool", InlinePool)
        assert suite.cli.main([str(a) for a in [*command, "--runs", RUNS, "--block", 20, "--results", folder / "results"]]) == 1
    return folder / "results"


@pytest.fixture(scope="module")
def scores(results):
    """Rows of all scores."""
    with contextlib.redirect_stdout(io.StringIO()) as out:
        assert suite.cli.main(["score", "--format", "json", "--results", str(results)]) == 0
    return pandas.DataFrame(json.loads(out.getvalue()))


def test_each_fault_is_named_in_the_scores(scores):
    remarks = scores.groupby("estimator")["remarks"].first()
    assert remarks["kalman"] == remarks["ukf"] == ""
    for name, words in FAULTS.items():
        said = remarks[name].split("; ")
        assert len(said) == len(words), said
        assert all(any(part in remark for remark in said) for part in words.values()), said


def test_none_is_marked_in_anything_but_running_times(scores):
    marked = scores[scores.standing.isin([BEST, TIED]) & ~scores.metric.isin(TIMED)]
    assert set(marked.estimator) == {"kalman", "ukf"}
    for (metric, block), rows in marked.groupby(["metric", "block"]):
        assert set(rows.estimator) >= {"kalman"}, (metric, block)
    assert set(marked.metric) >= {"rmse", "crlb-ratio", "nees", "lag", "divergence", "loglik"}


def test_failures_are_counted_where_the_data_brings_them_about(scores):
    """As many as first measurements that lie outside the gate of the fragile filter."""
    case = cases.CASES["linear-gaussian"]
    y = case.simulate(RUNS, seed=1).y
    count = int((abs(Kalman().run(case.model, y).innovation[0, 0]) > GATE).sum())
    assert count > 0  # 3 are expected
    row = scores[scores.estimator == "fragile"].iloc[0]
    assert (row.status, row.failed, row.lost) == ("partly failed", count, 0)
    assert row.remarks == f"failed in {count} of {RUNS} runs"


def test_the_case_page_names_each_fault_beside_its_estimator(cli, results, scores, tmp_path):
    assert cli("report", "--results", results, "--out", tmp_path / "site").code == 0
    page = next((tmp_path / "site").glob("*linear-gaussian.html")).read_text(encoding="utf-8")
    for name in ("kalman", "ukf", *FAULTS):
        row = re.search(rf'<tr id="{name}".*?</tr>', page, re.DOTALL)
        assert row
        assert set(re.findall(r'<span class="tag\b[^>]*>([^<]*)<', row[0])) == set(FAULTS.get(name, {}))
    text = html.unescape(re.sub(r"<[^>]*>", "", page))
    for sentence in {sentence for remarks in scores.remarks for sentence in remarks.split("; ") if sentence}:
        assert sentence in text
