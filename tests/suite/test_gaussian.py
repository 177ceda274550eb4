"""Moment rules and the update they share, against formulas and plain numbers."""

import numpy as np
import pytest

from suite.gaussian import GaussianBelief, affine, prior, unscented, update
from suite.model import AdditiveSensor, Affine
from suite.noise import Gaussian
from tests.oracles import random_linear

SPREADS = [(1.0, 2.0, 0.0), (0.5, 0.0, 1.0), (1e-2, 2.0, 0.0), (1.0, 0.0, 3.0)]


def beliefs(runs=3, n=3, seed=0, rank=None):
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((runs, n, rank or n))
    return rng.standard_normal((runs, n)), root @ np.swapaxes(root, 1, 2)


@pytest.mark.parametrize("rank", [1, 2, 3])
@pytest.mark.parametrize("spread", SPREADS, ids=str)
def test_rules_are_exact_for_affine_functions(spread, rank):
    mean, cov = beliefs(rank=rank)
    matrix, offset = np.random.default_rng(1).standard_normal((2, 3)), np.array([1.0, -2.0])
    function = Affine(matrix, offset)
    for rule in (affine, unscented(3, *spread)):
        value, square, cross = rule(mean, cov, function, 1, np.subtract)
        np.testing.assert_allclose(value, mean @ matrix.T + offset, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(square, matrix @ cov @ matrix.T, rtol=1e-7, atol=1e-8)
        np.testing.assert_allclose(cross, cov @ matrix.T, rtol=1e-7, atol=1e-8)


def plain_unscented(mean, cov, function, alpha, beta, kappa):
    """The scaled unscented transform of one Gaussian as its paper writes it, with lambda and two sets of weights."""
    n = len(mean)
    lam = alpha**2 * (n + kappa) - n
    root = np.linalg.cholesky((n + lam) * cov)
    points = [mean, *(mean + root[:, i] for i in range(n)), *(mean - root[:, i] for i in range(n))]
    wm = [lam / (n + lam)] + [0.5 / (n + lam)] * (2 * n)
    wc = [lam / (n + lam) + 1 - alpha**2 + beta, *wm[1:]]
    values = [function(p) for p in points]
    value = sum(w * v for w, v in zip(wm, values, strict=True))
    square = sum(w * np.outer(v - value, v - value) for w, v in zip(wc, values, strict=True))
    cross = sum(w * np.outer(p - mean, v - value) for w, p, v in zip(wc, points, values, strict=True))
    return value, square, cross


@pytest.mark.parametrize("spread", [SPREADS[0], SPREADS[1], SPREADS[3]], ids=str)
def test_unscented_rule_equals_the_textbook(spread):
    mean, cov = beliefs(seed=2)
    function = lambda x, k: np.stack([x[0] * x[1], np.sin(x[2]) + k, x[0] ** 2, np.exp(0.3 * x[1])])  # noqa: E731
    found = unscented(3, *spread)(mean, cov, function, 2, np.subtract)
    for r in range(3):
        expected = plain_unscented(mean[r], cov[r], lambda x: function(x, 2), *spread)
        for a, b in zip(found, expected, strict=True):
            np.testing.assert_allclose(a[r], b, rtol=1e-10, atol=1e-10)


def test_unscented_moments_of_an_angle_near_pi():
    # The angle is the state itself, wrapped: N(pi - 0.01, 0.1²) has that mean, whatever branch its points fall on.
    sensor = AdditiveSensor(lambda x, k: np.angle(np.exp(1j * x)), Gaussian.diagonal([1.0]), angles=(0,))
    value, square, cross = unscented(1, 1.0, 2.0, 2.0)(
        np.array([[np.pi - 0.01]]), np.array([[[0.01]]]), sensor.mean, 1, sensor.residual
    )
    np.testing.assert_allclose(np.exp(1j * value), np.exp(1j * (np.pi - 0.01)), rtol=1e-12)
    np.testing.assert_allclose(square, 0.01, rtol=1e-10)
    np.testing.assert_allclose(cross, 0.01, rtol=1e-10)


def test_a_bad_covariance_harms_its_own_run():
    problem = random_linear(3, 3, 2, 3)
    mean, cov = beliefs()
    y = np.random.default_rng(4).standard_normal((2, 3))
    clean = update(affine, GaussianBelief(mean, cov), problem.model.sensor, y, 1)
    broken = cov.copy()
    broken[1] = -1e6 * np.eye(3)
    found = update(affine, GaussianBelief(mean, broken), problem.model.sensor, y, 1)
    assert np.isnan(found.mean[1]).all()
    for r in (0, 2):
        np.testing.assert_array_equal(found.mean[r], clean.mean[r])
        np.testing.assert_array_equal(found.cov[r], clean.cov[r])


def test_prior_is_the_models_once_a_run():
    model = random_linear(3, 3, 2, 3).model
    belief = prior(model, 4)
    for r in range(4):
        np.testing.assert_array_equal(belief.mean[r], model.prior.mean)
        np.testing.assert_array_equal(belief.cov[r], model.prior.cov)
    belief.mean[0] = 7
    assert not (model.prior.mean == 7).any()


def test_readout_is_components_first():
    mean, cov = beliefs()
    readout = GaussianBelief(mean, cov).read()
    np.testing.assert_array_equal(readout.mean[:, 1], mean[1])
    np.testing.assert_array_equal(readout.cov[..., 1], cov[1])
