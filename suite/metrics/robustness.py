"""How often an estimator loses its target."""

import numpy as np

from suite.case import Card, Truth
from suite.estimator import LOST, Estimate
from suite.linalg import Array
from suite.metrics.metric import Contributions, Metric


def diverged(case: Card, truth: Truth, estimate: Estimate) -> Contributions:
    """1 for each run that diverged by the case's definition or was lost, else 0 [1, R].

    Steps whose truth is not known are left out: what is before and after them is on end. A run of which no step is known is
    NaN, lost or not: of such runs the lost alone could be counted, and their rate would be 100 %.
    """
    rule = case.divergence
    components = list(case.block(rule.block).components)
    known = np.isfinite(truth.x[:, components].sum(1))
    error = np.sqrt(((estimate.mean - truth.x)[:, components] ** 2).sum(1))
    away = longest_streak(error > rule.limit, known) >= rule.steps
    lost = np.array([status == LOST for status in estimate.status], bool)
    return {"runs": np.where(known.any(0), away | lost, np.nan)[None]}


def longest_streak(flags: Array, counted: Array) -> Array:
    """Length of the longest run of true values along the first axis of flags[T, R], of those that are counted[T, R]: [R]."""
    longest = current = np.zeros(flags.shape[1])
    for row, counts in zip(flags, counted, strict=True):
        current = np.where(counts, np.where(row, current + 1, 0), current)
        longest = np.maximum(longest, current)
    return longest


DIVERGENCE = Metric(
    name="divergence",
    title="Divergence rate",
    unit="",
    better="lower",
    formula=r"\frac{1}{R} \sum_{r=1}^{R} \left[ \text{run } r \text{ is beyond the limit for } j \text{ steps on end} \right]",
    words="Share of runs in which the error stays beyond the case's limit for its number of consecutive steps, or in which "
    "the estimator lost the target altogether; the interval is the exact binomial one; on a recording, whose runs are "
    "all of the same data, a table of scores gives none. Steps whose truth is not known are left out.",
    reference="C. J. Clopper, E. S. Pearson, The use of confidence or fiducial limits, Biometrika 26, 1934 (the interval)",
    fn=diverged,
    binomial=True,
)
METRICS = (DIVERGENCE,)
