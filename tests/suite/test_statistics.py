"""Intervals against scipy, against closed forms, and by their coverage."""

import numpy as np
import pytest
from scipy import stats

from suite.statistics import averaged, below_zero, jackknife, means, positive_jackknife, proportion


def root_mean_square(data):
    return means(np.atleast_2d(data) ** 2).map(np.sqrt)


def interval(sample, kind=jackknife, **level):
    return sample.value, *kind(sample, **level)


def test_means_without_each_run_in_turn():
    data = np.random.default_rng(0).lognormal(0, 3, (4, 9))
    data[1, 3] = data[2, :7] = np.nan
    data[3, 2] = np.inf
    found = means(data)
    np.testing.assert_allclose(found.value, np.nanmean(data, axis=1))
    for r in range(9):
        np.testing.assert_allclose(found.left_out[:, r], np.nanmean(np.delete(data, r, axis=1), axis=1))
    assert np.isfinite(found.left_out[3, 2])


def test_a_run_that_is_far_larger_than_the_others_takes_no_digits_from_them():
    data = np.array([[1.0, 2.0, 1e30, 4.0]])
    np.testing.assert_allclose(means(data).left_out[0, 2], 7 / 3, rtol=1e-15)


def test_averaged_is_the_mean_over_time_of_a_function_of_the_mean_over_runs():
    data = np.random.default_rng(1).exponential(size=(5, 7))
    data[0, 2] = data[3] = np.nan
    known = [0, 1, 2, 4]
    found = averaged(data, np.sqrt)
    np.testing.assert_allclose(found.value, np.sqrt(np.nanmean(data[known], axis=1)).mean())
    np.testing.assert_allclose(found.left_out[0, 4], np.sqrt(np.nanmean(np.delete(data[known], 4, axis=1), axis=1)).mean())
    plain = averaged(data[known[1:]])
    np.testing.assert_allclose(plain.value, data[known[1:]].mean())
    np.testing.assert_allclose(plain.left_out[0, 4], np.delete(data[known[1:]], 4, axis=1).mean())


def test_jackknife_of_a_mean_is_the_t_interval():
    data = np.random.default_rng(0).exponential(size=(4, 25))
    value, low, high = interval(means(data))
    expected = stats.ttest_1samp(data, 0, axis=1).confidence_interval(0.95)
    np.testing.assert_allclose(value, data.mean(1))
    np.testing.assert_allclose([low, high], expected, rtol=1e-10)


def test_below_zero_is_the_one_sided_t_test():
    data = np.random.default_rng(3).standard_normal((5, 12)) - 0.3
    expected = stats.ttest_1samp(data, 0, axis=1, alternative="less").pvalue
    np.testing.assert_allclose(below_zero(means(data)), expected, rtol=1e-10)
    np.testing.assert_array_equal(below_zero(means(np.array([[-1.0] * 4, [0.0] * 4, [2.0] * 4]))), [0, 0.5, 1])


def test_jackknife_of_a_root_by_pseudo_values():
    data = np.random.default_rng(1).exponential(size=12)
    value, low, high = interval(root_mean_square(data))
    whole = np.sqrt((data**2).mean())
    pseudo = np.array([12 * whole - 11 * np.sqrt((np.delete(data, r) ** 2).mean()) for r in range(12)])
    expected = stats.ttest_1samp(pseudo, 0).confidence_interval(0.95)
    np.testing.assert_allclose([value[0], low[0], high[0]], [whole, *expected], rtol=1e-10)


@pytest.mark.parametrize("kind", [jackknife, positive_jackknife])
def test_coverage_for_normal_means(kind):
    # 6000 samples give the coverage a standard deviation of 0.0028; the logarithm of a mean that is 3 with a scatter of
    # 0.22 costs less than 0.005. Band 0.02: a false alarm has probability below 1e-6.
    data = np.random.default_rng(0).standard_normal((6000, 20)) + 3
    low, high = kind(means(data))
    assert abs(((low < 3) & (high > 3)).mean() - 0.95) < 0.02
    assert abs((low > 3).mean() - (high < 3).mean()) < 0.025  # both sides miss alike


def test_coverage_of_a_root_averaged_over_many_steps():
    """The mean over 1000 steps of a root over 12 runs is 1 % too small, several times its scatter."""
    # 400 samples of 12 runs: a coverage of 0.95 has a standard deviation of 0.011, the band is 5 of them.
    squares = np.random.default_rng(0).standard_exponential((1000, 400 * 12)).reshape(1000, 400, 12)
    inside = 0
    for sample in range(400):
        low, high = positive_jackknife(averaged(squares[:, sample], np.sqrt))
        inside += low[0] < 1.0 < high[0]
    assert inside / 400 > 0.95 - 0.055


def test_a_positive_interval_is_positive():
    wild = np.array([[1.0, 1.0, 1.0, 1.0, 1000.0], [0.0, 0.0, 0.0, 0.0, 7.0], [0.0] * 5])
    value, low, high = interval(means(wild), positive_jackknife)
    assert (low >= 0).all()
    assert low[0] > 0
    assert ((low <= value) & (value <= high)).all()
    assert (value[2], low[2], high[2]) == (0, 0, 0)
    assert np.isnan(positive_jackknife(means(np.array([[2.5]])))).all()


def test_level_widens_the_interval():
    sample = means(np.random.default_rng(0).standard_normal((1, 30)))
    (low, high), (wide_low, wide_high) = jackknife(sample), jackknife(sample, level=0.99)
    assert wide_low < low < high < wide_high


def test_pairs_stay_paired():
    """A constant difference between two estimators has an interval of no width."""
    data = np.random.default_rng(0).standard_normal((1, 30))
    np.testing.assert_allclose(jackknife(means(data + 0.25) - means(data)), 0.25, rtol=1e-12)


def test_constant_contributions_have_no_width():
    value, low, high = interval(means(np.full((3, 10), 0.1)))
    np.testing.assert_allclose([value, low, high], 0.1, rtol=1e-13)
    assert interval(means(np.zeros((1, 10)))) == (0, 0, 0)


def test_one_run_has_a_value_and_no_interval():
    value, low, high = interval(means(np.array([[2.5]])))
    assert value == 2.5
    assert np.isnan([low, high]).all()


def test_two_runs():
    value, low, high = interval(means(np.array([[1.0, 3.0]])))
    np.testing.assert_allclose([value[0], high[0] - 2, 2 - low[0]], [2, *[stats.t.ppf(0.975, 1)] * 2])


def test_an_infinite_run_makes_the_interval_open():
    value, low, high = interval(means(np.array([[1.0, 1.5, 2.0, 2.5, np.inf]])), positive_jackknife)
    assert (value, high) == (np.inf, np.inf)
    assert 1 <= low <= np.inf


def test_nan_contributions_are_as_if_the_run_were_not_there():
    # The ten known runs of fifteen: leaving out a run that is not there changes nothing.
    data = np.random.default_rng(0).standard_normal(10)
    value, low, high = interval(means(np.concatenate([data, np.full(5, np.nan)])[None]))
    plain, plain_low, plain_high = interval(means(data[None]))
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


def test_a_statistic_that_one_run_makes_is_not_positive():
    found = means(np.array([[0.0, 3.0, 0.0], [1.0, 3.0, 0.0], [-1.0, 0.0, 0.0]])).positive
    assert found.tolist() == [False, True, False]
