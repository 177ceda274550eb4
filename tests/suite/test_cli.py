"""The command line: one line for every mistake, exit codes, and what commands print."""

import csv
import io
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

TINY = str(Path(__file__).resolve().parents[1] / "plugins" / "tiny.py")
ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "required: COMMAND"),
        (["rum"], "invalid choice: 'rum'"),
        (["run", "x\ny"], "unrecognized arguments: x y"),
        (["run", "--run", "3"], "unrecognized arguments"),
        (["run", "-e", "kalmann"], "did you mean 'kalman'?"),
        (["run", "-e", "*kalmann*"], "did you mean 'kalman'?"),
        (["run", "-c", "linear"], "no case matches 'linear'; did you mean 'jump-linear' or 'linear-gaussian'?"),
        (["run", "-c", "linear-gaussian[steps=3]"], "a case takes no settings"),
        (["run", "-e", "bootstrap[particle=10]"], "bootstrap has no parameter 'particle'; did you mean 'particles'?"),
        (["run", "-e", "kalman[gain=1]"], "kalman has no parameter 'gain'; it has no parameters"),
        (["run", "-e", "bootstrap[particles=0]"], "particles must be at least 1, got 0"),
        (["run", "-e", "bootstrap[particles=abc]"], "particles must be an integer, got 'abc'"),
        (["run", "-e", "bootstrap[particles=1e3]"], "particles must be an integer, got '1e3'"),
        (["run", "-e", "ukf[alpha=nan]"], "alpha must be finite"),
        (["run", "-e", "ukf[alpha=0]"], "alpha must be at least 1e-06"),
        (["run", "-e", "ukf[alpha=2]"], "alpha must be at most 1"),
        (["run", "-e", "bootstrap[particles=5"], "cannot read 'bootstrap[particles=5'"),
        (["run", "-e", "bootstrap[particles=]"], "write settings as name[parameter=value,...]"),
        (["run", "-e", "bootstrap[particles=1,particles=2]"], "write settings as name[parameter=value,...]"),
        (["run", "-e", "bootstrap]particles=1["], "cannot read"),
        (["run", "-e", ""], "no estimator matches ''"),
        (["run", "-e", "z" * 3000], "no estimator matches"),
        (["run", "--runs", "-1"], "must be at least 1, got -1"),
        (["run", "--runs", "0"], "must be at least 1, got 0"),
        (["run", "--runs", "2.5"], "must be an integer of at least 1, got '2.5'"),
        (["run", "--seed", "abc"], "must be an integer of at least 0, got 'abc'"),
        (["run", "--seed", "-1"], "must be at least 0, got -1"),
        (["run", "--jobs", "0"], "must be at least 1, got 0"),
        (["run", "--block", "0"], "must be at least 1, got 0"),
        (["run", "--time-limit", "nan"], "must be a positive number of seconds, got 'nan'"),
        (["run", "--time-limit", "0"], "must be a positive number of seconds, got '0'"),
        (["run", "--profile", "slow"], "invalid choice: 'slow'"),
        (["score", "--format", "xml"], "invalid choice: 'xml'"),
        (["list", "filters"], "invalid choice: 'filters'"),
        (["list", "metrics", "brierr"], "no metric matches 'brierr'; did you mean 'brier'?"),
    ],
    ids=lambda value: " ".join(value)[:40] if isinstance(value, list) else "",
)
def test_a_mistake_gives_one_line(cli, tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    said = cli(*arguments)
    assert said.code == 2
    assert len(said.errors) == 1, said.errors
    assert said.errors[0].startswith("filterbench: ")
    assert words in said.errors[0]
    assert not said.out
    assert not list(tmp_path.iterdir()), "a mistake leaves nothing behind"


def test_results_that_are_a_file(cli, tiny, tmp_path):
    path = tmp_path / "notes.txt"
    path.write_text("mine")
    for said in (tiny(results=path), cli("score", "--results", path), cli("report", "--results", path)):
        assert (said.code, said.errors) == (2, [f"filterbench: results {path} is a file; name a folder"])
    assert path.read_text() == "mine"


def test_results_that_hold_the_files_of_others(cli, tiny, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    for said in (tiny(results=tmp_path), cli("score", "--results", tmp_path), tiny("--dry-run", results=tmp_path)):
        assert said.code == 2
        assert said.errors == [
            f"filterbench: {tmp_path} holds other files and no results; name an empty or new folder"
        ]  # fmt: skip
    assert [p.name for p in tmp_path.iterdir()] == ["notes.txt"]


@pytest.mark.parametrize("command", ["score", "report"])
def test_a_folder_without_results(cli, tmp_path, command):
    (tmp_path / "empty").mkdir()
    for folder in (tmp_path / "empty", tmp_path / "none"):
        said = cli(command, "--results", folder)
        assert said.code == 2
        assert said.errors == [f"filterbench: no results in {folder}; run `filterbench run --results {folder}` first"]
    assert not (tmp_path / "none").exists()


def test_a_report_of_no_finished_block_says_so(cli, tmp_path):
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "_filterbench.json").write_text('{"format": 1}')
    arguments = ("report", "--results", tmp_path / "results", "--out", tmp_path / "site", "--jobs", 1)
    assert cli(*arguments).code == 0
    assert "there is nothing to compare yet" in (tmp_path / "site" / "index.html").read_text(encoding="utf-8")
    assert cli(*arguments, "--seed", 4).code == 2


def test_results_without_a_finished_block(cli, tmp_path):
    (tmp_path / "_filterbench.json").write_text('{"format": 1}')
    said = cli("score", "--results", tmp_path)
    assert said.code == 2
    assert said.errors == [
        f"filterbench: no block is finished yet in {tmp_path}; run `filterbench run --results {tmp_path}` first"
    ]  # fmt: skip


def test_a_name_that_is_too_long(cli, tmp_path):
    for arguments in (["score", "--results", "a" * 5000], ["list", "--plugin", "a" * 5000]):
        said = cli(*arguments)
        assert said.code == 2
        assert len(said.errors) == 1
        assert "File name too long" in said.errors[0]


def test_out_inside_the_results(cli, tiny, tmp_path):
    assert tiny("-e", "last").code == 0
    results = tmp_path / "results"
    for out in (results, results / "site", results / "tiny" / ".." / "site"):
        said = cli("report", "--results", results, "--out", out)
        assert said.code == 2
        assert len(said.errors) == 1
        assert "lies in the results folder" in said.errors[0]
    assert not (results / "site").exists()


def test_names_that_are_not_stored(cli, tiny, tmp_path):
    assert tiny("-e", "last").code == 0
    for option, name, words in (
        ("-e", "lost", "no stored estimator matches 'lost'; did you mean 'last'?"),
        ("-c", "tini", "no stored case matches 'tini'; did you mean 'tiny'?"),
        ("-m", "brierr", "no metric matches 'brierr'; did you mean 'brier'?"),
    ):
        said = cli("score", "--results", tmp_path / "results", option, name)
        assert said.code == 2
        assert said.errors == [f"filterbench: {words}"]


def test_list(cli):
    said = cli("list")
    assert said.code == 0
    for name in ("estimators", "kalman", "particles=1000", "cases", "linear-gaussian", "metrics", "rmse"):
        assert name in said.out
    said = cli("list", "estimators", "k*")
    assert "kalman" in said.out
    assert "bootstrap" not in said.out
    said = cli("list", "cases", "--plugin", TINY)
    assert "tiny" in said.out
    assert not said.errors


def test_a_dry_run_writes_nothing(cli, tiny, tmp_path, files):
    results = tmp_path / "results"
    said = tiny("--dry-run", "-e", "last", "kalman")
    assert said.code == 0
    assert said.out.startswith("2 cells (2 estimators x 1 cases, 0 refused), 4 runs each, seed 1: 9 blocks to run, 0 stored")
    assert not results.exists()
    results.mkdir()
    assert tiny("--dry-run", "-e", "last", "kalman").out == said.out
    assert not list(results.iterdir())
    assert tiny("-e", "last").code == 0
    (results / "notes.txt").write_text("mine")
    before = files(results)
    said = tiny("--dry-run", "-e", "last", "kalman")
    assert "3 blocks to run, 6 stored already" in said.out
    assert said.errors == [f"filterbench: would set aside {results / 'notes.txt'}: not a Parquet file of this store"]
    assert files(results) == before


def test_formats_agree_and_json_is_strict(cli, tiny, tmp_path):
    assert tiny("-e", "smoothed", "kalman", "last", "-c", "tiny", "linear-gaussian").code == 0
    score = ("score", "--results", tmp_path / "results")
    as_json, as_csv, as_table = cli(*score, "--format", "json"), cli(*score, "--format", "csv"), cli(*score)
    assert (as_json.code, as_csv.code, as_table.code) == (0, 0, 0)

    def forbid(token):
        raise AssertionError(f"{token} is not JSON")

    records = json.loads(as_json.out, parse_constant=forbid)
    rows = list(csv.DictReader(io.StringIO(as_csv.out)))
    assert len(records) == len(rows) > 20
    for record, row in zip(records, rows, strict=True):
        assert record.keys() == row.keys()
        for name, value in record.items():
            if value is None:
                assert row[name] == ""
            elif isinstance(value, float):
                assert float(row[name]) == value
            else:
                assert row[name] == str(value)
    assert any(record["value"] is None for record in records), "nothing here puts strict JSON to the test"
    shown = next(r for r in records if r["metric"] == "rmse" and r["case"] == "tiny")
    assert f"{shown['value']:.4g} {shown['unit']}" in as_table.out


def test_a_refusal_is_a_row_and_no_failure(cli, tiny, tmp_path):
    assert tiny("-e", "last", "-c", "tiny", "linear-gaussian").code == 0
    records = json.loads(cli("score", "--results", tmp_path / "results", "--format", "json").out)
    refused = [r for r in records if r["case"] == "linear-gaussian"]
    assert [(r["status"], r["reason"], r["metric"]) for r in refused] == [
        ("refused", "it takes one measurement component", None)
    ]  # fmt: skip


def test_plain_output_where_there_is_no_terminal(shell, tiny, tmp_path):
    assert tiny("-e", "last").code == 0
    said = shell("score", "--results", tmp_path / "results")
    assert "last" in said.out
    assert not said.errors
    assert "\x1b" not in said.out
    assert "\r" not in said.out


def test_output_that_nobody_reads(tmp_path):
    """As in `filterbench list | head -1`, at its worst: the reader is gone before anything is written."""
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run([sys.executable, "-m", "suite", "list"], stdout=write, stderr=subprocess.PIPE, cwd=ROOT)
    os.close(write)
    assert done.stderr == b""


def test_output_to_a_full_disk():
    if not Path("/dev/full").exists():
        pytest.skip("the system has no device that is always full")
    with Path("/dev/full").open("w") as full:
        done = subprocess.run([sys.executable, "-m", "suite", "list"], stdout=full, stderr=subprocess.PIPE, cwd=ROOT)
    assert done.returncode == 2
    assert done.stderr == b"filterbench: [Errno 28] No space left on device\n"


def test_names_that_the_terminal_cannot_show(shell, tmp_path):
    said = shell(
        "run", "--dry-run", "-c", "linear-gaussian", "-e", "kalman", "--results", "m\xfcller", env={"PYTHONIOENCODING": "ascii"}
    )
    assert said.code == 0
    assert "stored already in m\\xfcller" in said.out


@pytest.fixture
def heeding_interrupts():
    """Where the tests run in the background Ctrl-C is ignored, and what they start inherits that."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("heeding_interrupts")
def test_an_interrupt_keeps_whole_blocks_and_says_one_line(tmp_path, files):
    """Ctrl-C reaches the command and its workers alike: while the workers start, and while they work."""
    results = tmp_path / "results"
    command = [
        sys.executable, "-m", "suite", "run", "--plugin", str(Path(TINY).with_name("slow.py")),
        "-c", "tiny", "-e", "slow", "--runs", "100", "--block", "1", "--results", str(results),
    ]  # fmt: skip
    for ready in ("_filterbench.json", "tiny/slow/*.parquet"):
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT, start_new_session=True
        )
        while not list(results.glob(ready)) and process.poll() is None:
            time.sleep(0.02)
        time.sleep(0.3)
        os.killpg(process.pid, signal.SIGINT)
        _, errors = process.communicate()
        assert process.returncode == 130
        assert errors.splitlines() == ["filterbench: interrupted; what is finished is kept, repeat the command to go on"]
    assert not [name for name in files(results) if name.endswith(".tmp")]
    score = subprocess.run(
        [sys.executable, "-m", "suite", "score", "--results", results], capture_output=True, text=True, cwd=ROOT
    )
    assert (score.returncode, score.stderr) == (0, "")
