"""What the figures of a case draw: errors over time and tracks on the ground, as plain arrays."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from suite.case import RECORDED
from suite.linalg import Array
from suite.metrics import Metric, counted
from suite.metrics.consistency import chi_square_band
from suite.results import CaseResults, Cell
from suite.statistics import mean_over_time, means

BAND_POINTS = 200
"""Steps at which the interval over time is computed; the line itself has all steps."""


@dataclass(frozen=True)
class Series:
    """A metric over time for one estimator: time[T] and value[T]; the interval low[B], high[B] at the steps `at`[B]."""

    label: str
    time: Array
    value: Array
    at: Array
    low: Array
    high: Array
    runs: int
    total: int

    @property
    def hidden(self) -> int:
        """Steps whose value is infinite, or is missing: a line cannot show them."""
        return int((~np.isfinite(self.value)).sum())

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


@dataclass(frozen=True)
class Tracks:
    """One run on the ground plane: truth[2, T], NaN where it is not known, and the estimates[2, T] by label."""

    run: int
    chosen_by: str
    truth: Array
    estimates: dict[str, Array]
    missing: tuple[str, ...]

    @property
    def known(self) -> bool:
        """Whether a place of the truth is known."""
        return bool(np.isfinite(self.truth).all(0).any())


def over_time(case: CaseResults, metric: Metric, labels: Sequence[str]) -> dict[str, list[Series]]:
    """The metric over time by block, for every estimator of which a run came through."""
    found: dict[str, list[Series]] = {}
    for label in labels:
        cell = case.cells.get(label)
        for block, values in (cell.contributions(metric) if cell else {}).items():
            known = counted(values)
            values = values[:, known if known.any() else cell.estimate.ok]  # of unknown truths nothing is known of any run
            if values.shape[1]:
                found.setdefault(block, []).append(_series(cell, metric, values))
    return found


def _series(cell: Cell, metric: Metric, values: Array) -> Series:
    steps = len(values)
    at = np.unique(np.linspace(0, steps - 1, min(steps, BAND_POINTS)).round().astype(int))
    with np.errstate(all="ignore"):
        value = means(values).map(metric.link).value
        _, low, high = metric.over_time(values[at])
    return Series(cell.label, cell.case.card.time, value, at, low, high, values.shape[1], len(cell.runs))


def tracks(case: CaseResults, labels: Sequence[str]) -> Tracks | None:
    """The run whose error on the ground plane is the median of the first estimator of which a run came through.

    Where none of its errors is known, the first that came through; None without any.
    """
    cells = [case.cells[label] for label in labels if label in case.cells and case.cells[label].runs]
    if case.card.plane is None or not cells:
        return None
    plane = list(case.card.plane)
    first = next((cell for cell in cells if cell.estimate.ok.any()), None)
    if first is None:
        return None
    with np.errstate(all="ignore"):
        error = mean_over_time(((first.estimate.mean - first.truth.x)[:, plane] ** 2).sum(1))[0]
    usable = np.flatnonzero(first.estimate.ok)
    order = usable[np.argsort(error[usable], kind="stable")]  # unknown errors come last
    run = first.runs[order[max((~np.isnan(error[usable])).sum() - 1, 0) // 2]]
    truth = case.truth_of[run].x[:, plane].T
    estimates = {}
    for cell in cells:
        place = cell.runs.index(run) if run in cell.runs else None
        if place is not None and cell.estimate.ok[place]:
            estimates[cell.label] = cell.estimate.mean[:, plane, place].T
    missing = tuple(cell.label for cell in cells if cell.label not in estimates)
    return Tracks(run, first.label, truth, estimates, missing)


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
