"""Weighted particles: normalisation without overflow, moments against numpy, resampling run by run, blocks."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logsumexp

from suite import particles
from suite.noise import Gaussian
from suite.particles import BLOCK, all_of, blockwise, drawn, resample, runs_at_once, weighted
from suite.resampling import SCHEMES, systematic
from tests.oracles import generators


def evenly(x, logw):
    """Particles with these log-weights, each its own parent."""
    return weighted(x, logw, all_of(*logw.shape))


def clouds(runs, count, n=3, spread=1.0, seed=0):
    rng = np.random.default_rng(seed)
    return evenly(rng.standard_normal((n, runs, count)) + 5, rng.standard_normal((runs, count)) * spread - 30)


def assert_same_bits(alone, whole, r):
    """The one run of `alone` is run r of `whole`, to the bit."""
    for name in ("x", "logw", "weights", "loglik", "ancestors", "ess"):
        a, b = getattr(alone, name), getattr(whole, name)
        np.testing.assert_array_equal(*((a[:, 0], b[:, r]) if name == "x" else (a[0], b[r])), err_msg=name)
    for a, b in zip(alone.moments, whole.moments, strict=True):
        np.testing.assert_array_equal(a[..., 0], b[..., r])


@pytest.mark.parametrize("shift", [0.0, -1e4, 700.0, 1e5, -1e15])
def test_the_weights_are_normalised_and_their_sum_is_the_likelihood(shift):
    logw = np.random.default_rng(0).standard_normal((3, 50)) * 5 + shift
    made = evenly(np.zeros((1, 3, 50)), logw)
    np.testing.assert_allclose(made.loglik, logsumexp(logw, axis=1), rtol=1e-14)
    below = logw - logw.max(1, keepdims=True)
    np.testing.assert_allclose(made.weights, np.exp(below - logsumexp(below, axis=1, keepdims=True)), rtol=1e-12)
    np.testing.assert_allclose(made.weights.sum(1), 1, rtol=1e-14)
    np.testing.assert_allclose(made.logw, below - logsumexp(below, axis=1, keepdims=True), atol=1e-13)


def test_logarithms_are_normalised_next_to_a_likelihood_of_any_size():
    made = evenly(np.zeros((1, 1, 2)), np.full((1, 2), -1e17))
    np.testing.assert_allclose(np.exp(made.logw), made.weights, rtol=1e-14)


def test_weights_too_small_for_a_number_keep_their_logarithm():
    made = evenly(np.zeros((1, 1, 3)), np.array([[0.0, -800.0, -np.inf]]))
    np.testing.assert_array_equal(made.weights, [[1, 0, 0]])
    np.testing.assert_array_equal(made.logw, [[0, -800, -np.inf]])


def test_a_lost_run_is_lost_alone():
    logw = np.random.default_rng(0).standard_normal((6, 8))
    logw[1] = -np.inf
    logw[2, 3] = np.nan
    logw[3, 4] = -np.inf
    logw[4] = np.nan
    x = np.random.default_rng(1).standard_normal((2, 6, 8))
    with np.errstate(all="ignore"):
        made = evenly(x, logw)
        for r in (0, 2, 3, 5):
            assert_same_bits(evenly(x[:, r : r + 1], logw[r : r + 1]), made, r)
    for lost in (made.weights.T, made.moments[0], made.moments[1].reshape(4, 6), made.ess[None]):
        assert np.isnan(lost[:, [1, 4]]).all()
        assert np.isfinite(lost[:, [0, 2, 3, 5]]).all()
    assert (made.loglik[[1, 4]] == -np.inf).all()
    assert np.isfinite(made.loglik[[0, 2, 3, 5]]).all()
    assert made.weights[2, 3] == made.weights[3, 4] == 0


@pytest.mark.parametrize("gone", [np.nan, np.inf, -np.inf])
def test_a_particle_that_left_the_numbers_counts_for_nothing(gone):
    rng = np.random.default_rng(3)
    x, logw = rng.standard_normal((2, 3, 6)), rng.standard_normal((3, 6))
    x[1, 1, 4] = gone
    logw[1, 4] = np.nan
    with np.errstate(all="ignore"):
        mean, cov = evenly(x, logw).moments
        keep = np.arange(6) != 4
        expected = evenly(x[:, 1:2, keep], logw[1:2, keep]).moments
    np.testing.assert_allclose(mean[:, 1], expected[0][:, 0])
    np.testing.assert_allclose(cov[..., 1], expected[1][..., 0])
    others = evenly(np.ascontiguousarray(x[:, [0, 2]]), logw[[0, 2]])
    np.testing.assert_array_equal(mean[:, [0, 2]], others.moments[0])
    np.testing.assert_array_equal(cov[..., [0, 2]], others.moments[1])


def test_moments_are_those_of_numpy():
    made = clouds(4, 60)
    mean, cov = made.moments
    for r in range(4):
        np.testing.assert_allclose(mean[:, r], np.average(made.x[:, r], axis=1, weights=made.weights[r]))
        np.testing.assert_allclose(cov[:, :, r], np.cov(made.x[:, r], aweights=made.weights[r], ddof=0), rtol=1e-10)
    np.testing.assert_array_equal(cov, np.swapaxes(cov, 0, 1))


@pytest.mark.parametrize("count", [BLOCK - 1, BLOCK, BLOCK + 1, 20_000])
def test_moments_of_many_particles_are_those_of_numpy(count):
    made = clouds(2, count)
    for r in range(2):
        np.testing.assert_allclose(made.moments[0][:, r], np.average(made.x[:, r], axis=1, weights=made.weights[r]))
        expected = np.cov(made.x[:, r], aweights=made.weights[r], ddof=0)
        np.testing.assert_allclose(made.moments[1][..., r], expected, rtol=1e-9, atol=1e-12)


def test_moments_far_from_zero_do_not_cancel():
    _, cov = evenly(1e8 + np.array([[[-1.0, 0.0, 1.0]]]), np.zeros((1, 3))).moments
    np.testing.assert_allclose(cov, 2 / 3, rtol=1e-6)
    _, cov = evenly(1e8 + np.arange(3.0 * BLOCK).reshape(1, 1, -1) % 2, np.zeros((1, 3 * BLOCK))).moments
    np.testing.assert_allclose(cov, 1 / 4, rtol=1e-6)


def test_one_particle_has_no_spread():
    made = evenly(np.full((2, 3, 1), 7.0), np.full((3, 1), -5.0))
    np.testing.assert_array_equal(made.moments[0], 7)
    np.testing.assert_array_equal(made.moments[1], 0)
    np.testing.assert_array_equal(made.ess, 1)
    np.testing.assert_array_equal(made.loglik, -5)


@pytest.mark.parametrize("count", [1, 2, 7, 333, 9000, 20_000])
@pytest.mark.parametrize("runs", [1, 2, 3, 4, 5])
def test_a_run_has_the_same_bits_alone(runs, count):
    rng = np.random.default_rng(1)
    x, logw = rng.standard_normal((4, runs, count)) + 5, rng.standard_normal((runs, count))
    whole = evenly(x, logw)
    for r in range(runs):
        assert_same_bits(evenly(np.ascontiguousarray(x[:, r : r + 1]), logw[r : r + 1]), whole, r)
        # A view of the batch, and particles that lie run by run in memory, as random numbers do.
        assert_same_bits(evenly(x[:, r : r + 1], logw[r : r + 1]), whole, r)
    by_run = evenly(np.moveaxis(np.moveaxis(x, 1, 0).copy(), 0, 1), logw)
    for r in range(runs):
        assert_same_bits(evenly(x[:, r : r + 1], logw[r : r + 1]), by_run, r)


def test_effective_sample_size():
    weights = np.array([[0.25] * 4, [1.0, 0, 0, 0], [0.5, 0.5, 0, 0], [0.7, 0.1, 0.1, 0.1]])
    with np.errstate(divide="ignore"):
        made = evenly(np.zeros((1, 4, 4)), np.log(weights))
    np.testing.assert_allclose(made.ess, [4, 1, 2, 1 / 0.52])


def test_ancestors_are_the_different_parents():
    parents = np.array([[0, 1, 2, 3], [2, 2, 2, 2], [0, 0, 3, 3], [1, 2, 2, 3]])
    made = weighted(np.zeros((1, 4, 4)), np.zeros((4, 4)), parents)
    np.testing.assert_array_equal(made.ancestors, [4, 1, 2, 3])
    many = np.sort(np.random.default_rng(0).integers(0, 500, (3, 500)), axis=1)
    made = weighted(np.zeros((1, 3, 500)), np.zeros((3, 500)), many)
    np.testing.assert_array_equal(made.ancestors, [len(np.unique(row)) for row in many])


def test_the_readout_is_what_the_particles_say():
    made = replace(clouds(3, 20), acceptance=np.array([0.5, np.nan, 1.0]))
    said = made.read()
    for name in ("loglik", "ess", "ancestors", "acceptance"):
        np.testing.assert_array_equal(getattr(said, name), getattr(made, name))
    np.testing.assert_array_equal(said.mean, made.moments[0])
    np.testing.assert_array_equal(said.cov, made.moments[1])
    assert clouds(3, 20).read().acceptance is None


def test_draws_from_the_prior_weigh_the_same():
    prior = Gaussian(np.array([1.0, -2.0]), np.array([[2.0, 0.5], [0.5, 1.0]]))
    made = drawn(prior, generators(3, "prior"), 10)
    np.testing.assert_array_equal(made.x, prior.sample(generators(3, "prior"), (3, 10)))
    np.testing.assert_allclose(made.weights, 0.1)
    np.testing.assert_allclose(made.logw, -np.log(10))
    np.testing.assert_allclose(made.ess, 10)
    np.testing.assert_allclose(made.loglik, 0, atol=1e-15)
    np.testing.assert_array_equal(made.ancestors, 10)


def mixed(count=40):
    """Five runs: even, bad, good, bad and equal weights; effective sample sizes on both sides of 0.6 N."""
    rng = np.random.default_rng(4)
    logw = rng.standard_normal((5, count)) * np.array([0.1, 3.0, 0.4, 2.0, 0.0])[:, None]
    made = evenly(rng.standard_normal((2, 5, count)), logw)
    assert list(made.ess < 0.6 * count) == [False, True, False, True, False]
    return made


@pytest.mark.parametrize("scheme", SCHEMES.values(), ids=SCHEMES)
def test_the_runs_below_the_threshold_are_resampled_and_they_alone(scheme):
    made, rng, plain = mixed(), generators(5, "mixed"), generators(5, "mixed")
    done = resample(made, scheme, 0.6, rng)
    np.testing.assert_array_equal(done.runs, [1, 3])
    for r in (0, 2, 4):
        np.testing.assert_array_equal(done.x[:, r], made.x[:, r])
        np.testing.assert_array_equal(done.logw[r], made.logw[r])
        np.testing.assert_array_equal(done.parents[r], np.arange(40))
    for r in (1, 3):
        np.testing.assert_array_equal(done.parents[r], scheme(made.weights[r : r + 1], plain.of([r]))[0])
        np.testing.assert_array_equal(done.x[:, r], made.x[:, r, done.parents[r]])
        np.testing.assert_array_equal(done.logw[r], -np.log(40))
    # A run that was not resampled has drawn nothing.
    np.testing.assert_array_equal(rng.random((2, 5)), plain.random((2, 5)))


@pytest.mark.parametrize("threshold", [0.0, 0.3, 0.6, 0.999, 1.0])
def test_a_run_is_resampled_to_the_same_bits_alone(threshold):
    made = mixed()
    whole = resample(made, systematic, threshold, generators(5, "alone"))
    for r in range(5):
        one = evenly(made.x[:, r : r + 1], made.logw[r : r + 1])
        alone = resample(one, systematic, threshold, generators(5, "alone").of([r]))
        assert (len(alone.runs) == 1) == (r in whole.runs) == bool(made.ess[r] < threshold * 40 and r != 4)
        np.testing.assert_array_equal(alone.x[:, 0], whole.x[:, r])
        np.testing.assert_array_equal(alone.parents[0], whole.parents[r])
        np.testing.assert_allclose(alone.logw[0], whole.logw[r], rtol=1e-14, atol=1e-15)  # normalised twice


@pytest.mark.parametrize("count", [1, 3, 49, 1000, 99_991])
def test_equal_weights_are_never_resampled(count):
    """Rounding puts their effective sample size a little below N; a run with a threshold of 1 must not see that."""
    made = evenly(np.zeros((1, 2, count)), np.full((2, count), -1234.5678))
    assert len(resample(made, systematic, 1.0, generators(2, "equal")).runs) == 0
    if count > 1:
        logw = np.zeros((1, count))
        logw[0, 0] = np.log(1.1) if count < 100 else 3.0
        made = evenly(np.zeros((1, 1, count)), logw)
        assert len(resample(made, systematic, 1.0, generators(1, "equal")).runs) == 1


def test_a_lost_run_does_not_disturb_the_resampling_of_others():
    made = mixed()
    logw = made.logw.copy()
    logw[1] = np.nan
    with np.errstate(all="ignore"):
        lost = resample(evenly(made.x, logw), systematic, 0.6, generators(5, "lost"))
    done = resample(evenly(made.x, made.logw), systematic, 0.6, generators(5, "lost"))
    for r in (0, 2, 3, 4):
        np.testing.assert_array_equal(lost.x[:, r], done.x[:, r])
        np.testing.assert_array_equal(lost.logw[r], done.logw[r])
        np.testing.assert_array_equal(lost.parents[r], done.parents[r])


@pytest.mark.parametrize("count", [1, BLOCK, BLOCK + 1, 2 * BLOCK, 20_000])
def test_blockwise_equals_one_call(count):
    rng = np.random.default_rng(0)
    x, w = rng.standard_normal((3, 2, count)), rng.standard_normal((2, count))

    def function(x, w):
        return np.sin(x) * w, w * w, np.stack([w + x[0], w])

    for found, expected in zip(blockwise(function, x, w), function(x, w), strict=True):
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("count", [5, BLOCK, 20_000])
def test_blockwise_draws_block_after_block(count):
    x, rng, plain = np.zeros((1, 2, count)), generators(2, "blocks"), generators(2, "blocks")
    sizes = [min(BLOCK, count - s) for s in range(0, count, BLOCK)]
    (found,) = blockwise(lambda part: (part + rng.standard_normal((1, *part.shape[1:])),), x)
    expected = np.concat([plain.standard_normal((1, 2, size)) for size in sizes], axis=-1)
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(rng.random((1, 2)), plain.random((1, 2)))


def test_blocks_cover_all_particles_once():
    for count in (1, BLOCK - 1, BLOCK, BLOCK + 1, 5 * BLOCK, 100_000):
        covered = np.concat([np.arange(count)[part] for part in particles.blocks(count)])
        np.testing.assert_array_equal(covered, np.arange(count))
        assert max(len(np.arange(count)[part]) for part in particles.blocks(count)) <= BLOCK
        assert 1 <= runs_at_once(count) <= max(1, BLOCK / count)


def test_a_state_that_left_the_numbers_unseen_by_the_sensor_is_impossible():
    x, logw = np.random.default_rng(4).standard_normal((2, 2, 5)), np.zeros((2, 5))
    x[0, 1, 3] = np.nan
    made = evenly(x, logw)
    np.testing.assert_allclose(made.weights, [[0.2] * 5, [0.25, 0.25, 0.25, 0.0, 0.25]])
    np.testing.assert_allclose(made.loglik, np.log([5, 4]))
