"""The passive multi-sensor case is the stated one."""

import numpy as np
import pytest
from scipy.linalg import expm

from cases import passive_multisensor
from cases.passive_multisensor import CASES, OMEGA, T, turn
from estimators import ESTIMATORS
from suite.metrics import METRICS
from suite.parameters import label

TURNS = {1: range(31, 51), 2: range(71, 91)}


@pytest.mark.parametrize("rate", [OMEGA, -OMEGA, 0.3])
def test_a_turn_is_the_solution_of_its_differential_equation(rate):
    # The velocity rotates: d(vx, vy)/dt = rate (-vy, vx).
    generator = np.zeros((4, 4))
    generator[:2, 2:] = np.eye(2)
    generator[2:, 2:] = rate * np.array([[0, -1], [1, 0]])
    np.testing.assert_allclose(turn(rate), expm(generator * T), atol=1e-14)


def test_straight_flight_is_the_limit_of_a_turn():
    np.testing.assert_allclose(turn(1e-7), passive_multisensor.STRAIGHT, atol=1e-7)


@pytest.mark.parametrize(("case", "sigma"), [(CASES[0], 0.002), (CASES[1], 0.005)], ids=["2 mrad", "5 mrad"])
def test_model_is_the_stated_one(case, sigma):
    model, x = case.model, np.array([[4.0], [-3.0], [0.2], [0.1]])
    assert (case.steps, case.interval, case.divergence.limit) == (100, 1, 1)
    assert (model.names, model.nominal) == (("straight", "left turn", "right turn"), 0)
    np.testing.assert_array_equal(model.initial, [0.9, 0.05, 0.05])
    np.testing.assert_allclose(model.transition, [[0.9, 0.05, 0.05], [0.2, 0.795, 0.005], [0.2, 0.005, 0.795]])
    for mode, rate in zip(model.modes, (0, 0.1, -0.1), strict=True):
        np.testing.assert_allclose(mode.prior.cov, 1e-6 * np.diag([400, 400, 100, 100]), rtol=1e-12)
        np.testing.assert_array_equal(mode.prior.mean, [3, 6, 0.15, 0.05])
        lever = np.array([[0.5, 0], [0, 0.5], [1, 0], [0, 1]])
        np.testing.assert_allclose(mode.dynamics.noise_cov(1), 0.01**2 * lever @ lever.T, rtol=1e-12)
        np.testing.assert_allclose(mode.sensor.noise.cov, sigma**2 * np.eye(3), rtol=1e-12)
        assert (mode.sensor.angles, mode.linear) == ((0, 1, 2), (2, 3))
        # Stations at (0, 0), (20, 0) and (10, 20) km, and a target to the south of all: bearings over all quadrants.
        bearings = [np.arctan(3 / 4) + np.pi / 2, -np.arctan(3 / 16) - np.pi / 2, -np.pi + np.arctan(6 / 23)]
        np.testing.assert_allclose(mode.sensor.mean(x, 1)[:, 0], bearings, rtol=1e-12)
        velocity = np.exp(1j * rate) * (0.2 + 0.1j)
        np.testing.assert_allclose(mode.dynamics.mean(x, 1)[2:, 0], [velocity.real, velocity.imag], rtol=1e-12)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_landmarks_are_the_stations(case):
    assert case.landmarks == (("station 1", 0, 0), ("station 2", 20, 0), ("station 3", 10, 20))


@pytest.mark.parametrize(("case", "sigma"), [(CASES[0], 0.002), (CASES[1], 0.005)], ids=["2 mrad", "5 mrad"])
def test_truth_starts_from_the_prior_and_is_measured_with_the_stated_error(case, sigma):
    # 1000 runs: 4 means and 4 variances of the start, 3 means and 3 variances of 100 000 errors, within 5.5 standard errors in
    # each of 2 cases: false alarm below 2e-6.
    truth = case.simulate(1000, seed=4)
    x, y, vx, vy = truth.x[0]
    start = np.stack([x - vx, y - vy, vx, vy])
    scaled = (start - [[3], [6], [0.15], [0.05]]) / [[0.02], [0.02], [0.01], [0.01]]
    stations = np.array([[0.0, 0.0], [20.0, 0.0], [10.0, 20.0]])[:, :, None]
    bearings = np.arctan2(truth.x[:, None, 0] - stations[:, 0], truth.x[:, None, 1] - stations[:, 1])
    error = np.moveaxis(np.angle(np.exp(1j * (truth.y - bearings))) / sigma, 1, 0).reshape(3, -1)
    for sample in (*scaled, *error):
        assert abs(sample.mean()) < 5.5 / np.sqrt(sample.size)
        assert abs((sample**2).mean() - 1) < 5.5 * np.sqrt(2 / sample.size)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_the_flight_turns_when_it_is_said_to(case):
    truth = case.simulate(3, seed=2)
    heading = np.unwrap(np.arctan2(truth.x[:, 3], truth.x[:, 2]), axis=0)
    turned = np.diff(heading, axis=0)
    expected = np.array([0.0, 0.1, -0.1])[truth.mode[1:]]
    np.testing.assert_allclose(turned, expected, atol=1e-12)
    for mode, steps in TURNS.items():
        for modes in truth.mode.T:
            np.testing.assert_array_equal(np.flatnonzero(modes == mode) + 1, steps)
    np.testing.assert_allclose(np.hypot(truth.x[:, 2], truth.x[:, 3]), np.hypot(*truth.x[0, 2:])[None].repeat(100, 0))


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_the_flight_keeps_off_the_stations(case):
    """A bearing has no slope at its station; starts differ by some ten metres only, and 300 flights pass 2 km off at least."""
    x = case.simulate(300, seed=1).x
    for _, east, north in case.landmarks:
        assert np.hypot(x[:, 0] - east, x[:, 1] - north).min() > 2


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_what_the_paper_ran_can_be_run(case):
    for ran in case.experiment.estimators:
        assert label(ESTIMATORS[ran]) == ran
        assert ESTIMATORS[ran].accepts(case.model) is None
    assert {p.estimator for p in case.published} <= set(case.experiment.estimators)
    assert {p.metric for p in case.published} <= set(METRICS)
    assert {p.value for p in case.published} == {None}
