"""Bearings only: the stated model, a truth that starts where it is said to, and a particle filter that keeps it."""

import dataclasses
from math import erfc

import numpy as np
import pytest

from cases.bearings_only import CASES
from estimators.sir import ESTIMATORS as SIR
from suite import gaussian

(CASE,) = CASES
MODEL = CASE.model
A = np.array([[1, 1, 0, 0], [0, 1, 0, 0], [0, 0, 1, 1], [0, 0, 0, 1.0]])
START = np.array([-0.05, 0.001, 0.7, -0.055])


def test_model_is_the_stated_one():
    np.testing.assert_array_equal(MODEL.dynamics.mean.matrix(1), A)
    G = np.array([[0.5, 0], [1, 0], [0, 0.5], [0, 1]])
    np.testing.assert_allclose(MODEL.dynamics.noise_cov(1), 1e-6 * G @ G.T, rtol=1e-14)
    np.testing.assert_allclose(MODEL.sensor.noise.cov, [[0.005**2]])
    np.testing.assert_array_equal(MODEL.prior.mean, [0, 0, 0.4, -0.05])
    np.testing.assert_allclose(np.sqrt(np.diag(MODEL.prior.cov)), [0.5, 0.005, 0.3, 0.01])
    assert np.count_nonzero(MODEL.prior.cov) == 4
    assert CASE.steps == 24
    assert gaussian.differentiable(MODEL) is None


def test_bearings_are_angles_of_the_position_from_the_x_axis():
    x = np.random.default_rng(0).standard_normal((4, 100))  # all four quadrants
    np.testing.assert_allclose(MODEL.sensor.mean(x, 1)[0], np.angle(x[0] + 1j * x[2]), rtol=1e-14)
    square, zero = x[0] ** 2 + x[2] ** 2, np.zeros(100)
    np.testing.assert_allclose(MODEL.sensor.jacobian(x, 1), [[-x[2] / square, zero, x[0] / square, zero]], rtol=1e-12)


def test_bearings_wrap():
    """Due west is pi as well as -pi."""
    west = np.array([-1.0, 0.0, 0.0, 0.0])[:, None, None]
    density = MODEL.sensor.logpdf(np.array([[np.pi - 1e-3, -np.pi + 1e-3]]), np.repeat(west, 2, axis=1), 1)[:, 0]
    assert density[0] == pytest.approx(density[1], rel=1e-9)


@pytest.fixture(scope="module")
def truth():
    """A thousand runs, k = 1 to 24."""
    return CASE.simulate(1000, seed=3)


def test_truth_follows_the_model_from_its_start(truth):
    # 24 000 accelerations on each axis and as many bearings: three means, three variances, and correlations of the axes and
    # from step to step: 10 figures of 5 standard errors, a false alarm below 1e-5.
    before = np.concatenate([np.broadcast_to(START[None, :, None], (1, 4, 1000)), truth.x[:-1]])
    step = truth.x - np.einsum("ij,tjr->tir", A, before)
    np.testing.assert_allclose(step[:, [0, 2]], step[:, [1, 3]] / 2, rtol=0, atol=1e-15)
    bearing = np.angle(np.exp(1j * (truth.y[:, 0] - np.angle(truth.x[:, 0] + 1j * truth.x[:, 2]))))
    white = np.stack([step[:, 1] / 0.001, step[:, 3] / 0.001, bearing / 0.005])
    count = 24_000
    assert (np.abs(white.mean((1, 2))) < 5 / np.sqrt(count)).all()
    assert (np.abs((white**2).mean((1, 2)) - 1) < 5 * np.sqrt(2 / count)).all()
    assert abs((white[0] * white[1]).mean()) < 5 / np.sqrt(count)
    assert (np.abs((white[:, 1:] * white[:, :-1]).mean((1, 2))) < 5 / np.sqrt(count)).all()


def test_the_target_passes_on_either_side(truth):
    # At k = 13 it is expected at (-0.037, -0.015), with a standard deviation of 0.001 sqrt(k³/3) = 0.027 on each axis: some
    # 8 % of the runs pass to the right, and those to the left cross the cut of the angle.
    right = (truth.x[12, 0] > 0).mean()
    spread = 0.001 * np.sqrt(sum((13 - j + 0.5) ** 2 for j in range(1, 14)))
    expected = 0.5 * erfc(0.037 / spread / np.sqrt(2))
    assert abs(right - expected) < 5 * np.sqrt(expected * (1 - expected) / 1000)
    assert (truth.x[-1, 2] < 0).all()


def test_a_good_filter_does_not_diverge(truth):
    """A particle filter with as many samples as in the paper, on 20 runs; the extended Kalman filter loses a quarter."""
    estimate = dataclasses.replace(SIR[0], particles=4000).run(MODEL, truth.y[..., :20], 1)
    error = np.sqrt(((estimate.mean - truth.x[..., :20])[:, [0, 2]] ** 2).sum(1))
    assert estimate.ok.all()
    assert (error > CASE.divergence.limit).sum(0).max() < CASE.divergence.steps
