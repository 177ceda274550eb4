"""The jump-linear case is the stated one."""

import numpy as np

from cases import CASES
from tests.jump_oracles import JumpLinear, enumeration
from tests.oracles import Linear

CASE = CASES["jump-linear"]
INITIAL, TRANSITION = np.array([0.9, 0.1]), np.array([[0.9, 0.1], [0.3, 0.7]])


def test_model_is_the_stated_one():
    assert (CASE.steps, CASE.interval, CASE.divergence.limit) == (12, 1, 12)
    assert (CASE.model.names, CASE.model.nominal) == (("straight", "manoeuvre"), 0)
    np.testing.assert_array_equal(CASE.model.transition, TRANSITION)
    np.testing.assert_array_equal(CASE.model.initial, INITIAL)
    for mode, sigma in zip(CASE.model.modes, (0.2, 5.0), strict=True):
        np.testing.assert_array_equal(mode.prior.mean, [0, 10])
        np.testing.assert_array_equal(mode.prior.cov, [[25, 0], [0, 4]])
        np.testing.assert_array_equal(mode.dynamics.mean.matrix(1), [[1, 1], [0, 1]])
        np.testing.assert_allclose(mode.dynamics.noise_cov(1), sigma**2 * np.array([[0.25, 0.5], [0.5, 1.0]]), rtol=1e-15)
        np.testing.assert_array_equal(mode.sensor.mean.matrix(1), [[1, 0]])
        np.testing.assert_array_equal(mode.sensor.noise.cov, [[4.0]])


def test_truth_follows_the_model():
    # 2000 runs: probabilities and transitions of modes, the first state, accelerations by mode and measurement errors, each
    # within 5.5 standard errors of its expectation: 12 figures, false alarm below 1e-5.
    truth = CASE.simulate(2000, seed=3)
    ahead = np.array([INITIAL @ np.linalg.matrix_power(TRANSITION, k) for k in range(1, CASE.steps + 1)])[:, 1]
    for k in (0, 5, 11):
        p = ahead[k]
        assert abs((truth.mode[k] == 1).mean() - p) < 5.5 * np.sqrt(p * (1 - p) / 2000)
    for mode in (0, 1):
        followers, p = truth.mode[1:][truth.mode[:-1] == mode], TRANSITION[mode, 1]
        assert abs((followers == 1).mean() - p) < 5.5 * np.sqrt(p * (1 - p) / followers.size)
    first = truth.x[0][:, truth.mode[0] == 0]
    for component, mean, variance in zip(first, (10, 10), (25 + 4 + 0.2**2 / 4, 4 + 0.2**2), strict=True):
        assert abs(component.mean() - mean) < 5.5 * np.sqrt(variance / component.size)
        assert abs(((component - mean) ** 2).mean() - variance) < 5.5 * variance * np.sqrt(2 / component.size)
    acceleration = np.diff(truth.x[:, 1], axis=0)
    for mode, sigma in ((0, 0.2), (1, 5.0)):
        own = acceleration[truth.mode[1:] == mode]
        assert abs((own**2).mean() - sigma**2) < 5.5 * sigma**2 * np.sqrt(2 / own.size)
    error = truth.y[:, 0] - truth.x[:, 0]
    assert abs((error**2).mean() - 4) < 5.5 * 4 * np.sqrt(2 / error.size)
    np.testing.assert_allclose(np.diff(truth.x[:, 0], axis=0), truth.x[:-1, 1] + acceleration / 2, rtol=1e-9, atol=1e-9)


def test_the_optimal_filter_errs_by_about_1_6_m():
    # What the divergence limit is chosen by: the deviation of the exact posterior, which varies little from run to run.
    zero, move = np.zeros(1), {"A": np.array([[1.0, 1.0], [0.0, 1.0]]), "G": np.array([[0.5], [1.0]])}
    seen = {"H": np.array([[1.0, 0.0]]), "h": zero, "v": zero, "R": np.array([[4.0]])}
    start = {"m0": np.array([0.0, 10.0]), "P0": np.diag([25.0, 4.0]), "a": np.zeros(2), "w": zero}
    modes = tuple(Linear(**move, **seen, **start, Q=np.array([[sigma**2]])) for sigma in (0.2, 5.0))
    exact = enumeration(JumpLinear(modes, TRANSITION, INITIAL), CASE.simulate(10, seed=1).y)
    np.testing.assert_allclose(np.sqrt(exact.cov[:, 0, 0].mean()), 1.65, atol=0.1)
