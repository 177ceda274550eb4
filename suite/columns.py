"""Recorded columns from CSV and Parquet files: every fault is named with its file, line and column."""

import csv
import io
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta
from pathlib import Path

import pandas
import pyarrow.parquet as pq

from suite.errors import BadInput, near, one_line

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
ISO = "ISO 8601"


@dataclass(frozen=True)
class Columns:
    """Cells by column and row; `word` is what a row is called in the file, lines[row] its number there."""

    file: Path
    word: str
    lines: Sequence[int]
    cells: Mapping[str, Sequence[object]]

    def at(self, row: int, column: str = "") -> str:
        """Where a row or a cell stands."""
        return f"{self.file}, {self.word} {self.lines[row]}" + (f", column {column!r}" if column else "")

    def only(self, known: Sequence[str]) -> None:
        """Raise BadInput when there are other columns than the known ones."""
        for column in self.cells:
            if column not in known:
                raise BadInput(f"{self.file}: unknown column {column!r}; {near(column, known)}")

    def need(self, columns: Sequence[str]) -> None:
        """Raise BadInput when one of these columns is missing."""
        for column in columns:
            if column not in self.cells:
                raise BadInput(f"{self.file}: the column {column!r} is missing; there are {', '.join(self.cells)}")

    def blank(self, row: int, column: str) -> bool:
        """Whether a cell holds nothing."""
        cell = self.cells[column][row]
        if isinstance(cell, str):
            return not cell.strip()
        return cell is None or cell is pandas.NA or cell is pandas.NaT or (isinstance(cell, float) and math.isnan(cell))

    def text(self, row: int, column: str) -> str:
        """The text in a cell. Raises BadInput when there is none."""
        if self.blank(row, column):
            raise BadInput(f"{self.at(row, column)}: is blank")
        return str(self.cells[column][row]).strip()

    def number(self, row: int, column: str) -> float:
        """The number in a cell. Raises BadInput when there is none."""
        if self.blank(row, column):
            raise BadInput(f"{self.at(row, column)}: a number is missing")
        return _number(self.cells[column][row], self.at(row, column))

    def instant(self, row: int, unit: str) -> float:
        """The time of a row, as `instant` gives it."""
        if self.blank(row, "time"):
            raise BadInput(f"{self.at(row, 'time')}: a time is missing")
        return instant(self.cells["time"][row], unit, self.at(row, "time"))


def read(path: Path) -> Columns:
    """The columns of a CSV (UTF-8, with a header) or Parquet file. Raises BadInput."""
    readers: dict[str, Callable[[Path], Columns]] = {".csv": _csv, ".parquet": _parquet}
    if path.suffix.lower() not in readers:
        raise BadInput(f"{path}: must be a .csv or a .parquet file")
    if not path.is_file():
        raise BadInput(f"{path}: there is no such file")
    found = readers[path.suffix.lower()](path)
    if not found.lines:
        raise BadInput(f"{path}: is empty")
    return found


def instant(cell: object, unit: str, where: str) -> float:
    """A time in its unit, or in whole microseconds since 1970 when the unit is ISO 8601; without a zone it is UTC.

    Raises BadInput when the cell holds no such time.
    """
    if unit != ISO:
        return _number(cell, where)
    try:
        moment = cell if isinstance(cell, date) else datetime.fromisoformat(str(cell).strip())
    except ValueError:
        moment = None
    if not isinstance(moment, datetime):
        raise BadInput(f"{where}: must be a date and time in ISO 8601, got {cell!r}")
    aware = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    return (aware - EPOCH) // timedelta(microseconds=1)


def _number(cell: object, where: str) -> float:
    try:
        value = math.nan if isinstance(cell, bool) or "_" in str(cell) else float(cell)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        value = math.nan
    if not math.isfinite(value):
        raise BadInput(f"{where}: must be a number, got {cell!r}")
    return value


def _csv(path: Path) -> Columns:
    try:
        reader = csv.reader(io.StringIO(path.read_bytes().decode("utf-8-sig"), newline=""), strict=True)
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise BadInput(f"{path}, line {line}: is no text in UTF-8") from error
    try:
        rows = [(reader.line_num, row) for row in reader if row]
    except csv.Error as error:
        raise BadInput(f"{path}, line {reader.line_num}: is no CSV: {one_line(error)}") from error
    if not rows:
        raise BadInput(f"{path}: is empty")
    line, names = rows[0]
    for mark, word in ((";", "semicolons"), ("\t", "tabs")):
        if len(names) == 1 and mark in names[0]:
            raise BadInput(f"{path}, line {line}: columns must be separated by commas, not by {word}, and decimals by points")
    header = [" ".join(name.split()) for name in names]
    _distinct(path, header)
    for line, row in rows[1:]:
        if len(row) != len(header):
            raise BadInput(f"{path}, line {line}: has {len(row)} cells, the header has {len(header)}")
    cells = {name: [row[i] for _, row in rows[1:]] for i, name in enumerate(header)}
    return Columns(path, "line", [line for line, _ in rows[1:]], cells)


def _parquet(path: Path) -> Columns:
    try:
        _distinct(path, pq.read_schema(path).names)
        frame = pandas.read_parquet(path)
    except BadInput:
        raise
    except Exception as error:  # pyarrow's own errors are many
        raise BadInput(f"{path}: is no Parquet file: {one_line(error)}") from error
    return Columns(path, "row", range(1, len(frame) + 1), {str(name): frame[name].tolist() for name in frame})


def _distinct(path: Path, names: Sequence[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise BadInput(f"{path}: there are two columns {name!r}")
