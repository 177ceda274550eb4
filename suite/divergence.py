"""When a run has lost its target, by the definition of its case."""

import numpy as np

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
    known = np.isfinite(truth.x[:, components].sum(1))
    error = np.sqrt(((estimate.mean - truth.x)[:, components] ** 2).sum(1))
    lost = np.array([status == LOST for status in estimate.status], bool)
    gone = np.isnan(estimate.mean).any(1) & lost
    first = np.where(gone.any(0), gone.argmax(0) + 1.0, np.where(lost, len(gone), np.inf))
    found = np.minimum(streak(error > rule.limit, known, rule.steps), first)
    return np.where(known.any(0), found, np.nan)


def streak(flags: Array, counted: Array, length: int) -> Array:
    """Step [R] at which the first run of `length` true values of flags[T, R] begins, of those counted[T, R]; else infinity."""
    current = begin = np.zeros(flags.shape[1])
    found = np.full(flags.shape[1], np.inf)
    for k, (row, counts) in enumerate(zip(flags, counted, strict=True), start=1):
        begin = np.where(counts & (current == 0), k, begin)
        current = np.where(counts, np.where(row, current + 1, 0), current)
        found = np.where(np.isinf(found) & counts & row & (current >= length), begin, found)
    return found
