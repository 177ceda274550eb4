"""Resample-move: the move leaves its target alone and finds it, and the step wires parents, fits and measurements rightly."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from suite import move
from suite.model import AdditiveSensor, Affine
from suite.move import metropolis
from suite.noise import Gaussian
from suite.particles import BLOCK, all_of, drawn, resample, weighted
from suite.proposal import from_transition, linearise, linearised
from suite.resampling import SCHEMES, select, systematic
from tests.oracles import generators, quadrature_of_transition, range_bearing, wavy_model

FITS = {
    from_transition: lambda model, origins, y, k: lambda x: model.sensor.logpdf(y, x, k),
    linearised: lambda model, origins, y, k: linearise(model, origins, y, k).fit,
}
"""The fit of particles that the proposal did not draw itself."""

proposals = pytest.mark.parametrize("propose", FITS, ids=lambda p: p.__name__)
ORIGIN, SEEN = 1.0, np.array([[0.2, -0.5, 2.5]])


def moved(propose, x, times, key):
    """Scalar particles x[1, R, N] after some moves, and the share accepted in the last."""
    model, rng = wavy_model(), generators(3, "move", propose.__name__, key)
    origins = np.full(x.shape, ORIGIN)
    fit = FITS[propose](model, origins, SEEN, 1)
    for _ in range(times):
        x, accepted = metropolis(propose, model, origins, x, fit(x), SEEN, 1, rng)
    return x, accepted.mean(1)


def target():
    return quadrature_of_transition(wavy_model(), np.array([ORIGIN]), SEEN[0], 1)


def uniform(x):
    """Particles x[1, R, N] put through the target's distribution function: uniform when they are draws from it."""
    return [np.interp(x[0, r], target().x, target().cdf[r]) for r in range(3)]


def assert_uniform(numbers):
    # Mean and variance within 5.5 standard errors and a Kolmogorov-Smirnov test, for three runs: a false alarm has
    # probability below 3e-7.
    for u in numbers:
        assert abs(u.mean() - 1 / 2) < 5.5 / np.sqrt(12 * len(u))
        assert abs(u.var() - 1 / 12) < 5.5 / np.sqrt(180 * len(u))
        assert stats.kstest(u, stats.uniform.cdf).pvalue > 1e-9


@proposals
def test_the_move_leaves_its_target_alone(propose):
    u = generators(3, "exact").random((1, 3, 60_000))
    x = np.stack([[np.interp(u[0, r], target().cdf[r], target().x) for r in range(3)]])
    assert_uniform(uniform(x))
    after, acceptance = moved(propose, x, 3, "stays")
    assert_uniform(uniform(after))
    # It does move: the target is kept, not the particles.
    assert ((acceptance > 0.1) & (acceptance < 0.99)).all()
    assert (np.mean(after != x, axis=2) > 0.3).all()


@proposals
@pytest.mark.parametrize("start", [-2.0, 0.0, 2.0])
def test_the_move_finds_its_target_from_elsewhere(propose, start):
    # An independence chain forgets at least as fast as (1 - 1/B)^t, with B the greatest ratio of target to proposal (Mengersen
    # and Tweedie, 1996): after 100 moves fewer than 2e-8 of the particles remember.
    model, origins, grid = wavy_model(), np.full((1, 3, 1), ORIGIN), np.broadcast_to(target().x, (1, 3, len(target().x)))
    evidence = propose(model, origins, SEEN, 1, generators(3, "bound"))[2][:, 0]
    fit = FITS[propose](model, origins, SEEN, 1)(grid)
    assert (np.exp(fit.max(1) + evidence) / target().likelihood < 6).all()
    x, _ = moved(propose, np.full((1, 3, 4000), start), 100, str(start))
    assert_uniform(uniform(x))


def test_with_a_linear_sensor_every_optimal_candidate_is_accepted():
    model = replace(wavy_model(), sensor=AdditiveSensor(Affine([[2.0]], np.array([0.3])), wavy_model().sensor.noise))
    origins = np.random.default_rng(0).standard_normal((1, 3, 500))
    x, fit, _ = linearised(model, origins, SEEN, 1, generators(3, "first"))
    after, accepted = metropolis(linearised, model, origins, x, fit, SEEN, 1, generators(3, "second"))
    assert accepted.all()
    np.testing.assert_array_equal(after, linearised(model, origins, SEEN, 1, generators(3, "second"))[0])


