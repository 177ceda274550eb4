"""Detectors on a case: their receiver operating characteristics and what they do at false-alarm levels, as plain data."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from suite import roc
from suite.linalg import Array
from suite.metrics.detection import scores
from suite.operating import operating_points
from suite.results import CaseResults

CURVE_POINTS = 400
"""Points of a curve that are kept at most; a curve of many scans has as many as there are scores."""


@dataclass(frozen=True)
class Detector:
    """A detector on a case: per scan and per manoeuvre the curve as (false-alarm rates, detection rates), ascending.

    points: what `suite.operating.operating_points` says of it, a row a false-alarm level.
    """

    label: str
    curves: dict[str, tuple[list[float], list[float]]]
    points: list[dict[str, Any]]


def detectors(case: CaseResults) -> Iterator[Detector]:
    """All cells that have a statistic and manoeuvres, of the runs that came through."""
    for label, cell in case.cells.items():
        if cell.evidence and (found := scores(cell.evidence)):
            known = {name: part[..., cell.estimate.ok] for name, part in found.items()}
            curves = {name: _thinned(roc.curve(part)) for name, part in known.items() if _both(part)}
            yield Detector(label, curves, operating_points(cell.evidence).to_dict("records"))


def _both(part: Array) -> bool:
    """Whether there are scores of nominal motion and of manoeuvres."""
    return bool((~np.isnan(part)).any((1, 2)).all())


def _thinned(curve: roc.Curve) -> tuple[list[float], list[float]]:
    """The corners of a curve, of many those that are spread evenly along it."""
    along = np.append(0, np.cumsum(np.abs(np.diff(curve.false_alarm)) + np.abs(np.diff(curve.detection))))
    at = np.unique(np.searchsorted(along, np.linspace(0, along[-1], CURVE_POINTS)))
    at = np.arange(len(along)) if len(along) <= CURVE_POINTS else at
    return curve.false_alarm[at].tolist(), curve.detection[at].tolist()
