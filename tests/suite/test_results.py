"""What a results folder holds, read back: versions, cells, plug-ins that are gone."""

import json
import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from suite import plan, store
from suite.metrics import METRICS
from suite.results import load
from tests.reports.conftest import Scripted, Written, small_case

TINY = Path(__file__).resolve().parents[1] / "plugins" / "tiny.py"


@pytest.fixture
def results(tmp_path):
    return tmp_path / "results"


def scores(cli, results, *arguments):
    said = cli("score", "--results", results, "--format", "json", *arguments)
    assert (said.code, said.errors) == (0, [])
    return {(r["case"], r["estimator"], r["metric"], r["block"]): r for r in json.loads(said.out)}


def test_what_was_stored_comes_back(tiny, results):
    assert tiny("-e", "smoothed", "kalman").code == 0
    loaded = load(results, ["tiny"], ["kalman", "smoothed"])
    case = loaded.cases["tiny"]
    assert (list(case.cells), loaded.labels) == (["kalman", "smoothed"], ["kalman", "smoothed"])
    assert (case.seed, case.card.steps, len(case.truths), loaded.superseded, loaded.damages) == (1, 20, 2, 0, [])
    cell = case.cells["kalman"]
    assert cell.runs == [0, 1, 2, 3]
    assert cell.truth.x.shape == (20, 2, 4)
    assert cell.truth.y.shape == (20, 1, 4)
    assert cell.estimate.mean.shape == (20, 2, 4)
    assert cell.estimate.cov.shape == (20, 2, 2, 4)
    np.testing.assert_array_equal(cell.estimate.cov, cell.estimate.cov.swapaxes(1, 2))
    assert cell.counts == {"ok": 4, "lost": 0, "failed": 0}
    assert cell.timing is not None


def test_the_numbers_that_come_back_are_those_of_the_estimator(tiny, results):
    assert tiny("-e", "last").code == 0
    cell = load(results).cases["tiny"].cells["last"]
    np.testing.assert_array_equal(cell.estimate.mean[:, 0], cell.truth.y[:, 0])
    assert cell.scores(METRICS["rmse"])["position"].runs == 4


def test_timed_calls_of_older_versions_lack_columns_and_are_read(tiny, cli, results, monkeypatch):
    older = pa.schema([f for f in store.SCHEMA if f.name not in ("seed", "version", "memory", "logliks")])
    monkeypatch.setattr(store, "SCHEMA", older)
    assert tiny("-e", "kalman").code == 0
    assert all(pq.read_schema(p).names == older.names for p in results.rglob("*.parquet"))
    monkeypatch.undo()
    found = {key[2] for key in scores(cli, results)}
    assert {"rmse", "latency", "latency-p99", "throughput"} <= found
    assert not {"memory", "loglik-variance"} & found
    timing = load(results).cases["tiny"].cells["kalman"].timing
    assert (timing.memory, timing.logliks) == (None, None)


def test_the_newest_version_counts(tiny, cli, results):
    assert tiny("-e", "last", "kalman").code == 0
    first = scores(cli, results)
    assert tiny("-e", "last", "--seed", 2).code == 0
    loaded = load(results)
    assert loaded.cases["tiny"].seed == 2
    assert list(loaded.cases["tiny"].cells) == ["last"], "kalman ran on another truth"
    assert loaded.superseded == 9
    assert scores(cli, results)["tiny", "last", "rmse", "position"] != first["tiny", "last", "rmse", "position"]


def test_a_case_and_estimator_that_are_no_longer_known(tiny, cli, results, tmp_path):
    """The plug-in is there for `run` only; `score` and `report` read all they need from the store."""
    assert tiny("-e", "last", "kalman").code == 0
    found = scores(cli, results)
    assert {key[:2] for key in found} == {("tiny", "last"), ("tiny", "kalman")}
    said = cli("report", "--results", results, "--out", tmp_path / "site")
    assert (said.code, said.errors) == (0, [])
    pages = [p.read_text() for p in (tmp_path / "site").rglob("*.html")]
    assert any("Two states" in page for page in pages)


def test_results_may_move(tiny, cli, results, tmp_path):
    assert tiny("-e", "last").code == 0
    before = scores(cli, results)
    moved = tmp_path / "böx of results"
    shutil.move(results, moved)
    assert scores(cli, moved) == before
    assert "0 blocks to run" in tiny("-e", "last", results=moved).out


def test_scoring_writes_nothing(tiny, cli, results, files):
    assert tiny("-e", "last").code == 0
    before = files(results)
    scores(cli, results)
    assert files(results) == before


def test_patterns_choose_what_is_scored(tiny, cli, results):
    assert tiny("-e", "last", "smoothed", "smoothed[gain=0.25]").code == 0
    assert {k[1] for k in scores(cli, results, "-e", "smoothed[gain=0.25]")} == {"smoothed[gain=0.25]"}
    assert {k[1] for k in scores(cli, results, "-e", "smoothed*")} == {"smoothed", "smoothed[gain=0.25]"}
    assert {k[2] for k in scores(cli, results, "-m", "rmse")} == {"rmse"}


def test_a_store_of_refusals_alone(cli, inline, tmp_path):
    said = cli("run", "--plugin", TINY, "-c", "linear-gaussian", "-e", "last", "--runs", 1, "--results", tmp_path / "results")
    assert said.code == 0
    for path in (tmp_path / "results").rglob("*.parquet"):
        if path.parent.name == "truth":
            path.unlink()
    found = scores(cli, tmp_path / "results")
    assert [r["status"] for r in found.values()] == ["refused"]


def test_estimates_whose_truth_is_gone(tiny, cli, results):
    assert tiny("-e", "last").code == 0
    for path in (results / "tiny" / "truth").iterdir():
        path.unlink()
    cell = load(results).cases["tiny"].cells["last"]
    assert (cell.runs, cell.counts) == ([], {})
    assert {r["status"] for r in scores(cli, results).values()} == {"not run"}
    assert "2 blocks to run" in tiny("-e", "last").out
    assert {r["status"] for r in scores(cli, results).values()} == {"done"}


def test_blocks_of_many_sizes_are_one_cell(tiny, results):
    for runs, size in ((3, 2), (7, 3), (8, 8)):
        assert tiny("-e", "kalman", "--runs", runs, "--block", size).code == 0
    cell = load(results).cases["tiny"].cells["kalman"]
    assert cell.runs == list(range(8))
    assert [e.meta["kind"] for e in cell.estimates] == [plan.ESTIMATE] * len(cell.estimates)
    assert cell.estimate.mean.shape == (20, 2, 8)


def test_labels_are_in_the_order_asked_for_also_where_the_first_case_lacks_some(tmp_path):
    written = Written(tmp_path / "r")
    written.add([small_case("one")], [Scripted("last"), Scripted("first")], runs=2, seconds=0)
    written.add([small_case("two")], [Scripted("middle"), Scripted("first"), Scripted("unknown")], runs=2, seconds=0)
    assert load(tmp_path / "r", ["one", "two"], ["first", "middle", "last"]).labels == ["first", "middle", "last", "unknown"]
