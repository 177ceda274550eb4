"""Ten thousand steps of Gaussian filters: covariances stay what they are where subtracting covariances loses them.

Independent systems stand side by side in one state, so that one run serves them all: a target seen by range and bearing; a
position that drifts, with a constant offset in its sensor; components some 1e10 apart in scale; a sensor 1e-6 as wide as the
prior; two constants whose sensors, as accurate, see nearly the same sum of them.
"""

import numpy as np
import pytest
from scipy.linalg import block_diag

from estimators.ekf import Extended
from estimators.ukf import Unscented
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian
from tests.oracles import Linear, range_bearing

STEPS, CHECKED = 10_000, 2000
AXIS = np.array([[1.0, 1.0], [0.0, 1.0]])
TARGET = range_bearing()


def linear(A, G, Q, H, R, P0):
    """A centred linear model."""
    A, G, H = np.array(A, float), np.array(G, float), np.array(H, float)
    n, m, q, zero = len(A), len(H), len(Q), np.zeros
    return Linear(A, zero(n), G, zero(q), np.diag(Q), H, zero(m), zero(m), np.diag(R), zero(n), np.diag(P0))


SYSTEMS = {
    "offset": linear(block_diag(AXIS, 1.0), [[0.5], [1.0], [0.0]], [1e-6], [[1, 0, 1]], [1e-2], [1e4, 1e2, 1e4]),
    "scales": linear(
        [[1, 1e6, 0], [0, 1, 0], [0, 0, 0.9]], np.eye(3), [1e4, 1e-10, 1e-16], [[1, 0, 1e10]], [1.0], [1e12, 1e-2, 1e-14]
    ),
    "sharp": linear(
        [[1, 1, 0.5], [0, 1, 1], [0, 0, 1]], [[1 / 6], [0.5], [1.0]], [1e-12], [[1, 0, 0]], [1e-12], [1.0, 1.0, 1.0]
    ),
    "constants": linear(np.eye(2), np.zeros((2, 1)), [1.0], [[1, 1], [1, 1 + 1e-4]], [1e-12, 1e-12], [1.0, 1.0]),
}
ROWS = block_diag(*(p.H for p in SYSTEMS.values()))


def look(x, k):
    return np.concatenate([np.sqrt(x[:1] ** 2 + x[2:3] ** 2), np.atan2(x[2:3], x[:1]), np.tensordot(ROWS, x[4:], 1)])


def look_slope(x, k):
    out, r = np.zeros((2 + len(ROWS), *x.shape)), np.sqrt(x[0] ** 2 + x[2] ** 2)
    out[0, [0, 2]] = x[[0, 2]] / r
    out[1, 0], out[1, 2] = -x[2] / r**2, x[0] / r**2
    out[2:, 4:] = ROWS[:, :, None]
    return out


def side_by_side():
    """The model of the target and all systems."""

    def joined(first, name):
        return block_diag(first, *(getattr(p, name) for p in SYSTEMS.values()))

    target, sensor = TARGET.dynamics, TARGET.sensor
    return StateSpaceModel(
        Gaussian(np.concatenate([TARGET.prior.mean, np.zeros(ROWS.shape[1])]), joined(TARGET.prior.cov, "P0")),
        AdditiveTransition(
            Affine(joined(target.mean.matrix(1), "A")), Gaussian.noise(joined(target.noise.cov, "Q")), joined(np.eye(4), "G")
        ),
        AdditiveSensor(look, Gaussian.noise(joined(sensor.noise.cov, "R")), (1,), look_slope),
    )


