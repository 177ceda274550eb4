"""Intervals against scipy, against closed forms, and by their coverage."""

import numpy as np
import pytest
from scipy import stats

from suite.statistics import jackknife, positive_jackknife, proportion, weighted_mean


def mean_of(data):
    """The mean of data[S, R] as a statistic of weighted runs."""
    return lambda weights: weighted_mean(np.atleast_2d(data), weights)


def root_mean_square(data):
    return lambda weights: np.sqrt(weighted_mean(np.atleast_2d(data) ** 2, weights))


def test_jackknife_of_a_mean_is_the_t_interval():
    data = np.random.default_rng(0).exponential(size=(4, 25))
    value, low, high = jackknife(mean_of(data), 25)
    expected = stats.ttest_1samp(data, 0, axis=1).confidence_interval(0.95)
    np.testing.assert_allclose(value, data.mean(1))
    np.testing.assert_allclose([low, high], expected, rtol=1e-10)


def test_jackknife_of_a_root_by_pseudo_values():
    data = np.random.default_rng(1).exponential(size=12)
    value, low, high = jackknife(root_mean_square(data), 12)
    whole = np.sqrt((data**2).mean())
    pseudo = np.array([12 * whole - 11 * np.sqrt((np.delete(data, r) ** 2).mean()) for r in range(12)])
    expected = stats.ttest_1samp(pseudo, 0).confidence_interval(0.95)
    np.testing.assert_allclose([value[0], low[0], high[0]], [whole, *expected], rtol=1e-10)


@pytest.mark.parametrize("interval", [jackknife, positive_jackknife])
def test_coverage_for_normal_means(interval):
    # 6000 samples give the coverage a standard deviation of 0.0028; the logarithm of a mean that is 3 with a scatter of
    # 0.22 costs less than 0.005. Band 0.02: a false alarm has probability below 1e-6.
    data = np.random.default_rng(0).standard_normal((6000, 20)) + 3
    _, low, high = interval(mean_of(data), 20)
    assert abs(((low < 3) & (high > 3)).mean() - 0.95) < 0.02
    assert abs((low > 3).mean() - (high < 3).mean()) < 0.025  # both sides miss alike


def test_coverage_of_a_root_averaged_over_many_steps():
    """The mean over 1000 steps of a root over 12 runs is 1 % too small, several times its scatter."""
    # 400 samples of 12 runs: a coverage of 0.95 has a standard deviation of 0.011, the band is 5 of them.
    squares = np.random.default_rng(0).standard_exponential((1000, 400 * 12)).reshape(1000, 400, 12)
    inside = 0
    for sample in range(400):
        part = squares[:, sample]

        def rms(weights, part=part):
            return np.sqrt(weighted_mean(part, weights)).mean(0)[None]

        _, low, high = positive_jackknife(rms, 12)
        inside += low[0] < 1.0 < high[0]
    assert inside / 400 > 0.95 - 0.055


def test_a_positive_interval_is_positive():
    wild = np.array([[1.0, 1.0, 1.0, 1.0, 1000.0], [0.0, 0.0, 0.0, 0.0, 7.0], [0.0] * 5])
    value, low, high = positive_jackknife(mean_of(wild), 5)
    assert (low >= 0).all()
    assert low[0] > 0
    assert ((low <= value) & (value <= high)).all()
    assert (value[2], low[2], high[2]) == (0, 0, 0)
    assert np.isnan(positive_jackknife(mean_of(np.array([[2.5]])), 1)[1:]).all()


def test_level_widens_the_interval():
    data = np.random.default_rng(0).standard_normal((1, 30))
    _, low, high = jackknife(mean_of(data), 30)
    _, wide_low, wide_high = jackknife(mean_of(data), 30, level=0.99)
    assert wide_low < low < high < wide_high


def test_the_same_data_give_the_same_interval_and_pairs_stay_paired():
    data = np.random.default_rng(0).standard_normal((2, 30))
    assert np.array_equal(jackknife(mean_of(data), 30), jackknife(mean_of(data), 30))
    both, alone = jackknife(mean_of(data), 30), jackknife(mean_of(data[1]), 30)
    np.testing.assert_allclose([part[1] for part in both], [part[0] for part in alone], rtol=1e-12)
    # A constant difference between two estimators has an interval of no width.
    _, low, high = jackknife(lambda w: mean_of(data[0] + 0.25)(w) - mean_of(data[0])(w), 30)
    np.testing.assert_allclose([low, high], 0.25, rtol=1e-12)


def test_constant_contributions_have_no_width():
    value, low, high = jackknife(mean_of(np.full((3, 10), 0.1)), 10)
    np.testing.assert_allclose([value, low, high], 0.1, rtol=1e-13)
    value, low, high = jackknife(mean_of(np.zeros((1, 10))), 10)
    assert (value, low, high) == (0, 0, 0)


def test_one_run_has_a_value_and_no_interval():
    value, low, high = jackknife(mean_of(np.array([[2.5]])), 1)
    assert value == 2.5
    assert np.isnan([low, high]).all()


def test_two_runs():
    value, low, high = jackknife(mean_of(np.array([[1.0, 3.0]])), 2)
    np.testing.assert_allclose([value[0], high[0] - 2, 2 - low[0]], [2, *[stats.t.ppf(0.975, 1)] * 2])


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
    value, low, high = positive_jackknife(mean_of(np.array([[1.0, 1.5, 2.0, 2.5, np.inf]])), 5)
    assert (value, high) == (np.inf, np.inf)
    assert 1 <= low <= np.inf


def test_nan_contributions_are_as_if_the_run_were_not_there():
    # The ten known runs of fifteen: leaving out a run that is not there changes nothing.
    data = np.random.default_rng(0).standard_normal(10)
    holes = np.concatenate([data, np.full(5, np.nan)])[None]
    value, low, high = jackknife(mean_of(holes), 15)
    plain, plain_low, plain_high = jackknife(mean_of(data), 10)
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
