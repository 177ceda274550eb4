"""Errors of the state estimate."""

import numpy as np

from suite.case import Card, Truth
from suite.estimator import Estimate
from suite.metrics.metric import Contributions, Metric


def squared_error(case: Card, truth: Truth, estimate: Estimate) -> Contributions:
    """Squared Euclidean error of each state block [T, R]."""
    error = estimate.mean - truth.x
    return {block.name: (error[:, list(block.components)] ** 2).sum(1) for block in case.blocks}


def norm_of_error(case: Card, truth: Truth, estimate: Estimate) -> Contributions:
    """Norm of the error of the whole state over the square root of its dimension [T, R]."""
    error = estimate.mean - truth.x
    return {"state": np.sqrt((error**2).mean(1))}


RMSE = Metric(
    name="rmse",
    title="Root mean square error",
    unit="block",
    better="lower",
    formula=r"\mathrm{RMSE}_b = \frac{1}{T} \sum_{k=1}^{T} \sqrt{ \frac{1}{R} \sum_{r=1}^{R} "
    r"\left\| \hat x_{b,k}^{(r)} - x_{b,k}^{(r)} \right\|^2 }",
    words="Root mean square over runs of the Euclidean error of a block of the state, then averaged over time.",
    reference="Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001",
    fn=squared_error,
    link=np.sqrt,
)
ETA = Metric(
    name="eta",
    title="Mean normalised error η",
    unit="mixed",
    better="lower",
    formula=r"\eta = \frac{1}{R\,T} \sum_{r=1}^{R} \sum_{k=1}^{T} \sqrt{ \frac{1}{n_x} \sum_{a=1}^{n_x} "
    r"\left( \hat x_{a,k}^{(r)} - x_{a,k}^{(r)} \right)^2 }",
    words="Mean over runs and time of the norm of the error of the whole state. It is a mean of norms, no RMSE, and adds "
    "components of different units as they stand.",
    reference="Velozo and Souza, comparison of particle filter and UKF for a land vehicle (in Portuguese), eq. (29)",
    fn=norm_of_error,
)
METRICS = (RMSE, ETA)
