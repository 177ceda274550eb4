"""The runs of a case one by one: which is the best, the median and the worst, and the table of their errors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reports.text import number
from reports.views import CaseView
from suite.estimator import OK
from suite.linalg import Array
from suite.results import CaseResults, Cell
from suite.statistics import mean_over_time

MOST_RUNS = 200
"""Rows of the table of runs at most."""
BEST, MEDIAN, WORST = "best", "median", "worst"


@dataclass(frozen=True)
class Runs:
    """The table of runs: the state block and unit of its errors, the estimators in its columns, and a row a run.

    rows: number of the run, whether it is the best, the median or the worst one, and of each estimator the error in words and
    what went wrong in a word. left: how many runs the table leaves out. load: Python that loads the run `example`.
    """

    block: str
    unit: str
    labels: Sequence[str]
    rows: Sequence[tuple[int, str, Sequence[tuple[str, str]]]]
    left: int
    example: int
    load: str


def errors(cell: Cell, components: Sequence[int]) -> Array:
    """Root mean square over the known steps of the Euclidean error of some components [R]; NaN of runs of which none is."""
    with np.errstate(all="ignore"):
        squared = ((cell.estimate.mean - cell.truth.x)[:, list(components)] ** 2).sum(1)
        return np.asarray(np.sqrt(mean_over_time(squared)[0]))


def chosen(case: CaseResults, labels: Sequence[str], components: Sequence[int]) -> dict[str, int]:
    """The numbers of the best, the median and the worst run, as far as there are so many of which an error is known.

    By the median over the estimators that came through a run of its error, each over that estimator's own median.
    """
    relative: dict[int, list[float]] = {}
    for cell in _with_runs(case, labels):
        found, ok = errors(cell, components), cell.estimate.ok
        known = ok & ~np.isnan(found)
        if known.any():
            usual = float(np.sort(found[known])[(known.sum() - 1) // 2])
            for place in np.flatnonzero(known):
                relative.setdefault(cell.runs[place], []).append(_over(float(found[place]), usual))
    ranks = sorted((float(np.median(values)), run) for run, values in relative.items())
    order = [run for _, run in ranks]
    if len(order) < 3:
        return dict(zip((BEST, WORST) if len(order) == 2 else (MEDIAN,), order, strict=False))
    return {BEST: order[0], MEDIAN: order[(len(order) - 1) // 2], WORST: order[-1]}


def _over(error: float, usual: float) -> float:
    """An error over the usual one; 1 where both are zero, or beyond all numbers."""
    return 1.0 if error == usual else error / usual if usual else np.inf


def _with_runs(case: CaseResults, labels: Sequence[str]) -> list[Cell]:
    return [case.cells[label] for label in labels if label in case.cells and case.cells[label].runs]


def table(case: CaseView, labels: Sequence[str], picked: Mapping[str, int]) -> Runs | None:
    """The error of each estimator in each run, over the first state block; None without a run or a block."""
    cells = _with_runs(case.results, labels)
    if not cells or not case.card.blocks:
        return None
    block = case.card.blocks[0]
    columns = [_column(cell, block.components) for cell in cells]
    numbers = sorted({run for cell in cells for run in cell.runs})
    shown = numbers[:MOST_RUNS]
    told = {run: which for which, run in picked.items()}
    nothing = ("not run", "")
    rows = [(run, told.get(run, ""), [column.get(run, nothing) for column in columns]) for run in shown]
    example = picked.get(MEDIAN, shown[0])
    left, code = len(numbers) - len(shown), load(case.results, example)
    return Runs(block.name, block.unit, [c.label for c in cells], rows, left, example, code)


def _column(cell: Cell, components: Sequence[int]) -> dict[int, tuple[str, str]]:
    """By run the error in words, and what went wrong in a word."""
    assert cell.evidence is not None
    away: NDArray[np.bool_] = np.isfinite(cell.evidence.away)
    found = errors(cell, components)
    said = {}
    for place, run in enumerate(cell.runs):
        status = cell.estimate.status[place]
        if status != OK:
            said[run] = ("", status)
        else:
            value = "unknown" if np.isnan(found[place]) else number(float(found[place]))
            said[run] = (value, "diverged" if away[place] else "")
    return said


def load(case: CaseResults, run: int) -> str:
    """Python that loads a run of the case: its truth, and all estimates of it."""
    folder = case.truths[0].path.parent.parent
    return (
        "import pandas\n\n"
        f'rows = pandas.read_parquet("{folder.parent.name}/{folder.name}",\n'
        f'    filters=[("run", "==", {run}), ("seed", "==", {case.seed}), ("kind", "in", ["truth", "estimate"])])\n'
        'truth = rows[rows["kind"] == "truth"]  # one row a step: truth, y, true_mode\n'
        'estimates = rows[rows["kind"] == "estimate"].groupby("estimator", observed=True)  # mean, cov, ...'
    )
