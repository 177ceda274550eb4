"""Whether an estimator's covariance agrees with its errors, and with its innovations, which needs no truth."""

from functools import lru_cache

import numpy as np
from scipy.special import gammaincinv

from suite.linalg import Array
from suite.metrics.evidence import Evidence
from suite.metrics.metric import Contributions, Metric
from suite.statistics import LEVEL, Resampled, mean_over_time

LAGS = 10
"""Most lags of the correlation of innovations; fewer where a component has less than five measurements a lag."""
DECIBEL = 10 / np.log(10)
"""Decibels of a ratio e : 1."""
ALONE = 1e-6
"""Part of a direction of the errors that other runs have, below which they are whitened anew without the run that has it."""


def chi_square_band(dimension: Array | float, runs: Array | float, level: float = LEVEL) -> tuple[Array, Array]:
    """Ends of the central band of the average of NEES or NIS over independent runs, divided by the dimension.

    For a filter that is right the average times runs and dimension is chi-square of so many degrees of freedom; the band holds
    it with probability `level`, at one step. Arrays broadcast; NaN where nothing counts. Source: Y. Bar-Shalom, X. R. Li,
    T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 5.4.
    """
    freedom = np.asarray(dimension, float) * runs
    half = np.where(freedom > 0, freedom, np.nan) / 2
    low, high = (gammaincinv(half, tail) / half for tail in ((1 - level) / 2, (1 + level) / 2))
    return low, high


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
    return {"innovation": portmanteau(e.estimate.innovation)[None]}