def simulated(model, steps):
    """States [T, n] and measurements [T, m, 1] of the model."""
    rng = np.random.default_rng(3)

    def drawn(noise, count):
        return rng.standard_normal((count, len(noise.mean))) @ np.linalg.cholesky(noise.cov).T

    A, pushes = model.dynamics.mean.matrix(1), drawn(model.dynamics.noise, steps) @ model.dynamics.gain.T
    x, states = model.prior.mean + drawn(model.prior, 1)[0], []
    for push in pushes:
        x = A @ x + push
        states.append(x)
    y = model.sensor.mean(np.transpose(states), 1).T + drawn(model.sensor.noise, steps)
    return np.array(states), y[:, :, None]


def covariances(p, steps, dtype, joseph):
    """Covariances [T, n, n] by Joseph's form, or by P - K S K', in a given precision."""
    A, G, Q, H, R, P = (part.astype(dtype) for part in (p.A, p.G, p.Q, p.H, p.R, p.P0))
    identity, found = np.eye(len(A), dtype=dtype), []
    for _ in range(steps):
        P = A @ P @ A.T + G @ Q @ G.T
        S = H @ P @ H.T + R
        cofactors = np.array([[S[1, 1], -S[0, 1]], [-S[1, 0], S[0, 0]]]) if len(S) == 2 else np.ones((1, 1), dtype)
        K = P @ H.T @ cofactors / (S @ cofactors)[0, 0]
        rest = identity - K @ H
        P = rest @ P @ rest.T + K @ R @ K.T if joseph else P - K @ S @ K.T
        found.append(P)
    return np.array(found)


def correlations(covs):
    """Covariances [T, n, n] in units of their own standard deviations."""
    scale = np.sqrt(np.abs(np.diagonal(covs, axis1=1, axis2=2)))
    return covs / (scale[:, :, None] * scale[:, None])


def relative_error(covs, exact):
    scale = np.sqrt(np.diagonal(exact, axis1=1, axis2=2))
    return float(np.abs((covs - exact) / (scale[:, :, None] * scale[:, None])).max())


@pytest.fixture(scope="module")
def exact():
    """Covariances of the linear systems in extended precision, by Joseph's form."""
    if np.finfo(np.longdouble).eps > 1e-18:
        pytest.skip("no extended precision here")
    return {name: covariances(p, CHECKED, np.longdouble, joseph=True) for name, p in SYSTEMS.items()}


@pytest.mark.parametrize(("filter", "steps", "tolerance"), [(Extended(), STEPS, 1e-6), (Unscented(), CHECKED, 1e-3)], ids=repr)
def test_covariances_stay_symmetric_positive_and_right(exact, filter, steps, tolerance):
    """Sigma points lie on both sides of the mean, and lose the digits by which the mean is larger than they are far apart."""
    model = side_by_side()
    states, y = simulated(model, steps)
    found = filter.run(model, y)
    assert found.ok.all()
    # Nowhere is the target further off than 6 times what the sensor alone would say, 5 m in range and 0.02 rad across it.
    miss, away = (np.sqrt((part[:, [0, 2]] ** 2).sum(1)) for part in (found.mean[..., 0] - states, states))
    assert (miss < 6 * (5 + 0.02 * away)).all()
    covs = found.cov[..., 0]
    at = TARGET.n
    np.testing.assert_allclose(correlations(covs), correlations(np.swapaxes(covs, 1, 2)), atol=1e-14)
    assert np.linalg.eigvalsh(correlations(covs)).min() > -1e-13
    for name, p in SYSTEMS.items():
        n = len(p.A)
        own = covs[:, at : at + n, at : at + n]
        assert np.linalg.eigvalsh(correlations(own)).min() > -1e-14, name
        assert relative_error(own[:CHECKED], exact[name]) < tolerance, name
        at += n


def test_subtracting_covariances_would_lose_them(exact):
    """What the filters above are spared: the two constants by P - K S K'."""
    covs = covariances(SYSTEMS["constants"], CHECKED, float, joseph=False)
    covs = (covs + np.swapaxes(covs, 1, 2)) / 2
    assert np.linalg.eigvalsh(correlations(covs)).min() < -0.1
    assert relative_error(covs, exact["constants"]) > 1
