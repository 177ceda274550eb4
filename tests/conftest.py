"""What the tests share: the command line in this process, a pool without processes, stored numbers to compare."""

import os
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas
import pytest

import suite.cli
import suite.run

ROOT = Path(__file__).resolve().parent.parent
PLUGINS = Path(__file__).resolve().parent / "plugins"
TINY = str(PLUGINS / "tiny.py")
NO_CHANGE: Mapping[str, str] = {}
NUMBERS = ["truth", "y", "true_mode", "mean", "cov", "loglik", "ess", "statistic", "innovation", "mode", "status", "reason"]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest tests come first: at the end one processor would wait for them."""
    items.sort(key=lambda item: item.get_closest_marker("long") is None)


@dataclass(frozen=True)
class Said:
    """What a command answered: its exit code, and the lines of its output and of its complaints."""

    code: int
    out: str
    errors: list[str]


class InlinePool:
    """A process pool's stand-in that computes at once, in this process: quick, and no processes to look after."""

    def __init__(self, *, initializer: Callable[..., object], initargs: Sequence[Any], **_: object):
        initializer(*initargs)

    def schedule(self, function: Callable[..., Any], args: Sequence[Any], timeout: float) -> "Future[Any]":
        future: Future[Any] = Future()
        try:
            future.set_result(function(*args))
        except Exception as error:
            future.set_exception(error)
        return future

    def stop(self) -> None:
        """Nothing runs."""

    def close(self) -> None:
        """Nothing runs."""

    def join(self) -> None:
        """Nothing runs."""


@pytest.fixture
def inline(monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks are computed in this process."""
    monkeypatch.setattr(suite.run, "ProcessPool", InlinePool)


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str]) -> Callable[..., Said]:
    """The command line, run in this process."""

    def command(*arguments: object) -> Said:
        capsys.readouterr()
        code = suite.cli.main([str(a) for a in arguments])
        said = capsys.readouterr()
        assert "Traceback" not in said.err + said.out
        return Said(code, said.out, said.err.splitlines())

    return command


@pytest.fixture
def tiny(cli: Callable[..., Said], inline: None, tmp_path: Path) -> Callable[..., Said]:
    """`run` of the tiny plug-in's case in this process, into the folder `results` unless told otherwise."""

    def run(*arguments: object, results: Path | None = None) -> Said:
        folder = results or tmp_path / "results"
        chosen = [] if "-c" in arguments else ["-c", "tiny"]
        return cli("run", "--plugin", TINY, "--runs", 4, "--block", 2, "--results", folder, *chosen, *arguments)

    return run


@pytest.fixture
def shell() -> Callable[..., Said]:
    """The command line in a process of its own."""

    def command(*arguments: object, prefix: str = "exec", env: Mapping[str, str] = NO_CHANGE, cwd: Path | None = None) -> Said:
        done = subprocess.run(
            ["bash", "-c", f'{prefix} "$@"', "bash", sys.executable, "-m", "suite", *map(str, arguments)],
            capture_output=True,
            text=True,
            env={**os.environ, "PYTHONPATH": str(ROOT), **env},
            cwd=cwd,
        )
        assert "Traceback" not in done.stderr + done.stdout, done.stderr
        return Said(done.returncode, done.stdout, done.stderr.splitlines())

    return command


@pytest.fixture
def numbers() -> Callable[..., dict[tuple[object, ...], bytes]]:
    """All stored numbers of a results folder, bit for bit, by kind, case, estimator, run and step; timings left out."""

    def read(folder: Path) -> dict[tuple[object, ...], bytes]:
        frame = pandas.read_parquet(folder)
        frame = frame[frame.kind.isin(["truth", "estimate"])]
        keys = zip(frame.kind, frame.case, frame.estimator.astype(object).fillna(""), frame.run, frame.step, strict=True)
        columns = [frame[name].astype(object) for name in NUMBERS]
        found = {}
        for key, values in zip(keys, zip(*columns, strict=True), strict=True):
            found[key] = b"|".join(_bits(v) for v in values)
        assert len(found) == len(frame), "a run and step is stored twice"
        return found

    return read


def _bits(value: Any) -> bytes:
    if hasattr(value, "tobytes"):
        return bytes(value.tobytes())
    return value.hex().encode() if isinstance(value, float) else str(value).encode()


@pytest.fixture
def files() -> Callable[[Path], dict[str, tuple[int, int, int]]]:
    """Every file below a folder, with what changes when it is written again: inode, time of change, size."""

    def look(folder: Path) -> dict[str, tuple[int, int, int]]:
        found = (p for p in sorted(folder.rglob("*")) if p.is_file())
        return {str(p.relative_to(folder)): (p.stat().st_ino, p.stat().st_mtime_ns, p.stat().st_size) for p in found}

    return look
