"""The scores on a case's page: what a chooser needs first, side by side, and one table for each family of metrics."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from reports.sentences import against_bound
from reports.text import Quantity, listed
from reports.views import WITHOUT_TRUTH, CaseView, CellView, Key
from suite.metrics import FAMILIES, METRICS, SURVIVING, Score

HEADS = {"rmse": "RMSE", "nees": "NEES", "nis": "NIS"}
"""Metrics better known by their initials."""
BESTS = {"lower": "smallest", "higher": "largest"}
STANDINGS = {"tie": "among the best"}
FIRST = ("rmse", "crlb-ratio", "nees", "divergence", "latency")
"""Metrics of the first table: errors of each block, and one column of each other."""
NEGLIGIBLE = Quantity("negligible", "", "")
WORDS = ("one run", "no interval")
"""What stands in place of an interval."""


@dataclass(frozen=True)
class Column:
    """A metric and block, with the head of its column and what stands below that.

    ahead: the estimator that has the best value though it competes for no place, where there is one. instead: what stands in
    place of the interval of each score in it, where there is none of any.
    """

    key: Key
    head: str
    under: str
    ahead: str
    instead: str


@dataclass(frozen=True)
class Entry:
    """What a table shows of a score: words, standing, count of runs where not all, flags; `absent` says why there is none.

    place: the number by which a reader may sort, NaN where there is none.
    """

    words: Quantity | None = None
    mark: str = ""
    runs: str = ""
    flags: tuple[str, ...] = ()
    absent: str = ""
    place: float = math.nan


@dataclass(frozen=True)
class Table:
    """Scores: estimators that have any in rows, the labels of the others in `without`; `inside` lists the heads."""

    name: str
    heading: str
    inside: str
    note: str
    columns: Sequence[Column]
    rows: Sequence[tuple[CellView, Sequence[Entry]]]
    without: str


def first(case: CaseView) -> Table:
    """What a chooser needs first, of all estimators that were tried: also of those that failed at once."""
    columns, limits = [_column(case, key) for key in _first_keys(case)], case.rounding
    tried = [cell for cell in case.cells.values() if cell.status not in ("refused", "not run")]
    rows = [(cell, [_entry(case, cell, column, limits) for column in columns]) for cell in tried]
    return Table("first", "At a glance", "", against_bound(case.results.bounds), columns, rows, "")


def families(case: CaseView) -> list[Table]:
    """A table for each family of metrics of which any estimator has a score."""
    limits = case.rounding
    return [
        _family(case, family, limits) for family in FAMILIES if any(METRICS[name].family == family for name, _ in case.keys)
    ]


def absent(case: CaseView, status: str) -> list[tuple[str, list[CellView]]]:
    """The cells of a status, 'refused' or 'not run', by their reasons."""
    found: dict[str, list[CellView]] = {}
    for cell in case.cells.values():
        if cell.status == status:
            found.setdefault(cell.reason, []).append(cell)
    return list(found.items())


def sortable(x: float) -> str:
    """A number for the scripts of tables to sort by; empty where there is none."""
    return "" if math.isnan(x) else f"{x:.6g}"


def whole(block: str) -> str:
    """The block over all runs, of one that may be over the surviving ones."""
    return block.removesuffix(f", {SURVIVING}")


def _first_keys(case: CaseView) -> Iterator[Key]:
    held = dict.fromkeys(name for name, _ in case.keys)
    names = FIRST if case.known else (*WITHOUT_TRUTH, "latency")
    for name in names:
        metric = "nis" if name == "nees" and name not in held else name
        keys = [key for key in case.keys if key[0] == metric and key[1] == whole(key[1])]
        yield from keys if metric == "rmse" else keys[:1]


def _family(case: CaseView, family: str, limits: Mapping[str, float]) -> Table:
    columns = [_column(case, key) for key in _ordered(case) if METRICS[key[0]].family == family]
    rows = [(cell, [_entry(case, cell, column, limits) for column in columns]) for cell in case.cells.values() if cell.ran]
    held = [(cell, entries) for cell, entries in rows if not all(entry.absent for entry in entries)]
    without = [cell.label for cell, entries in rows if all(entry.absent for entry in entries)]
    note = against_bound(case.results.bounds) if family == "bound" else ""
    inside = listed(dict.fromkeys(column.head for column in columns))
    return Table(family, FAMILIES[family], inside, note, columns, held, listed(without) if without else "")


def _ordered(case: CaseView) -> list[Key]:
    """The keys, those over surviving runs, which are there where any run diverged, right behind those over all."""
    place = {key: i for i, key in enumerate(case.keys)}
    return sorted(case.keys, key=lambda key: (place.get((key[0], whole(key[1])), place[key]), place[key]))


def _column(case: CaseView, key: Key) -> Column:
    """The metric, and the block where there are several or it is one of the state, or how to read it."""
    metric, block = METRICS[key[0]], key[1]
    reading = f"{metric.better} is better" if isinstance(metric.better, str) else f"{metric.better:g} is best"
    reading = reading if metric.ranked else "not ranked"
    named = metric.unit == "block" or sum(key[0] == metric.name for key in case.keys) > 1
    under = block if metric.unit == "block" else f"{block}; {reading}" if named else reading
    shown = {cell.quantity(key).interval for cell in case.cells.values() if _scored(cell.scores.get(key))}
    instead = shown.pop() if len(shown) == 1 and shown <= set(WORDS) else ""
    ahead = case.ahead(key)
    return Column(
        key,
        HEADS.get(metric.name, metric.title),
        f"{under}; {instead}" if instead else under,
        ahead[0].label if ahead else "",
        instead,
    )


def _scored(score: Score | None) -> bool:
    return score is not None and score.runs > 0 and not math.isnan(score.value)


def _entry(case: CaseView, cell: CellView, column: Column, limits: Mapping[str, float]) -> Entry:
    key = column.key
    metric, score = METRICS[key[0]], cell.scores.get(key)
    if score is None or score.runs == 0:
        if not metric.timed or any(METRICS[name].timed and held.runs for (name, _), held in cell.scores.items()):
            return Entry(absent="none")
        return Entry(absent=f"failed: {cell.timing_failure}" if cell.timing_failure else "not timed")
    runs = "" if score.runs == score.total else f"{score.runs} of {score.total} runs"
    if metric.unit == "block" and score.value <= limits.get(whole(key[1]), -1.0):
        return Entry(NEGLIGIBLE, runs=runs, place=0.0)
    flags = []
    if cell.label == column.ahead:
        best = BESTS[metric.better] if isinstance(metric.better, str) else f"nearest to {metric.better:g}"
        flags.append(f"{best}, not ranked")
    over = {"crlb-ratio": score.high < 1, "efficiency": score.low > 1}
    if over.get(metric.name) and case.results.bounds[0].strict:
        sure = any(remark.kind == "too good" for remark in cell.remarks)
        flags.append("below the bound: too good" if sure else "below the bound: chance, or too good")
    words, mark = cell.quantity(key), cell.mark(key)
    words = Quantity(words.value, words.unit, "") if words.interval == column.instead else words
    return Entry(words, STANDINGS.get(mark, mark), runs, tuple(flags), place=score.value)
