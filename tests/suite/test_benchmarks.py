"""Running times from pytest-benchmark: from a file that it wrote, and from files that are damaged."""

import copy
import io
import json
import math
import os
import re
import statistics
import subprocess
import sys

import numpy as np
import pandas
import pytest

from suite.benchmarks import read, select
from suite.errors import BadInput
from tests.benchmarks.timing import Turns

SOURCE = """
import pytest

@pytest.mark.parametrize("runs", [1, 4])
def test_filter(benchmark, runs):
    benchmark.group = "easy"
    benchmark.extra_info |= {"estimator": "last", "case": "tiny", "runs": runs, "steps": 20}
    benchmark.pedantic(lambda: sum(range(2000)), rounds=25)

def test_else(benchmark):
    benchmark.pedantic(lambda: sum(range(100)), rounds=5)
"""


def written(folder, *arguments):
    """The JSON that pytest-benchmark writes for the source above."""
    (folder / "test_source.py").write_text(SOURCE)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "test_source.py", *arguments]
    alone = {name: value for name, value in os.environ.items() if "XDIST" not in name}  # beside others it does not time
    subprocess.run(command, cwd=folder, check=True, capture_output=True, env=alone)


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    folder = tmp_path_factory.mktemp("benchmarks")
    written(folder, "--benchmark-json=times.json", "--benchmark-storage=file://kept", "--benchmark-autosave")
    return folder / "times.json"


def by_name(path):
    return {row["name"]: row for row in read(str(path))}


def test_rows_are_what_the_file_says(path):
    said = json.loads(path.read_text())
    rows = by_name(path)
    assert list(rows) == [b["name"] for b in said["benchmarks"]] == ["test_filter[1]", "test_filter[4]", "test_else"]
    one, many, other = rows.values()
    medians = [b["stats"]["median"] for b in said["benchmarks"]]
    assert (one["metric"], one["block"], one["unit"]) == ("latency", "step", "µs")
    assert one["value"] == pytest.approx(1e6 * medians[0] / 20)
    assert (many["metric"], many["block"], many["unit"]) == ("throughput", "step", "run-steps/s")
    assert many["value"] == pytest.approx(4 * 20 / medians[1])
    assert (other["metric"], other["value"], other["unit"]) == ("duration", medians[2], "s")
    assert "estimator" not in other
    assert [(r["estimator"], r["case"], r["batch"], r["steps"]) for r in (one, many)] == [
        ("last", "tiny", n, 20) for n in (1, 4)
    ]
    assert [(r["group"], r["rounds"]) for r in rows.values()] == [("easy", 25), ("easy", 25), (None, 5)]
    for row in rows.values():
        assert (row["source"], row["date"], row["commit"]) == (str(path), said["datetime"], said["commit_info"]["id"])
        assert row["machine"]


def test_the_interval_of_the_median_is_that_of_its_ranks(path):
    """Of 25 rounds the 8th and the 18th: B(25, 1/2) is below 8 with probability 0.0216, below 9 with 0.0539."""
    said = {b["name"]: sorted(b["stats"]["data"]) for b in json.loads(path.read_text())["benchmarks"]}
    one, many, other = by_name(path).values()
    times = said["test_filter[1]"]
    assert statistics.median(times) == pytest.approx(one["value"] * 20 / 1e6)
    assert (one["low"], one["high"]) == pytest.approx((1e6 * times[7] / 20, 1e6 * times[17] / 20))
    times = said["test_filter[4]"]
    assert (many["low"], many["high"]) == pytest.approx((80 / times[17], 80 / times[7]))
    assert np.isnan([other["low"], other["high"]]).all(), "five rounds are too few"


def test_files_that_kept_no_times_have_an_interval_where_the_ends_are_it(path, tmp_path):
    (kept,) = (path.parent / "kept").rglob("*.json")
    assert "data" not in json.loads(kept.read_text())["benchmarks"][0]["stats"]
    assert all(np.isnan([row["low"], row["high"]]).all() for row in by_name(kept).values())
    said = json.loads(kept.read_text())
    ends = {}
    for rounds in (5, 6, 8, 9):
        said["benchmarks"][2]["stats"]["rounds"] = rounds
        (tmp_path / "x.json").write_text(json.dumps(said))
        row = by_name(tmp_path / "x.json")["test_else"]
        ends[rounds] = row["low"], row["high"]
    stats = said["benchmarks"][2]["stats"]
    assert ends[6] == ends[8] == (stats["min"], stats["max"])
    assert np.isnan(ends[5] + ends[9]).all()


