"""Running a plan: the same numbers however it is cut up, failures recorded, the rest going on."""

import itertools
import json
from pathlib import Path

import pandas
import pytest

import suite.cli
from suite.store import Store

PLUGINS = Path(__file__).resolve().parents[1] / "plugins"
FAULTY = str(PLUGINS / "faulty.py")
ENTRIES = ["smoothed[jitter=1.0]", "kalman", "ukf", "bootstrap[particles=50]"]

FAULTS = {
    "wrong-shape": "ValueError: mean has shape (19, 2, 1), expected (20, 2, 1)",
    "wrong-type": "TypeError: run returned ndarray, not an Estimate",
    "not-finite": "step 6: mean is not finite",
    "raises": "step 17: ArithmeticError: the matrix is not positive definite",
    "raises-once": "ArithmeticError: run 3 is not to my taste",
    "exits": "SystemExit: good bye",
    "dies": "the worker process died (exit code 7)",
    "hangs": "ran past the time limit of 2 s for a block",
}
SOUND = ("kalman", "last", "leaves-thread")


def test_every_run_and_step_has_one_row(tiny, tmp_path):
    assert tiny("-e", "last", "-c", "tiny", "linear-gaussian").code == 0
    frame = pandas.read_parquet(tmp_path / "results")
    assert not frame[["case", "kind"]].isna().any(axis=None)
    tiny_rows = frame[frame.case == "tiny"]
    assert not tiny_rows[["run", "step"]].isna().any(axis=None)
    for kind, needed, absent in (
        ("truth", ["truth", "y"], ["mean", "cov", "status", "estimator"]),
        ("estimate", ["estimator", "mean", "cov", "seconds", "batch", "status", "reason"], ["truth", "y"]),
    ):
        rows = tiny_rows[tiny_rows.kind == kind]
        assert sorted(zip(rows.run, rows.step, strict=True)) == list(itertools.product(range(4), range(1, 21)))
        assert not rows[needed].isna().any(axis=None)
        assert rows[absent].isna().all(axis=None)
    assert set(frame[frame.kind == "refusal"].reason) == {"it takes one measurement component"}


def test_numbers_do_not_depend_on_blocks_or_on_other_entries(tiny, tmp_path, numbers):
    for name, block, entries in (
        ("one", 1, ENTRIES),
        ("three", 3, ENTRIES[::-1]),
        ("all", 4, [*ENTRIES, "last", "filterpy:*"]),
    ):
        assert tiny("-e", *entries, "--block", block, results=tmp_path / name).code == 0
    one, three, every = (numbers(tmp_path / name) for name in ("one", "three", "all"))
    assert one == three
    assert one.keys() < every.keys()
    assert {key: every[key] for key in one} == one
    assert len(one) == 5 * 4 * 20


def test_numbers_depend_on_the_run_and_the_seed(tiny, tmp_path, numbers):
    assert tiny("-e", "smoothed[jitter=1.0]").code == 0
    assert tiny("-e", "smoothed[jitter=1.0]", "--seed", 2, results=tmp_path / "other").code == 0
    first, second = numbers(tmp_path / "results"), numbers(tmp_path / "other")
    assert len(set(first.values())) == len(first)
    assert not set(first.values()) & set(second.values())


def test_numbers_do_not_depend_on_processes_nor_on_what_was_stored_before(tiny, cli, tmp_path, numbers, files, request):
    """Four runs, then eight, in two worker processes; against eight in this one."""
    arguments = ("run", "--plugin", str(PLUGINS / "tiny.py"), "-c", "tiny", "-e", *ENTRIES)
    assert tiny("-e", *ENTRIES, "--runs", 8, results=tmp_path / "inline").code == 0
    assert tiny("-e", *ENTRIES, "--runs", 4, results=tmp_path / "spread").code == 0
    before = files(tmp_path / "spread")
    request.getfixturevalue("monkeypatch").undo()  # processes again
    said = cli(*arguments, "--runs", 8, "--block", 3, "--jobs", 2, "--results", tmp_path / "spread")
    assert said.code == 0
    assert "15 stored already" in said.out
    after = files(tmp_path / "spread")
    assert {name: after[name] for name in before} == before, "what is stored is not touched"
    assert numbers(tmp_path / "inline") == numbers(tmp_path / "spread")


