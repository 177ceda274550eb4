"""Whether the truth lies where the filter's Gaussian says: coverage, probability integral transform, proper scores."""

from functools import lru_cache

import numpy as np
from scipy.special import erf, gammaincinv, gammaln, ndtri, stdtrit

from suite.linalg import Array
from suite.metrics.evidence import Evidence
from suite.metrics.metric import Contributions, Metric, counted, share
from suite.statistics import LEVEL, Resampled, means

BINS = 10
"""Equal bins of the histogram of the probability integral transform."""
REPLICATES = 1000
"""Replicates of a histogram, by which its interval is found."""
ANGLES, DEGREE, FRAMES = 16, 11, 64
"""Directions of a plane; degree of Lebedev's rule on the sphere (25 pairs); directions at least in more dimensions."""


def inside(e: Evidence, level: float) -> Array:
    """1 where the truth is inside the ellipsoid that holds it with a probability of `level`, else 0 [T, R]."""
    limits = np.append(np.nan, 2 * gammaincinv(np.arange(1, e.error.shape[1] + 1) / 2, level))
    limit = limits[np.nan_to_num(e.dimension).astype(int)]
    return np.where(np.isnan(e.distance) | np.isnan(limit), np.nan, e.distance <= limit)


def transformed(e: Evidence) -> Contributions:
    """Shares of a run's steps in each bin of the probability integral transform [10, R], by component of the state.

    The transform is 0 or 1 where the variance is zero but the error is not. Components that are certain are left out.
    """
    with np.errstate(all="ignore"):
        deviation = np.sqrt(np.maximum(np.einsum("taar->tar", e.estimate.cov), 0.0))
        score = np.where(e.certain, np.nan, -e.error / deviation)
        place = np.where(np.isnan(score), -1, np.searchsorted(ndtri(np.arange(1, BINS) / BINS), score, side="right"))
        shares = np.stack([(place == each).sum(0) for each in range(BINS)]) / (place >= 0).sum(0)
    never = np.asarray((e.certain | np.isnan(e.error)).all((0, 2)) & e.certain.any((0, 2)))  # is there any doubt
    return {name: shares[:, i] for i, name in enumerate(e.case.state) if not never[i]}


def pit_histogram(e: Evidence) -> dict[str, Array]:
    """Shares [10] of the probability integral transform in its equal bins, over the runs that came through, by component.

    0.1 each for a filter whose Gaussian is right; a component of which nothing is known is left out.
    """
    found = PIT.contributions(e)
    return {name: means(values[:, counted(values)]).value for name, values in found.items() if counted(values).any()}


def unevenness(shares: Array) -> Array:
    """How much would have to move for the shares [10, B] to be equal [1, B]."""
    return np.asarray(np.abs(shares - 1 / BINS).sum(0, keepdims=True) / 2)


def uneven(contributions: Array) -> Resampled:
    """The unevenness of the mean over runs of their histograms [10, R]."""
    return means(contributions).map(unevenness)


def uneven_interval(contributions: Array) -> tuple[float, float, float]:
    """The unevenness of the mean over runs of their histograms [10, R], with an interval.

    The histogram's own distance from where infinitely many runs would put it bounds that of its unevenness; it is replicated
    with normal multipliers of the runs' deviations, and widened as Student's t is to the normal law.
    """
    runs = contributions.shape[1]
    mean = contributions.mean(1, keepdims=True)
    value = float(unevenness(mean)[0, 0])
    if runs < 2:
        return value, np.nan, np.nan
    moved = np.abs((contributions - mean) @ _multipliers(runs)).sum(0) / 2
    reach = np.quantile(moved, LEVEL) * stdtrit(runs - 1, 0.5 + LEVEL / 2) / ndtri(0.5 + LEVEL / 2)
    return value, float(max(value - reach, 0.0)), float(min(value + reach, 1 - 1 / BINS))


@lru_cache(maxsize=8)
def _multipliers(runs: int) -> Array:
    """Normal multipliers [R, 1000] that give deviations from a mean the scatter of that mean; the same at every call."""
    return np.asarray(np.random.default_rng(0).standard_normal((runs, REPLICATES)) / np.sqrt(runs * (runs - 1)))


