"""Coverage, probability integral transform and proper scores: by hand, against libraries, on exact and wrong filters."""

import dataclasses

import numpy as np
import pytest
import scoringrules
from scipy import stats

from estimators.kalman import Kalman
from suite.case import Card, Divergence, StateBlock, Truth
from suite.estimator import FAILED, Estimate
from suite.metrics import METRICS, Evidence
from suite.metrics.calibration import crps, energy, pit_histogram, uneven_interval
from tests.oracles import random_linear

CARD = Card(
    name="toy", title="", summary="", steps=3, interval=1.0, state=("x", "y", "v"),
    blocks=(StateBlock("position", (0, 1), "m"), StateBlock("speed", (2,), "m/s")),
    divergence=Divergence("position", 1e9, 2), reference="",
)  # fmt: skip
KNOWN = random_linear(3, n=3, m=2, q=2)
COVERAGES = (50, 90, 95)


@pytest.fixture(scope="module")
def exact():
    """Truths of a linear model and what the exact filter says of them."""
    x, y = KNOWN.simulate(5, 4000)
    return Truth(x, y), Kalman().run(KNOWN.model, y)


def scaled(pair, factor):
    return pair[0], dataclasses.replace(pair[1], cov=factor * pair[1].cov)


def of(error, variances):
    """A truth and an estimate with these errors [T, 3, R] and variances [3]."""
    cov = np.tile(np.diag(variances).astype(float)[:, :, None], (len(error), 1, 1, error.shape[2]))
    return Truth(np.ones_like(error), np.zeros((len(error), 1, error.shape[2]))), Estimate(1 + error, cov)


def contributions(name, pair):
    return METRICS[name].contributions(Evidence(CARD, *pair))


def test_coverage_by_hand():
    error = np.zeros((1, 3, 5))
    error[0, 0] = 2 * np.sqrt(stats.chi2(3).ppf([0.49, 0.51, 0.89, 0.91, 0.96]))
    for percent, hits in zip(COVERAGES, (1, 3, 4), strict=True):
        assert METRICS[f"coverage-{percent}"](CARD, *of(error, [4, 1, 1]))["state"].value == pytest.approx(hits / 5)


def test_coverage_counts_the_components_that_are_uncertain_and_leaves_out_what_is_unknown():
    error = np.zeros((2, 3, 2))
    error[0, 0] = np.sqrt(stats.chi2(2).ppf([0.49, 0.51]))
    truth, estimate = of(error, [1, 1, 0])
    truth.x[1, 1, 0] = np.nan
    np.testing.assert_array_equal(contributions("coverage-50", (truth, estimate))["state"], [[1, 0], [np.nan, 1]])
    error[0, 2, 0] = 1e-3  # certain, and wrong: the covariance is singular
    assert contributions("coverage-50", of(error, [1, 1, 0]))["state"][0, 0] == 0
    np.testing.assert_array_equal(contributions("coverage-95", of(np.zeros((1, 3, 2)), [0, 0, 0]))["state"], [[np.nan] * 2])


@pytest.mark.parametrize("percent", COVERAGES)
def test_coverage_of_the_exact_filter_is_nominal(percent, exact):
    # 4000 independent runs at the last step, 5 standard errors: a false alarm has probability 6e-7.
    def shares(pair):
        return contributions(f"coverage-{percent}", pair)["state"][-1].mean()

    level = percent / 100
    for factor in (0.5, 1.0, 2.0):
        expected = stats.chi2(3).cdf(factor * stats.chi2(3).ppf(level))
        assert abs(shares(scaled(exact, factor)) - expected) < 5 * np.sqrt(expected * (1 - expected) / 4000)
        assert factor == 1 or abs(expected - level) > 0.02


def test_probability_integral_transform_by_hand():
    error = np.zeros((4, 3, 2))
    error[:, 0, 0] = 2 * stats.norm.ppf([0.05, 0.07, 0.55, 0.85])  # the truth is as far on the other side of the mean
    error[:, 1, 0] = [1.0, 1.0, 1.0, -1.0]
    truth, estimate = of(error, [4, 0, 0])
    truth.x[:, :, 1] = np.nan
    found = contributions("pit", (truth, estimate))
    assert list(found) == ["x", "y"]  # nobody doubts v
    np.testing.assert_allclose(found["x"][:, 0], np.array([0, 1, 0, 0, 1, 0, 0, 0, 0, 2]) / 4)
    np.testing.assert_allclose(found["y"][:, 0], np.array([3, 0, 0, 0, 0, 0, 0, 0, 0, 1]) / 4)
    assert np.isnan(found["x"][:, 1]).all()
    score = METRICS["pit"](CARD, truth, estimate)["y"]
    assert (score.value, score.runs, score.total) == (pytest.approx(0.8), 1, 2)
    shares = pit_histogram(Evidence(CARD, truth, estimate))
    np.testing.assert_allclose(shares["y"], found["y"][:, 0])
    lost = dataclasses.replace(estimate, status=[FAILED] * 2)
    assert pit_histogram(Evidence(CARD, truth, lost)) == {}