def without(*keys):
    def spoil(said):
        for key in keys[:-1]:
            said = said[key]
        del said[keys[-1]]

    return spoil


def with_value(value, *keys):
    def spoil(said):
        for key in keys[:-1]:
            said = said[key]
        said[keys[-1]] = value

    return spoil


@pytest.mark.parametrize(
    "spoil",
    [
        without("benchmarks"), without("machine_info"), without("commit_info"), without("benchmarks", 0, "stats"),
        without("benchmarks", 0, "stats", "median"), with_value("fast", "benchmarks", 0, "stats", "median"),
        with_value(float("nan"), "benchmarks", 0, "stats", "median"), with_value(-1.0, "benchmarks", 0, "stats", "median"),
        with_value(None, "benchmarks", 0, "stats", "rounds"), with_value(10**15, "benchmarks", 0, "stats", "rounds"),
        with_value(0, "benchmarks", 0, "extra_info", "runs"), with_value("many", "benchmarks", 0, "extra_info", "steps"),
        with_value(float("inf"), "benchmarks", 0, "extra_info", "steps"), with_value(3, "benchmarks"),
        with_value(None, "machine_info"), with_value({"turns": 3, "ratio_to_floor": 1.0}, "benchmarks", 2, "extra_info"),
        with_value({"ratio_to_floor": "high"}, "benchmarks", 2, "extra_info"),
    ],
)  # fmt: skip
def test_a_damaged_file_is_named(path, tmp_path, spoil):
    said = copy.deepcopy(json.loads(path.read_text()))
    spoil(said)
    damaged = tmp_path / "damaged.json"
    damaged.write_text(json.dumps(said))
    with pytest.raises(
        BadInput, match=rf"^{re.escape(str(damaged))} is damaged or no JSON of pytest-benchmark \(.*\); name a"
    ) as caught:
        read(str(damaged))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"{}", b"null", b"\xff\xfe\x00", b"[" * 100_000])
def test_a_file_of_something_else_is_named(tmp_path, content):
    other = tmp_path / "other.json"
    other.write_bytes(content)
    with pytest.raises(BadInput, match=rf"^{re.escape(str(other))} is damaged or no JSON of pytest-benchmark \(.*\); name a"):
        read(str(other))


def test_a_mistake_is_one_line_and_no_table(cli, tiny, tmp_path):
    assert tiny("-e", "last").code == 0
    said = cli("score", "--results", tmp_path / "results", "--benchmarks", "none.json")
    assert (said.code, said.out, len(said.errors)) == (2, "", 1)
    assert said.errors[0].startswith("filterbench: cannot read none.json: ")


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(BadInput, match=rf"^cannot read {tmp_path}/none.json: No such file or directory; name a file that"):
        read(f"{tmp_path}/none.json")


def test_benchmarks_stand_below_the_scores(cli, tiny, tmp_path, path):
    assert tiny("-e", "last").code == 0
    results = ("--results", tmp_path / "results")
    plain = pandas.read_csv(io.StringIO(cli("score", *results, "--format", "csv").out))
    whole = pandas.read_csv(io.StringIO(cli("score", *results, "--format", "csv", "--benchmarks", path, path).out))
    assert list(whole.columns[: len(plain.columns)]) == list(plain.columns)
    pandas.testing.assert_frame_equal(whole[: len(plain)][plain.columns], plain, check_dtype=False)
    assert list(whole.source) == ["stored"] * len(plain) + [str(path)] * 6
    assert list(whole.name[len(plain) :]) == ["test_filter[1]", "test_filter[4]", "test_else"] * 2
    same = json.loads(cli("score", *results, "--format", "json", "--benchmarks", path).out)
    last = same[-1]
    assert (last["name"], last["case"], last["seed"], last["low"], last["rounds"]) == ("test_else", None, None, None, 5)
    assert [isinstance(row["seed"], int) for row in same] == [True] * len(plain) + [False] * 3


