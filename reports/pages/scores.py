"""The scores on a case's page: one table for each family of metrics."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from reports.sentences import against_bound
from reports.text import Quantity, listed
from reports.views import CaseView, CellView, Key
from suite.metrics import FAMILIES, METRICS

HEADS = {"rmse": "RMSE", "nees": "NEES", "nis": "NIS"}
"""Metrics better known by their initials."""
BESTS = {"lower": "smallest", "higher": "largest"}


@dataclass(frozen=True)
class Column:
    """A metric and block, with the head of its column and what stands below that.

    ahead: the estimator that has the best value though it competes for no place, where there is one.
    """

    key: Key
    head: str
    under: str
    ahead: str


@dataclass(frozen=True)
class Entry:
    """What a table shows of a score: words, standing, count of runs where not all, flags; `absent` says why there is none."""

    words: Quantity | None = None
    mark: str = ""
    runs: str = ""
    flags: tuple[str, ...] = ()
    absent: str = ""


@dataclass(frozen=True)
class Table:
    """The scores of a family of metrics: estimators that have any in rows, the labels of the others in `without`."""

    family: str
    heading: str
    inside: str
    note: str
    columns: Sequence[Column]
    rows: Sequence[tuple[CellView, Sequence[Entry]]]
    without: str


@dataclass(frozen=True)
class Warned:
    """What a reader must know of an estimator before choosing it."""

    cell: CellView
    reasons: Sequence[str]
    more: int


def tables(case: CaseView) -> list[Table]:
    """A table for each family of which any estimator has a score; the first has all estimators, run or not."""
    found = [_table(case, family) for family in FAMILIES if any(METRICS[name].family == family for name, _ in case.keys)]
    first, *others = found or [Table("error", FAMILIES["error"], "", "", (), (), "")]
    everyone = [(cell, [_entry(case, cell, column) for column in first.columns]) for cell in case.cells.values()]
    return [replace(first, rows=everyone, without=""), *others]


def _table(case: CaseView, family: str) -> Table:
    columns = [_column(case, key) for key in case.keys if METRICS[key[0]].family == family]
    rows = [(cell, [_entry(case, cell, column) for column in columns]) for cell in case.cells.values() if cell.ran]
    held = [(cell, entries) for cell, entries in rows if not all(entry.absent for entry in entries)]
    without = [cell.label for cell, entries in rows if all(entry.absent for entry in entries)]
    note = against_bound(case.results.bounds) if family == "bound" else ""
    inside = listed(dict.fromkeys(column.head for column in columns))
    return Table(family, FAMILIES[family], inside, note, columns, held, listed(without) if without else "")


def _column(case: CaseView, key: Key) -> Column:
    """The metric, and the block where there are several or it is one of the state, or how to read it."""
    metric, block = METRICS[key[0]], key[1]
    reading = f"{metric.better} is better" if isinstance(metric.better, str) else f"{metric.better:g} is best"
    reading = reading if metric.ranked else "not ranked"
    named = metric.unit == "block" or sum(key[0] == metric.name for key in case.keys) > 1
    under = block if metric.unit == "block" else f"{block}; {reading}" if named else reading
    ahead = case.ahead(key)
    return Column(key, HEADS.get(metric.name, metric.title), under, ahead[0].label if ahead else "")


def _entry(case: CaseView, cell: CellView, column: Column) -> Entry:
    key = column.key
    metric, score = METRICS[key[0]], cell.scores.get(key)
    if score is None or score.runs == 0:
        if not metric.timed or any(METRICS[name].timed and held.runs for (name, _), held in cell.scores.items()):
            return Entry(absent="none")
        return Entry(absent=f"failed: {cell.timing_failure}" if cell.timing_failure else "not timed")
    flags = []
    if cell.label == column.ahead:
        best = BESTS[metric.better] if isinstance(metric.better, str) else f"nearest to {metric.better:g}"
        flags.append(f"{best}, not ranked")
    over = {"crlb-ratio": score.high < 1, "efficiency": score.low > 1}
    if over.get(metric.name) and case.results.bounds[0].strict:
        sure = any(remark.kind == "too good" for remark in cell.remarks)
        flags.append("below the bound: too good" if sure else "below the bound: chance, or too good")
    runs = "" if score.runs == score.total else f"{score.runs} of {score.total} runs"
    return Entry(cell.quantity(key), cell.mark(key), runs, tuple(flags))


def warned(case: CaseView) -> list[Warned]:
    """The estimators of which something must be known, with up to four reasons of what went wrong."""
    return [
        Warned(cell, cell.reasons[:4], max(0, len(cell.reasons) - 4))
        for cell in case.cells.values()
        if cell.remarks or cell.failures
    ]
