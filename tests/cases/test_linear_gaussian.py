"""The linear case draws from the model that it states."""

import numpy as np

from cases import CASES
from cases.linear_gaussian import ACCELERATION, SIGMA, T

CASE = CASES["linear-gaussian"]


def test_model_is_the_stated_one():
    model = CASE.model
    A = np.array([[1, T, 0, 0], [0, 1, 0, 0], [0, 0, 1, T], [0, 0, 0, 1]])
    q = ACCELERATION * np.array([[T**3 / 3, T**2 / 2], [T**2 / 2, T]])
    np.testing.assert_array_equal(model.dynamics.mean.matrix(1), A)
    np.testing.assert_array_equal(model.dynamics.noise.cov, np.block([[q, 0 * q], [0 * q, q]]))
    np.testing.assert_array_equal(model.sensor.mean.matrix(1), [[1, 0, 0, 0], [0, 0, 1, 0]])
    np.testing.assert_array_equal(model.sensor.noise.cov, SIGMA**2 * np.eye(2))


def test_process_noise_is_the_integral_of_white_acceleration():
    # Q = q * integral of (s, 1) (s, 1)^T over 0..T, by a sum.
    s = (np.arange(100_000) + 0.5) / 100_000 * T
    lever = np.stack([s, np.ones_like(s)])
    np.testing.assert_allclose(CASE.model.dynamics.noise.cov[:2, :2], ACCELERATION * lever @ lever.T * T / 1e5, rtol=1e-8)


def test_simulated_moments():
    # 1000 runs; 5 standard errors for means and variances at three steps, 4 states and 2 measurements: 36 figures, false
    # alarm below 3e-5.
    truth = CASE.simulate(1000, seed=6)
    model = CASE.model
    A, Q, H = model.dynamics.mean.matrix(1), model.dynamics.noise.cov, model.sensor.mean.matrix(1)
    mean, cov = model.prior.mean, model.prior.cov
    for k in range(1, 101):
        mean, cov = A @ mean, A @ cov @ A.T + Q
        if k in (1, 10, 100):
            y_cov = H @ cov @ H.T + SIGMA**2 * np.eye(2)
            for sample, m, P in ((truth.x[k - 1], mean, cov), (truth.y[k - 1], H @ mean, y_cov)):
                variance = np.diag(P)
                assert (np.abs(sample.mean(1) - m) < 5 * np.sqrt(variance / 1000)).all()
                found = ((sample - m[:, None]) ** 2).mean(1)
                assert (np.abs(found - variance) < 5 * variance * np.sqrt(2 / 1000)).all()


def test_noises_of_all_steps():
    # 1000 x 99 steps of process noise and 1000 x 100 of measurement noise: covariances within 5 standard errors, no
    # correlation from step to step.
    truth = CASE.simulate(1000, seed=7)
    A, H = CASE.model.dynamics.mean.matrix(1), CASE.model.sensor.mean.matrix(1)
    w = truth.x[1:] - np.einsum("ij,tjr->tir", A, truth.x[:-1])
    v = truth.y - np.einsum("ij,tjr->tir", H, truth.x)
    for noise, P in ((w, CASE.model.dynamics.noise.cov), (v, CASE.model.sensor.noise.cov)):
        count = noise.shape[0] * 1000
        spread = np.outer(np.diag(P), np.diag(P)) + P**2
        found = np.einsum("tir,tjr->ij", noise, noise) / count
        assert (np.abs(found - P) < 5 * np.sqrt(spread / count)).all()
        lagged = np.einsum("tir,tjr->ij", noise[1:], noise[:-1]) / count
        assert (np.abs(lagged) < 5 * np.sqrt(np.outer(np.diag(P), np.diag(P)) / count)).all()