def test_steps_at_which_a_component_is_certain_are_left_out_of_its_transform():
    truth, estimate = of(np.full((3, 3, 1), 0.5), [1, 1, 1])
    estimate.mean[0, 0], estimate.cov[0, 0, 0] = 1 + 1e-12, 0  # rounding
    assert contributions("pit", (truth, estimate))["x"][:, 0].tolist() == [0, 0, 0, 1, 0, 0, 0, 0, 0, 0]


def test_probability_integral_transform_of_the_exact_filter_is_flat(exact):
    # Shares of 4000 runs at one step, 10 bins of 3 components, 5.5 standard errors: a false alarm has probability 2e-6.
    last = (Truth(exact[0].x[-1:], exact[0].y[-1:]), Estimate(exact[1].mean[-1:], exact[1].cov[-1:]))
    for factor in (1.0, 2.0):
        shares = np.array(list(pit_histogram(Evidence(CARD, *scaled(last, factor))).values()))
        edges = stats.norm.cdf(np.sqrt(factor) * stats.norm.ppf(np.linspace(0, 1, 11)))
        expected = np.diff(edges)
        assert (np.abs(shares - expected) < 5.5 * np.sqrt(expected * (1 - expected) / 4000)).all()
        for score in METRICS["pit"](CARD, *scaled(last, factor)).values():
            # Half the width is what 95 % of the histograms keep within; twice that none in a million leaves.
            assert abs(score.value - np.abs(expected - 0.1).sum() / 2) < score.high - score.low
            assert score.low > 0 or factor == 1


@pytest.mark.parametrize("factor", [1.0, 3.0])
def test_unevenness_is_in_its_interval_at_its_rate(factor):
    # 400 sets of 20 runs of 10 equal pairs of steps. A coverage of 0.95 has a standard deviation of 0.011; 5 of them below.
    # Where the histogram is flat the interval is just as wide as it must be, so the coverage is not above either.
    score = np.random.default_rng(0).standard_normal((400, 10, 20)) / np.sqrt(factor)
    place = np.digitize(score, stats.norm.ppf(np.arange(1, 10) / 10))
    shares = np.stack([(place == b).mean(1) for b in range(10)], axis=1)
    truth = np.abs(np.diff(stats.norm.cdf(np.sqrt(factor) * stats.norm.ppf(np.linspace(0, 1, 11)))) - 0.1).sum() / 2
    found = np.array([uneven_interval(each) for each in shares])
    coverage = ((found[:, 1] <= truth) & (truth <= found[:, 2])).mean()
    assert coverage > 0.95 - 0.055
    assert factor > 1 or coverage < 1
    assert (found[:, 2] <= 0.9).all()


def test_chance_moves_as_much_of_a_flat_histogram_as_is_said():
    flat = np.random.default_rng(0).multinomial(600, np.full(10, 0.1), 2000) / 600
    assert np.mean(np.abs(flat - 0.1).sum(1) / 2) == pytest.approx(1.2 / np.sqrt(600), rel=0.03)


def test_without_a_second_run_there_is_no_interval_of_unevenness():
    value, *interval = uneven_interval(np.eye(10)[:, :1])
    assert value == pytest.approx(0.9)
    assert np.isnan(interval).all()


def test_one_dimension_is_the_continuous_ranked_probability_score():
    rng = np.random.default_rng(0)
    error, deviation = rng.normal(0, 3, (4, 1, 6)), rng.gamma(1, 2, (4, 1, 6))
    expected = scoringrules.crps_normal(0.0, error, deviation)
    np.testing.assert_allclose(crps(error, deviation), expected, rtol=1e-12)
    np.testing.assert_allclose(energy(error, deviation[:, None] ** 2), expected[:, 0], rtol=1e-12)
    assert crps(np.array([-3.0, 0.0, 1e200]), np.array([0.0, 0.0, 1.0])) == pytest.approx([3, 0, 1e200])


def mean_norm(mean, cov):
    """E|X| of a Gaussian X from the Laplace transform of its square, by the trapezoidal rule in the logarithm."""
    variance, axes = np.linalg.eigh(cov)
    total = variance.sum() + mean @ mean
    t = np.exp(np.linspace(-40, 60, 4001))[:, None]
    growth = 2 * t * np.maximum(variance, 0) / total
    exponent = (t * (axes.T @ mean) ** 2 / total / (1 + growth) + np.log1p(growth) / 2).sum(1)
    return np.sqrt(total / np.pi) / 2 * np.sum(-np.expm1(-exponent) / np.sqrt(t[:, 0])) * 100 / 4000


