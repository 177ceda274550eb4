"""The store: whole files or none, damage named and set aside, disks that do not take it."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from suite.errors import StoreError
from suite.store import Store, constant, read, texts, vectors

META = {"kind": "estimate", "case": {"name": "a case"}, "estimator": {"label": "kalman[x=1]"}, "first": 0, "count": 2}


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / "store", create=True)


def columns():
    """Two runs of two steps."""
    return {
        "case": constant("a case", 4),
        "kind": constant("estimate", 4),
        "run": np.repeat(np.arange(2, dtype=np.int32), 2),
        "step": np.tile(np.arange(1, 3, dtype=np.int32), 2),
        "mean": vectors(np.arange(8.0).reshape(4, 2)),
        "loglik": np.array([0.1, np.nan, -np.inf, 3.0]),
        "status": texts(["ok", "failed"], 2),
    }


def test_what_is_written_is_read(store):
    path = store.write("abc", META, columns(), 4)
    assert path == store.folder / "a_case" / "kalman_x_1" / "abc.parquet"
    entries, damages = store.scan()
    assert ([e.path for e in entries], damages) == ([path], [])
    assert dict(entries[0].meta) == {**META, "address": "abc"}
    back = read(path, ["run", "mean", "loglik", "status", "ess"])
    np.testing.assert_array_equal(back["run"], [0, 0, 1, 1])
    np.testing.assert_array_equal(back["mean"], np.arange(8.0).reshape(4, 2))
    np.testing.assert_array_equal(back["loglik"], [0.1, np.nan, -np.inf, 3.0])
    assert back["status"] == ["ok", "ok", "failed", "failed"]
    assert back["ess"] is None


def test_pandas_reads_the_whole_folder(store):
    store.write("abc", META, columns(), 4)
    store.write("abd", {**META, "estimator": None}, {**columns(), "mean": None}, 4)
    (store.folder / "_set_aside").mkdir()
    (store.folder / "_set_aside" / "old.parquet").write_text("not one")
    frame = pandas.read_parquet(store.folder)
    assert len(frame) == 8
    assert not frame[["case", "kind", "run", "step", "status"]].isna().any(axis=None)
    assert frame["mean"].isna().sum() == 4


def test_pandas_tells_seeds_versions_and_kinds_apart(tiny, tmp_path):
    assert tiny("-e", "last").code == tiny("-e", "last", "--seed", 2).code == 0
    frame = pandas.read_parquet(tmp_path / "results")
    assert set(frame.seed) == {1, 2}
    assert frame.seed.dtype == np.int64
    assert not frame.version.isna().any()
    timed = frame[frame.kind == "timing"]
    assert (timed.memory > 0).all()
    assert timed.seconds.notna().all()
    assert frame[frame.kind != "timing"].memory.isna().all()
    entries, _ = Store(tmp_path / "results").scan()
    said = {(e.meta["kind"], e.meta["seed"], e.meta["version"]) for e in entries}
    assert set(zip(frame.kind, frame.seed, frame.version, strict=True)) == said


def test_a_seed_that_the_store_cannot_hold(tiny):
    assert tiny("-e", "last", "--seed", 2**63 - 1).code == 0
    said = tiny("-e", "last", "--seed", 2**63)
    assert said.code == 2
    assert said.errors == [f"filterbench: seed {2**63} does not fit into the store; give one below 2^63"]


def test_a_block_is_written_under_its_name_only_when_whole(store, monkeypatch):
    seen = []
    real = Path.replace

    def replace(self, target):
        seen.append((self.name, target.exists(), len(pq.read_table(self, partitioning=None))))
        return real(self, target)

    monkeypatch.setattr(Path, "replace", replace)
    store.write("abc", META, columns(), 4)
    assert seen == [(f".abc.parquet.{os.getpid()}.tmp", False, 4)]


def test_the_temporary_files_of_the_dead_are_removed(store):
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    folder = store.folder / "a"
    folder.mkdir()
    for name in (f".abc.parquet.{gone.pid}.tmp", f".abc.parquet.{os.getpid()}.tmp", ".abc.tmp", "notes.tmp"):
        (folder / name).write_text("x")
    store.sweep()
    assert sorted(p.name for p in folder.iterdir()) == [f".abc.parquet.{os.getpid()}.tmp", ".abc.tmp", "notes.tmp"]


def truncate(path):
    path.write_bytes(path.read_bytes()[:-20])


def truncate_front(path):
    path.write_bytes(path.read_bytes()[:50])


def empty(path):
    path.write_bytes(b"")


def flip(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 4] ^= 0xFF
    path.write_bytes(bytes(content))


def edit_meta(path):
    content = path.read_bytes()
    assert content.count(b'"seed": 1') >= 1
    path.write_bytes(content.replace(b'"seed": 1', b'"seed": 2'))


def alien(path):
    path.unlink()
    pq.write_table(pa.table({"x": [1]}), path)


def text(path):
    path.write_text("not Parquet at all")


def folder(path):
    path.unlink()
    path.mkdir()
    (path / "inside.txt").write_text("x")


def dangling(path):
    path.unlink()
    path.symlink_to(path.with_name("nowhere"))


def pipe(path):
    path.unlink()
    os.mkfifo(path)


@pytest.mark.parametrize(
    ("harm", "words"),
    [
        (truncate, "magic bytes"),
        (truncate_front, "magic bytes"),
        (empty, "size is 0 bytes"),
        (flip, "its contents have changed since they were written"),
        (edit_meta, "its contents have changed since they were written"),
        (alien, "a Parquet file, but not written by filterbench"),
        (text, "magic bytes"),
        (folder, "not a readable file"),
        (dangling, "not a readable file"),
        (pipe, "not a readable file"),
    ],
)
def test_damage_is_named_left_out_set_aside_and_mended(cli, tiny, tmp_path, numbers, harm, words):
    results = tmp_path / "results"
    assert tiny("-e", "last").code == 0
    whole = numbers(results)
    path = sorted((results / "tiny" / "last").glob("*.parquet"))[0]
    harm(path)

    said = cli("score", "--results", results)
    assert said.code == 1
    assert len(said.errors) == 1
    assert re.match(
        rf"filterbench: left out {re.escape(str(path))}: .*{words}.*; `filterbench run` sets it aside", said.errors[0]
    )
    assert os.path.lexists(path), "to look at results changes nothing"

    said = tiny("-e", "last")
    assert said.code == 0
    assert len(said.errors) == 1
    aside = results / "_set_aside" / path.relative_to(results)
    assert said.errors[0].startswith(f"filterbench: set aside {path}: ")
    assert said.errors[0].endswith(f"it is now {aside}")
    assert os.path.lexists(aside)
    assert "1 blocks to run" in said.out
    assert numbers(results) == whole
    assert (cli("score", "--results", results).code, cli("score", "--results", results).errors) == (0, [])


def test_what_lies_about_is_set_aside_under_distinct_names(tiny, tmp_path):
    results = tmp_path / "results"
    assert tiny("-e", "last").code == 0
    blocks = sorted((results / "tiny" / "last").glob("*.parquet"))
    for number in range(3):
        shutil.copy(blocks[0], blocks[0].with_name("copy.parquet"))
        (results / "notes.txt").write_text(str(number))
        said = tiny("-e", "last")
        assert said.code == 0
        assert "0 blocks to run" in said.out
        assert len(said.errors) == 2
        assert any(f"its contents belong to address {blocks[0].stem}" in line for line in said.errors)
    aside = sorted(str(p.relative_to(results / "_set_aside")) for p in (results / "_set_aside").rglob("*") if p.is_file())
    assert aside == [
        "notes.txt", "notes.txt.1", "notes.txt.2",
        "tiny/last/copy.parquet", "tiny/last/copy.parquet.1", "tiny/last/copy.parquet.2",
    ]  # fmt: skip
    assert (results / "_set_aside" / "notes.txt.2").read_text() == "2"


@pytest.mark.parametrize("folder", ["/proc/none", "/proc/none/deeper", "/dev/null/results"])
def test_a_path_that_cannot_be_written(tiny, folder):
    said = tiny("-e", "last", results=Path(folder))
    assert said.code == 2
    assert len(said.errors) == 1
    assert folder.partition("/results")[0] in said.errors[0]


def test_an_error_of_the_disk_names_the_file_and_the_mend(store, monkeypatch):
    monkeypatch.setattr(os, "fsync", lambda fd: os.write(os.open("/dev/full", os.O_WRONLY), b"x"))
    with pytest.raises(StoreError, match=r"cannot write .*abc.parquet: No space left on device; free some space"):
        store.write("abc", META, columns(), 4)
    assert not [p for p in store.folder.rglob("*abc*") if p.is_file()]


def test_a_full_disk_loses_nothing_that_is_stored(shell, cli, tiny, tmp_path, files):
    """The size of files is limited to 8 KiB: the tiny case fits, the larger one does not."""
    results = tmp_path / "results"
    assert tiny("-e", "last").code == 0
    before = files(results)
    command = ["run", "-c", "linear-gaussian", "-e", "kalman", "--runs", 4, "--results", results]
    said = shell(*command, prefix="ulimit -f 8; exec")
    assert said.code == 2
    assert len(said.errors) == 1
    words = "File too large; free some space and repeat the command, what is finished is kept"
    assert re.fullmatch(rf"filterbench: cannot write .*\.parquet: {words}", said.errors[0])
    assert files(results) == before
    assert cli("score", "--results", results).code == 0
