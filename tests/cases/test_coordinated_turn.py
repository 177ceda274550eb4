"""The coordinated turn: the paper's matrix recoded, turns at no rate at all, and what is simulated."""

import numpy as np
import pytest

from cases.coordinated_turn import CASES
from estimators.ckf import ESTIMATORS as CUBATURE
from suite import gaussian
from suite.kinematics import sinc

(CASE,) = CASES
MODEL = CASE.model
Q = np.zeros((5, 5))
Q[:2, :2] = Q[2:4, 2:4] = 0.1 * np.array([[1 / 3, 1 / 2], [1 / 2, 1]])
Q[4, 4] = 1.75e-4
R = np.diag([100.0, 1e-5])
RUNS = 300


def matrix(w):
    """The paper's transition matrix for T = 1 s (Arasaratnam and Haykin, 2009, section VI)."""
    s, c = np.sin(w), np.cos(w)
    return np.array([[1, s / w, 0, -(1 - c) / w, 0], [0, c, 0, -s, 0], [0, (1 - c) / w, 1, s / w, 0], [0, s, 0, c, 0],
                     [0, 0, 0, 0, 1]])  # fmt: skip


@pytest.fixture(scope="module")
def truth():
    """A few hundred runs."""
    return CASE.simulate(RUNS, seed=3)


def test_motion_is_the_papers(truth):
    states = truth.x[::9, :, 0]
    assert np.abs(states[:, 4]).min() > 1e-3
    np.testing.assert_allclose(MODEL.dynamics.mean(states.T, 1).T, [matrix(s[4]) @ s for s in states], rtol=1e-12, atol=1e-9)


def test_slow_turns_and_none_at_all_are_exact():
    a = np.concatenate([[0.0], np.logspace(-12, 1, 400)])
    for sign in (1, -1):
        np.testing.assert_allclose(sinc(sign * a), np.sinc(a / np.pi), rtol=1e-14, atol=1e-15)
    straight = np.array([10.0, 3.0, 20.0, -4.0, 0.0])[:, None]
    np.testing.assert_array_equal(MODEL.dynamics.mean(straight, 1)[:, 0], [13, 3, 16, -4, 0])
    # To first order in the rate the velocity turns by it, and the place by half of that.
    slope = MODEL.dynamics.jacobian(straight, 1)[..., 0]
    np.testing.assert_allclose(slope[:, 4], [2.0, 4.0, 1.5, 3.0, 1.0], rtol=1e-14)
    np.testing.assert_allclose(slope[:, :4], np.vstack([np.kron(np.eye(2), [[1, 1], [0, 1]]), np.zeros(4)]), atol=1e-15)


def test_a_steady_turn_closes_its_circle():
    """At 3°/s the aircraft is back after 120 s, at the same speed all along, after a circle to the right."""
    x = start = np.array([1000.0, 300.0, 1000.0, 0.0, -np.deg2rad(3.0)])[:, None]
    path = []
    for k in range(1, 121):
        x = MODEL.dynamics.mean(x, k)
        path.append(x[:, 0])
    np.testing.assert_allclose(x, start, rtol=1e-11, atol=1e-7)
    path = np.array(path)
    np.testing.assert_allclose(np.hypot(path[:, 1], path[:, 3]), 300, rtol=1e-12)
    radius = 300 / np.deg2rad(3.0)
    np.testing.assert_allclose(np.hypot(path[:, 0] - 1000, path[:, 2] - (1000 - radius)), radius, rtol=1e-11)


def test_jacobians_are_those_of_differences(truth):
    x = truth.x[::9, :, 1].T
    for law in (MODEL.dynamics, MODEL.sensor):
        found = law.jacobian(x, 1)
        for i, d in enumerate((1e-2, 1e-3, 1e-2, 1e-3, 1e-6)):
            shift = np.zeros((5, 1))
            shift[i] = d
            difference = law.residual(law.mean(x + shift, 1), law.mean(x - shift, 1)) / (2 * d)
            np.testing.assert_allclose(found[:, i], difference, rtol=1e-5, atol=1e-7)
    assert gaussian.differentiable(MODEL) is None


def test_noises_and_prior_are_the_stated_ones():
    np.testing.assert_allclose(MODEL.dynamics.noise.cov, Q)
    np.testing.assert_allclose(MODEL.sensor.noise.cov, R)
    assert MODEL.sensor.angles == (1,)
    np.testing.assert_allclose(MODEL.prior.mean, [1000, 300, 1000, 0, -3 * np.pi / 180])
    np.testing.assert_allclose(MODEL.prior.cov, np.diag([100, 10, 100, 10, 1e-4]))
    assert (CASE.steps, CASE.interval) == (100, 1.0)


def test_simulated_noises_are_those_of_the_model(truth):
    # 29 700 process and 30 000 measurement noises: 5 + 2 means and 15 + 3 covariances within 5 standard errors, and those
    # with the step before, 25 + 4: a false alarm has probability below 4e-5.
    x = np.moveaxis(truth.x, 1, 0)
    ahead = np.stack([matrix(w) @ s for s, w in zip(x[:, :-1].reshape(5, -1).T, x[4, :-1].ravel(), strict=True)])
    w = x[:, 1:] - ahead.T.reshape(5, 99, RUNS)
    place = x[0] + 1j * x[2]
    v = np.moveaxis(truth.y, 1, 0) - np.stack([np.abs(place), np.angle(place)])
    v[1] = np.angle(np.exp(1j * v[1]))
    for noise, cov in ((w, Q), (v, R)):
        flat, power = noise.reshape(len(cov), -1), np.outer(np.diag(cov), np.diag(cov))
        count = flat.shape[1]
        assert (np.abs(flat.mean(1)) < 5 * np.sqrt(np.diag(cov) / count)).all()
        assert (np.abs(flat @ flat.T / count - cov) < 5 * np.sqrt((power + cov**2) / count)).all()
        lagged = np.einsum("itr,jtr->ij", noise[:, 1:], noise[:, :-1]) / count
        assert (np.abs(lagged) < 5 * np.sqrt(power / count)).all()


def test_first_states_follow_the_prior(truth):
    # To first order x_1 is N(f(m0), F P0 F' + Q), good to a thousandth here; 5 + 5 figures within 5 standard errors of 300
    # runs: below 1e-5. F is by differences.
    mean, cov = MODEL.prior.mean, MODEL.prior.cov
    steps = np.sqrt(np.diag(cov)) * np.eye(5) * 1e-3
    F = np.stack([(matrix((mean + d)[4]) @ (mean + d) - matrix((mean - d)[4]) @ (mean - d)) / (2 * d.sum()) for d in steps], 1)
    variance = np.diag(F @ cov @ F.T + Q)
    x = truth.x[0]
    assert (np.abs(x.mean(1) - matrix(mean[4]) @ mean) < 5 * np.sqrt(variance / RUNS)).all()
    assert (np.abs(x.var(1) - variance) < 5 * variance * np.sqrt(2 / RUNS)).all()


def test_a_good_filter_does_not_diverge(truth):
    estimate = CUBATURE[0].run(MODEL, truth.y, 1)
    error = np.sqrt(((estimate.mean - truth.x)[:, [0, 2]] ** 2).sum(1))
    assert estimate.ok.all()
    assert (error > CASE.divergence.limit).sum(0).max() < CASE.divergence.steps
