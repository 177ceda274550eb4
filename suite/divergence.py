"""When a run has lost its target, by the definition of its case."""

import numpy as np
from numpy.typing import NDArray

from suite.case import Card, Truth
from suite.estimator import LOST, Estimate
from suite.linalg import Array


def onset(case: Card, truth: Truth, estimate: Estimate) -> Array:
    """Step [R] from which on each run is away: at which it was lost, or at which a streak of errors beyond the limit begins.

    Infinite where it never is. Steps whose truth is not known are left out: what is before and after them is on end. A run of
    which no step is known is NaN, lost or not: of such runs the lost alone could be counted, and their rate would be 100 %.
    """
    rule = case.divergence
    components = list(case.block(rule.block).components)
    known = np.asarray(np.isfinite(truth.x[:, components]).all(1))
    with np.errstate(over="ignore", invalid="ignore"):  # of errors of any size
        error = np.sqrt(((estimate.mean - truth.x)[:, components] ** 2).sum(1))
    lost = np.array([status == LOST for status in estimate.status], bool)
    gone = np.isnan(estimate.mean).any(1) & lost
    first = np.where(gone.any(0), gone.argmax(0) + 1.0, np.where(lost, len(gone), np.inf))
    found = np.minimum(streak(error > rule.limit, known, rule.steps), first)
    return np.where(known.any(0), found, np.nan)


def streak(flags: NDArray[np.bool_], counted: NDArray[np.bool_], length: int) -> Array:
    """Step [R] at which the first run of `length` true values of flags[T, R] begins, of those counted[T, R]; else infinity."""
    total = np.cumsum(flags & counted, axis=0)
    broken = np.maximum.accumulate(np.where(counted & ~flags, total, 0), axis=0)
    enough = np.asarray(total - broken >= length)
    reached = np.take_along_axis(total, enough.argmax(0)[None], axis=0)
    begin = (total > reached - length).argmax(0) + 1.0
    return np.where(enough.any(0), begin, np.inf)