def energy_score(e: Evidence) -> Contributions:
    """Energy score of the filter's Gaussian [T, R], by state block."""
    found = {}
    for block in e.case.blocks:
        at = list(block.components)
        found[block.name] = energy(e.error[:, at], e.estimate.cov[:, at][:, :, at])
    return found


def energy(error: Array, cov: Array) -> Array:
    """E|X - x| - E|X - X'| / 2 of Gaussian X and X' [T, R], from error[T, d, R] of their mean and cov[T, d, d, R].

    By the continuous ranked probability scores of projections, of which it is a mean over all directions times a constant.
    Exact in one dimension; with the directions taken right within 1 % at each point in two, 3 % in three and 10 % in more, and
    within 0.1, 0.5 and 2 % on average. Over any directions the score is proper. Variances below zero count as zero.
    """
    steps, d, runs = error.shape
    directions, weights = _directions(d)
    along = directions @ error
    squares = (directions[:, :, None] * directions[:, None, :]).reshape(-1, d * d)
    variance = squares @ cov.reshape(steps, d * d, runs)
    return np.asarray(weights @ crps(along, np.sqrt(np.maximum(variance, 0.0))))


def crps(error: Array, deviation: Array) -> Array:
    """Continuous ranked probability score of Gaussians: their mean's error and standard deviations, of any one shape.

    Source: T. Gneiting, A. E. Raftery, A. H. Westveld, T. Goldman, Monthly Weather Review 133(5), 2005, equation 5.
    """
    with np.errstate(over="ignore"):
        z = error / np.maximum(deviation * np.sqrt(2), np.finfo(float).tiny)
        return np.asarray(error * erf(z) + deviation * (np.sqrt(2 / np.pi) * np.exp(-(z**2)) - 1 / np.sqrt(np.pi)))


