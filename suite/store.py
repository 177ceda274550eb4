"""The store: one immutable, content-addressed Parquet file a block of work.

Files are tidy, one row per run and step, all with one schema, so that `pandas.read_parquet(folder)` reads a whole
folder. They are written under a temporary name, flushed and renamed: what is there is whole. A checksum in each file's
footer tells when it has changed since. Names that begin with an underscore or a dot are not results, and Parquet readers
skip them.
"""

import errno
import io
import json
import os
import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from suite.errors import StoreError
from suite.files import sweep, write_whole
from suite.linalg import Array

FORMAT = 1
META, CHECKSUM = b"filterbench", b"filterbench.checksum"
MARKER = "_filterbench.json"
SET_ASIDE = "_set_aside"
_TEXT = pa.dictionary(pa.int32(), pa.string())
_VECTOR = pa.list_(pa.float64())
SCHEMA = pa.schema(
    {
        "case": _TEXT,
        "estimator": _TEXT,
        "kind": _TEXT,
        "seed": pa.int64(),
        "version": _TEXT,
        "run": pa.int32(),
        "step": pa.int32(),
        "truth": _VECTOR,
        "y": _VECTOR,
        "true_mode": pa.int32(),
        "mean": _VECTOR,
        "cov": _VECTOR,
        "bound": _VECTOR,
        "bound_error": _VECTOR,
        "loglik": pa.float64(),
        "ess": pa.float64(),
        "ancestors": pa.float64(),
        "acceptance": pa.float64(),
        "statistic": pa.float64(),
        "innovation": _VECTOR,
        "mode": _VECTOR,
        "seconds": pa.float64(),
        "batch": pa.int32(),
        "memory": pa.float64(),
        "logliks": _VECTOR,
        "status": _TEXT,
        "reason": _TEXT,
    }
)


@dataclass(frozen=True)
class Entry:
    """A block that is stored: its file and what it says of itself."""

    path: Path
    meta: Mapping[str, Any]


@dataclass(frozen=True)
class Damage:
    """A file in the store that is not one of its blocks, with the reason."""

    path: Path
    reason: str


class Store:
    """A results folder. Raises StoreError when the path is not, and cannot become, one."""

    def __init__(self, folder: str | Path, create: bool = False):
        self.folder = Path(folder)
        marker = self.folder / MARKER
        if self.folder.exists() and not self.folder.is_dir():
            raise StoreError(f"results {self.folder} is a file; name a folder")
        if marker.exists():
            return
        if self.folder.exists() and any(self.folder.iterdir()):
            raise StoreError(f"{self.folder} holds other files and no results; name an empty or new folder")
        if not create:
            raise StoreError(f"no results in {self.folder}; run `filterbench run --results {self.folder}` first")
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            marker.write_text(json.dumps({"format": FORMAT}) + "\n")
        except OSError as error:
            raise unwritable(self.folder, error) from error

    def scan(self) -> tuple[list[Entry], list[Damage]]:
        """All blocks, ordered by path, and what lies among them without being one."""
        entries, damages = [], []
        for path in self._files():
            try:
                entries.append(Entry(path, _read_meta(path)))
            except Exception as error:  # whatever a damaged file makes the reader raise
                damages.append(Damage(path, " ".join(str(error).split())[:200] or type(error).__name__))
        return entries, damages

    def set_aside(self, damage: Damage) -> Path:
        """Move a damaged or alien file out of the way, and return where it is now."""
        target = self.folder / SET_ASIDE / damage.path.relative_to(self.folder)
        number = 0
        while target.exists() or target.is_symlink():
            number += 1
            target = target.with_name(f"{damage.path.name}.{number}")
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            damage.path.rename(target)
        except OSError as error:
            raise unwritable(damage.path, error) from error
        return target

    def sweep(self) -> None:
        """Remove the temporary files of writers that are no longer alive."""
        try:
            sweep(self.folder.rglob(".*.tmp"), r"\w+\.parquet")
        except OSError as error:
            raise unwritable(self.folder, error) from error

    def write(self, address: str, meta: Mapping[str, Any], columns: Mapping[str, Any], rows: int) -> Path:
        """Store a block; columns left out are null. Raises StoreError when the disk does not take it."""
        folder = (
            self.folder / _slug(meta["case"]["name"]) / _slug(meta["estimator"]["label"] if meta["estimator"] else meta["kind"])
        )
        final = folder / f"{address}.parquet"
        content = _encode(_table(columns, rows), json.dumps({**meta, "address": address}))
        try:
            folder.mkdir(parents=True, exist_ok=True)
            write_whole(final, content)
        except OSError as error:
            raise unwritable(final, error) from error
        return final

    def _files(self) -> Iterator[Path]:
        for root, folders, names in os.walk(self.folder):
            folders[:] = sorted(f for f in folders if not f.startswith(("_", ".")))
            links = [f for f in folders if f.endswith(".parquet")]  # a folder where a file should be
            folders[:] = [f for f in folders if f not in links]
            yield from (Path(root) / n for n in sorted([*names, *links]) if not n.startswith(("_", ".")))


