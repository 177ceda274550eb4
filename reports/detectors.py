"""Detectors on a case: their receiver operating characteristics and what they do at false-alarm levels, as plain data."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from suite import roc
from suite.linalg import Array
from suite.metrics.detection import scores
from suite.operating import operating_points
from suite.results import CaseResults

MOST_CORNERS = 400
"""A curve with more is thinned; one of many scans has nearly as many as there are scores."""
NEAR_ENOUGH = 1 / 800
"""How far a point of a curve may be from the one that is kept: less than a drawing shows."""
STRAIGHT = 1e-9
"""A turn by less, in radians, is rounding."""


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
    """The corners of a curve; of many, as many that no point is farther than `NEAR_ENOUGH` from the line through those kept."""
    points = np.stack([curve.false_alarm, curve.detection])
    points = points[:, _corners(points)]
    if points.shape[1] > MOST_CORNERS:
        points = points[:, _kept(points)]
    return points[0].tolist(), points[1].tolist()


def _corners(points: Array) -> NDArray[np.bool_]:
    """Where points[2, D] are no part of a straight line, the ends included [D]."""
    x, y = steps = np.diff(points)
    length = np.hypot(*steps)
    turn = np.abs(x[:-1] * y[1:] - y[:-1] * x[1:]) > STRAIGHT * length[:-1] * length[1:]
    return np.concatenate([[True], turn, [True]])


def _kept(points: Array) -> list[int]:
    """Places of points[2, D] to keep, the ends included: the farthest one, then both sides (Douglas and Peucker, 1973)."""
    kept, waiting = {0, points.shape[1] - 1}, [(0, points.shape[1] - 1)]
    while waiting:
        first, last = waiting.pop()
        inner = points[:, first + 1 : last] - points[:, first, None]
        along = points[:, last] - points[:, first]
        away = np.abs(along[0] * inner[1] - along[1] * inner[0]) / np.hypot(*along)
        if away.max(initial=0.0) > NEAR_ENOUGH:
            middle = first + 1 + int(away.argmax())
            kept.add(middle)
            waiting += [(first, middle), (middle, last)]
    return sorted(kept)