def test_a_candidate_is_accepted_by_the_ratio_of_the_fits():
    """Fits that differ by log 2 and log 4: accepted one time in two and in four; better ones, always."""

    # 5.5 standard errors of 50 000 draws: a false alarm has probability below 1e-7.
    def propose(model, x, y, k, rng):
        return x + 10, np.repeat([[-np.log(2)], [-np.log(4)], [0.0], [1.0], [-np.inf], [np.nan]], 50_000, axis=1), np.inf

    origins, x = np.zeros((2, 6, 50_000)), np.ones((2, 6, 50_000))
    after, accepted = metropolis(propose, None, origins, x, np.zeros((6, 50_000)), None, 1, generators(6, "ratio"))
    share = accepted.mean(1)
    assert abs(share[0] - 1 / 2) < 5.5 * np.sqrt(1 / 4 / 50_000)
    assert abs(share[1] - 1 / 4) < 5.5 * np.sqrt(3 / 16 / 50_000)
    np.testing.assert_array_equal(share[2:], [1, 1, 0, 0])
    np.testing.assert_array_equal(after, np.where(accepted, 10.0, 1.0) * np.ones((2, 1, 1)))


def restless():
    """The range-bearing model with process noise that grows with the time index."""
    model = range_bearing()
    cov = model.dynamics.noise_cov(1)
    return replace(model, dynamics=replace(model.dynamics, noise=lambda k: Gaussian.noise(k * cov)))


