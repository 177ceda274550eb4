"""Whether an estimator's covariance agrees with its errors, and with its innovations, which needs no truth."""

import numpy as np

from suite.linalg import Array
from suite.metrics.evidence import Evidence
from suite.metrics.metric import Contributions, Metric
from suite.statistics import mean_over_time

LAGS = 10
"""Most lags of the correlation of innovations; fewer where a component has less than five measurements a lag."""


def nees(e: Evidence) -> Contributions:
    """Normalised estimation error squared over the state dimension [T, R]; infinite where the covariance is singular."""
    return {"state": e.distance / e.dimension}


def nis(e: Evidence) -> Contributions:
    """Normalised innovation squared over the number of measured components [T, R]; nothing where no innovation is stored."""
    if e.estimate.innovation is None:
        return {}
    seen = (~np.isnan(e.estimate.innovation)).sum(1)
    return {"innovation": np.nansum(e.estimate.innovation**2, axis=1) / np.where(seen, seen, np.nan)}


def ljung_box(e: Evidence) -> Contributions:
    """Ljung and Box's statistic of a run's whitened innovations over its number of lags [1, R]; NaN from too few of them."""
    if e.estimate.innovation is None:
        return {}
    return {"innovation": np.array([[portmanteau(run) for run in np.moveaxis(e.estimate.innovation, -1, 0)]])}


def portmanteau(series: Array) -> float:
    """Ljung and Box's Q of innovations [T, m], each component against itself, over all lags: 1 on average where they are white.

    Innovations have mean zero, so none is taken off, and a bias counts as correlation. Lags are counted in measurements.
    """
    total, lags = 0.0, 0
    for column in series.T:
        values = column[~np.isnan(column)]
        count = len(values)
        reach = min(LAGS, count // 5)
        for lag in range(1, reach + 1):
            total += count * (count + 2) / (count - lag) * (values[lag:] @ values[:-lag] / (values @ values)) ** 2
        lags += reach
    return total / lags if lags else np.nan


def log_density(e: Evidence) -> Contributions:
    """Mean log-likelihood of a run over the steps at which something was measured [1, R]."""
    if e.estimate.loglik is None:
        return {}
    return {"measurement": mean_over_time(np.where(np.isnan(e.truth.y).all(1), np.nan, e.estimate.loglik))}


NEES = Metric(
    name="nees",
    family="consistency",
    title="Normalised estimation error squared",
    unit="",
    better=1.0,
    formula=r"\mathrm{NEES} = \frac{1}{R\,T\,n_x} \sum_{r,k} \left( \hat x_k - x_k \right)^{\top} P_k^{-1} "
    r"\left( \hat x_k - x_k \right)",
    words="Mean of the squared error measured by the filter's own covariance, divided by the dimension of the state: 1 for "
    "a filter that knows its errors, above 1 for one that is too sure of itself, below 1 for one that is too cautious. "
    "Components that the case leaves no doubt about, and the filter has none, do not count.",
    reference="Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, "
    "section 5.4",
    fn=nees,
)
NIS = Metric(
    name="nis",
    family="consistency",
    title="Normalised innovation squared",
    unit="",
    better=1.0,
    formula=r"\mathrm{NIS} = \frac{1}{R\,T} \sum_{r,k} \frac{1}{n_{y,k}} \nu_k^{\top} S_k^{-1} \nu_k",
    words="Mean of the squared innovation measured by the covariance that the filter gave it, divided by the number of "
    "measured components; steps without a measurement are left out. 1 for a filter that knows how well it predicts "
    "measurements, above 1 for one that is too sure of itself. It needs no truth. Where all runs are of the same data the "
    "interval over runs does not tell how far from 1 chance alone may lead: with M components measured in all, as many at "
    "each step, a filter that is right is within 1 ± 1.96 √(2/M) on 19 of 20 recordings.",
    reference=NEES.reference,
    fn=nis,
)
WHITENESS = Metric(
    name="whiteness",
    family="consistency",
    title="Correlation of innovations in time",
    unit="",
    better=1.0,
    formula=r"Q = \frac{1}{h} \sum_{l=1}^{h} \frac{N (N + 2)}{N - l} \left( \frac{\sum_{i=l+1}^{N} \nu_i \nu_{i-l}}"
    r"{\sum_{i=1}^{N} \nu_i^2} \right)^2",
    words="Ljung and Box's statistic of the whitened innovations over its number of lags: each measured component against "
    "itself, over up to 10 lags, the mean over components and runs. 1 for innovations that are white, as those of a right "
    "model are; above 1 where something of a measurement could have been told from earlier ones, or where there is a bias. It "
    "needs no truth. With h lags in all, h Q is about chi-square of h degrees: on 19 of 20 recordings white innovations of one "
    "component are below 1.83 (h = 10), those of two below 1.57 (h = 20).",
    reference="G. M. Ljung, G. E. P. Box, On a measure of lack of fit in time series models, Biometrika 65(2), 1978, 297-303",
    fn=ljung_box,
)
LOGLIK = Metric(
    name="loglik",
    family="consistency",
    title="Log-likelihood of a measurement",
    unit="nat",
    better="higher",
    formula=r"\frac{1}{R\,T} \sum_{r,k} \log p \left( y_k \mid y_1, \ldots, y_{k-1} \right)",
    words="Logarithm of the density that a filter gave to what was measured next, mean over steps and runs. It needs no truth. "
    "It compares filters on the same data alone, since it depends on the units of the measurements. Steps without a "
    "measurement are left out.",
    reference="A. P. Dawid, Statistical theory: the prequential approach, Journal of the Royal Statistical Society A 147(2), "
    "1984, 278-292",
    fn=log_density,
    signed=True,
)
METRICS = (NEES, NIS, WHITENESS, LOGLIK)
