"""The Epanechnikov kernel: published bandwidths, the bandwidth's derivation, and the law of the draws."""

import math

import numpy as np
import pytest
from scipy import integrate, stats

from suite.kernel import bandwidth, epanechnikov
from tests.oracles import generators


def test_the_bandwidths_are_the_known_ones():
    """Silverman (1986), table 4.1, for one dimension; the check values of Musso, Oudjane and Le Gland's formula for six."""
    assert bandwidth(1, 1) == pytest.approx(2.345, abs=5e-4)
    assert bandwidth(6, 1) == pytest.approx(2.810, abs=5e-4)
    assert bandwidth(6, 1000) == pytest.approx(1.408, abs=5e-4)
    assert bandwidth(6, 10_000) == pytest.approx(1.119, abs=5e-4)


@pytest.mark.parametrize("n", range(1, 9))
@pytest.mark.parametrize("count", [1, 100, 1_000_000])
def test_the_bandwidth_is_that_of_the_formula(n, count):
    ball = math.pi ** (n / 2) / math.gamma(n / 2 + 1)
    a = (8 / ball * (n + 4) * (2 * math.sqrt(math.pi)) ** n) ** (1 / (n + 4))
    assert bandwidth(n, count) == pytest.approx(a * count ** (-1 / (n + 4)), rel=1e-12)


@pytest.mark.parametrize("n", range(1, 7))
def test_the_bandwidth_minimises_the_mean_integrated_square_error(n):
    """By quadrature: of variance R(K) / (N h^n) plus squared bias h^4 mu^2 R(Laplacian of the density) / 4."""
    ball = math.pi ** (n / 2) / math.gamma(n / 2 + 1)

    def over_space(function, end):
        return integrate.quad(lambda r: n * ball * r ** (n - 1) * function(r), 0, end, epsabs=0, epsrel=1e-11)[0]

    def kernel(r):
        return (1 - r * r) * (n + 2) / (2 * ball)

    def laplacian(r):
        return (r * r - n) * math.exp(-r * r / 2) / (2 * math.pi) ** (n / 2)

    assert over_space(kernel, 1) == pytest.approx(1)
    roughness = over_space(lambda r: kernel(r) ** 2, 1)
    spread = over_space(lambda r: kernel(r) * r * r, 1) / n
    bias = over_space(lambda r: laplacian(r) ** 2, 30) * spread**2
    assert bandwidth(n, 500) == pytest.approx((n * roughness / (500 * bias)) ** (1 / (n + 4)), rel=1e-9)


RUNS, COUNT = 2, 20_000


@pytest.fixture(params=range(1, 7), ids=lambda n: f"n={n}", scope="module")
def draws(request):
    n = request.param
    e = epanechnikov(generators(RUNS, "kernel", n), n, COUNT)
    assert e.shape == (n, RUNS, COUNT)
    return e.reshape(n, -1)


def test_the_length_is_that_of_a_beta_variate(draws):
    # A Kolmogorov-Smirnov test fails by chance with probability 1e-9.
    n, square = len(draws), (draws**2).sum(0)
    assert (square <= 1).all()
    assert stats.kstest(square, stats.beta(n / 2, 2).cdf).pvalue > 1e-9


def test_the_moments_are_zero_and_one_over_n_plus_four(draws):
    # 5.5 standard errors, at most 27 figures: a false alarm has probability below 2e-6 for each n.
    n, count = len(draws), draws.shape[1]
    assert (np.abs(draws.mean(1)) < 5.5 / np.sqrt((n + 4) * count)).all()
    for i in range(n):
        for j in range(i + 1):
            product = draws[i] * draws[j]
            expected = (i == j) / (n + 4)
            assert abs(product.mean() - expected) < 5.5 * product.std() / np.sqrt(count)


def test_the_direction_is_uniform_and_says_nothing_about_the_length(draws):
    # A Kolmogorov-Smirnov test fails by chance with probability 1e-9, signs are fair within 5.5 standard errors.
    n, count = draws.shape
    length = np.sqrt((draws**2).sum(0))
    axes = [*np.eye(n), np.ones(n) / np.sqrt(n)]
    for axis in axes:
        along = axis @ draws / length
        assert abs((along > 0).mean() - 0.5) < 5.5 * 0.5 / np.sqrt(count)
        if n > 1:
            assert stats.kstest(along**2, stats.beta(1 / 2, (n - 1) / 2).cdf).pvalue > 1e-9
            assert abs(np.corrcoef(along**2, length)[0, 1]) < 5.5 / np.sqrt(count)
        # The marginal of the kernel along any axis is again proportional to a power of 1 - e².
        law = stats.beta((n + 3) / 2, (n + 3) / 2, loc=-1, scale=2)
        assert stats.kstest(axis @ draws, law.cdf).pvalue > 1e-9


def test_a_run_draws_the_same_numbers_alone():
    whole, rng = epanechnikov(generators(4, "kernel"), 3, 50), generators(4, "kernel")
    for r in range(4):
        np.testing.assert_array_equal(epanechnikov(rng.of([r]), 3, 50)[:, 0], whole[:, r])