def test_patterns_choose_benchmarks_too(cli, tiny, tmp_path, path):
    assert tiny("-e", "last", "smoothed").code == 0

    def names(*arguments):
        said = cli("score", "--results", tmp_path / "results", "--format", "json", "--benchmarks", path, *arguments)
        return [row["name"] for row in json.loads(said.out) if row["source"] != "stored"]

    assert names("-c", "tin*") == ["test_filter[1]", "test_filter[4]"]
    assert names("-e", "last") == ["test_filter[1]", "test_filter[4]"]
    assert names("-e", "smoothed") == []
    assert names("-m", "throughput", "rmse") == ["test_filter[4]"]


def test_patterns_that_no_benchmark_matches_are_told(cli, tiny, tmp_path, path):
    assert tiny("-e", "last", "smoothed").code == 0
    results = ("--results", tmp_path / "results", "--benchmarks", path)
    said = cli("score", *results, "-e", "smoothed", "-m", "rmse", "nees")
    assert (said.code, len(said.errors)) == (0, 1)
    assert said.errors[0].endswith(f"none of the 3 benchmarks in {path} is of estimator 'smoothed' and metric 'rmse' 'nees'")
    assert cli("score", *results, "-e", "last").errors == []


def test_a_file_without_benchmarks_is_told(path, tmp_path, capsys):
    said = json.loads(path.read_text()) | {"benchmarks": []}
    (tmp_path / "none.json").write_text(json.dumps(said))
    assert select([str(tmp_path / "none.json")], (), (), ()) == []
    assert capsys.readouterr().err == f"filterbench: {tmp_path / 'none.json'} holds no benchmark\n"


def test_ratios_to_rivals_have_intervals_where_they_were_timed_in_turns(path, tmp_path):
    """A rival that does a tenth of the work is a tenth as long: ratio and interval are those for the same work."""
    said = json.loads(path.read_text())
    turns = {"floor": [4.0, 3.0, 6.0], "one": [20.0, 10.0, 40.0], "few": [2.0, math.nan, math.nan], "else": [1.0, 1.0, 1.0]}
    told = {"ratio_to_floor": 4.0, "peer to one": 2.0, "ratio_to_few": 2.0, "ratio_to_other": 7.0, "largest_to_least": 3.0}
    said["benchmarks"][2]["extra_info"] = {"turns": turns, "filter": "x", "steps": 7, **told}
    (tmp_path / "x.json").write_text(json.dumps(said))
    row = by_name(tmp_path / "x.json")["test_else"]
    assert {name: ratio for name, ratio in row["against"].items() if not math.isnan(ratio[1])} == {
        "ratio_to_floor": (4.0, 3.0, 6.0), "peer to one": (2.0, 1.0, 4.0),
    }  # fmt: skip
    assert {name: ratio[0] for name, ratio in row["against"].items() if math.isnan(ratio[1])} == {
        "ratio_to_few": 2.0, "ratio_to_other": 7.0,
    }  # fmt: skip
    assert row["told"] == {"filter": "x", "steps": 7, "largest_to_least": 3.0}


def test_turns_give_the_median_ratio_and_its_exact_interval(path):
    """Of 25 rounds the 8th and the 18th, as for a median; of five none."""
    turns = Turns(np.arange(25.0, 0, -1), {"floor": np.full(25, 2.0)})
    assert turns.intervals() == {"floor": [6.5, 4.0, 9.0]}
    (few,) = Turns(np.arange(1.0, 6), {"floor": np.ones(5)}).intervals().values()
    assert few[0] == 3.0
    assert np.isnan(few[1:]).all()


def test_the_machine_is_told_apart_by_node_and_python(path):
    info, row = json.loads(path.read_text())["machine_info"], by_name(path)["test_else"]
    assert (row["node"], row["python"], row["dirty"]) == (info["node"], info["python_version"], False)


def test_the_printed_table_of_a_file(cli, tiny, tmp_path, path):
    assert tiny("-e", "last").code == 0
    out = cli("score", "--results", tmp_path / "results", "-m", "rmse", "--benchmarks", path).out
    assert "test_filter" not in out
    out = cli("score", "--results", tmp_path / "results", "--benchmarks", path).out
    one = by_name(path)["test_filter[1]"]
    cells = [part.strip() for part in next(line for line in out.splitlines() if "test_filter[1]" in line).split("│")]
    interval = f"[{one['low']:.4g}, {one['high']:.4g}]"
    assert cells[1:-1] == ["test_filter[1]", "1", "latency:step", f"{one['value']:.4g} µs", interval, "25"]
    assert next(line for line in out.splitlines() if "test_else" in line).split("│")[5].strip() == ""