def test_what_goes_wrong_is_stored_and_the_rest_goes_on(cli, tmp_path):
    """All faults in one command, in real worker processes: two of them end or block their process."""
    results = tmp_path / "results"
    said = cli(
        "run", "--plugin", PLUGINS / "tiny.py", "--plugin", FAULTY, "-c", "tiny", "-e", *FAULTS, *SOUND,
        "--runs", 4, "--jobs", 2, "--time-limit", 2, "--results", results,
    )  # fmt: skip
    assert said.code == 2
    counts = {name: 1 if name == "raises-once" else 4 for name in FAULTS}
    assert sorted(line for line in said.errors if "blocks, about" not in line) == sorted(
        f"filterbench: {name} on tiny (plug-in {FAULTY}): {counts[name]} of 4 runs failed or were lost; {reason}"
        for name, reason in FAULTS.items()
    )
    frame = pandas.read_parquet(results)
    frame = frame[frame.kind == "estimate"].drop_duplicates(["estimator", "run"])
    status = {(e, r): (s, why) for e, r, s, why in zip(frame.estimator, frame.run, frame.status, frame.reason, strict=True)}
    for name, reason in FAULTS.items():
        for run in range(4):
            fine = name == "raises-once" and run < 3
            assert status[name, run] == (("ok", "") if fine else ("failed", reason))
    for name in SOUND:
        assert [status[name, run] for run in range(4)] == [("ok", "")] * 4
    entries, damages = Store(results).scan()
    assert not damages
    tracebacks = {e.meta["estimator"]["label"]: e.meta["tracebacks"] for e in entries if e.meta["kind"] == "estimate"}
    assert "the matrix is" in tracebacks["raises"][0]
    assert "faulty.py" in tracebacks["raises"][0]
    score = cli("score", "--results", results)
    assert score.code == 0
    assert "hangs" in score.out


def faulty(tiny, *arguments):
    return tiny("--plugin", FAULTY, *arguments)


def test_exit_code_of_a_plugin_that_fails_always(tiny):
    said = faulty(tiny, "-e", "wrong-shape", "kalman", "--block", 2)
    assert (said.code, len(said.errors)) == (2, 1)


def test_exit_code_of_a_plugin_that_fails_in_all_runs_of_a_block_only(tiny):
    said = faulty(tiny, "-e", "raises-once", "--block", 1)
    assert said.code == 1
    assert "1 of 4 runs failed" in said.errors[0]


def test_only_the_run_that_fails_is_marked_and_the_others_keep_their_numbers(tiny, tmp_path, numbers):
    for block in (1, 2, 4):
        assert faulty(tiny, "-e", "raises-once", "--block", block, "--results", tmp_path / str(block)).code == 1
    assert numbers(tmp_path / "1") == numbers(tmp_path / "2") == numbers(tmp_path / "4")
    frame = pandas.read_parquet(tmp_path / "4")
    failed = frame[frame.status == "failed"]
    assert set(failed[failed.kind == "estimate"].run) == {3}


def test_exit_code_of_an_entry_of_the_project_that_fails(tiny, monkeypatch):
    def step(self, model, belief, y, k, rng):
        raise ArithmeticError("not today")

    monkeypatch.setattr("estimators.kalman.Kalman.step", step)
    said = tiny("-e", "kalman", "last")
    assert said.code == 1
    assert said.errors == [
        "filterbench: kalman on tiny: 4 of 4 runs failed or were lost; step 1: ArithmeticError: not today"
    ]  # fmt: skip


