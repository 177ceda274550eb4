"""What is wrong with an estimator on a case, as far as its scores can tell: in words, and only where they are sure of it."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from suite.case import FROM_MODEL, RECORDED
from suite.digits import within
from suite.linalg import Array
from suite.metrics import METRICS, SURVIVING, Metric, Score, counted
from suite.results import Cell
from suite.statistics import Resampled, below_zero

Scale = Callable[[Array], Array]
SURE = 1e-3
"""Probability at most of a remark by chance, of each kind on each estimator and case that give no cause for it.

At the very limit of a cause it is a few times that, where runs are few and their errors very skew.
"""
CREDIBLE = 1.5
"""Mean squared errors so many times larger or smaller than the covariance says are named; a little they always differ."""
LATE = 0.5
"""Steps behind the truth beyond which an estimator is called late."""
OFTEN = 0.5
"""Share of diverged runs from which on an estimator is said to lose its target."""


@dataclass(frozen=True)
class Remark:
    """What a reader must know of an estimator on a case before choosing it: in a word or two, and in a sentence.

    bars: whether it keeps the estimator from being called best, see `barred`.
    """

    kind: str
    words: str
    bars: bool


_KNOWN: WeakKeyDictionary[Cell, list[Remark]] = WeakKeyDictionary()


def remarks(cell: Cell) -> list[Remark]:
    """What is wrong with an estimator on a case, looked up once; nothing where no run is stored."""
    if cell not in _KNOWN:
        looks = (_incomplete, _lost_target, _too_good, _misled, _incredible, _late)
        _KNOWN[cell] = [remark for look in looks for remark in look(cell)] if cell.runs else []
    return _KNOWN[cell]


def in_words(found: Sequence[Remark]) -> str:
    """Remarks in one line."""
    return "; ".join(remark.words for remark in found)


def barred(found: Sequence[Remark], metric: Metric) -> bool:
    """Whether remarks keep an estimator from a place by a metric: not by running time, nor by what its statistic detects."""
    return not metric.timed and metric.family != "detection" and any(remark.bars for remark in found)


def _incomplete(cell: Cell) -> Iterator[Remark]:
    for status in ("failed", "lost"):
        if count := cell.counts[status]:
            yield Remark(status, f"{status} in {count} of {len(cell.runs)} runs", True)


def _lost_target(cell: Cell) -> Iterator[Remark]:
    score = cell.scores(METRICS["divergence"]).get("runs")
    if score and score.runs and score.value >= OFTEN:
        yield Remark("diverges", f"diverged in {round(score.value * score.runs)} of {score.runs} runs", True)


def _too_good(cell: Cell) -> Iterator[Remark]:
    """Errors below a bound that holds for every estimator: it knows what measurements do not tell."""
    bound = cell.case.bounds[0] if cell.case.bounds else None
    if bound is None or not bound.strict:
        return
    with np.errstate(all="ignore"):
        uncertain = 4 * np.nanmax(np.where(bound.value > 0, bound.error / bound.value, 0.0))
    for block, score in _below(cell, "crlb-ratio", 1 - uncertain):
        yield Remark("too good", f"RMSE of {block} only {_size(score)} of a bound that no estimator can beat", True)
        return


def _misled(cell: Cell) -> Iterator[Remark]:
    for block, score in _beyond(cell, "skill", 0.0, -1, _log_of_unexplained):
        times = within(1 - score.value, 1 - score.high, 1 - score.low, "")
        words = f"squared errors of {block} larger than without any measurement: {times} times as large"
        yield Remark("misled", words, True)
        return


def _incredible(cell: Cell) -> Iterator[Remark]:
    """A covariance far from the errors; where the truth is drawn from the model, that is the filter's own fault."""
    bars = cell.case.card.origin == FROM_MODEL
    for _, score in _above(cell, "nees", CREDIBLE):
        said = "squared errors endlessly larger than its covariance, which may be singular" if np.isinf(score.value) else ""
        yield Remark("optimistic", said or f"squared errors {_size(score)} times what its covariance says", bars)
    for _, score in _below(cell, "nees", 1 / CREDIBLE):
        yield Remark("pessimistic", f"squared errors only {_size(score)} of what its covariance says", bars)


def _late(cell: Cell) -> Iterator[Remark]:
    for block, score in _beyond(cell, "lag", LATE, -1, np.positive):
        words = f"estimates of {block} {_size(score)} steps behind the truth"
        yield Remark("late", words, cell.case.card.origin == FROM_MODEL)
        return


def _above(cell: Cell, name: str, limit: float) -> Iterator[tuple[str, Score]]:
    """Blocks whose score of a metric that is never negative is surely above a limit."""
    return _beyond(cell, name, limit, -1, np.log)


def _below(cell: Cell, name: str, limit: float) -> Iterator[tuple[str, Score]]:
    """Blocks whose score of a metric that is never negative is surely below a limit."""
    return _beyond(cell, name, limit, 1, np.log)


def _beyond(cell: Cell, name: str, limit: float, side: int, scale: Scale) -> Iterator[tuple[str, Score]]:
    """Blocks whose score is, on a scale, surely beyond a limit, see `gap`; of a recording, a single sample, none is."""
    if cell.case.card.origin == RECORDED:
        return
    metric = METRICS[name]
    found = {block: score for block, score in cell.scores(metric).items() if score.runs > 1 and SURVIVING not in block}
    for block, score in found.items():
        values = cell.contributions(metric)[block]
        distance = gap(metric.resampled(values[..., counted(values)]), limit, side, scale)
        endless = scale is np.log and score.value == (0 if side > 0 else np.inf)
        if endless or below_zero(distance)[0] < SURE / len(found):
            yield block, score


def gap(sample: Resampled, limit: float, side: int, scale: Scale) -> Resampled:
    """How far a score is below a limit (side 1) or above it (side -1) on a scale: negative there, with its scatter.

    Of a logarithm below the limit the relative shortfall counts, which is less: few runs of a skew law mostly lack the rare
    large ones, and then their mean and its scatter are small together.
    """
    distance = sample.map(lambda value: side * (scale(value) - scale(np.array([limit]))))
    if side < 0 or scale is not np.log:
        return distance
    centre, _ = distance.centre_and_error
    shift = np.expm1(centre) - centre
    return Resampled(distance.value + shift, distance.left_out + shift[:, None])


def _log_of_unexplained(skill: Array) -> Array:
    """Logarithm of the ratio of two mean squares, one minus which is the skill: scatter is in proportion to their sizes."""
    return np.log1p(-skill)


def _size(score: Score) -> str:
    """A score with its interval, without its unit."""
    return within(score.value, score.low, score.high, "")
