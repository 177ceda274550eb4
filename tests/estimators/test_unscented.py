"""The unscented particle filter: the covariance that each particle carries, and weights from a known state."""

import copy
import dataclasses

import numpy as np
import pytest

from estimators.unscented import UnscentedParticle
from suite import particles
from suite.case import draw
from suite.random import Streams
from suite.resampling import SCHEMES
from tests.estimators.references import PAIR, PUSHED, SIDES, on_a_grid, repeated, unbiased, without_gain
from tests.oracles import filterpy_kalman, generators

MODEL = without_gain(PAIR)


def with_outages():
    y = PAIR.simulate(steps=6, runs=3, seed=1)[1]
    y[2] = np.nan
    y[3, 1] = np.nan
    return y


def covariances(belief):
    """What every particle's filter carries [n, n, R, N]."""
    return np.einsum("ij...,kj...->ik...", belief.root, belief.root)


def test_on_linear_models_every_particle_carries_the_kalman_filters_covariance():
    y, rng = with_outages(), Streams.of(2).batch(0, 3)
    estimator = UnscentedParticle(particles=30)
    _, cov, _ = filterpy_kalman(PAIR, y[:, :, 0])
    belief = estimator.init(MODEL, rng)
    np.testing.assert_allclose(covariances(belief)[..., 0, 0], PAIR.P0, rtol=1e-14)
    for k, z in enumerate(y, start=1):
        belief = estimator.step(MODEL, belief, z, k, rng)
        np.testing.assert_allclose(
            np.moveaxis(covariances(belief), (0, 1), (2, 3)), np.broadcast_to(cov[k - 1], (3, 30, 2, 2)), rtol=1e-8
        )


def unscented_variance(origin, variance, k):
    """Variance of the scalar unscented filter on SIDES with points at 0 and ± sqrt(3) deviations, weights 2/3 and 1/6."""
    offsets, weights = np.array([0.0, 1.0, -1.0]) * np.sqrt(3.0), np.array([4.0, 1.0, 1.0]) / 6
    points = origin[..., None] + np.sqrt(variance)[..., None] * offsets
    moved = 0.8 * points + 2 * np.sin(points) + 0.5 * np.cos(k)
    mean = moved @ weights
    predicted = (moved - mean[..., None]) ** 2 @ weights + 0.5
    away = np.sqrt(predicted)[..., None] * offsets
    seen = np.sqrt(1 + (mean[..., None] + away) ** 2)
    error = seen - (seen @ weights)[..., None]
    return predicted - (away * error @ weights) ** 2 / (error**2 @ weights + 2.0)


def test_covariances_follow_the_particles_that_survive():
    y, rng = draw(SIDES, 4, generators(3, "follow")).y, Streams.of(3).batch(0, 3)
    estimator = UnscentedParticle(particles=40)
    belief = estimator.init(SIDES, rng)
    for k, z in enumerate(y, start=1):
        # The same random numbers give the same survivors.
        start = particles.resample(belief.particles, SCHEMES[estimator.resampling], 1.0, copy.deepcopy(rng))
        variance = np.take_along_axis(covariances(belief)[0, 0], start.parents, axis=1)
        belief = estimator.step(SIDES, belief, z, k, rng)
        np.testing.assert_allclose(covariances(belief)[0, 0], unscented_variance(start.x[0], variance, k), rtol=1e-9)
    assert len(start.runs) == 3


def test_from_a_known_state_the_proposal_is_optimal():
    """Then the weights of the first step do not depend on the draws: the likelihood is exact, and all are equal."""
    known = dataclasses.replace(PAIR, P0=np.zeros((2, 2)))
    y = with_outages()
    estimate = UnscentedParticle(particles=25).run(without_gain(known), y, 4)
    exact = [filterpy_kalman(known, y[:1, :, r])[2][0] for r in range(3)]
    np.testing.assert_allclose(estimate.loglik[0], exact, rtol=1e-9)
    np.testing.assert_allclose(estimate.ess[0], 25, rtol=1e-9)


@pytest.mark.parametrize("settings", [{"alpha": 0.5, "beta": 2.0}, {"threshold": 0.5, "resampling": "systematic"}], ids=str)
def test_figures_are_unbiased_whatever_the_settings(settings):
    # 4 steps x 3 figures in two tests, 6 standard errors: a false alarm has probability below 1e-6.
    y = draw(SIDES, 4, generators(1, "sides")).y
    mean, variance, loglik = on_a_grid(np.linspace(-25, 25, 1001), SIDES, y)
    estimate = UnscentedParticle(particles=30, **settings).run(SIDES, repeated(y, 1200), 1)
    worst = np.abs(unbiased(estimate, mean, variance[..., None], loglik[:, 0])).max()
    assert worst < 6


def test_it_needs_a_transition_with_a_density():
    assert UnscentedParticle().accepts(MODEL) is None
    assert UnscentedParticle().accepts(PUSHED.model) is not None
