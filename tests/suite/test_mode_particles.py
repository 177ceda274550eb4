"""Particles with modes: modes and states stay together, each particle follows its own mode, sums do not underflow."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy import stats
from scipy.special import logsumexp

from suite import particles
from suite.jump import JumpModel
from suite.mode_particles import ModeParticles, drawn, either, restricted, step
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.modes import LARGEST
from suite.noise import Gaussian
from suite.resampling import SCHEMES, systematic
from tests.oracles import generators

P = np.array([[0.5, 0.3, 0.2], [0.1, 0.6, 0.3], [0.0, 0.4, 0.6]])


def mode(shift, start=0.0, spread=1.0, noise=0.0):
    """x_k = x_{k-1} + shift + noise, y_k = x_k - shift + v_k; x_0 near the start."""
    return StateSpaceModel(
        Gaussian([start], [[spread]]),
        AdditiveTransition(Affine([[1.0]], np.array([shift])), Gaussian.noise([[noise]])),
        AdditiveSensor(Affine([[1.0]], np.array([-shift])), Gaussian.noise([[0.5 + shift]])),
    )


SHIFTS = np.array([0.0, 10.0, 200.0])
MODEL = JumpModel(tuple(mode(shift) for shift in SHIFTS), P, np.array([0.2, 0.3, 0.5]))


def with_weights(logw, modes, before=None):
    cloud = particles.weighted(np.zeros((1, *logw.shape)), logw, particles.all_of(*logw.shape))
    return ModeParticles(MODEL, cloud, modes, logw if before is None else before)


def test_modes_are_drawn_from_their_initial_law_and_states_from_that_modes_prior():
    # 6 figures at 5 standard errors: a false alarm has probability below 4e-6.
    model = replace(MODEL, modes=tuple(mode(0.0, start, spread) for start, spread in ((0, 1), (50, 4), (-90, 9))))
    cloud = drawn(model, generators(4, "drawn"), 5000)
    x, modes = cloud.particles.x[0].ravel(), cloud.modes.ravel()
    share = np.array([(modes == j).mean() for j in range(3)])
    assert (np.abs(share - model.initial) < 5 * np.sqrt(share * (1 - share) / len(modes))).all()
    for j, (start, deviation) in enumerate(((0, 1), (50, 2), (-90, 3))):
        own = x[modes == j]
        assert abs(own.mean() - start) < 5 * deviation / np.sqrt(len(own))
        assert np.abs(own - start).max() < 6 * deviation  # 20 000 draws: 4e-5
    np.testing.assert_allclose(cloud.particles.weights, 1 / 5000)


def test_particles_move_and_are_weighed_by_the_mode_they_jumped_to():
    # 9 frequencies at 5 standard errors: a false alarm has probability below 6e-6.
    start, y = drawn(MODEL, generators(5, "moved"), 4000), np.array([[0.5, -1.0, 0.0, 2.0, np.nan]])
    now = step(start, y, 1, generators(5, "moved", "step"), systematic, 0.0)
    np.testing.assert_allclose(now.particles.x[0], start.particles.x[0] + SHIFTS[now.modes], rtol=1e-12)
    for i in range(3):
        after, count = now.modes[start.modes == i], (start.modes == i).sum()
        share = np.array([(after == j).mean() for j in range(3)])
        assert (np.abs(share - P[i]) <= 5 * np.sqrt(P[i] * (1 - P[i]) / count)).all()
    # x_k - shift is where the particle was: the mode's own sensor takes back what its dynamics did.
    fit = stats.norm.logpdf(y.T, start.particles.x[0], np.sqrt(0.5 + SHIFTS[now.modes]))
    fit[4] = 0.0  # nothing was measured
    np.testing.assert_allclose(now.particles.loglik, logsumexp(fit, axis=1) - np.log(4000), atol=1e-12)
    np.testing.assert_allclose(now.particles.logw, fit - logsumexp(fit, axis=1, keepdims=True), atol=1e-10)
    np.testing.assert_array_equal(now.before, start.particles.logw)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_resampling_keeps_state_and_mode_together(scheme):
    """A mode for ever, and a state that tells which; sharp measurements in half of the runs make these resample."""
    modes = tuple(replace(mode(0.0, start, 0.01), sensor=mode(0.0).sensor) for start in (0.0, 10.0, 20.0))
    model = JumpModel(modes, np.eye(3), np.array([0.3, 0.3, 0.4]))
    belief, rng = drawn(model, generators(6, "carry"), 300), generators(6, "carry", scheme)
    fewer = np.zeros(6, bool)
    for k in range(1, 5):
        y = np.where(np.arange(6) % 2, 9.0 + k / 4, np.nan)[None]
        belief = step(belief, y, k, rng, SCHEMES[scheme], 0.5)
        fewer |= belief.particles.ancestors < 300
        np.testing.assert_array_equal(np.round(belief.particles.x[0] / 10), belief.modes)
    np.testing.assert_array_equal(fewer, np.arange(6) % 2 == 1)
    assert {0, 1, 2} == set(belief.modes[0].tolist())


def test_probabilities_of_modes_are_sums_of_weights():
    rng = np.random.default_rng(0)
    before, fit, modes = rng.standard_normal((7, 50)), 3 * rng.standard_normal((7, 50)), rng.integers(0, 3, (7, 50))
    before -= logsumexp(before, axis=1, keepdims=True)
    cloud = with_weights(before + fit, modes, before)
    pi = np.stack([(np.exp(before) * (modes == j)).sum(1) for j in range(3)])
    joint = np.stack([(np.exp(before + fit) * (modes == j)).sum(1) for j in range(3)])
    np.testing.assert_allclose(np.exp(cloud.predicted), pi, rtol=1e-12)
    np.testing.assert_allclose(np.exp(cloud.evidence), joint / pi / joint.sum(0), rtol=1e-12)
    now = cloud.read()
    np.testing.assert_allclose(now.mode, joint / joint.sum(0), rtol=1e-12)
    np.testing.assert_allclose(now.statistic, np.log((joint[1] + joint[2]) / joint[0]), rtol=1e-10)


def test_small_probabilities_keep_their_logarithm_and_no_particles_give_a_finite_statistic():
    logw = np.log([[0.5, 0.5, 0.5, 0.5]]) + np.array([[0.0, 0.0, -2000.0, -3000.0], [0, 0, 0, 0], [0, 0, 0, 0]])
    modes = np.array([[1, 1, 0, 2], [1, 2, 2, 1], [0, 0, 0, 0]])
    cloud = with_weights(logw, modes)
    np.testing.assert_allclose(cloud.logp[:, 0], [-2000 - np.log(2), 0.0, -3000 - np.log(2)], rtol=1e-14, atol=1e-14)
    np.testing.assert_array_equal(cloud.logp[:, 1:], [[-np.inf, 0.0], [np.log(0.5), -np.inf], [np.log(0.5), -np.inf]])
    np.testing.assert_allclose(cloud.read().statistic, [2000 + np.log(2), LARGEST, -LARGEST])
    assert cloud.evidence[0, 1] == -np.inf


def test_the_evidence_for_a_mode_is_not_lost_in_a_huge_likelihood():
    cloud = with_weights(np.array([[0.0, -16.0, -np.inf]]) - 1e17, np.array([[0, 1, 2]]), np.log([[0.6, 0.1, 0.3]]))
    np.testing.assert_allclose(cloud.evidence[:, 0], [-np.log(0.6), -16 - np.log(0.1), -np.inf], atol=1e-6)


def test_a_run_without_possible_particles_is_lost_alone():
    logw, modes = np.zeros((3, 4)), np.tile([0, 1, 2, 0], (3, 1))
    logw[1] = -np.inf
    with np.errstate(invalid="ignore"):
        cloud = with_weights(logw, modes)
        now = cloud.read()
    assert np.isnan(now.mean[:, 1]).all()
    assert np.isnan(now.mode[:, 1]).all()
    np.testing.assert_allclose(now.mode[:, [0, 2]], [[0.5, 0.5], [0.25, 0.25], [0.25, 0.25]])


@dataclass(frozen=True, eq=False)
class Counted:
    """A law that counts how often it is asked."""

    law: object
    calls: list

    dim = 1

    def sample(self, rng, x, k):
        self.calls.append("sample")
        return self.law.sample(rng, x, k)

    def logpdf(self, z, x, k):
        self.calls.append("logpdf")
        return self.law.logpdf(z, x, k)


def test_a_law_that_modes_share_is_asked_once_and_that_of_an_unreachable_mode_never():
    calls = []
    first, second, third = MODEL.modes
    shared, lonely = Counted(first.dynamics, calls), Counted(third.dynamics, ["never"])
    modes = (replace(first, dynamics=shared), replace(second, dynamics=shared), replace(third, dynamics=lonely))
    model = JumpModel(modes, [[0.5, 0.5, 0.0], [0.5, 0.5, 0.0], [0.5, 0.5, 0.0]], MODEL.initial)
    start = drawn(model, generators(3, "shared"), 20)
    now = step(start, np.zeros((1, 3)), 1, generators(3, "shared", "step"), systematic, 0.0)
    assert calls == ["sample"]
    assert lonely.calls == ["never"]
    np.testing.assert_array_equal(now.particles.x, start.particles.x)
    fit = np.where(now.modes == 0, *(m.sensor.logpdf(np.zeros((1, 3)), start.particles.x, 1) for m in modes[:2]))
    np.testing.assert_allclose(now.particles.logw, fit - logsumexp(fit, axis=1, keepdims=True), atol=1e-12)


def test_many_particles_go_through_in_blocks(monkeypatch):
    monkeypatch.setattr(particles, "BLOCK", 16)
    noisy = replace(MODEL, modes=tuple(mode(shift, noise=0.01) for shift in SHIFTS))
    start = drawn(noisy, generators(1, "blocks"), 50)
    now = step(start, np.zeros((1, 1)), 1, generators(1, "blocks", "step"), systematic, 0.0)
    moved = now.particles.x[0] - start.particles.x[0] - SHIFTS[now.modes]
    assert np.abs(moved).max() < 0.6  # 6 standard deviations
    assert len(np.unique(moved)) == 50
    fit = stats.norm.logpdf(0.0, now.particles.x[0] - SHIFTS[now.modes], np.sqrt(0.5 + SHIFTS[now.modes]))
    np.testing.assert_allclose(now.particles.logw, fit - logsumexp(fit, axis=1, keepdims=True), atol=1e-10)
    np.testing.assert_allclose(np.exp(now.logp).sum(0), 1)


def test_restriction_renormalises_and_never_ends():
    np.testing.assert_allclose(restricted(MODEL, [1, 2]).transition, [[0, 0.6, 0.4], [0, 2 / 3, 1 / 3], [0, 0.4, 0.6]])
    np.testing.assert_allclose(restricted(MODEL, [0]).transition, [[1, 0, 0]] * 3)
    ends = replace(MODEL, transition=np.eye(3))
    np.testing.assert_allclose(restricted(ends, [0, 2]).transition, [[1, 0, 0], [0.5, 0, 0.5], [0, 0, 1]])
    assert restricted(MODEL, [1]).modes is MODEL.modes


def test_runs_are_taken_from_either_side():
    one, other = (drawn(MODEL, generators(3, "side", i), 10) for i in range(2))
    other = replace(other, model=restricted(MODEL, [1, 2]))
    both = either(np.array([True, False, True]), one, other)
    assert both.model is other.model
    for r, side in enumerate((one, other, one)):
        for part in ("modes", "before"):
            np.testing.assert_array_equal(getattr(both, part)[r], getattr(side, part)[r])
        for part in ("logw", "weights", "loglik", "ancestors"):
            np.testing.assert_array_equal(getattr(both.particles, part)[r], getattr(side.particles, part)[r])
        np.testing.assert_array_equal(both.particles.x[:, r], side.particles.x[:, r])
