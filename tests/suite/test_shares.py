"""The interval of a share: against exact ones, and by its coverage."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from suite.metrics.bound import ratio
from suite.metrics.metric import share
from suite.statistics import averaged, jackknife


def test_the_interval_of_a_share_is_the_binomial_one_of_its_effective_trials():
    values = np.random.default_rng(0).beta(4, 1, (1, 15))
    mean, variance = values.mean(), values.var(ddof=1) / 15
    trials = mean * (1 - mean) / variance * (stats.norm.ppf(0.975) / stats.t.ppf(0.975, 14)) ** 2
    low = stats.beta.ppf(0.025, trials * mean, trials * (1 - mean) + 1)
    high = stats.beta.ppf(0.975, trials * mean + 1, trials * (1 - mean))
    np.testing.assert_allclose(share(values), [mean, low, high], rtol=1e-9)


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_where_all_runs_agree_on_all_or_nothing_the_interval_is_that_of_as_many_trials(value):
    other = 1 - 0.025 ** (1 / 12)
    expected = [value, 0.0, other] if value == 0 else [value, 1 - other, 1.0]
    np.testing.assert_allclose(share(np.full((3, 12), value)), expected, rtol=1e-9)


@pytest.mark.parametrize("value", [0.1, 0.5, 1 / 3])
def test_runs_without_scatter_leave_no_doubt(value):
    np.testing.assert_allclose(share(np.full((5, 7), value)), value, rtol=1e-12)


def test_a_single_run_gives_no_interval():
    for value in (0.0, 0.4, 1.0):
        np.testing.assert_array_equal(share(np.array([[value]])), [value, np.nan, np.nan])


def test_away_from_the_ends_the_interval_of_a_share_is_that_of_its_mean():
    values = 0.5 + 0.01 * np.random.default_rng(0).standard_normal((1, 20))
    low, high = jackknife(averaged(values))
    np.testing.assert_allclose(share(values), [values.mean(), low[0], high[0]], atol=2e-5)


@given(st.integers(2, 30), st.integers(1, 4), st.floats(0.01, 10), st.integers(0, 2**32 - 1))
@settings(max_examples=200, deadline=None)
def test_the_interval_of_a_share_stays_within_zero_and_one_and_holds_it(count, steps, spread, seed):
    rng = np.random.default_rng(seed)
    values = np.where(rng.random((steps, count)) < 0.5, rng.integers(0, 2, (steps, count)), rng.beta(spread, 1, (steps, count)))
    values = values.round(6)  # one less a smaller number is one
    value, low, high = share(values)
    assert 0 <= low <= value <= high <= 1
    np.testing.assert_allclose(share(1 - values), [1 - value, 1 - high, 1 - low], atol=1e-9)


@pytest.mark.parametrize(
    ("draw", "truth", "link"),
    [
        (lambda rng, runs: rng.beta(18, 2, (1, runs)), 0.9, np.positive),
        (lambda rng, runs: np.minimum(rng.exponential(3, (1, runs)), 1), 3 * (1 - np.exp(-1 / 3)), np.positive),
        (lambda rng, runs: (rng.random((1, runs)) < 0.05) * 1.0, 0.05, np.positive),
        (lambda rng, runs: np.stack([rng.binomial(4, rng.beta(0.2, 1.8, runs)), np.full(runs, 4)]) * 1.0, 0.1, ratio),
    ],
    ids=["times of modes told right", "times to divergence", "rare losses", "missed switches that come together"],
)
@pytest.mark.parametrize("count", [12, 40])
def test_the_interval_of_a_share_covers_it(draw, truth, link, count):
    # 1000 samples give a coverage of 0.95 a standard deviation of 0.007; approximations may cost 0.02: below 0.93 less 5 of
    # them a false alarm has probability below 1e-6. Rare losses are covered more often, as by every exact interval.
    rng = np.random.default_rng(0)
    held = 0
    for _ in range(1000):
        _, low, high = share(draw(rng, count), link)
        held += low <= truth <= high
    assert held / 1000 > 0.93 - 5 * 0.007


def test_share_of_steps_that_resemble_each_other_is_in_its_interval_at_its_rate():
    # 1000 sets of 15 runs of 40 steps, whose latent variable is the same for 20 steps on end: 30 independent trials.
    # Coverage 0.95 has a standard deviation of 0.007; the interval is meant to be wide rather than narrow. 5 sigma below.
    latent = np.random.default_rng(0).random((1000, 2, 15)).repeat(20, axis=1)
    for truth in (0.5, 0.95):
        found = np.array([share((values < truth).astype(float)) for values in latent])
        assert ((found[:, 1] <= truth) & (truth <= found[:, 2])).mean() > 0.95 - 5 * 0.007
        assert (found[:, 1] >= 0).all()
        assert (found[:, 2] <= 1).all()
        assert np.median(found[:, 2] - found[:, 1]) < 6 * np.sqrt(truth * (1 - truth) / 30)
