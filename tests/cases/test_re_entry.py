"""Re-entry in the plane: the toolbox's equations recoded, Jacobians worked out by hand, and what is simulated."""

import numpy as np
import pytest

from cases.re_entry import CASES
from estimators.ukf import ESTIMATORS as UNSCENTED
from suite import gaussian

(CASE,) = CASES
MODEL = CASE.model
B0, H0, GM, R0, DT = -0.59783, 13.406, 3.9860e5, 6374.0, 0.1
RUNS = 6


def parts(s):
    """Radius, speed, drag and gravity of one state."""
    R, V = np.linalg.norm(s[:2]), np.linalg.norm(s[2:4])
    return R, V, B0 * np.exp(s[4]) * np.exp((R0 - R) / H0) * V, -GM / R**3


def successor(s):
    _, _, D, G = parts(s)
    return s + DT * np.concatenate([s[2:4], D * s[2:4] + G * s[:2], [0.0]])


def slope(s):
    """Derivative of `successor`, as worked out by hand."""
    R, V, D, G = parts(s)
    x, v = s[:2], s[2:4]
    df = np.zeros((5, 5))
    df[:2, 2:4] = np.eye(2)
    df[2:4, :2] = np.outer(v, -D / H0 * x / R) + G * np.eye(2) - 3 * G * np.outer(x, x) / R**2
    df[2:4, 2:4] = D * np.eye(2) + D * np.outer(v, v) / V**2
    df[2:4, 4] = D * v
    return np.eye(5) + DT * df


@pytest.fixture(scope="module")
def truth():
    """Half a dozen runs, k = 1 to 2000."""
    return CASE.simulate(RUNS, seed=3)


def test_motion_is_the_toolboxs(truth):
    states = truth.x[::97, :, 0]
    np.testing.assert_allclose(MODEL.dynamics.mean(states.T, 1).T, [successor(s) for s in states], rtol=1e-14)
    found = MODEL.dynamics.jacobian(states.T, 1)
    np.testing.assert_allclose(np.moveaxis(found, -1, 0), [slope(s) for s in states], rtol=1e-10, atol=1e-15)
    assert gaussian.differentiable(MODEL) is None


def test_measurements_are_range_and_bearing_from_the_ground(truth):
    states = truth.x[::97, :, 1]
    place = states[:, 0] - R0 + 1j * states[:, 1]
    np.testing.assert_allclose(MODEL.sensor.mean(states.T, 1), [np.abs(place), np.angle(place)], rtol=1e-13)
    x, y, r = place.real, place.imag, np.abs(place)
    zero = np.zeros((3, len(x)))
    expected = np.stack([np.vstack([[x / r, y / r], zero]), np.vstack([[-y / r**2, x / r**2], zero])])
    np.testing.assert_allclose(MODEL.sensor.jacobian(states.T, 1), expected, rtol=1e-12)
    assert MODEL.sensor.angles == (1,)


def test_noises_and_prior_are_the_toolboxs():
    np.testing.assert_allclose(MODEL.dynamics.noise_cov(1), np.diag([0, 0, 2.4064e-5, 2.4064e-5, 1e-6]))
    np.testing.assert_allclose(MODEL.sensor.noise.cov, np.diag([1e-6, 0.17e-3**2]))
    np.testing.assert_array_equal(MODEL.prior.mean, [6500.4, 349.14, -1.8093, -6.7967, 0])
    np.testing.assert_allclose(MODEL.prior.cov, np.diag([1e-6, 1e-6, 1e-6, 1e-6, 1]))
    assert (CASE.steps, CASE.interval) == (2000, 0.1)


def test_truth_follows_the_toolboxs_program(truth):
    # 6 · 1999 noises on each velocity and 12 000 on each measurement: 4 means, 4 variances, 2 + 4 correlations of 5 standard
    # errors: below 1e-5. Positions, and x5, have none.
    x = np.moveaxis(truth.x, 1, 0)
    np.testing.assert_array_equal(x[4], 0.6932)
    ahead = np.stack([successor(s) for s in x[:, :-1].reshape(5, -1).T]).T.reshape(5, 1999, RUNS)
    w = x[:, 1:] - ahead
    assert np.abs(w[:2]).max() < 1e-11
    place = x[0] - R0 + 1j * x[1]
    v = np.moveaxis(truth.y, 1, 0) - np.stack([np.abs(place), np.angle(place)])
    for noise, deviations in ((w[2:4], np.sqrt([2.4064e-5] * 2)), (v, np.array([1e-3, 0.17e-3]))):
        white = noise / deviations[:, None, None]
        count = white[0].size
        assert (np.abs(white.mean((1, 2))) < 5 / np.sqrt(count)).all()
        assert (np.abs((white**2).mean((1, 2)) - 1) < 5 * np.sqrt(2 / count)).all()
        assert abs((white[0] * white[1]).mean()) < 5 / np.sqrt(count)
        assert (np.abs((white[:, 1:] * white[:, :-1]).mean((1, 2))) < 5 / np.sqrt(count)).all()


def test_first_states_follow_the_stated_start(truth):
    # x_1 is N(f(m0), F P0 F' + Q) to a millionth: 4 means and 4 variances of 6 runs, whose sum of squares is chi-square with
    # 6 degrees of freedom, above 55 with probability 5e-10 and below 0.01 with 2e-8; means within 6 standard errors: 1e-8.
    start = np.array([6500.4, 349.14, -1.8093, -6.7967, 0.6932])
    F = slope(start)
    variance = np.diag(F @ np.diag([1e-6, 1e-6, 1e-6, 1e-6, 0]) @ F.T + np.diag([0, 0, 2.4064e-5, 2.4064e-5, 0]))[:4]
    white = (truth.x[0, :4] - successor(start)[:4, None]) / np.sqrt(variance)[:, None]
    assert (np.abs(white.mean(1)) < 6 / np.sqrt(RUNS)).all()
    assert ((white**2).sum(1) < 55).all()
    assert ((white**2).sum(1) > 0.01).all()


def test_the_vehicle_comes_down_and_slows(truth):
    height = np.sqrt(truth.x[:, 0] ** 2 + truth.x[:, 1] ** 2) - R0
    speed = np.sqrt(truth.x[:, 2] ** 2 + truth.x[:, 3] ** 2)
    assert (height[0] > 135).all()
    assert ((height[-1] > 0) & (height[-1] < 30)).all()
    assert (speed[0] > 7).all()
    assert (speed[-1] < 1).all()


def test_a_good_filter_does_not_diverge(truth):
    estimate = UNSCENTED[0].run(MODEL, truth.y, 1)
    error = np.sqrt(((estimate.mean - truth.x)[:, :2] ** 2).sum(1))
    assert estimate.ok.all()
    assert (error > CASE.divergence.limit).sum(0).max() < CASE.divergence.steps
    assert (np.abs(estimate.mean[-1, 4] - 0.6932) < 6 * np.sqrt(estimate.cov[-1, 4, 4])).all()  # drag has shown itself