def tracked(propose, runs, count, steps, threshold, scheme=systematic, only=None):
    """Beliefs over some steps, the model and the measurements; `only` one of the runs when given, with its own numbers."""
    model, rng = restless(), generators(runs, "tracked")
    x = model.prior.sample(generators(runs, "truth"), (runs,))
    y = np.stack([model.sensor.sample(generators(runs, "seen", k), x * [[1], [0], [1], [0]], k) for k in range(steps)])
    y[1, 0, : runs // 2] = np.nan
    if only is not None:
        rng, y = rng.of([only]), y[..., [only]]
    beliefs = [move.start(drawn(model.prior, rng, count))]
    for k in range(1, steps + 1):
        beliefs.append(move.step(propose, model, beliefs[-1], y[k - 1], k, rng, scheme, threshold))
    return beliefs, model, y


@proposals
@pytest.mark.parametrize("scheme", SCHEMES.values(), ids=SCHEMES)
def test_the_step_is_resampling_then_a_move_then_the_proposal(propose, scheme):
    """Written out run by run, over the same random numbers."""
    beliefs, model, y = tracked(propose, 4, 60, 5, 0.6, scheme)
    tried = 0
    for r in range(4):
        rng = generators(4, "tracked").of([r])
        now = drawn(model.prior, rng, 60)
        origins, fit = None, None
        for k in range(1, 6):
            seen, logw, x, parents, acceptance = y[k - 1][:, [r]], now.logw, now.x, all_of(1, 60), np.nan
            if now.ess[0] < 0.6 * 60:
                parents = scheme(now.weights, rng)
                x, logw = select(x, parents), np.full((1, 60), -np.log(60))
                if k > 1:  # the particles came from a proposal: move them, given the measurement that weighed them
                    candidates, new, _ = propose(model, origins[:, :, parents[0]], y[k - 2][:, [r]], k - 1, rng)
                    better = rng.random((1, 1, 60))[0] < np.exp(new - fit[:, parents[0]])
                    x, acceptance, tried = np.where(better, candidates, x), better.mean(), tried + 1
            origins = x
            x, fit, evidence = propose(model, origins, seen, k, rng)
            now = weighted(x, logw + fit + evidence, parents)
            found = beliefs[k]
            np.testing.assert_array_equal(found.origins[:, r], origins[:, 0])
            np.testing.assert_array_equal(found.particles.x[:, r], x[:, 0])
            np.testing.assert_array_equal(found.particles.logw[r], now.logw[0])
            np.testing.assert_array_equal(found.fit[r], fit[0])
            np.testing.assert_array_equal(found.particles.acceptance[r], acceptance)
            assert found.particles.ancestors[r] == len(np.unique(parents))
    assert tried > 4


@proposals
@pytest.mark.parametrize("count", [40, BLOCK + 100])
def test_a_run_has_the_same_bits_alone(propose, count):
    whole, _, _ = tracked(propose, 3, count, 4, 0.6)
    some = np.stack([b.particles.acceptance for b in whole[1:]])
    assert np.isnan(some).any()
    assert np.isfinite(some).any()
    for r in range(3):
        alone, _, _ = tracked(propose, 3, count, 4, 0.6, only=r)
        for a, b in zip(alone, whole, strict=True):
            np.testing.assert_array_equal(a.origins[:, 0], b.origins[:, r])
            np.testing.assert_array_equal(a.particles.x[:, 0], b.particles.x[:, r])
            np.testing.assert_array_equal(a.particles.logw[0], b.particles.logw[r])
        for a, b in zip(alone[1:], whole[1:], strict=True):
            np.testing.assert_array_equal(a.particles.acceptance[0], b.particles.acceptance[r])


@proposals
def test_the_acceptance_is_the_share_that_moved_and_untouched_runs_keep_their_particles(propose):
    beliefs, model, y = tracked(propose, 4, 300, 5, 0.6)
    touched = 0
    for k in range(2, 6):
        before, after = beliefs[k - 1], beliefs[k]
        chosen = before.particles.ess < 0.6 * 300
        rng = generators(4, "again", k)
        step = move.step(propose, model, before, y[k - 1], k, rng, systematic, 0.6)
        copies = resample(before.particles, systematic, 0.6, generators(4, "again", k))
        share = (step.origins != copies.x).any(0).mean(1)
        np.testing.assert_array_equal(step.particles.acceptance, np.where(chosen, share, np.nan))
        np.testing.assert_array_equal(np.isnan(after.particles.acceptance), ~chosen)
        for r in np.flatnonzero(~chosen):
            np.testing.assert_array_equal(after.origins[:, r], before.particles.x[:, r])
        touched += chosen.sum()
    assert 0 < touched < 16


@proposals
def test_a_threshold_of_zero_is_the_plain_filter(propose):
    beliefs, model, y = tracked(propose, 3, 100, 4, 0.0)
    rng = generators(3, "tracked")
    plain = drawn(model.prior, rng, 100)
    for k in range(1, 5):
        x, fit, evidence = propose(model, plain.x, y[k - 1], k, rng)
        plain = weighted(x, plain.logw + fit + evidence, all_of(3, 100))
        found = beliefs[k].particles
        np.testing.assert_array_equal(found.x, plain.x)
        np.testing.assert_array_equal(found.logw, plain.logw)
        np.testing.assert_array_equal(found.loglik, plain.loglik)
        assert np.isnan(found.acceptance).all()


@proposals
def test_draws_from_the_prior_are_not_moved(propose):
    """However uneven their weights: no proposal made them."""
    model, rng = range_bearing(), generators(2, "prior")
    begin = drawn(model.prior, rng, 50)
    uneven = weighted(begin.x, np.random.default_rng(0).standard_normal((2, 50)) * 4, all_of(2, 50))
    after = move.step(propose, model, move.start(uneven), np.array([[1000.0] * 2, [3.0] * 2]), 1, rng, systematic, 1.0)
    assert np.isnan(after.particles.acceptance).all()
    again = resample(uneven, systematic, 1.0, replay(model, "prior"))
    np.testing.assert_array_equal(after.origins, again.x)
    assert (after.particles.ancestors < 50).all()


def replay(model, key):
    """The generators of that key after the prior was drawn."""
    rng = generators(2, key)
    drawn(model.prior, rng, 50)
    return rng


@proposals
def test_the_readout_is_that_of_the_particles(propose):
    belief = tracked(propose, 2, 50, 3, 1.0)[0][-1]
    for name in ("mean", "cov", "loglik", "ess", "ancestors", "acceptance"):
        np.testing.assert_array_equal(getattr(belief.read(), name), getattr(belief.particles.read(), name))
