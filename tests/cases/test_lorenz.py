"""Lorenz's system: its flow held against an adaptive integrator and against what is known of it exactly."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cases.lorenz import CASES
from estimators.ckf import ESTIMATORS as CUBATURE
from suite import gaussian

(CASE,) = CASES
MODEL = CASE.model


def velocity(t, s):
    x, y, z = s.reshape(3, -1)
    return np.concatenate([10 * (y - x), x * (28 - z) - y, x * y - 8 / 3 * z])


def integrated(x, time):
    """States [3, R] after a time, or before it, by an adaptive rule of order 8."""
    return solve_ivp(velocity, (0, time), x.ravel(), method="DOP853", rtol=1e-11, atol=1e-11).y[:, -1].reshape(x.shape)


@pytest.fixture(scope="module")
def truth():
    """A few hundred runs."""
    return CASE.simulate(300, seed=3)


def test_flow_is_lorenzs(truth):
    x = truth.x[::40, :, :20].transpose(1, 0, 2).reshape(3, -1)
    # A Runge-Kutta rule of order 4 with steps of 0.01 errs by 1e-4 over 0.25; Euler's would by 1.
    np.testing.assert_allclose(MODEL.dynamics.mean(x, 1), integrated(x, 0.25), rtol=0, atol=1e-3)
    halves = np.sqrt(72.0)
    rest = np.array([[0, halves, -halves], [0, halves, -halves], [0, 27, 27.0]])
    np.testing.assert_allclose(MODEL.dynamics.mean(rest, 1), rest, atol=1e-12)


def test_the_rule_is_of_fourth_order_with_steps_of_a_hundredth():
    """The textbook rule, recoded number by number."""
    found = s = np.array([3.0, -4.0, 22.0])
    for _ in range(25):
        a = velocity(0, s)
        b = velocity(0, s + 0.005 * a)
        c = velocity(0, s + 0.005 * b)
        d = velocity(0, s + 0.01 * c)
        s = s + 0.01 / 6 * (a + 2 * b + 2 * c + d)
    np.testing.assert_allclose(MODEL.dynamics.mean(found[:, None], 1)[:, 0], s, rtol=1e-12)


def test_jacobian_shrinks_volumes_as_lorenz_says(truth):
    # The flow's divergence is -(10 + 1 + 8/3) everywhere, so the determinant is exp of -0.25 times that (Lorenz, 1963, eq. 30).
    assert gaussian.differentiable(MODEL) is None
    x = truth.x[100, :, :20]
    J = MODEL.dynamics.jacobian(x, 1)
    np.testing.assert_allclose(np.linalg.det(np.moveaxis(J, -1, 0)), np.exp(-0.25 * 41 / 3), rtol=1e-4)
    for i in range(3):
        shift = 1e-5 * np.eye(3)[:, i : i + 1]
        difference = (MODEL.dynamics.mean(x + shift, 1) - MODEL.dynamics.mean(x - shift, 1)) / 2e-5
        np.testing.assert_allclose(J[:, i], difference, rtol=1e-6, atol=1e-6)


def test_model_is_the_stated_one():
    np.testing.assert_array_equal(MODEL.dynamics.noise.cov, np.zeros((3, 3)))
    np.testing.assert_array_equal(MODEL.sensor.mean.matrix(1), np.eye(3))
    np.testing.assert_array_equal(MODEL.sensor.noise.cov, 2 * np.eye(3))
    np.testing.assert_array_equal(MODEL.prior.mean, [1.509, -1.531, 25.46])
    np.testing.assert_array_equal(MODEL.prior.cov, 2 * np.eye(3))
    assert (CASE.steps, CASE.interval) == (200, 0.25)


def test_truth_is_one_orbit_and_its_measurements(truth):
    # 60 000 measurement errors a component: means, covariances, correlation from step to step: 3 + 6 + 9 figures of 5 standard
    # errors, below 2e-5.
    for k in (1, 2, 120):
        np.testing.assert_array_equal(truth.x[k], MODEL.dynamics.mean(truth.x[k - 1], k + 1))
    v = (truth.y - truth.x).transpose(1, 0, 2)
    count = v[0].size
    assert (np.abs(v.mean((1, 2))) < 5 * np.sqrt(2 / count)).all()
    cov = np.einsum("itr,jtr->ij", v, v) / count
    assert (np.abs(cov - 2 * np.eye(3)) < 5 * np.sqrt((4 + 4 * np.eye(3)) / count)).all()
    assert (np.abs(np.einsum("itr,jtr->ij", v[:, 1:], v[:, :-1]) / count) < 5 * 2 / np.sqrt(count)).all()


def test_orbits_start_at_the_stated_law(truth):
    # Traced back from the first measurement's time: 3 + 6 figures of 300 runs within 5 standard errors, below 1e-5.
    start = integrated(truth.x[0], -0.25)
    error = start - np.array([1.509, -1.531, 25.46])[:, None]
    assert (np.abs(error.mean(1)) < 5 * np.sqrt(2 / 300)).all()
    assert (np.abs(error @ error.T / 300 - 2 * np.eye(3)) < 5 * np.sqrt((4 + 4 * np.eye(3)) / 300)).all()


def test_late_states_balance(truth):
    # On the attractor averages do not change: those of dx²/dt, 2 · 10 (xy - x²), and of dz/dt, xy - 8/3 z, are zero. Averages
    # of late steps over runs, which are independent: 2 figures of 5 standard errors, below 2e-6.
    x, y, z = truth.x[100:].transpose(1, 0, 2)
    for balance in (x * y - x * x, x * y - 8 / 3 * z):
        run = balance.mean(0)
        assert abs(run.mean()) < 5 * run.std(ddof=1) / np.sqrt(300)


def test_two_orbits_are_further_apart_than_the_limit_of_divergence(truth):
    """Late states of different runs are strangers; most such pairs are further apart than the limit."""
    late = truth.x[100:].transpose(1, 0, 2)
    apart = np.sqrt(((late[..., ::2] - late[..., 1::2]) ** 2).sum(0))
    assert (apart > CASE.divergence.limit).mean() > 0.7


def test_a_good_filter_does_not_diverge(truth):
    estimate = CUBATURE[0].run(MODEL, truth.y[..., :30], 1)
    error = np.sqrt(((estimate.mean - truth.x[..., :30]) ** 2).sum(1))
    assert estimate.ok.all()
    assert (error > CASE.divergence.limit).sum(0).max() < CASE.divergence.steps
