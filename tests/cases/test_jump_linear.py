"""The jump-linear case is the stated one, and its optimal filter is the sum over all sequences of modes."""

import numpy as np

from cases import CASES
from cases.jump_linear import INITIAL, TRANSITION

CASE = CASES["jump-linear"]


def test_model_is_the_stated_one():
    np.testing.assert_array_equal(CASE.model.transition, [[0.9, 0.1], [0.3, 0.7]])
    np.testing.assert_array_equal(CASE.model.initial, [0.9, 0.1])
    for mode, sigma in zip(CASE.model.modes, (0.2, 5.0), strict=True):
        np.testing.assert_array_equal(mode.dynamics.mean.matrix(1), [[1, 1], [0, 1]])
        np.testing.assert_allclose(mode.dynamics.noise_cov(1), sigma**2 * np.array([[0.25, 0.5], [0.5, 1.0]]), rtol=1e-15)
        np.testing.assert_array_equal(mode.sensor.mean.matrix(1), [[1, 0]])
        np.testing.assert_array_equal(mode.sensor.noise.cov, [[4.0]])


def test_truth_follows_the_model():
    # 2000 runs: transitions of modes, accelerations by mode and measurement errors, each within 5 standard errors of its
    # expectation: 7 figures, false alarm below 1e-5.
    truth = CASE.simulate(2000, seed=3)
    ahead = np.array([INITIAL @ np.linalg.matrix_power(TRANSITION, k) for k in range(1, CASE.steps + 1)])[:, 1]
    for k in (0, 5, 11):
        p = ahead[k]
        assert abs((truth.mode[k] == 1).mean() - p) < 5 * np.sqrt(p * (1 - p) / 2000)
    acceleration = np.diff(truth.x[:, 1], axis=0)
    for mode, sigma in ((0, 0.2), (1, 5.0)):
        own = acceleration[truth.mode[1:] == mode]
        assert abs((own**2).mean() - sigma**2) < 5 * sigma**2 * np.sqrt(2 / own.size)
    error = truth.y[:, 0] - truth.x[:, 0]
    assert abs((error**2).mean() - 4) < 5 * 4 * np.sqrt(2 / error.size)
    np.testing.assert_allclose(np.diff(truth.x[:, 0], axis=0), truth.x[:-1, 1] + acceleration / 2, rtol=1e-9, atol=1e-9)
