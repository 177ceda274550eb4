"""Errors against the Cramér-Rao bound of the case, and signs that something is wrong with an estimator."""

import numpy as np

from suite.bounds import NONE
from suite.case import FROM_ANOTHER, FROM_MODEL
from suite.linalg import Array
from suite.metrics.evidence import Evidence
from suite.metrics.metric import Contributions, Metric
from suite.statistics import means, positive_jackknife


def over_bound(e: Evidence) -> Contributions:
    """Squared error of each state block over its squared bound [T, R]; NaN where it is zero, to rounding, or not finite.

    Of several bounds the first counts.
    """
    if not e.bounds or e.bounds[0].kind == NONE:
        return {}
    limit = [e.negligible[list(block.components)].max() for block in e.case.blocks]
    value = e.bounds[0].value
    squared = np.where((value > limit) & np.isfinite(value), value, np.nan) ** 2
    held = [(i, block.name) for i, block in enumerate(e.case.blocks) if np.isfinite(squared[:, i]).any()]
    return {name: e.squared_error[name] / squared[:, i, None] for i, name in held}


def along_own_step(e: Evidence) -> Contributions:
    """Error against the estimate's own last step, and that step squared [2, R], by state block.

    Of an estimate that is a mean given all measurements so far the error is orthogonal to all that is computed of them.
    """
    step, behind = np.diff(e.estimate.mean, axis=0), -e.error[1:]
    blocks = {block.name: list(block.components) for block in e.case.blocks}
    found = {}
    for name, at in blocks.items():
        known = ~np.isnan(behind[:, at])
        sums = [np.where(known, part, 0.0).sum((0, 1)) for part in (step[:, at] * behind[:, at], step[:, at] ** 2)]
        found[name] = np.where(known.any((0, 1)), np.stack(sums), np.nan)
    return found


def against_spread(e: Evidence) -> Contributions:
    """Squared error and squared distance of the truth from its mean over runs, summed over time [2, R], by state block.

    Nothing where truths are not drawn, or do not differ.
    """
    if e.case.origin not in (FROM_MODEL, FROM_ANOTHER):
        return {}
    runs = np.isfinite(e.truth.x).sum(2, keepdims=True)
    mean = np.nansum(e.truth.x, axis=2, keepdims=True) / runs
    away = (e.truth.x - mean) ** 2 * np.where(runs > 1, runs / (runs - 1), np.nan)
    found = {}
    for block in e.case.blocks:
        at = list(block.components)
        known = np.isfinite(away[:, at]).all(1)
        spread = np.where(known, away[:, at].sum(1), 0.0).sum(0)
        if spread.mean() > len(away) * (e.negligible[at] ** 2).sum():
            sums = np.stack([np.where(known, e.squared_error[block.name], 0.0).sum(0), spread])
            found[block.name] = np.where(known.any(0), sums, np.nan)
    return found


def ratio(moments: Array) -> Array:
    """The first of two means over the second [1, B]."""
    return moments[:1] / moments[1:]


def complement_of_ratio(moments: Array) -> Array:
    """One minus the first of two means over the second [1, B]."""
    return 1 - ratio(moments)


def explained(moments: Array) -> tuple[float, float, float]:
    """One minus the first of two means over the second, and its interval, which is not above 1."""
    sample = means(moments).map(ratio)
    low, high = positive_jackknife(sample)
    return 1 - float(sample.value[0]), 1 - float(high[0]), 1 - float(low[0])


CRLB_RATIO = Metric(
    name="crlb-ratio",
    family="bound",
    title="RMSE over the Cramér-Rao bound",
    unit="",
    better="lower",
    formula=r"\frac{1}{T} \sum_{k=1}^{T} \frac{ \mathrm{RMSE}_{b,k} }{ \sqrt{ \operatorname{tr} \left( J_k^{-1} \right)_b } }",
    words="Root mean square error over runs divided by the bound at each step, averaged over time: 1 for an estimator that "
    "reaches it. Over finitely many runs a good one may fall below by chance; one that is below beyond chance knows what it "
    "cannot know, where the bound is one. Steps at which the bound is zero are left out.",
    reference="P. Tichavský, C. H. Muravchik, A. Nehorai, Posterior Cramér-Rao bounds for discrete-time nonlinear filtering, "
    "IEEE Transactions on Signal Processing 46(5), 1998",
    fn=over_bound,
    link=np.sqrt,
)
EFFICIENCY = Metric(
    name="efficiency",
    family="bound",
    title="Efficiency",
    unit="",
    better="higher",
    formula=r"\frac{1}{T} \sum_{k=1}^{T} \frac{ \operatorname{tr} \left( J_k^{-1} \right)_b }{ \mathrm{RMSE}_{b,k}^2 }",
    words="Bound on the mean square error divided by the mean square error at each step, averaged over time: the share of the "
    "information that is made use of.",
    reference="Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, "
    "section 2.7",
    fn=over_bound,
    link=np.reciprocal,
)
SKILL = Metric(
    name="skill",
    family="bound",
    title="Share of the truth's spread explained",
    unit="",
    better="higher",
    formula=r"1 - \frac{ \sum_{r,k} \left\| \hat x_{b,k}^{(r)} - x_{b,k}^{(r)} \right\|^2 }"
    r"{ \frac{R}{R-1} \sum_{r,k} \left\| x_{b,k}^{(r)} - \bar x_{b,k} \right\|^2 }",
    words="One minus the mean square error over that of the truth's mean over runs, which is the best that could be said "
    "without any measurement: 1 for no error, 0 for what measurements are not needed for, below 0 for an estimator that "
    "they mislead.",
    reference="A. H. Murphy, Skill scores based on the mean square error, Monthly Weather Review 116(12), 1988",
    fn=against_spread,
    link=complement_of_ratio,
    exact=explained,
    signed=True,
)
LAG = Metric(
    name="lag",
    family="bound",
    title="Lag",
    unit="steps",
    better=0.0,
    formula=r"\frac{ \sum_{r,k} \left( x_{b,k} - \hat x_{b,k} \right)^{\top} \left( \hat x_{b,k} - \hat x_{b,k-1} \right) }"
    r"{ \sum_{r,k} \left\| \hat x_{b,k} - \hat x_{b,k-1} \right\|^2 }",
    words="How many of its own steps the estimate is behind the truth: the regression of the error on the estimate's last "
    "step. The error of a mean given all measurements so far is orthogonal to whatever is computed of them, so it is 0 for a "
    "filter that makes the best of a right model, 1 for one that is a step late on a steady course, negative for one that "
    "overreacts. Of a delay it sees what could have been foreseen: of a state that moves at random from step to step, nothing.",
    reference="B. D. O. Anderson, J. B. Moore, Optimal Filtering, 1979, section 5.2 (orthogonality)",
    fn=along_own_step,
    link=ratio,
    signed=True,
)
METRICS = (CRLB_RATIO, EFFICIENCY, SKILL, LAG)
