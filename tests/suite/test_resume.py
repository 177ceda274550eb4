"""A command that is killed at any moment loses nothing that was finished, and leaves nothing half done."""

import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SLOW = str(ROOT / "tests" / "plugins" / "slow.py")
RUNS, KILLS = 60, 6


def command(results):
    return [
        sys.executable, "-m", "suite", "run", "--plugin", SLOW, "-c", "tiny", "-e", "slow",
        "--runs", str(RUNS), "--block", "1", "--jobs", "2", "--results", str(results),
    ]  # fmt: skip


def alive(group):
    """Processes of a process group that have not ended, from /proc."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, pgrp = stat.read_text().rpartition(")")[2].split()[:3]
        except (FileNotFoundError, ProcessLookupError):
            continue
        if int(pgrp) == group and state != "Z":
            found.append(int(stat.parent.name))
    return found


def await_true(condition, seconds):
    limit = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < limit, "it never came true"
        time.sleep(0.01)


def blocks(results):
    return set(results.rglob("*.parquet"))


def kill_when(results, more, delay):
    """Run, and kill the parent process when `more` blocks have been stored, and a little later."""
    before = len(blocks(results))
    process = subprocess.Popen(
        command(results), cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True
    )
    await_true(lambda: len(blocks(results)) >= before + more or process.poll() is not None, 60)
    time.sleep(delay)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert process.returncode == -signal.SIGKILL
    await_true(lambda: not alive(process.pid), 20)


@pytest.mark.long
def test_kill_dash_nine(cli, inline, tmp_path, numbers, files):
    chance = random.Random(20240229)
    results = tmp_path / "results"
    finished = {}
    for _ in range(KILLS):
        kill_when(results, chance.randrange(8), chance.random() * 0.2)
        now = files(results)
        assert {name: now[name] for name in finished} == finished, "what was finished is not computed again"
        finished = {name: stat for name, stat in now.items() if name.endswith(".parquet")}
    assert 0 < len(finished) < 2 * RUNS + 1, "the kills did not fall into the work"
    subprocess.run(command(results), cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    now = files(results)
    assert {name: now[name] for name in finished} == finished
    assert not [name for name in now if not name.endswith((".parquet", "_filterbench.json"))], "a temporary file remains"
    undisturbed = ("run", "--plugin", SLOW, "-c", "tiny", "-e", "slow", "--runs", RUNS, "--results", tmp_path / "undisturbed")
    assert cli(*undisturbed).code == 0
    assert numbers(results) == numbers(tmp_path / "undisturbed")
