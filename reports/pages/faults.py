"""What is to be known of estimators before choosing one: remarks of scores, and what went wrong in how many runs."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from reports.text import count
from reports.views import CaseView, CellView
from suite.diagnosis import Remark
from suite.estimator import OK

MOST = 4
"""Reasons of an estimator that are told on the page."""


@dataclass(frozen=True)
class Warned:
    """What a reader must know of estimators before choosing one of them; more: how many further reasons there are."""

    labels: Sequence[str]
    remarks: Sequence[Remark]
    reasons: Sequence[str]
    more: int


def warned(case: CaseView) -> list[Warned]:
    """The estimators of which something must be known, those together of which the same is to be said.

    Reasons of what went wrong are the most frequent ones.
    """
    found: dict[tuple[tuple[Remark, ...], tuple[str, ...]], list[str]] = {}
    for cell in case.cells.values():
        reasons = tuple(_reasons(case, cell))
        if cell.remarks or reasons:
            found.setdefault((cell.remarks, reasons), []).append(cell.label)
    return [Warned(labels, said, reasons[:MOST], max(0, len(reasons) - MOST)) for (said, reasons), labels in found.items()]


def _reasons(case: CaseView, cell: CellView) -> list[str]:
    """What went wrong, the most frequent first, with the steps and the number of runs; then what is told of no run."""
    held = case.results.cells.get(cell.label)
    ended: dict[str, list[int | None]] = {}
    told = set()
    if held is not None and held.runs:
        for status, reason in zip(held.estimate.status, held.estimate.reason, strict=True):
            if status != OK:
                step, words = _parted(reason)
                ended.setdefault(words, []).append(step)
                told.add(reason)
    often = sorted(ended.items(), key=lambda item: -len(item[1]))
    return [*(_told(words, steps) for words, steps in often), *(reason for reason in cell.reasons if reason not in told)]


def _parted(reason: str) -> tuple[int | None, str]:
    """A reason's step, where it begins with one, and its words."""
    found = re.match(r"step (\d+): (.*)", reason, re.DOTALL)
    return (int(found[1]), found[2]) if found else (None, reason)


def _told(words: str, steps: Sequence[int | None]) -> str:
    known = [step for step in steps if step is not None]
    runs = count(len(steps), "run")
    if len(known) < len(steps) or not known:
        return f"{words} ({runs})"
    first, last = min(known), max(known)
    return f"{words} ({runs}, {f'step {first}' if first == last else f'steps {first} to {last}'})"
