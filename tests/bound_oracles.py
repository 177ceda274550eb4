"""What the tests of Cramér-Rao bounds share: curved models, outages, one step of the Riccati recursion."""

import dataclasses

import numpy as np

from suite.model import AdditiveSensor, AdditiveTransition, StateSpaceModel
from suite.noise import Gaussian
from tests.jump_oracles import THREE, TWO


def near(actual, expected, tolerance=1e-10):
    np.testing.assert_allclose(actual, expected, rtol=tolerance, atol=tolerance * np.abs(expected).max())


def swing(gain=None):
    """Two states whose transition and sensor both curve; with a gain [2, 1] a single noise drives them."""
    cov = [[0.3, 0.1], [0.1, 0.4]] if gain is None else [[0.4]]
    return StateSpaceModel(
        Gaussian([0.5, -0.2], [[0.8, 0.3], [0.3, 0.6]]),
        AdditiveTransition(
            lambda x, k: np.stack([0.9 * x[0] + 0.5 * x[1], x[1] + 0.1 * k - 0.8 * np.sin(x[0])]), Gaussian.noise(cov), gain
        ),
        AdditiveSensor(
            lambda x, k: np.stack([x[0] + 0.3 * x[0] * x[1], np.sin(x[1]) * (1 + 0.2 * k)]),
            Gaussian.noise([[0.5, 0.2], [0.2, 0.7]]),
        ),
    )


def outages(steps, m, runs, seed=0):
    """Measurements of zero; some components are missing in some runs, one step in all."""
    y = np.zeros((steps, m, runs))
    y[np.random.default_rng(seed).random(y.shape) < 0.3] = np.nan
    y[2] = np.nan
    return y


def riccati(P, F, Q, H, R, y):
    """One step of the covariance of an extended Kalman filter with slopes F and H, and the rows observed in y[m]."""
    P, rows = F @ P @ F.T + Q, np.flatnonzero(~np.isnan(y))
    H, R = H[rows], R[np.ix_(rows, rows)]
    return P - P @ H.T @ np.linalg.solve(H @ P @ H.T + R, H @ P)


TURNING = dataclasses.replace(
    THREE,
    modes=tuple(
        dataclasses.replace(p, H=TWO.modes[0].H, R=TWO.modes[0].R, m0=np.ones(2) * i) for i, p in enumerate(THREE.modes)
    ),
    P=np.tile([0.5, 0.2, 0.3], (3, 1)),
)
"""Modes that differ in motion and prior, drawn anew at each step: r_k does not depend on x_{k-1}, as the fit takes it."""