@pytest.mark.parametrize(
    ("d", "each", "average"), [(1, 1e-8, 1e-8), (2, 1e-2, 1e-3), (3, 3e-2, 5e-3), (5, 0.1, 0.02), (40, 0.1, 0.02)]
)
def test_energy_score_of_a_gaussian(d, each, average):
    rng = np.random.default_rng(d)
    root = rng.standard_normal((100, d, d)) * rng.gamma(1, 1, (100, 1, d))
    cov = root @ np.swapaxes(root, 1, 2)
    error = np.einsum("rij,rj->ri", root, rng.standard_normal((100, d))) * rng.choice([0.3, 1, 3], (100, 1))
    got = energy(error.T[None], np.moveaxis(cov, 0, -1)[None])[0]
    assert mean_norm(np.zeros(d), np.eye(d)) == pytest.approx(stats.chi(d).mean(), rel=1e-8)
    expected = [mean_norm(e, c) - mean_norm(0 * e, 2 * c) / 2 for e, c in zip(error, cov, strict=True)]
    np.testing.assert_allclose(got, expected, rtol=each)
    assert np.mean(got) == pytest.approx(np.mean(expected), rel=average)


@pytest.mark.parametrize("d", [2, 3])
def test_energy_score_of_a_gaussian_is_that_of_many_draws(d):
    # The score of 4000 draws in 8 sets: 6 standard errors of 8 (Student, 7 degrees: below 1e-3), and a hundredth of its size.
    rng = np.random.default_rng(d)
    root, error = rng.standard_normal((d, d)), rng.standard_normal(d)
    draws = error + rng.standard_normal((8, 500, d)) @ root.T
    found = scoringrules.es_ensemble(np.zeros((8, d)), draws, estimator="fair", backend="numpy")
    exact = energy(error[None, :, None], (root @ root.T)[None, :, :, None])[0, 0]
    assert abs(found.mean() - exact) < 6 * found.std(ddof=1) / np.sqrt(8) + 1e-2 * exact


@pytest.mark.parametrize("d", [1, 2, 3, 5])
def test_without_doubt_the_energy_score_is_the_euclidean_error(d):
    error = np.random.default_rng(d).standard_normal((2, d, 400))
    size = np.linalg.norm(error, axis=1)
    for variance in (0.0, -1e-12):
        got = energy(error, np.tile(variance * np.eye(d)[None, :, :, None], (2, 1, 1, 400)))
        assert got.mean() == pytest.approx(size.mean(), rel=1e-2)


def test_energy_score_is_of_each_block_in_its_unit():
    error = np.random.default_rng(0).standard_normal((3, 3, 4))
    truth, estimate = of(error, [4, 1, 9])
    estimate.mean[1, 2, 3] = np.nan
    found = contributions("energy-score", (truth, estimate))
    expected = scoringrules.crps_normal(0.0, error[:, 2], 3.0)
    expected[1, 3] = np.nan
    np.testing.assert_allclose(found["speed"], expected, rtol=1e-12)
    by_block = energy(error[:, :2], estimate.cov[:, :2, :2])
    np.testing.assert_allclose(found["position"], by_block, rtol=1e-12)
    assert [s.unit for s in METRICS["energy-score"](CARD, truth, estimate).values()] == ["m", "m/s"]


def test_logarithmic_score_is_minus_the_log_density_at_the_truth():
    rng = np.random.default_rng(0)
    root, error = rng.standard_normal((2, 4, 3, 3)) * np.array([10, 1, 0.1])[:, None], rng.standard_normal((2, 3, 4))
    cov = np.moveaxis(root @ np.swapaxes(root, 2, 3), 1, -1)
    estimate = Estimate(1 + error, cov)
    found = contributions("log-score", (Truth(np.ones_like(error), error), estimate))["state"]
    expected = [[-stats.multivariate_normal.logpdf(error[k, :, r], None, cov[k, :, :, r]) for r in range(4)] for k in range(2)]
    np.testing.assert_allclose(found, expected, rtol=1e-8)


def test_logarithmic_score_of_a_singular_covariance_is_infinite_and_certain_components_do_not_count():
    error = np.random.default_rng(0).standard_normal((1, 3, 2))
    assert contributions("log-score", of(error, [4, 1, 0]))["state"].tolist() == [[np.inf, np.inf]]
    assert METRICS["log-score"](CARD, *of(error, [4, 1, 0]))["state"].value == np.inf
    error[:, 2] = 0
    expected = [-stats.norm.logpdf(error[0, :2, r], 0, [2, 1]).sum() for r in range(2)]
    np.testing.assert_allclose(contributions("log-score", of(error, [4, 1, 0]))["state"], [expected])
    truth, estimate = of(error, [4, 1, 0])
    estimate.mean[0, 1, 0] = np.nan
    assert np.isnan(contributions("log-score", (truth, estimate))["state"][0, 0])


@pytest.mark.parametrize(("name", "block"), [("energy-score", "position"), ("energy-score", "speed"), ("log-score", "state")])
def test_proper_scores_are_best_for_the_exact_filter(name, block, exact):
    # Paired over 4000 runs at one step; 6 standard errors: a false alarm has probability 1e-9.
    right = contributions(name, exact)[block][-1]
    biased = dataclasses.replace(exact[1], mean=exact[1].mean + 0.5 * np.sqrt(np.einsum("taar->tar", exact[1].cov)))
    for wrong in (scaled(exact, 0.5), scaled(exact, 2.0), (exact[0], biased)):
        worse = contributions(name, wrong)[block][-1] - right
        assert worse.mean() > 6 * worse.std() / np.sqrt(4000)
