"""What interacting particle filters share, held against plain sums, scipy's densities and probabilities known exactly."""

import numpy as np
import pytest
from scipy import stats

from suite import imm, imm_particles, modes, particles
from suite.model import AdditiveSensor, Affine
from suite.noise import Gaussian
from tests.jump_oracles import TWO
from tests.oracles import Given, from_west, generators, range_bearing

LARGEST = 1 - 2.0**-53


def test_starts_are_picked_from_the_modes_with_their_probabilities():
    # 3 x 2 counts of 40,000: 6 standard deviations are passed with probability below 1e-8 each.
    share = np.array([[0.5, 0.0], [0.2, 0.7], [0.3, 0.3]])
    options = [np.full((2, 2, 40_000), float(i)) + np.arange(40_000) / 1e6 for i in range(3)]
    found = imm_particles.picked(share, options, generators(2, "picked"))
    for i, option in enumerate(options):
        here = np.floor(found[0]) == i
        worst = np.abs(here.mean(1) - share[i]) / np.sqrt(np.maximum(share[i] * (1 - share[i]), 1e-12) / 40_000)
        assert (worst < 6).all()
        np.testing.assert_array_equal(found[:, here], option[:, here])  # each stays in its place


@pytest.mark.parametrize("share", [[0.0, 1.0, 0.0], [0.0, 0.1 + 0.2, 0.7], [1.0, 0.0, 0.0], [0.7, 0.1 + 0.2 - 1e-9, 0.0]])
def test_a_mode_of_probability_zero_is_never_picked(share):
    options = [np.full((1, 1, 2), float(i)) for i in range(3)]
    found = imm_particles.picked(np.array(share)[:, None], options, Given([[0.0, LARGEST]]))[0, 0]
    possible = np.flatnonzero(share)
    np.testing.assert_array_equal(found, [possible[0], possible[-1]])


def test_redrawn_particles_have_the_moments_of_the_gaussian():
    # 2 x 3 means and 2 x 6 covariances of 100,000 draws: 6 standard errors are passed with probability below 1e-8 each.
    rng, count = np.random.default_rng(1), 100_000
    root = rng.standard_normal((2, 3, 3))
    root[1, :, 2] = 0.0  # a singular one
    mean = np.array([[1.0, -5.0, 100.0], [0.0, 2.0, 3.0]])
    x = imm_particles.redrawn(mean, root, count, generators(2, "redrawn"))
    for r in range(2):
        cov = root[r] @ root[r].T
        assert (np.abs(x[:, r].mean(1) - mean[r]) < 6 * np.sqrt(np.diag(cov) / count)).all()
        error = np.sqrt((cov**2 + np.outer(np.diag(cov), np.diag(cov))) / count)
        assert (np.abs(np.cov(x[:, r]) - cov) < 6 * error).all()
    across = np.linalg.svd(root[1])[0][:, -1]
    np.testing.assert_allclose(across @ x[:, 1], across @ mean[1], atol=1e-12)


SENSOR = AdditiveSensor(
    Affine([[1.0, 0.5], [0.0, 1.0], [2.0, -1.0]], np.array([0.3, 0.0, -1.0])),
    Gaussian([0.1, -0.2, 0.3], [[2.0, 0.5, 0.1], [0.5, 1.0, 0.2], [0.1, 0.2, 3.0]]),
)


def test_the_likelihood_of_a_mode_is_the_normal_density_at_the_innovation():
    rng = np.random.default_rng(2)
    x, y = rng.standard_normal((2, 4, 7)) * 3, rng.standard_normal((3, 4))
    y[0, 1] = y[0:2, 2] = y[:, 3] = np.nan
    found = imm_particles.gaussian_loglik(SENSOR, x, y, 1)
    for r in range(4):
        seen = ~np.isnan(y[:, r])
        ahead = SENSOR.mean(x[:, r], 1)[seen]
        S = (np.cov(ahead, bias=True) + SENSOR.noise.cov[np.ix_(seen, seen)]) if seen.any() else None
        centre = ahead.mean(1) + SENSOR.noise.mean[seen]
        expected = stats.multivariate_normal(centre, S).logpdf(y[seen, r]) if seen.any() else 0.0
        np.testing.assert_allclose(found[r], expected, rtol=1e-10, atol=1e-12)


def test_the_likelihood_of_a_mode_does_not_depend_on_where_angles_jump():
    rng = np.random.default_rng(3)
    x = range_bearing().prior.mean[:, None, None] + rng.standard_normal((4, 3, 50)) * np.array([20, 2, 200, 2])[:, None, None]
    # The last lies opposite to the mean of the predictions, where differences to single ones jump.
    y = np.array([[1000.0, 990.0, 1010.0], [3.1, -3.1, 0.05]])
    found = imm_particles.gaussian_loglik(range_bearing().sensor, x, y, 1)
    west = imm_particles.gaussian_loglik(range_bearing(west=True).sensor, x, from_west(y[None])[0], 1)
    np.testing.assert_allclose(found, west, rtol=1e-9)
    assert found[2] < found[0] - 20


def cloud(weights, x=None):
    weights = np.asarray(weights, float)
    with np.errstate(divide="ignore"):
        return particles.weighted(np.zeros((2, *weights.shape)) if x is None else x, np.log(weights), particles.all_of(1, 8))


def test_the_effective_sample_size_is_that_of_particles_shared_out_by_probability():
    before = imm.init(TWO.model, 1)
    clouds = [cloud([[1, 0] * 4]), cloud([[1] * 8])]
    p = np.array([[0.75], [0.25]])
    found = imm_particles.updated(before, np.log(p), [np.zeros(1)] * 2, clouds, [c.ess for c in clouds])
    shared = np.array([0.25, 0, 0.25, 0, 0.25, 0, 0.125, 0.125])  # six of the first, of which every other counts, and two
    np.testing.assert_allclose(found.ess, 1 / (shared @ shared))
    np.testing.assert_allclose(found.read().ess, found.ess)


def test_nothing_of_a_mode_without_likelihood_enters_the_mixture():
    before, rng = imm.init(TWO.model, 1), np.random.default_rng(4)
    x = rng.standard_normal((2, 1, 8))
    with np.errstate(all="ignore"):
        clouds = [cloud([[1] * 8], x), cloud([[0] * 8], 1e300 * x)]
        ahead = modes.predicted(TWO.model, before.logp)[0]
        found = imm_particles.updated(before, ahead, [np.zeros(1), np.full(1, -np.inf)], clouds, [c.ess for c in clouds]).read()
    np.testing.assert_array_equal(found.mode[:, 0], [1, 0])
    np.testing.assert_allclose(found.mean[:, 0], x[:, 0].mean(1))
    np.testing.assert_allclose(found.cov[..., 0], np.cov(x[:, 0], bias=True), rtol=1e-10)
    np.testing.assert_allclose(found.ess, 8)
    assert np.isfinite(found.statistic).all()
