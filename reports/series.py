"""What figures over time draw, as plain arrays, and the order in which they name estimators."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from reports.sentences import first_block
from reports.views import CaseView
from suite.case import RECORDED
from suite.linalg import Array
from suite.metrics import METRICS, Metric, counted
from suite.metrics.consistency import chi_square_band
from suite.results import CaseResults, Cell
from suite.score import ROUNDING, loss, rounding
from suite.statistics import means

BAND_POINTS = 100
"""Steps at which the interval over time is computed; the line itself has all steps."""
SHOWN_FIRST = 8
"""Of many estimators a figure shows so many at first."""
ALIKE = 1e-3
"""Relative difference up to which two lines cannot be told apart."""


@dataclass(frozen=True)
class Series:
    """A metric over time for one estimator: time[T] and value[T]; the interval low[B], high[B] at the steps `at`[B].

    negligible: values up to this are rounding; minus infinity where none are.
    """

    label: str
    time: Array
    value: Array
    at: Array
    low: Array
    high: Array
    runs: int
    total: int
    negligible: float = -np.inf

    @property
    def hidden(self) -> int:
        """Steps whose value is infinite, or is missing: a line cannot show them."""
        return int((~np.isfinite(self.value)).sum())

    @property
    def peak(self) -> float:
        """The largest finite value; minus infinity without any."""
        return float(self.value[np.isfinite(self.value)].max(initial=-np.inf))

    @property
    def rounding(self) -> bool:
        """Whether there is nothing in it but rounding."""
        return -np.inf < self.peak <= self.negligible

    def spread(self, end: Array) -> Array:
        """An end of the interval over all steps [T], NaN where it was not computed."""
        whole = np.full(len(self.time), np.nan)
        whole[self.at] = end
        return whole


@dataclass(frozen=True)
class Band:
    """Where chance alone puts the average over runs of a normalised square: low[T], high[T].

    NaN where runs differ in dimension; runs and dimension are the most of any step.
    """

    low: Array
    high: Array
    runs: int
    dimension: int


def ranked(case: CaseView) -> list[str]:
    """All labels, in the order in which figures name them, by the RMSE of the first block.

    Those that are marked come first, then those that compete, then the others, each by their values but for rounding; behind
    them those whose value is that of one before, whose line it would hide; last those without a value.
    """
    key = first_block(case)
    metric = METRICS[key[0]]
    values = {cell.label: float(loss(metric, np.asarray(cell.scores[key].value))) for cell in case.with_score(key)}
    values = {label: round(value / ROUNDING) for label, value in values.items() if np.isfinite(value)}

    def place(label: str) -> tuple[bool, bool, float]:
        cell = case.cells[label]
        return not cell.mark(key), not cell.competes(metric), values.get(label, 0)

    distinct: list[str] = []
    for label in sorted(values, key=place):
        if not any(math.isclose(values[label], values[other], rel_tol=ALIKE) for other in distinct):
            distinct.append(label)
    return sorted(case.cells, key=lambda label: (label not in values, label not in distinct, *place(label)))


def first(labels: Sequence[str]) -> tuple[str, ...]:
    """Those of a figure's estimators, in the order of `ranked`, that it shows at first; none where it shows all."""
    return tuple(labels[:SHOWN_FIRST]) if len(labels) > SHOWN_FIRST else ()


def over_time(case: CaseResults, metric: Metric, labels: Sequence[str]) -> dict[str, list[Series]]:
    """The metric over time by block, for every estimator of which a run came through."""
    found: dict[str, list[Series]] = {}
    for label in labels:
        cell = case.cells.get(label)
        for block, values in (cell.contributions(metric) if cell else {}).items():
            known = counted(values)
            values = values[:, known if known.any() else cell.estimate.ok]  # of unknown truths nothing is known of any run
            if values.shape[1]:
                found.setdefault(block, []).append(_series(cell, metric, block, values))
    return found


def _series(cell: Cell, metric: Metric, block: str, values: Array) -> Series:
    steps = len(values)
    at = np.unique(np.linspace(0, steps - 1, min(steps, BAND_POINTS)).round().astype(int))
    with np.errstate(all="ignore"):
        value = means(values).map(metric.link).value
        _, low, high = metric.over_time(values[at])
    limit = rounding(cell.case.rounding, metric, block)
    return Series(cell.label, cell.case.card.time, value, at, low, high, values.shape[1], len(cell.runs), limit)


def band(case: CaseResults, metric: Metric, labels: Sequence[str]) -> Band | None:
    """The band of NEES or NIS for the first of the estimators with the most runs; None without any.

    Runs of a recording are of the same data: for chance they are one.
    """
    cells = [case.cells[label] for label in labels if label in case.cells and case.cells[label].contributions(metric)]
    if not cells:
        return None
    cell = max(cells, key=lambda c: c.counts["ok"])
    (values,) = cell.contributions(metric).values()
    known = ~np.isnan(values)
    if not known.any():
        return None
    assert cell.evidence is not None
    innovation = cell.estimate.innovation
    components = cell.evidence.dimension if metric.name == "nees" or innovation is None else (~np.isnan(innovation)).sum(1)
    least, most = np.where(known, components, np.inf).min(1), np.where(known, components, -np.inf).max(1)
    runs = known.sum(1)
    runs = np.minimum(runs, 1) if case.card.origin == RECORDED else runs
    low, high = chi_square_band(np.where(least == most, most, np.nan), runs)
    return Band(low, high, int(runs.max()), int(most.max()))
