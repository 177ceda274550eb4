"""Paired differences on a case's page: every estimator beside a reference that the reader chooses."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from reports.pages.scores import sortable, whole
from reports.sentences import first_block
from reports.text import number, within
from reports.views import CaseView
from suite.compare import BETTER, CONDITIONAL, EQUAL, WORSE, ZONE, Comparison, compare_each
from suite.differences import Interval
from suite.metrics import METRICS
from suite.score import ROUNDING

METRIC = METRICS["rmse"]
NEGLIGIBLE = "both negligible"
"""In place of a verdict on errors that are both rounding."""
SAME = "rounding"
"""In place of a difference that is none but for rounding."""


@dataclass(frozen=True)
class Row:
    """An estimator beside the reference: difference, ratio, share of runs won, p, runs and verdict, in words.

    sorts: numbers by which a reader may sort all of these but the verdict. kind: the verdict's own word where it is a sure one.
    """

    label: str
    words: tuple[str, ...]
    sorts: tuple[str, ...]
    kind: str


@dataclass(frozen=True)
class Differences:
    """All comparisons of a case by RMSE: rows by reference and block; `start`, the reference that is shown first."""

    labels: Sequence[str]
    blocks: Sequence[str]
    units: Mapping[str, str]
    rows: Mapping[tuple[str, str], Sequence[Row]]
    start: str

    @property
    def first(self) -> Mapping[str, Row]:
        """What is shown first: rows by label, against `start`, by the first block."""
        return {row.label: row for row in self.rows[self.start, self.blocks[0]]}


def differences(case: CaseView) -> Differences | None:
    """The comparisons of a case, each reference a family of tests as in `filterbench compare`; None with fewer than two."""
    blocks = [block.name for block in case.card.blocks if case.with_score((METRIC.name, block.name))]
    labels = [cell.label for cell in case.cells.values() if any((METRIC.name, block) in cell.scores for block in blocks)]
    if len(labels) < 2:
        return None
    rows: dict[tuple[str, str], list[Row]] = {(label, block): [] for label in labels for block in blocks}
    for reference, comparisons in compare_each([case.results], METRIC, labels, labels).items():
        for found in comparisons:
            if (reference, found.block) in rows:
                rows[reference, found.block].append(_row(found, case.rounding.get(whole(found.block), -1.0)))
    units = {block: METRIC.unit_of(case.card, block) for block in blocks}
    return Differences(labels, blocks, units, rows, _start(case, labels))


def _start(case: CaseView, labels: Sequence[str]) -> str:
    """The first estimator that competes, whatever its place: against the best of these runs every other looks too bad."""
    key = first_block(case)
    scored = [cell for cell in case.with_score(key) if cell.label in labels]
    return next((cell.label for cell in scored if cell.competes(METRIC)), scored[0].label if scored else labels[0])


def _row(c: Comparison, limit: float) -> Row:
    left_out = f", left out {c.left_out} and {c.reference_left_out}" if c.left_out + c.reference_left_out else ""
    runs = f"{c.runs}{left_out}"
    if c.value <= limit and c.reference_value <= limit:
        return Row(c.estimator, ("negligible", "", "", "", runs, NEGLIGIBLE), ("", "", "", "", str(c.runs)), "")
    apart = np.abs([c.difference.value, c.difference.low, c.difference.high])
    same = bool((apart <= ROUNDING * abs(c.reference_value)).all())
    base = c.verdict.removesuffix(CONDITIONAL)
    verdict = f"{base} within {100 * ZONE:g} %" if base == EQUAL else base
    percent = Interval(*(100 * x for x in (c.wins.value, c.wins.low, c.wins.high)))
    return Row(
        c.estimator,
        (
            SAME if same else _words(c.difference, c.unit),
            "1" if same else _words(c.ratio),
            _words(percent, "%"),
            _p(c.holm),
            runs,
            verdict + c.verdict.removeprefix(base),
        ),
        tuple(sortable(x) for x in (c.difference.value, c.ratio.value, c.wins.value, c.holm, c.runs)),
        base if base in (BETTER, WORSE, EQUAL) else "",
    )


def _words(number_: Interval, unit: str = "") -> str:
    """A number with its interval, as far as there is one."""
    if math.isnan(number_.value):
        return ""
    if math.isnan(number_.low):
        return f"{number(number_.value)} {unit}".strip()
    return within(number_.value, number_.low, number_.high, unit)


def _p(p: float) -> str:
    """A p-value to two digits, not below a thousandth."""
    return "" if math.isnan(p) else "< 0.001" if p < 0.001 else "1" if p > 0.995 else f"{p:.2g}"


def script(found: Differences) -> str:
    """The rows as a script that the page loads when another reference or block is chosen: it hands them to the page."""
    place = {label: i for i, label in enumerate(found.labels)}
    rows = [
        [[_cells(place[row.label], row) for row in found.rows[label, block]] for block in found.blocks]
        for label in found.labels
    ]
    said = {"labels": found.labels, "blocks": found.blocks, "rows": rows}
    detail = json.dumps(said, separators=(",", ":"), ensure_ascii=False)
    return f'window.dispatchEvent(new CustomEvent("differences", {{ detail: {detail} }}));\n'


def _cells(place: int, row: Row) -> list[Any]:
    return [place, row.words, row.sorts, row.kind]
