"""Intervals against scipy, against closed forms, and by their coverage."""

import numpy as np
import pytest
from scipy import stats

import suite.statistics
from suite.statistics import bca, proportion, weighted_mean


def mean_of(data):
    """The mean of data[S, R] as a statistic of weighted runs."""
    return lambda weights: weighted_mean(np.atleast_2d(data), weights)


def root_mean_square(data):
    return lambda weights: np.sqrt(weighted_mean(np.atleast_2d(data) ** 2, weights))


@pytest.mark.parametrize(
    ("statistic", "plain"),
    [(mean_of, np.mean), (root_mean_square, lambda x, axis: np.sqrt(np.mean(x**2, axis)))],
    ids=["mean", "root mean square"],
)
@pytest.mark.parametrize("seed", [0, 1])
def test_bca_is_that_of_scipy(monkeypatch, seed, statistic, plain):
    # With B = 100000 resamples each, an end of an interval has a standard deviation of sqrt(p (1 - p) / B) / density, plus that
    # of the bias correction: together about 0.015 of the interval's half width on either side. The band of 0.1 is 5 of
    # their difference; an acceleration of the wrong sign would miss it for data so skew.
    monkeypatch.setattr(suite.statistics, "RESAMPLES", 100_000)
    data = np.random.default_rng(seed).exponential(size=25)
    value, low, high = bca(statistic(data), 25)
    expected = stats.bootstrap(
        (data,), plain, n_resamples=100_000, method="BCa", vectorized=True, batch=10_000, rng=np.random.default_rng(9)
    ).confidence_interval
    np.testing.assert_allclose(value[0], plain(data, axis=0))
    half = (expected.high - expected.low) / 2
    assert abs(low[0] - expected.low) < 0.1 * half
    assert abs(high[0] - expected.high) < 0.1 * half
    # Skewed to the right, and so not the plain percentiles.
    assert high[0] - value[0] > 1.1 * (value[0] - low[0])


def test_coverage_for_normal_means():
    # For R = 20 normal numbers a bootstrap interval of the mean covers with P(|t_19| < 1.96 sqrt(19 / 20)) = 0.929, to first
    # order. Of 6000 samples that is a standard deviation of 0.0033; the common resamples add as much again. Band 0.025:
    # a false alarm has probability below 1e-6.
    data = np.random.default_rng(0).standard_normal((6000, 20)) + 3
    _, low, high = bca(mean_of(data), 20)
    inside = ((low < 3) & (high > 3)).mean()
    assert abs(inside - 0.929) < 0.025
    # Both sides miss alike.
    assert abs((low > 3).mean() - (high < 3).mean()) < 0.025


def test_level_widens_the_interval():
    data = np.random.default_rng(0).standard_normal((1, 30))
    _, low, high = bca(mean_of(data), 30)
    _, wide_low, wide_high = bca(mean_of(data), 30, level=0.99)
    assert wide_low < low < high < wide_high


def test_the_same_data_give_the_same_interval_and_pairs_stay_paired():
    data = np.random.default_rng(0).standard_normal((2, 30))
    assert np.array_equal(bca(mean_of(data), 30), bca(mean_of(data), 30))
    both, alone = bca(mean_of(data), 30), bca(mean_of(data[1]), 30)
    np.testing.assert_allclose([part[1] for part in both], [part[0] for part in alone], rtol=1e-12)
    # A constant difference between two estimators has an interval of no width.
    _, low, high = bca(lambda w: mean_of(data[0] + 0.25)(w) - mean_of(data[0])(w), 30)
    np.testing.assert_allclose([low, high], 0.25, rtol=1e-12)


def test_constant_contributions_have_no_width():
    value, low, high = bca(mean_of(np.full((3, 10), 0.1)), 10)
    np.testing.assert_allclose([value, low, high], 0.1, rtol=1e-13)
    value, low, high = bca(mean_of(np.zeros((1, 10))), 10)
    assert (value, low, high) == (0, 0, 0)


def test_one_run_has_a_value_and_no_interval():
    value, low, high = bca(mean_of(np.array([[2.5]])), 1)
    assert value == 2.5
    assert np.isnan([low, high]).all()


def test_two_runs():
    value, low, high = bca(mean_of(np.array([[1.0, 3.0]])), 2)
    assert (value, low, high) == (2, 1, 3)


def test_weighted_mean_by_hand():
    data = np.array([[1.0, 2.0, 3.0], [4.0, np.nan, 6.0], [np.nan, np.nan, 5.0]])
    weights = np.array([[1.0, 1.0, 1.0], [2.0, 0.0, 1.0], [0.0, 0.0, 3.0]])
    expected = [[2.0, 5 / 3, 3.0], [5.0, 14 / 3, 6.0], [5.0, 5.0, 5.0]]
    np.testing.assert_allclose(weighted_mean(data, weights), expected)
    np.testing.assert_allclose(weighted_mean(data[:1], weights), expected[:1])
    with np.errstate(invalid="ignore"):
        assert np.isnan(weighted_mean(data, np.array([[1.0, 2.0, 0.0]]))[2, 0])


def test_infinite_contributions_count_where_they_have_weight():
    data = np.array([[1.0, np.inf, 3.0], [np.nan, np.inf, np.inf], [1.0, 2.0, 3.0]])
    weights = np.array([[1.0, 1.0, 1.0], [1.0, 0.0, 2.0], [2.0, 0.0, 1.0]])
    found = weighted_mean(data, weights)
    np.testing.assert_allclose(found, [[np.inf, 7 / 3, 5 / 3], [np.inf] * 3, [2.0, 7 / 3, 5 / 3]])
    value, low, high = bca(mean_of(np.array([[1.0, 1.5, 2.0, 2.5, np.inf]])), 5)
    assert (value, high) == (np.inf, np.inf)
    assert 1 <= low <= np.inf


def test_nan_contributions_are_as_if_the_run_were_not_there():
    # The interval of the ten known runs of fifteen: the resamples differ, the ends agree within their noise.
    data = np.random.default_rng(0).standard_normal(10)
    holes = np.concatenate([data, np.full(5, np.nan)])[None]
    value, low, high = bca(mean_of(holes), 15)
    plain, plain_low, plain_high = bca(mean_of(data), 10)
    np.testing.assert_allclose(value, plain)
    assert np.isfinite([low, high]).all()
    assert abs((high - low) / (plain_high - plain_low) - 1) < 0.25


@pytest.mark.parametrize("total", [1, 7, 100])
@pytest.mark.parametrize("level", [0.9, 0.95])
def test_proportion_is_clopper_and_pearson(total, level):
    tail = (1 - level) / 2
    for count in {0, 1, total // 2, total - 1, total}:
        low, high = proportion(count, total, level)
        assert low == pytest.approx(stats.beta.ppf(tail, count, total - count + 1) if count else 0.0, abs=1e-9)
        assert high == pytest.approx(stats.beta.ppf(1 - tail, count + 1, total - count) if count < total else 1.0, abs=1e-9)


def test_proportion_of_nothing():
    assert np.isnan(proportion(0, 0)).all()
