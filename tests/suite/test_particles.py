"""Weighted particles: normalisation without overflow, moments against numpy, effective sample size."""

import numpy as np
import pytest
from scipy.special import logsumexp

from suite.particles import Particles, normalise


@pytest.mark.parametrize("shift", [0.0, -1e4, 700.0, 1e5])
def test_normalise(shift):
    logw = np.random.default_rng(0).standard_normal((3, 50)) * 5 + shift
    weights, total = normalise(logw)
    np.testing.assert_allclose(total, logsumexp(logw, axis=1), rtol=1e-14)
    np.testing.assert_allclose(weights, np.exp(logw - logsumexp(logw, axis=1, keepdims=True)), rtol=1e-9)
    np.testing.assert_allclose(weights.sum(1), 1, rtol=1e-14)


def test_a_lost_run_is_lost_alone():
    logw = np.random.default_rng(0).standard_normal((5, 8))
    logw[1] = -np.inf
    logw[2, 3] = np.nan
    logw[3, 4] = -np.inf
    with np.errstate(all="ignore"):
        weights, total = normalise(logw)
    assert list(np.isnan(weights).any(1)) == [False, True, True, False, False]
    assert np.isnan(weights[[1, 2]]).all()
    assert weights[3, 4] == 0
    for r in (0, 3, 4):
        alone, alone_total = normalise(logw[r : r + 1])
        np.testing.assert_array_equal(weights[r], alone[0])
        assert total[r] == alone_total[0]


def test_moments_are_those_of_numpy():
    rng = np.random.default_rng(1)
    x, weights = rng.standard_normal((3, 4, 60)) + 5, rng.dirichlet(np.ones(60), 4)
    mean, cov = Particles(x, weights, np.zeros(4)).moments()
    for r in range(4):
        np.testing.assert_allclose(mean[:, r], np.average(x[:, r], axis=1, weights=weights[r]))
        np.testing.assert_allclose(cov[:, :, r], np.cov(x[:, r], aweights=weights[r], ddof=0), rtol=1e-10)
    np.testing.assert_array_equal(cov, np.swapaxes(cov, 0, 1))


def test_moments_far_from_zero_do_not_cancel():
    x = 1e8 + np.array([[[-1.0, 0.0, 1.0]]])
    _, cov = Particles(x, np.full((1, 3), 1 / 3), np.zeros(1)).moments()
    np.testing.assert_allclose(cov, 2 / 3, rtol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_moments_of_a_run_have_the_same_bits_alone(seed):
    rng = np.random.default_rng(seed)
    x, weights = rng.standard_normal((4, 5, 333)), rng.dirichlet(np.ones(333), 5)
    mean, cov = Particles(x, weights, np.zeros(5)).moments()
    for r in range(5):
        one = Particles(np.ascontiguousarray(x[:, r : r + 1]), weights[r : r + 1], np.zeros(1)).moments()
        np.testing.assert_array_equal(one[0][:, 0], mean[:, r])
        np.testing.assert_array_equal(one[1][..., 0], cov[..., r])


def test_effective_sample_size():
    weights = np.array([[0.25] * 4, [1.0, 0, 0, 0], [0.5, 0.5, 0, 0], [0.7, 0.1, 0.1, 0.1]])
    np.testing.assert_allclose(Particles(np.zeros((1, 4, 4)), weights, np.zeros(4)).ess, [4, 1, 2, 1 / 0.52])
