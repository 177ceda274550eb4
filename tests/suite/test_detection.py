"""Sequential tests against their definitions, Wald's and Lorden's bounds, and Kullback-Leibler divergences."""

import itertools

import numpy as np
import pytest
from scipy import stats

from suite.detection import cusum, log_likelihood_ratio, log_ratio, observed, sprt, wald
from suite.modes import LARGEST
from tests.oracles import generators

INF = np.inf


def gaussian_ratios(runs, shift, truth, *key):
    """Endless log-likelihood ratios [R] of N(shift, 1) against N(0, 1), for draws of N(truth, 1)."""
    rng, even = generators(1, "ratios", *key), np.log(np.full((2, runs), 0.5))
    while True:
        y = truth + rng.standard_normal((1, 1, runs))[0, 0]
        yield log_likelihood_ratio(even, np.stack([-y * y / 2, -((y - shift) ** 2) / 2]), 0)


@pytest.mark.parametrize("nominal", [0, 1, 2])
def test_the_ratio_is_that_of_the_mean_likelihood_of_a_manoeuvre_to_the_nominal_one(nominal):
    rng = np.random.default_rng(nominal)
    pi, likelihood = rng.dirichlet([1, 2, 3], 20).T, rng.exponential(size=(3, 20))
    others = [j for j in range(3) if j != nominal]
    manoeuvre = (pi[others] * likelihood[others]).sum(0) / pi[others].sum(0)
    found = log_likelihood_ratio(np.log(pi), np.log(likelihood) - 5000, nominal)  # that far off, all of them
    np.testing.assert_allclose(found, np.log(manoeuvre / likelihood[nominal]), atol=1e-11)


@pytest.mark.parametrize(
    ("logp", "loglik", "expected"),
    [
        ([0.0, -INF, -INF], [-1.0, -2.0, -3.0], 0.0),  # no manoeuvre was possible
        ([-INF, 0.0, -INF], [-1.0, -2.0, -3.0], 0.0),  # the nominal mode was not
        ([-1.0, -1.0, -INF], [-1.0, -4.0, 9.0], -3.0),  # a mode that was impossible does not count
        ([-1.0, -1.0, -INF], [-1.0, -4.0, np.nan], -3.0),
        ([-INF, 0.0, -INF], [np.nan, -2.0, -INF], 0.0),
        ([-1.0, -1.0, -1.0], [-INF, -2.0, -3.0], LARGEST),
        ([-1.0, -1.0, -1.0], [np.nan, -2.0, -3.0], LARGEST),
        ([-1.0, -1.0, -1.0], [-1.0, -INF, -INF], -LARGEST),
        ([-1.0, -1.0, -1.0], [-1.0, np.nan, -3.0], -2.0 - np.log(2)),
        ([-1.0, -1.0, -1.0], [-INF, -INF, -INF], 0.0),
        ([-1.0, -1.0, -1.0], [-1e6, -2e6, -3e6], -1e6 - np.log(2)),
        ([-1e6, 0.0, -INF], [-1.0, -2.0, -3.0], -1.0),
        ([0.0], [-5.0], 0.0),  # a single mode
    ],
)
def test_the_ratio_is_finite_whatever_is_impossible(logp, loglik, expected):
    found = log_likelihood_ratio(np.array(logp)[:, None], np.array(loglik)[:, None], 0)
    np.testing.assert_allclose(found, [expected], rtol=1e-12, atol=1e-9)


def test_the_ratio_of_two_likelihoods_is_finite():
    above, below = np.array([1.0, -INF, 2.0, -INF]), np.array([3.0, 0.0, -INF, -INF])
    np.testing.assert_array_equal(log_ratio(above, below), [-2, -LARGEST, LARGEST, 0])


def test_what_was_not_measured_says_nothing():
    y = np.array([[1.0, np.nan, np.nan], [np.nan, np.nan, 0.0]])
    np.testing.assert_array_equal(observed(np.array([1e-17, 1e-17, 5.0]), y), [1e-17, 0, 5])


def test_the_ratio_has_the_mean_that_kullback_and_leibler_give():
    # Divergences of N(0, 1) and N(0.8, 1) are 0.32 in both directions. 5 standard errors: a false alarm below 2e-6.
    for truth, expected in ((0.0, -0.32), (0.8, 0.32)):
        sample = np.concatenate(list(itertools.islice(gaussian_ratios(2000, 0.8, truth, "divergence"), 20)))
        assert abs(sample.mean() - expected) < 5 * sample.std() / np.sqrt(sample.size)
        assert sample.std() / np.sqrt(sample.size) < 0.01


