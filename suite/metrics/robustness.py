"""How often an estimator loses its target or does not come through at all, and how long it stays with its target."""

import numpy as np

from suite.estimator import FAILED, LOST, OK
from suite.linalg import Array
from suite.metrics.evidence import Evidence
from suite.metrics.metric import Contributions, Metric, share

CAME_BACK = (OK, LOST)
"""Statuses of runs of which it is known whether the target was lost."""


def diverged(e: Evidence) -> Contributions:
    """1 for each run that diverged by the case's definition or was lost, else 0 [1, R]; NaN where the truth is not known."""
    return {"runs": np.where(np.isnan(e.away), np.nan, np.isfinite(e.away))[None]}


def lost(e: Evidence) -> Contributions:
    """1 for each run that was lost, else 0 [1, R]."""
    return {"runs": np.array([[float(status == LOST) for status in e.estimate.status]])}


def failed(e: Evidence) -> Contributions:
    """1 for each run that failed, else 0 [1, R]."""
    return {"runs": np.array([[float(status == FAILED) for status in e.estimate.status]])}


def time_on_target(e: Evidence) -> Contributions:
    """Seconds from the beginning to the last step before a run diverged, and those of the whole case [2, R]."""
    time = np.concatenate([[0.0], e.case.time])
    known = ~np.isnan(e.away)
    stayed = time[np.minimum(np.where(known, e.away, 1) - 1, e.case.steps).astype(int)]
    return {"runs": np.where(known, np.stack([stayed, np.full_like(stayed, time[-1])]), np.nan)}


def first(moments: Array) -> Array:
    """The first of two means [1, B]."""
    return moments[:1]


def within_duration(contributions: Array) -> tuple[float, float, float]:
    """Mean of the first of contributions [2, R] over runs, and its interval between zero and the second."""
    duration = contributions[1, 0]
    value, low, high = (duration * part for part in share(contributions[:1] / duration))
    return value, low, high


DIVERGENCE = Metric(
    name="divergence",
    family="robustness",
    title="Divergence rate",
    unit="",
    better="lower",
    formula=r"\frac{1}{R} \sum_{r=1}^{R} \left[ \text{run } r \text{ is beyond the limit for } j \text{ steps on end} \right]",
    words="Share of runs in which the error stays beyond the case's limit for its number of consecutive steps, or in which "
    "the estimator lost the target altogether; the interval is the exact binomial one; on a recording, whose runs are "
    "all of the same data, a table of scores gives none. Steps whose truth is not known are left out.",
    reference="C. J. Clopper, E. S. Pearson, The use of confidence or fiducial limits, Biometrika 26, 1934 (the interval)",
    fn=diverged,
    accepted=CAME_BACK,
    binomial=True,
)
LOSSES = Metric(
    name="lost",
    family="robustness",
    title="Lost runs",
    unit="",
    better="lower",
    formula=r"\frac{1}{R} \sum_{r=1}^{R} \left[ \text{the numbers of run } r \text{ stop being finite} \right]",
    words="Share of runs in which the estimator gave up or its numbers stopped being finite, of those that did not fail. Each "
    "of them counts as diverged too. It needs no truth. Estimators are not ranked by it: one with a lost run is not ranked at "
    "all. The interval is the exact binomial one.",
    reference=DIVERGENCE.reference,
    fn=lost,
    accepted=CAME_BACK,
    binomial=True,
    ranked=False,
)
FAILURES = Metric(
    name="failed",
    family="robustness",
    title="Failed runs",
    unit="",
    better="lower",
    formula=r"\frac{1}{R} \sum_{r=1}^{R} \left[ \text{run } r \text{ ends in an error} \right]",
    words="Share of all runs in which the program of the estimator stopped with an error, ran past its time or returned what "
    "is no estimate. These runs count to this rate alone. An estimator that hangs, or takes its process down, takes the runs "
    "along that are computed with it, and the binomial interval does not know of that. Estimators are not ranked by it: one "
    "with a failed run is not ranked at all.",
    reference=DIVERGENCE.reference,
    fn=failed,
    accepted=(*CAME_BACK, FAILED),
    binomial=True,
    ranked=False,
)
TIME_TO_DIVERGENCE = Metric(
    name="time-to-divergence",
    family="robustness",
    title="Time to divergence",
    unit="s",
    better="higher",
    formula=r"\frac{1}{R} \sum_{r=1}^{R} \min \left( \tau_r, t_T \right)",
    words="Mean over runs of the time that an estimator stays with its target: from the beginning to the last step before the "
    "error goes beyond the case's limit and stays there for its number of consecutive steps, or before the target is lost. A "
    "run that does not diverge counts with the duration of the case, so the mean is a restricted mean survival time, and the "
    "duration is its largest value. Failed runs and steps whose truth is not known are left out. Estimators are ranked by how "
    "often they diverge, not by when.",
    reference="P. Royston, M. K. B. Parmar, Restricted mean survival time, BMC Medical Research Methodology 13:152, 2013; "
    "E. L. Korn, B. I. Graubard, Confidence intervals for proportions with small expected number of positive counts "
    "estimated from survey data, Survey Methodology 24(2), 1998 (the interval)",
    fn=time_on_target,
    link=first,
    exact=within_duration,
    accepted=CAME_BACK,
    ranked=False,
)
METRICS = (DIVERGENCE, LOSSES, FAILURES, TIME_TO_DIVERGENCE)