@lru_cache(maxsize=32)
def _directions(d: int) -> tuple[Array, Array]:
    """Directions [K, d], one of each opposite pair, and weights [K], whose sum times the mean over directions is the constant.

    Of a plane equally spaced, of space by Lebedev's rule, otherwise the axes of frames that are turned at random.
    """
    constant = np.sqrt(np.pi) * np.exp(gammaln((d + 1) / 2) - gammaln(d / 2))
    if d == 1:
        return np.ones((1, 1)), np.ones(1)
    if d == 2:
        angle = np.pi * np.arange(ANGLES) / ANGLES
        return np.stack([np.cos(angle), np.sin(angle)], axis=1), np.full(ANGLES, constant / ANGLES)
    if d == 3:
        from scipy.integrate import lebedev_rule  # half a second, for cases in space alone

        points, weights = lebedev_rule(DEGREE)
        half = [next(c for c in point if abs(c) > 1e-9) > 0 for point in points.T]
        return points.T[half], constant * weights[half] / weights[half].sum()
    frames = np.linalg.qr(np.random.default_rng(0).standard_normal((-(-FRAMES // d), d, d)))[0]
    return frames.reshape(-1, d), np.full(frames.shape[0] * d, constant / (frames.shape[0] * d))


def log_score(e: Evidence) -> Contributions:
    """Minus the logarithm of the filter's Gaussian density at the true state [T, R]; infinite from a singular covariance."""
    certain = np.moveaxis(e.certain, 1, -1)
    cov = np.moveaxis(e.estimate.cov, (1, 2), (-2, -1))
    if certain.any():
        cov = np.where(certain[..., :, None] | certain[..., None, :], np.eye(certain.shape[-1]), cov)
    with np.errstate(all="ignore"):
        found = (e.distance + np.linalg.slogdet(cov)[1] + e.dimension * np.log(2 * np.pi)) / 2
    return {"state": np.where(np.isinf(e.distance), np.inf, found)}


def _coverage(percent: int) -> Metric:
    def fn(e: Evidence) -> Contributions:
        return {"state": inside(e, percent / 100)}

    return Metric(
        name=f"coverage-{percent}",
        family="consistency",
        title=f"Coverage of the {percent} % region",
        unit="",
        better=percent / 100,
        formula=r"\frac{1}{R\,T} \sum_{r,k} \left[ \left( \hat x_k - x_k \right)^{\top} P_k^{-1} \left( \hat x_k - x_k \right) "
        rf"\le \chi^2_{{n_x}}({percent / 100:g}) \right]",
        words=f"Share of runs and steps in which the true state lies inside the ellipsoid that holds {percent} % of the "
        f"filter's Gaussian: {percent / 100:g} for a filter that knows its errors, less for one that is too sure of itself, "
        "more for one that is too cautious. Where the covariance is singular the truth is outside. Components that the case "
        "leaves no doubt about, and the filter has none, do not count.",
        reference="E. L. Korn, B. I. Graubard, Confidence intervals for proportions with small expected number of positive "
        "counts estimated from survey data, Survey Methodology 24(2), 1998 (the interval)",
        fn=fn,
        exact=share,
    )


PIT = Metric(
    name="pit",
    family="consistency",
    title="Unevenness of the probability integral transform",
    unit="",
    better="lower",
    formula=r"\frac{1}{2} \sum_{j=1}^{10} \left| \hat p_j - \frac{1}{10} \right|, \quad \hat p_j = \frac{1}{R\,T} \sum_{r,k} "
    r"\left[ \Phi \left( \frac{ x_k - \hat x_k }{ \sigma_k } \right) \in \text{bin } j \right]",
    words="Where the truth lies within the filter's Gaussian of a component, from 0 to 1, in ten equal bins: the share that "
    "would have to move for all bins to be alike. 0 for a filter whose Gaussian is right, 0.9 for one whose truths all lie in "
    "one bin. It is never quite 0: of N independent values a right filter has about 1.2/√N, and the steps of a run "
    "count for fewer, since they are alike. An interval that holds 0 says that chance explains it. Steps at which a "
    "component is certain are left out.",
    reference="A. P. Dawid, Statistical theory: the prequential approach, Journal of the Royal Statistical Society A 147(2), "
    "1984, 278-292",
    fn=transformed,
    statistic=uneven,
    exact=uneven_interval,
    ranked=False,
)
ENERGY = Metric(
    name="energy-score",
    family="consistency",
    title="Energy score",
    unit="block",
    better="lower",
    formula=r"\frac{1}{R\,T} \sum_{r,k} \left( E \left\| X - x_{b,k} \right\| - \frac{1}{2} E \left\| X - X' \right\| \right), "
    r"\quad X, X' \sim N \left( \hat x_{b,k}, P_{b,k} \right)",
    words="How far the filter's Gaussian is from the truth: the mean distance of its draws from the truth, less half of that "
    "between two of its draws. It is smallest, on average, for the Gaussian that is right, and punishes a large error as much "
    "as a covariance that is too large or too small; of a filter without any doubt it is the Euclidean error. In one dimension "
    "it is the continuous ranked probability score; in more it is the mean of those in several directions, which is right "
    "within 0.5 % up to three dimensions and 2 % beyond.",
    reference="T. Gneiting, A. E. Raftery, Strictly proper scoring rules, prediction, and estimation, Journal of the American "
    "Statistical Association 102(477), 2007, 359-378",
    fn=energy_score,
)
LOG_SCORE = Metric(
    name="log-score",
    family="consistency",
    title="Logarithmic score of the state",
    unit="nat",
    better="lower",
    formula=r"-\frac{1}{R\,T} \sum_{r,k} \log N \left( x_k;\, \hat x_k, P_k \right)",
    words="Minus the logarithm of the density that the filter's Gaussian gives to the true state, mean over steps and runs: "
    "smallest, on average, for the Gaussian that is right. It compares filters on the same case alone, since it depends on the "
    "units of the state. Infinite where a covariance is singular. Components that the case leaves no doubt about, and the "
    "filter has none, do not count.",
    reference="I. J. Good, Rational decisions, Journal of the Royal Statistical Society B 14(1), 1952, 107-114",
    fn=log_score,
    signed=True,
)
METRICS = (*map(_coverage, (50, 90, 95)), PIT, ENERGY, LOG_SCORE)
