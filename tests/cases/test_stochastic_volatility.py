"""Stochastic volatility: its law, its exact posterior on a grid, and who learns from a return and who cannot."""

import numpy as np
import pytest
from scipy import stats

from cases.stochastic_volatility import CASES
from estimators.bootstrap import Bootstrap
from estimators.ekf import Extended
from estimators.ukf import Unscented
from tests.oracles import grid_filter

(CASE,) = CASES
MODEL = CASE.model
MU, RHO, SIGMA = 2 * np.log(0.5992), 0.9702, 0.178
STATIONARY = SIGMA / np.sqrt(1 - RHO**2)


@pytest.fixture(scope="module")
def truth():
    """A few hundred runs."""
    return CASE.simulate(400, seed=3)


def test_model_is_the_stated_one():
    x = np.array([[-3.0, 0.0, 2.0]])
    np.testing.assert_allclose(MODEL.dynamics.mean(x, 1), MU + RHO * (x - MU), rtol=1e-14)
    np.testing.assert_allclose(MODEL.dynamics.noise.cov, [[SIGMA**2]])
    np.testing.assert_allclose(MODEL.prior.mean, [MU])
    np.testing.assert_allclose(MODEL.prior.cov, [[STATIONARY**2]])
    assert (CASE.steps, CASE.interval) == (200, 1)


def test_density_is_that_of_a_normal_number_of_variance_exp_x():
    x = np.linspace(-5, 3, 12).reshape(1, 2, 6)
    z = np.array([[0.7, -2.0]])
    expected = stats.norm.logpdf(z[0][:, None], scale=np.exp(x[0] / 2))
    np.testing.assert_allclose(MODEL.sensor.logpdf(z, x, 1), expected, rtol=1e-13)
    np.testing.assert_allclose(MODEL.sensor.logpdf(z, x[..., 0], 1), expected[:, 0], rtol=1e-13)
    missing = MODEL.sensor.logpdf(np.array([[np.nan, -2.0]]), x, 1)
    np.testing.assert_array_equal(missing[0], np.zeros(6))
    np.testing.assert_allclose(missing[1], expected[1], rtol=1e-13)


def test_simulated_states_and_returns_follow_the_model(truth):
    # First and last states of 400 runs are N(mu, stationary); 79 600 noises of the state and 80 000 of returns, means,
    # variances, correlation from step to step, and the fourth moment of a return: 11 figures of 5 standard errors, below 7e-6.
    x, y = truth.x[:, 0], truth.y[:, 0]
    for state in (x[0], x[-1]):
        scaled = (state - MU) / STATIONARY
        assert abs(scaled.mean()) < 5 / np.sqrt(400)
        assert abs((scaled**2).mean() - 1) < 5 * np.sqrt(2 / 400)
    w, v = (x[1:] - MU - RHO * (x[:-1] - MU)) / SIGMA, y * np.exp(-x / 2)
    for noise in (w, v):
        assert abs(noise.mean()) < 5 / np.sqrt(noise.size)
        assert abs((noise**2).mean() - 1) < 5 * np.sqrt(2 / noise.size)
        assert abs((noise[1:] * noise[:-1]).mean()) < 5 / np.sqrt(noise.size)
    assert abs((v**4).mean() - 3) < 5 * np.sqrt(96 / v.size)


@pytest.fixture(scope="module")
def exact(truth):
    """Means [T, 3], variances [T, 3] and log-likelihoods [T, 3] of the exact posteriors of three runs."""
    grid = np.linspace(MU - 7 * STATIONARY, MU + 7 * STATIONARY, 161)
    found = [
        grid_filter(
            grid, stats.norm.pdf(grid, MU, STATIONARY), lambda x, k: MU + RHO * (x - MU), SIGMA,
            lambda z, x: stats.norm.pdf(z, scale=np.exp(x / 2)), truth.y[:, 0, r],
        )
        for r in range(3)
    ]  # fmt: skip
    return tuple(np.stack(part, axis=1) for part in zip(*found, strict=True))


def test_a_bootstrap_filter_is_near_the_exact_posterior(exact, truth):
    # With 4000 particles the errors of mean, variance and log-likelihood were 0.011, 0.0064 and 0.20 at most over 5 seeds, and
    # they fell as the root of the number of particles from 500 to 32 000. The limits are four times that.
    estimate = Bootstrap(particles=4000).run(MODEL, truth.y[..., :3], 1)
    mean, variance, loglik = exact
    assert np.sqrt(((estimate.mean[:, 0] - mean) ** 2).mean()) < 0.045
    assert np.sqrt(((estimate.cov[:, 0, 0] - variance) ** 2).mean()) < 0.026
    np.testing.assert_allclose(estimate.loglik.sum(0), loglik.sum(0), atol=0.8)


@pytest.mark.parametrize("estimator", [Extended(), Unscented()], ids=lambda one: one.name)
def test_filters_linear_in_the_return_learn_nothing(estimator, truth):
    estimate = estimator.run(MODEL, truth.y[..., :20])
    np.testing.assert_allclose(estimate.mean, MU, rtol=1e-12)
    np.testing.assert_allclose(estimate.cov, STATIONARY**2, rtol=1e-9)


def test_no_estimate_of_the_stationary_mean_diverges_as_a_rule(truth):
    """The limit of divergence is four standard deviations of the state: it takes a wrong filter to get there."""
    away = np.abs(truth.x[:, 0] - MU) > CASE.divergence.limit
    assert away.mean() < 1e-3