def test_walds_thresholds():
    lower, upper = wald(false_alarm=0.01, miss=0.2)
    np.testing.assert_allclose([np.exp(lower), np.exp(upper)], [0.2 / 0.99, 0.8 / 0.01])
    assert wald(0.05, 0.05)[0] == -wald(0.05, 0.05)[1]
    for bad in ((0.0, 0.1), (0.1, 0.0), (0.5, 0.5), (np.nan, 0.1)):
        with pytest.raises(ValueError, match="false_alarm"):
            wald(*bad)


def test_a_test_that_accepts_nothing_begins_anew():
    ratios = np.array([[-1.0, -1.5, 4.0, -4.5, -0.5, 0.0, 1.0], [1, 1, 1, -6, 2, -4, 3]]).T
    total, found = np.zeros(2), []
    for llr in ratios:
        total = sprt(total, llr, -2.0)
        found.append(total)
    np.testing.assert_array_equal(np.stack(found).T, [[-1, 0, 4, -0.5, -1, -1, 0], [1, 2, 3, 0, 2, 0, 3]])


def test_cusum_is_the_rise_of_the_sum_above_its_least_value():
    ratios = np.random.default_rng(0).standard_normal((200, 5)) - 0.1
    sums = np.concatenate([np.zeros((1, 5)), np.cumsum(ratios, axis=0)])
    expected = (sums - np.minimum.accumulate(sums))[1:]
    total = np.zeros(5)
    for llr, wanted in zip(ratios, expected, strict=True):
        total = cusum(total, llr)
        np.testing.assert_allclose(total, wanted, atol=1e-12)
    assert (expected == 0).any()


def ends(shift, truth, lower, upper, runs):
    """Share of tests that end at the upper threshold, of `runs` tests that begin at 0."""
    total, high, open_ = np.zeros(runs), np.zeros(runs, bool), np.ones(runs, bool)
    for llr in gaussian_ratios(runs, shift, truth, "wald"):
        total = sprt(total, llr, lower)
        high |= open_ & (total >= upper)
        open_ &= (total != 0) & (total < upper)  # at 0 the test has begun anew
        if not open_.any():
            return high.mean()
    raise AssertionError


def test_the_errors_of_the_sequential_test_meet_walds_bounds():
    # Six standard errors of 20 000 tests a hypothesis: each of the five statements has a false alarm below 1e-9. The
    # last two say that the first three are sharp: an overshoot of mean 0.583 shift = 0.23 beyond each threshold multiplies
    # the errors by exp(-0.23) = 0.79 (Siegmund, 1985, section 3.1).
    runs, (false_alarm, miss) = 20_000, (0.05, 0.1)
    lower, upper = wald(false_alarm, miss)
    alarms, misses = ends(0.4, 0.0, lower, upper, runs), 1 - ends(0.4, 0.4, lower, upper, runs)
    alarms_error, misses_error = (np.sqrt(p * (1 - p) / runs) for p in (false_alarm, miss))
    assert alarms <= false_alarm / (1 - miss) + 6 * alarms_error
    assert misses <= miss / (1 - false_alarm) + 6 * misses_error
    assert alarms + misses <= false_alarm + miss + 6 * np.hypot(alarms_error, misses_error)
    assert alarms >= 0.7 * false_alarm - 6 * alarms_error
    assert misses >= 0.7 * miss - 6 * misses_error


def average_run_length(h, shift, truth):
    """Mean number of steps until g_k >= h from g_0 = 0, by Fredholm's equation on Gauss and Legendre's points (Page, 1954)."""
    node, weight = np.polynomial.legendre.leggauss(60)
    g, weight = h * (node + 1) / 2, h * weight / 2
    law = stats.norm(shift * (truth - shift / 2), shift)  # of one log-likelihood ratio
    start = np.concatenate([[0.0], g])
    into = np.column_stack([law.cdf(-start), law.pdf(g - start[:, None]) * weight])
    return np.linalg.solve(np.eye(61) - into, np.ones(61))[0]


@pytest.mark.parametrize(("truth", "runs"), [(0.0, 2000), (1.0, 20_000)])
def test_the_run_length_of_cusum_is_that_of_pages_integral_equation(truth, runs):
    # Run lengths have a standard deviation below their mean (nearly geometric without a change). 5 standard errors: a false
    # alarm has probability below 1e-6.
    h = 3.0
    total, length, first = np.zeros(runs), np.zeros(runs), np.ones(runs, bool)
    for llr in gaussian_ratios(runs, 1.0, truth, "length"):
        total = cusum(total, llr)
        length += first
        first &= total < h
        if not first.any():
            break
    exact = average_run_length(h, 1.0, truth)
    assert abs(length.mean() - exact) < 5 * length.std() / np.sqrt(runs)
    if truth == 0:  # Lorden's bound
        assert exact >= np.exp(h)
        assert length.mean() >= np.exp(h)


def test_a_run_that_is_lost_stays_lost():
    np.testing.assert_array_equal(sprt(np.array([np.nan, 0.0]), np.array([1.0, np.nan]), -1.0), [np.nan, np.nan])