def read(path: Path, names: list[str]) -> dict[str, Any]:
    """Columns of a block as arrays: numbers [rows], vectors [rows, d], texts as lists; None for a column that holds nothing.

    Raises StoreError when the file's contents are damaged.
    """
    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            held = [name for name in file.schema_arrow.names if name in names]  # files of older versions lack some
            table = file.read(columns=held)
    except (OSError, pa.ArrowException) as error:
        raise StoreError(f"{path} is damaged ({' '.join(str(error).split())[:120]}); run again to recompute it") from error
    return {name: _array(table.column(name)) if name in held else None for name in names}


def vectors(values: Array) -> pa.ListArray:
    """A column of vectors from an array [rows, d]."""
    rows, d = values.shape
    return pa.ListArray.from_arrays(np.arange(rows + 1, dtype=np.int32) * d, np.ascontiguousarray(values).ravel())


def constant(text: str, rows: int) -> pa.DictionaryArray:
    """A column that says the same in every row."""
    return pa.DictionaryArray.from_arrays(np.zeros(rows, np.int32), [text])


def texts(values: Sequence[str], repeat: int) -> pa.DictionaryArray:
    """A column that repeats each text `repeat` times."""
    distinct = list(dict.fromkeys(values))
    codes = np.array([distinct.index(v) for v in values], np.int32)
    return pa.DictionaryArray.from_arrays(np.repeat(codes, repeat), distinct)


def unwritable(path: Path, error: OSError) -> StoreError:
    """The error to show when a path cannot be written."""
    mend = (
        "free some space"
        if error.errno in (errno.ENOSPC, errno.EFBIG, errno.EDQUOT)
        else "make it writable or name another folder"
    )
    reason = error.strerror or " ".join(str(error).split())
    return StoreError(f"cannot write {path}: {reason}; {mend} and repeat the command, what is finished is kept")


def _table(columns: Mapping[str, Any], rows: int) -> pa.Table:
    arrays = []
    for field in SCHEMA:
        value = columns.get(field.name)
        array = pa.nulls(rows, field.type) if value is None else pa.array(value)
        arrays.append(array if array.type == field.type else array.cast(field.type))
    return pa.table(arrays, schema=SCHEMA)


def _encode(table: pa.Table, meta: str) -> bytes:
    """The bytes of a block's file; the footer holds what it says of itself, and the checksum."""
    buffer = io.BytesIO()
    with pq.ParquetWriter(buffer, SCHEMA, compression="zstd", write_page_checksum=True) as writer:
        writer.write_table(table)
        writer.add_key_value_metadata({META: meta, CHECKSUM: _checksum(buffer.getvalue(), meta.encode())})
    return buffer.getvalue()


def _checksum(data: bytes, meta: bytes) -> str:
    """Checksum of all that stands before the footer, and of what the file says of itself."""
    return f"{zlib.crc32(meta, zlib.crc32(data)):08x}"


def _array(column: pa.ChunkedArray) -> Any:
    if column.null_count == len(column):
        return None
    chunk = column.combine_chunks()
    if pa.types.is_list(column.type):
        return chunk.flatten().to_numpy(zero_copy_only=False).reshape(len(chunk), -1)
    if pa.types.is_dictionary(column.type):
        return np.array(chunk.dictionary.to_pylist(), object)[chunk.indices.to_numpy()].tolist()
    return chunk.to_numpy(zero_copy_only=False)


def _read_meta(path: Path) -> dict[str, Any]:
    if path.suffix != ".parquet":
        raise ValueError("not a Parquet file of this store")
    if not path.is_file():
        raise ValueError("not a readable file")
    content = path.read_bytes()
    said = pq.read_metadata(io.BytesIO(content)).metadata or {}
    if META not in said or CHECKSUM not in said:
        raise ValueError("a Parquet file, but not written by filterbench")
    footer = int.from_bytes(content[-8:-4], "little") + 8
    if _checksum(content[:-footer], said[META]) != said[CHECKSUM].decode():
        raise ValueError("its contents have changed since they were written")
    meta = json.loads(said[META])
    if meta.get("address") != path.stem:
        raise ValueError(f"its contents belong to address {meta.get('address')}")
    return dict(meta)


def _slug(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9.-]+", "_", name).strip("_.")[:80] or "unnamed"
