"""Bearings from two sensors: the toolbox's track and model recoded, and its figures."""

import numpy as np
import pytest
from scipy.linalg import expm

from cases.two_sensor_bearings import CASES
from estimators.ckf import Cubature
from estimators.ekf import Extended
from estimators.ukf import Unscented

(CASE,) = CASES
MODEL = CASE.model
SENSORS = np.array([[-1.0, -2.0], [1, 1]])
TURNING = np.isin(np.arange(1, 501), [*range(50, 101), *range(200, 251), *range(350, 401)])
RUNS = 60


def looked(x):
    away = x[:, None, :2] - SENSORS
    return np.angle(away[..., 0] + 1j * away[..., 1])


@pytest.fixture(scope="module")
def truth():
    """Some runs."""
    return CASE.simulate(RUNS, seed=3)


@pytest.fixture(scope="module")
def rates(truth):
    """Rates of turn [T, R] in rad/s, clockwise, from the simulated velocities."""
    v = truth.x[:, 2] + 1j * truth.x[:, 3]
    return -np.angle(v / np.concatenate([np.ones((1, RUNS)), v[:-1]])) / 0.01


def test_model_is_the_stated_one():
    x = np.random.default_rng(1).standard_normal((4, 50))
    steady = np.block([[np.eye(2), 0.01 * np.eye(2)], [np.zeros((2, 2)), np.eye(2)]])
    white = 0.1 * np.kron([[0.01**3 / 3, 0.01**2 / 2], [0.01**2 / 2, 0.01]], np.eye(2))
    np.testing.assert_allclose(MODEL.dynamics.mean(x, 1), steady @ x, rtol=1e-12)
    np.testing.assert_allclose(MODEL.dynamics.noise_cov(1), white, rtol=1e-12)
    np.testing.assert_array_equal(MODEL.prior.mean, np.zeros(4))
    np.testing.assert_array_equal(MODEL.prior.cov, 4 * np.eye(4))
    np.testing.assert_allclose(MODEL.sensor.mean(x, 1).T, looked(x.T), atol=1e-14)
    np.testing.assert_allclose(MODEL.sensor.noise.cov, 0.0025 * np.eye(2), rtol=1e-12)
    assert (MODEL.sensor.angles, MODEL.linear, CASE.steps, CASE.interval) == ((0, 1), (2, 3), 500, 0.01)
    assert CASE.landmarks == (("sensor 1", -1, -2), ("sensor 2", 1, 1))


def test_sensors_are_differentiated_right(truth):
    x = truth.x[::25, :, 0]
    found = MODEL.sensor.jacobian(x.T, 1)
    for i in range(4):
        shift = 1e-6 * np.eye(4)[i]
        difference = np.angle(np.exp(1j * (looked(x + shift) - looked(x - shift)))) / 2e-6
        np.testing.assert_allclose(found[:, i].T, difference, atol=1e-8)


def test_the_track_is_the_solution_of_its_differential_equation(truth, rates):
    """d(vx, vy)/dt = a (vy, -vx): what the toolbox integrates by a matrix exponential, at the rates that were drawn."""
    x = np.array([0.0, 0, 1, 0])
    for k, a in enumerate(rates[:, 5]):
        x = expm(0.01 * np.array([[0, 0, 1, 0], [0, 0, 0, 1], [0, 0, 0, a], [0, 0, -a, 0]])) @ x
        np.testing.assert_allclose(truth.x[k, :, 5], x, atol=1e-10)


def test_turns_are_of_a_right_angle_with_noise(rates):
    # 9180 rates of turns: mean, variance and correlation from step to step within 5.5 standard errors: below 2e-7.
    np.testing.assert_allclose(rates[~TURNING], 0, atol=1e-10)
    scaled = (rates[TURNING] - np.pi / 2 / 51 / 0.01) / 0.01
    assert abs(scaled.mean()) < 5.5 / np.sqrt(scaled.size)
    assert abs((scaled**2).mean() - 1) < 5.5 * np.sqrt(2 / scaled.size)
    assert abs((scaled[1:] * scaled[:-1]).mean()) < 5.5 / np.sqrt(scaled[1:].size)


def test_bearings_are_measured_with_the_stated_error(truth):
    # 30 000 errors a sensor: 2 means, 2 variances, 1 covariance within 5.5 standard errors: below 2e-7.
    flat = np.moveaxis(truth.x, 1, 2).reshape(-1, 4)
    error = np.angle(np.exp(1j * (np.moveaxis(truth.y, 1, 2).reshape(-1, 2) - looked(flat)))) / 0.05
    assert (np.abs(error.mean(0)) < 5.5 / np.sqrt(len(error))).all()
    assert (np.abs(error.T @ error / len(error) - np.eye(2)) < 5.5 * np.sqrt((1 + np.eye(2)) / len(error))).all()


def test_the_target_keeps_clear_of_the_sensors(truth):
    """A bearing has no derivative at a sensor; the target stays half a unit away, and its speed is 1 throughout."""
    away = np.abs((truth.x[:, 0] + 1j * truth.x[:, 1])[..., None] - (SENSORS @ [1, 1j]))
    assert away.min() > 0.5
    np.testing.assert_allclose(np.hypot(truth.x[:, 2], truth.x[:, 3]), 1, rtol=1e-12)


PRINTED = {("ekf", 1000): 0.114, ("ekf", 100): 0.106, ("ukf", 0): 0.113, ("ckf", 0): 0.108}


def test_published_figures_are_the_printed_ones():
    assert {(p.estimator, p.runs): p.value for p in CASE.published} == PRINTED
    assert {(p.metric, p.block) for p in CASE.published} == {("run-rmse", "position")}
    assert set(CASE.experiment.estimators) == {"ekf", "ukf", "ckf"}


@pytest.mark.parametrize("estimator", [Extended(), Unscented(), Cubature()], ids=lambda one: one.name)
def test_our_filters_come_near_the_figures(estimator, truth):
    # The mean over 60 runs within 5 % of the printed figures' mean and 5 standard errors: below 2e-6 for all three.
    estimate = estimator.run(MODEL, truth.y)
    error = ((estimate.mean - truth.x)[:, :2] ** 2).sum(1)
    run = np.sqrt(error.mean(0))
    printed = np.mean([value for (name, _), value in PRINTED.items() if name == estimator.name])
    assert abs(run.mean() - printed) < 0.05 * printed + 5 * run.std(ddof=1) / np.sqrt(RUNS)
    assert estimate.ok.all()
    assert (np.sqrt(error) > CASE.divergence.limit).sum(0).max() < CASE.divergence.steps