def test_cases_that_do_not_simulate(tiny, tmp_path):
    path = str(PLUGINS / "faulty_cases.py")
    said = tiny("--plugin", path, "-c", "raising", "short", "sound", "-e", "last", "kalman")
    assert said.code == 2
    assert len(said.errors) == 6, "one line for the simulation and for each estimator of each case that fails"
    for case, reason in (
        ("raising", "ArithmeticError: no truth today"),
        ("short", "ValueError: case short: x has shape (19, 2, 2), not (20, 2, 2)"),
    ):
        prefix = f"on {case} (plug-in {path}): 4 of 4 runs failed or were lost;"
        assert f"filterbench: simulation {prefix} {reason}" in said.errors
        for estimator in ("last", "kalman"):
            assert f"filterbench: {estimator} {prefix} the case does not simulate: {reason}" in said.errors, (
                "the case is to blame, not the estimator that could not run on it"
            )
    frame = pandas.read_parquet(tmp_path / "results")
    estimates = frame[frame.kind == "estimate"]
    assert set(estimates[estimates.case == "sound"].status) == {"ok"}
    assert set(estimates[estimates.case != "sound"].status) == {"failed"}


def test_failed_blocks_run_again_on_demand_only(tiny, tmp_path, files):
    results = tmp_path / "results"
    assert faulty(tiny, "-e", "raises-once", "last", "--block", 1).code == 1
    before = files(results)
    said = faulty(tiny, "-e", "raises-once", "last", "--block", 1)
    assert (said.code, said.errors) == (0, [])
    assert "0 blocks to run" in said.out
    assert "2 of the stored blocks hold failures; --retry-failed runs them again" in said.out
    assert files(results) == before
    said = faulty(tiny, "-e", "raises-once", "last", "--block", 1, "--retry-failed")
    assert said.code == 2, "it failed in every run that it was given now"
    assert "1 of 1 runs failed" in said.errors[0]
    assert "2 blocks to run" in said.out
    after = files(results)
    assert before.keys() == after.keys()
    assert len({name for name in before if before[name] != after[name]}) == 2


def test_retrying_in_other_blocks_takes_the_place_of_what_failed(tiny, cli, tmp_path, monkeypatch, numbers):
    """A block of four fails as a whole, and comes through when it is run again as four of one."""
    results = tmp_path / "results"
    run, fails = "suite.worker.compute", "wide"

    def too_wide(case, estimator, seed, first, count):
        raise MemoryError(fails)

    with monkeypatch.context() as patch:
        patch.setattr(run, too_wide)
        assert tiny("-e", "last", "--block", 4).code == 2
    assert tiny("-e", "last", "--block", 1, "--retry-failed").code == 0
    said = tiny("-e", "last", "--block", 1, "--retry-failed")
    assert (said.code, "0 blocks to run" in said.out) == (0, True)
    records = json.loads(cli("score", "--results", results, "--format", "json").out)
    assert {r["status"] for r in records} == {"done"}
    assert pandas.read_parquet(results)["status"].eq("failed").sum() == 80, "what failed stays on record"


def test_a_plugin_that_vanishes_while_its_blocks_wait(cli, tmp_path, monkeypatch):
    """The workers cannot load it: one line, and no end of new workers."""
    plugin = tmp_path / "gone.py"
    plugin.write_text((PLUGINS / "tiny.py").read_text())
    real = suite.cli.announce

    def announce(*arguments):
        real(*arguments)
        plugin.unlink()

    monkeypatch.setattr(suite.cli, "announce", announce)
    said = cli("run", "--plugin", plugin, "-c", "tiny", "-e", "last", "--runs", 2, "--results", tmp_path / "results")
    assert (said.code, said.errors) == (2, [f"filterbench: plug-in {plugin} is no file"])


@pytest.mark.parametrize("entry", ["last", "smoothed"])
def test_an_estimator_may_change_its_measurements(tiny, tmp_path, entry):
    """`last` sets them to zero; those of the others, and those stored, stay as they were."""
    assert tiny("-e", "last", "smoothed").code == 0
    assert tiny("-e", entry, results=tmp_path / "alone").code == 0
    both, alone = (pandas.read_parquet(tmp_path / name) for name in ("results", "alone"))
    for frame in (both, alone):
        assert frame[frame.kind == "truth"].y.map(lambda y: y[0] != 0).all()
    pick = [f[(f.kind == "estimate") & (f.estimator == entry)]["mean"].map(tuple).tolist() for f in (both, alone)]
    assert pick[0] == pick[1]
