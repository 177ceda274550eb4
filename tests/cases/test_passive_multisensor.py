"""The passive multi-sensor case is the stated one."""

import numpy as np
import pytest
from scipy.linalg import expm

from cases import passive_multisensor
from cases.passive_multisensor import CASES, OMEGA, START, STATIONS, T, turn


@pytest.mark.parametrize("rate", [OMEGA, -OMEGA, 0.3])
def test_a_turn_is_the_solution_of_its_differential_equation(rate):
    # The velocity rotates: d(vx, vy)/dt = rate (-vy, vx).
    generator = np.zeros((4, 4))
    generator[:2, 2:] = np.eye(2)
    generator[2:, 2:] = rate * np.array([[0, -1], [1, 0]])
    np.testing.assert_allclose(turn(rate), expm(generator * T), atol=1e-14)


def test_straight_flight_is_the_limit_of_a_turn():
    np.testing.assert_allclose(turn(1e-7), passive_multisensor.STRAIGHT, atol=1e-7)


def test_model_is_the_stated_one():
    for case, sigma in zip(CASES, (0.002, 0.005), strict=True):
        model = case.model
        np.testing.assert_array_equal(model.initial, [0.9, 0.05, 0.05])
        np.testing.assert_allclose(model.transition, [[0.9, 0.05, 0.05], [0.2, 0.795, 0.005], [0.2, 0.005, 0.795]])
        for mode in model.modes:
            np.testing.assert_allclose(mode.prior.cov, 1e-6 * np.diag([400, 400, 100, 100]), rtol=1e-12)
            np.testing.assert_array_equal(mode.prior.mean, START)
            lever = np.array([[0.5, 0], [0, 0.5], [1, 0], [0, 1]])
            np.testing.assert_allclose(mode.dynamics.noise_cov(1), 0.01**2 * lever @ lever.T, rtol=1e-12)
            np.testing.assert_allclose(mode.sensor.noise.cov, sigma**2 * np.eye(3), rtol=1e-12)


def test_bearings_are_counted_from_the_y_axis():
    z = passive_multisensor.bearings(np.array([[10.0], [20.0], [0.0], [0.0]]), 1)[:, 0]
    np.testing.assert_allclose(z[:2], [np.arctan(0.5), -np.arctan(0.5)], rtol=1e-14)
    assert len(STATIONS) == len(z)


def test_the_flight_turns_when_it_is_said_to():
    truth = CASES[0].simulate(3, seed=2)
    heading = np.unwrap(np.arctan2(truth.x[:, 3], truth.x[:, 2]), axis=0)
    turned = np.diff(heading, axis=0)
    expected = np.array([0.0, OMEGA, -OMEGA])[truth.mode[1:]]
    np.testing.assert_allclose(turned, expected, atol=1e-12)
    np.testing.assert_array_equal(np.flatnonzero(truth.mode[:, 0] == 1) + 1, range(31, 51))
    np.testing.assert_array_equal(np.flatnonzero(truth.mode[:, 0] == 2) + 1, range(71, 91))
    np.testing.assert_allclose(np.hypot(truth.x[:, 2], truth.x[:, 3]), np.hypot(*truth.x[0, 2:])[None].repeat(100, 0))
