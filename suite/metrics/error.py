"""Errors of the state estimate."""

import numpy as np

from suite.linalg import Array
from suite.metrics.evidence import Evidence
from suite.metrics.metric import Contributions, Metric
from suite.statistics import mean_over_time


def squared_error(e: Evidence) -> Contributions:
    """Squared Euclidean error of each state block [T, R]."""
    return dict(e.squared_error)


def norm_of_error(e: Evidence) -> Contributions:
    """Norm of the error of the whole state over the square root of its dimension [T, R]."""
    return {"state": np.sqrt((e.error**2).mean(1))}


def of_components(e: Evidence) -> Contributions:
    """Squared error of each state block, the mean over its components [T, R]."""
    return {block.name: e.squared_error[block.name] / len(block.components) for block in e.case.blocks}


def absolute(e: Evidence) -> Contributions:
    """Absolute error of each component of the state [T, R]."""
    named = {i for block in e.case.blocks for i in block.components}
    return {name: np.abs(e.error[:, i]) for i, name in enumerate(e.case.state) if i in named}


def over_time(e: Evidence) -> Contributions:
    """Mean over time of each run's squared Euclidean error, by state block [1, R]."""
    return {block: mean_over_time(values) for block, values in e.squared_error.items()}


def of_runs(e: Evidence) -> Contributions:
    """Root mean square error over time of each run, by state block [1, R]."""
    return {block: np.sqrt(values) for block, values in over_time(e).items()}


def moments_of_runs(e: Evidence) -> Contributions:
    """Root mean square error over time of each run, and its square, by state block [2, R]."""
    return {block: np.concat([values, values**2]) for block, values in of_runs(e).items()}


def standard_deviation(moments: Array) -> Array:
    """Standard deviation [1, B] from the first two moments [2, B]."""
    return np.asarray(np.sqrt(np.maximum(moments[1:] - moments[:1] ** 2, 0.0)))


def euclidean(e: Evidence) -> Contributions:
    """Euclidean error of each state block [T, R]; with regions also of the steps inside and outside each, else NaN."""
    found = {block: np.sqrt(values) for block, values in e.squared_error.items()}
    for region in e.case.regions:
        assert e.case.plane is not None
        inside = region.holds(*(e.truth.x[:, axis] for axis in e.case.plane))
        for where, chosen in ((f"inside {region.name}", inside), (f"outside {region.name}", ~inside)):
            found |= {f"{b.name}, {where}": np.where(chosen, found[b.name], np.nan) for b in e.case.blocks}
    return found


def largest(e: Evidence) -> Contributions:
    """Largest Euclidean error over time of each run, by state block and region [1, R]."""
    return {block: np.fmax.reduce(values, axis=0)[None] for block, values in euclidean(e).items() if len(values)}


RMSE = Metric(
    name="rmse",
    family="error",
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
    family="error",
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
MEAN_ERROR = Metric(
    name="mean-error",
    family="error",
    title="Mean error",
    unit="block",
    better="lower",
    formula=r"\frac{1}{R\,T} \sum_{r=1}^{R} \sum_{k=1}^{T} \left\| \hat x_{b,k}^{(r)} - x_{b,k}^{(r)} \right\|",
    words="Mean over runs and time of the Euclidean error of a block of the state; with regions also over the steps at which "
    "the truth is inside, or outside, of each: first over the runs that are there at a step, then over steps.",
    reference="M. Benko, P. Kulmon, Aplikácia časticových filtrov na merania multistatického radaru (in Slovak), table 1",
    fn=euclidean,
)
ABSOLUTE_ERROR = Metric(
    name="absolute-error",
    family="error",
    title="Absolute error of a component",
    unit="block",
    better="lower",
    formula=r"\varepsilon_a = \frac{1}{R\,T} \sum_{r=1}^{R} \sum_{k=1}^{T} \left| \hat x_{a,k}^{(r)} - x_{a,k}^{(r)} \right|",
    words="Mean over runs and time of the absolute error of one component of the state.",
    reference="Velozo and Souza, comparison of particle filter and UKF for a land vehicle (in Portuguese), eq. (30)",
    fn=absolute,
)
MAXIMUM_ERROR = Metric(
    name="maximum-error",
    family="error",
    title="Maximum error",
    unit="block",
    better="lower",
    formula=r"\frac{1}{R} \sum_{r=1}^{R} \max_k \left\| \hat x_{b,k}^{(r)} - x_{b,k}^{(r)} \right\|",
    words="Largest Euclidean error of a run over time, the mean over runs; with regions also inside and outside of each.",
    reference=MEAN_ERROR.reference,
    fn=largest,
)
MSE = Metric(
    name="mse",
    family="error",
    title="Mean square error",
    unit="block, squared",
    better="lower",
    formula=r"\frac{1}{R\,T\,n_b} \sum_{r=1}^{R} \sum_{k=1}^{T} \left\| \hat x_{b,k}^{(r)} - x_{b,k}^{(r)} \right\|^2",
    words="Mean over runs, time and the components of a block of the squared error, so of one axis. A few bad runs decide it.",
    reference="J. Hartikainen, A. Solin, S. Särkkä, Optimal filtering with Kalman filters and smoothers, 2011",
    fn=of_components,
)
POOLED_RMSE = Metric(
    name="pooled-rmse",
    family="error",
    title="RMSE, runs and time pooled",
    unit="block",
    better="lower",
    formula=r"\sqrt{ \frac{1}{R\,T} \sum_{r=1}^{R} \sum_{k=1}^{T} "
    r"\left\| \hat x_{b,k}^{(r)} - x_{b,k}^{(r)} \right\|^2 }",
    words="Root of the mean over runs and time of the squared Euclidean error of a block of the state.",
    reference="M. S. Arulampalam, S. Maskell, N. Gordon, T. Clapp, A tutorial on particle filters for online "
    "nonlinear/non-Gaussian Bayesian tracking, IEEE Transactions on Signal Processing 50(2), 2002 (as its figures are read)",
    fn=over_time,
    link=np.sqrt,
)
RUN_RMSE = Metric(
    name="run-rmse",
    family="error",
    title="RMSE of a run",
    unit="block",
    better="lower",
    formula=r"\mu_b = \frac{1}{R} \sum_{r=1}^{R} \sqrt{ \frac{1}{T} \sum_{k=1}^{T} "
    r"\left\| \hat x_{b,k}^{(r)} - x_{b,k}^{(r)} \right\|^2 }",
    words="Root mean square over time of a run's Euclidean error, the mean over runs.",
    reference="Liu, Song, Huang, IMM particle filter with uniform resampling (in Chinese), eqs (20)-(21)",
    fn=of_runs,
)
RUN_RMSE_SD = Metric(
    name="run-rmse-sd",
    family="error",
    title="Spread of the RMSE of runs",
    unit="block",
    better="lower",
    formula=r"\sigma_b = \sqrt{ \frac{1}{R} \sum_{r=1}^{R} \left( \mathrm{RMSE}_b^{(r)} - \mu_b \right)^2 }",
    words="Standard deviation over runs of a run's root mean square error over time.",
    reference="Liu, Song, Huang, IMM particle filter with uniform resampling (in Chinese), eq. (22)",
    fn=moments_of_runs,
    link=standard_deviation,
)
METRICS = (RMSE, ETA, MEAN_ERROR, ABSOLUTE_ERROR, MAXIMUM_ERROR, MSE, POOLED_RMSE, RUN_RMSE, RUN_RMSE_SD)