def portmanteau(series: Array) -> Array:
    """Ljung and Box's Q of innovations [T, m, ...], each component against itself, over all lags [...]: 1 on average if white.

    Innovations have mean zero, so none is taken off, and a bias counts as correlation. Lags are counted in measurements.
    """
    missing = np.isnan(series)
    if missing.any():  # to the end, where they add nothing
        series = np.take_along_axis(np.where(missing, 0.0, series), np.argsort(missing, axis=0, kind="stable"), axis=0)
    count = (~missing).sum(0)
    reach = np.minimum(LAGS, count // 5)
    power, total = (series**2).sum(0), np.zeros(series.shape[1:])
    with np.errstate(invalid="ignore"):
        for lag in range(1, reach.max(initial=0) + 1):
            correlation = (series[lag:] * series[:-lag]).sum(0) / power
            total += np.where(lag <= reach, count * (count + 2) / np.maximum(count - lag, 1) * correlation**2, 0.0)
        return np.asarray(total.sum(0) / reach.sum(0))


def log_density(e: Evidence) -> Contributions:
    """Mean log-likelihood of a run over the steps at which something was measured [1, R]."""
    if e.estimate.loglik is None:
        return {}
    return {"measurement": mean_over_time(np.where(np.isnan(e.truth.y).all(1), np.nan, e.estimate.loglik))}


def distance_and_error(e: Evidence) -> Contributions:
    """eᵀ P⁻¹ e of each run, above its error e [T, 1 + n, R]; components that are certain have none."""
    return {"state": np.concat([e.distance[:, None], np.where(e.certain, 0.0, e.error)], axis=1)}


def inclination(contributions: Array) -> Resampled:
    """Mean over runs and time of 10 log₁₀ ρ [1], from `distance_and_error`."""
    return _against_actual(contributions.tobytes(), contributions.shape)[0]


def noncredibility(contributions: Array) -> Resampled:
    """Mean over runs and time of 10 |log₁₀ ρ| [1], from `distance_and_error`."""
    return _against_actual(contributions.tobytes(), contributions.shape)[1]


def without_interval(contributions: Array) -> tuple[float, float, float]:
    """The index, of which no interval would hold the value of a right filter: of few runs all are above it."""
    return float(noncredibility(contributions).value[0]), np.nan, np.nan


@lru_cache(maxsize=64)
def _against_actual(data: bytes, shape: tuple[int, ...]) -> tuple[Resampled, Resampled]:
    """Means of 10 log₁₀ ρ and of its size over the steps at which it is known, of all runs and without each in turn.

    Runs without error do not count there. Kept from one call to the next: two metrics ask for the two.
    """
    contributions = np.frombuffer(data).reshape(shape)
    runs = shape[-1]
    whole, left_out = np.full((2, shape[0]), np.nan), np.full((2, shape[0], runs), np.nan)
    for k, (distance, *error) in enumerate(contributions):
        known = distance > 0
        with np.errstate(divide="ignore", invalid="ignore"):  # where a run is alone in a direction
            whole[:, k], without = _at_step(distance[known], np.array(error)[:, known])
        left_out[:, k] = whole[:, k, None]
        left_out[:, k, known] = without
    signed, sizes = (
        Resampled(mean_over_time(value[:, None])[0], mean_over_time(rest)) for value, rest in zip(whole, left_out, strict=True)
    )
    return signed, sizes


def _at_step(distance: Array, error: Array) -> tuple[Array, Array]:
    """The means over runs [2] of 10 log₁₀ ρ, and of its size, of distance[R] and error[n, R]; without each run in turn [2, R].

    NaN where there are not more runs than dimensions. With Σ the mean of e eᵀ over runs and h_rs = e_rᵀ Σ⁻¹ e_s, leaving out
    run r makes h_ss (R - 1) / R [h_ss + h_rs² / (R - h_rr)] (Sherman and Morrison).
    """
    white = _whitened(error)
    dimension, runs = white.shape
    if runs <= dimension or not runs:
        return np.full(2, np.nan), np.full((2, runs), np.nan)
    inner = white.T @ white
    own = np.diagonal(inner).copy()
    given = DECIBEL * np.log(distance)
    each = given - DECIBEL * np.log(own)
    value = np.array([each.mean(), np.abs(each).mean()])
    if runs - 1 <= dimension:
        return value, np.full((2, runs), np.nan)
    inner *= inner  # in place: this is done at every step
    inner /= (runs - own)[:, None]
    inner += own
    terms = np.log(inner, out=inner)
    terms *= -DECIBEL
    terms += given - DECIBEL * np.log((runs - 1) / runs)
    np.fill_diagonal(terms, 0.0)
    left_out = np.stack([terms.sum(1), np.abs(terms, out=terms).sum(1)]) / (runs - 1)
    for r in np.flatnonzero(runs - own < ALONE * runs):
        others = np.arange(runs) != r
        left_out[:, r] = _at_step(distance[others], error[:, others])[0]
    return value, left_out


def _whitened(error: Array) -> Array:
    """Errors [n, R] turned and scaled so that the mean over runs of e eᵀ is one; only what varies at all is kept [rank, R]."""
    largest = np.abs(error).max(1, initial=0.0)
    varying = largest > 0
    _, size, rows = np.linalg.svd(error[varying] / largest[varying, None], full_matrices=False)
    kept = size > max(error.shape) * np.finfo(float).eps * size.max(initial=0.0)
    return np.asarray(rows[kept] * np.sqrt(error.shape[1]))


NEES = Metric(
    name="nees",
    family="consistency",
    title="Average normalised estimation error squared (ANEES)",
    unit="",
    better=1.0,
    formula=r"\mathrm{NEES} = \frac{1}{R\,T\,n_x} \sum_{r,k} \left( \hat x_k - x_k \right)^{\top} P_k^{-1} "
    r"\left( \hat x_k - x_k \right)",
    words="Mean of the squared error measured by the filter's own covariance, divided by the dimension of the state, so that "
    "it is 1 in any dimension for a filter that knows its errors; above 1 for one that is too sure of itself, below 1 for one "
    "that is too cautious. Components that the case leaves no doubt about, and the filter has none, do not count.",
    reference="X. R. Li, Z. Zhao, V. P. Jilkov, Practical measures and test for credibility of an estimator, Workshop on "
    "Estimation, Tracking, and Fusion, 2001; Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking "
    "and Navigation, 2001, section 5.4",
    fn=nees,
)
NIS = Metric(
    name="nis",
    family="consistency",
    title="Average normalised innovation squared",
    unit="",
    better=1.0,
    formula=r"\mathrm{NIS} = \frac{1}{R\,T} \sum_{r,k} \frac{1}{n_{y,k}} \nu_k^{\top} S_k^{-1} \nu_k",
    words="Mean of the squared innovation measured by the covariance that the filter gave it, divided by the number of "
    "measured components; steps without a measurement are left out. 1 for a filter that knows how well it predicts "
    "measurements, above 1 for one that is too sure of itself. It needs no truth. Where all runs are of the same data the "
    "interval over runs does not tell how far from 1 chance alone may lead: with M components measured in all, as many at "
    "each step, a filter that is right is within 1 ± 1.96 √(2/M) on 19 of 20 recordings.",
    reference="Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, "
    "section 5.4",
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
NCI = Metric(
    name="nci",
    family="consistency",
    title="Non-credibility index",
    unit="dB",
    better="lower",
    formula=r"\frac{10}{R\,T} \sum_{r,k} \left| \log_{10} \rho_k^{(r)} \right|, \quad "
    r"\rho = \frac{ e^{\top} P^{-1} e }{ e^{\top} \Sigma^{-1} e }, \quad \Sigma_k = \frac{1}{R} \sum_r e_k e_k^{\top}",
    words="How far the covariance of each run is from the actual mean square error matrix Σ, along the run's own error e: the "
    "ratio of the two distances in decibels, whichever is larger, mean over runs and steps. 0 for a filter whose covariance is "
    "right, 3 for one that is wrong by a factor of 2 in every run. Σ is that of the runs at each step; there must be more of "
    "them than components of the state. Since it is known from R runs only, a filter that is right has about 5/√R dB; the "
    "value is left so, has no interval, and ranks nobody.",
    reference="X. R. Li, Z. Zhao, Measuring estimator's credibility: noncredibility index, 9th International Conference on "
    "Information Fusion, 2006",
    fn=distance_and_error,
    statistic=noncredibility,
    exact=without_interval,
    ranked=False,
)
INCLINATION = Metric(
    name="inclination",
    family="consistency",
    title="Inclination of the non-credibility",
    unit="dB",
    better=0.0,
    formula=r"\frac{10}{R\,T} \sum_{r,k} \log_{10} \rho_k^{(r)}, \quad "
    r"\rho = \frac{ e^{\top} P^{-1} e }{ e^{\top} \Sigma^{-1} e }",
    words="The non-credibility index with its sign: above 0 for a filter that is too sure of itself, 3 for a covariance half "
    "of what it should be; below 0 for one that is too cautious. A few large errors weigh less than in the ANEES. Of R "
    "runs it is about 4.3/R dB too small where errors are Gaussian; the value is left so, and the interval is centred where "
    "infinitely many runs would put it. There must be more runs than components of the state.",
    reference=NCI.reference,
    fn=distance_and_error,
    statistic=inclination,
    signed=True,
)
METRICS = (NEES, NIS, WHITENESS, LOGLIK, NCI, INCLINATION)
