"""The regularized filter: its kernel, and its estimates against a grid filter that widens its posterior by the same kernel."""

import numpy as np
import pytest
from scipy import stats

from estimators.regularized import Regularized
from suite import particles
from suite.case import draw
from suite.kernel import bandwidth, epanechnikov
from tests.estimators.references import SIDES, on_a_grid, repeated, scores
from tests.oracles import generators


def test_bandwidth_and_kernel_are_the_published_ones():
    # A, and h of six components at N = 1000 and 10 000 (Silverman, 1986, table 4.1 and eq. 4.14).
    np.testing.assert_allclose([bandwidth(1, 1), bandwidth(6, 1)], [2.345, 2.810], atol=5e-4)
    np.testing.assert_allclose([bandwidth(6, 1000), 1 + bandwidth(6, 1000) ** 2 / 10], [1.408, 1.198], atol=5e-4)
    np.testing.assert_allclose(bandwidth(6, 10_000), 1.119, atol=5e-4)
    for n in (1, 2, 5):
        e = epanechnikov(generators(2, "kernel", n), n, 20_000).reshape(n, -1)
        square = (e * e).sum(0)
        assert square.max() < 1
        assert stats.kstest(square, stats.beta(n / 2, 2).cdf).pvalue > 1e-6
        # Covariance I / (n + 4): each entry of it has a standard deviation below 1 / (n + 4) · sqrt(2 / 40 000).
        np.testing.assert_allclose(e @ e.T / 40_000, np.eye(n) / (n + 4), atol=6 / (n + 4) * np.sqrt(2 / 40_000))
        assert np.abs(e.mean(1)).max() < 6 / np.sqrt((n + 4) * 40_000)


@pytest.mark.parametrize("shrink", [False, True])
def test_regularised_samples_have_the_moments_of_the_kernel(shrink):
    # 40 000 particles that are moved, in two of three runs; tolerances of 6 standard errors.
    rng, count = generators(3, "moments"), 40_000
    root = np.array([[2.0, 0, 0], [1.0, 1.5, 0], [-0.5, 0.3, 0.1]])
    x = np.einsum("ij,jrn->irn", root, rng.standard_normal((3, 3, count))) + np.array([5.0, -3.0, 100.0])[:, None, None]
    belief = particles.weighted(x, -0.5 * (x[0] / 4) ** 2, particles.all_of(3, count))
    origins, runs = np.repeat(x[:, :, :400], 100, axis=2), np.array([0, 2])
    moved = Regularized(particles=count, shrink=shrink).regularised(belief, origins, runs, rng)
    np.testing.assert_array_equal(moved[:, 1], x[:, 1, :400].repeat(100, axis=1))
    h, (mean, cov) = bandwidth(3, count), belief.moments
    keep = np.sqrt(1 - h * h / 7) if shrink else 1.0
    for r in runs:
        step = moved[:, r] - mean[:, r, None] - keep * (origins[:, r] - mean[:, r, None])
        white = np.linalg.solve(np.linalg.cholesky(cov[:, :, r]), step) / h
        assert (white**2).sum(0).max() < 1
        np.testing.assert_allclose(white @ white.T / count, np.eye(3) / 7, atol=6 / 7 * np.sqrt(2 / count))
        assert np.abs(white.mean(1)).max() < 6 / np.sqrt(7 * count)


def smoothed(grid, count, shrink):
    """What the kernel makes of a posterior on a grid: its points drawn together, then convolved."""
    step, h = grid[1] - grid[0], bandwidth(1, count)
    keep = np.sqrt(1 - h * h / 5) if shrink else 1.0

    def between(predicted, likelihood, density):
        mean = grid @ density * step
        deviation = np.sqrt((grid**2) @ density * step - mean**2)
        width = h * deviation[0]
        kernel = np.maximum(1 - ((grid[:, None] - mean[0] - keep * (grid - mean[0])) / width) ** 2, 0) * 0.75 / width
        return kernel @ density * step

    return between


@pytest.mark.parametrize("shrink", [False, True])
@pytest.mark.parametrize("count", [300, 5000])
def test_estimates_are_those_of_a_grid_filter_with_the_same_kernel(count, shrink):
    # The bias of order 1/N of a mean of N weighted particles stays below the standard error of 40 runs. 4 steps x 3 figures in
    # four tests: 7 standard errors of Student's t with 39 degrees of freedom are passed with probability below 2e-6.
    y = draw(SIDES, 4, generators(1, "sides")).y
    grid = np.linspace(-20, 20, 1001)
    mean, variance, loglik = on_a_grid(grid, SIDES, y, smoothed(grid, count, shrink))
    estimate = Regularized(particles=count, shrink=shrink, threshold=1.0).run(SIDES, repeated(y, 40), 3)
    for found, exact in ((estimate.mean[:, 0], mean), (estimate.cov[:, 0, 0], variance), (estimate.loglik, loglik)):
        worst = np.abs(scores(found, exact[:, 0])).max()
        assert worst < 7


def test_its_bias_falls_with_the_square_of_the_bandwidth():
    """By the grid filters alone, which the test before ties to the particles: without a kernel they are exact."""
    y = draw(SIDES, 4, generators(1, "sides")).y
    grid = np.linspace(-16, 16, 1281)
    exact = np.stack(on_a_grid(grid, SIDES, y))
    counts = [10**5, 10**6, 10**7]  # before, the kernel is not narrow beside a mode
    bias = [np.abs(np.stack(on_a_grid(grid, SIDES, y, smoothed(grid, c, False))) - exact)[:, -1].max() for c in counts]
    slope = np.polyfit(np.log([bandwidth(1, c) for c in counts]), np.log(bias), 1)[0]
    assert abs(slope - 2) < 0.2
