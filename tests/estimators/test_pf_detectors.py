"""Particle detectors of manoeuvres: their statistics against scalar recursions, their estimates against exact mixtures."""

import dataclasses

import numpy as np
import pytest
from scipy import stats
from scipy.special import expit, logit

from estimators.multiple_model_pf import MultipleModelParticleFilter
from estimators.pf_cusum import ParticleCusum
from estimators.pf_sprt import ParticleSprt
from suite.detection import wald
from suite.estimator import LOST
from suite.jump import JumpModel
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.modes import LARGEST
from suite.noise import Gamma, Gaussian
from tests.estimators.references import repeated, scores, unbiased
from tests.jump_oracles import THREE, TWO, enumeration
from tests.oracles import generators

DETECTORS = [ParticleCusum(particles=200), ParticleSprt(particles=200)]
R = 0.5


def certain(memory, shifts, transition, nominal=0, noise=None):
    """Modes x_k = memory · x_{k-1} + shift without noise, from x_0 = 0, seen with noise: a mode's particles are all alike."""
    sensor = AdditiveSensor(Affine([[1.0]]), noise or Gaussian.noise([[R]]))
    modes = tuple(
        StateSpaceModel(
            Gaussian([0.0], [[0.0]]), AdditiveTransition(Affine([[memory]], np.array([shift])), Gaussian.noise([[0.0]])), sensor
        )
        for shift in shifts
    )
    start = np.eye(len(shifts))[nominal]
    return JumpModel(modes, transition, start, nominal)


def density(y, x):
    return stats.norm.logpdf(y, x, np.sqrt(R))


STICKY = [[0.9, 0.1], [0.2, 0.8]]
FORGETFUL = certain(0.0, [-0.5, 0.7], STICKY)
"""The position tells the mode and nothing else: both predictive likelihoods are known, and independent from step to step."""


def measured(truth, steps, runs, *key):
    return truth + np.sqrt(R) * generators(runs, "detectors", *key).standard_normal((1, runs, steps)).transpose(2, 0, 1)


# The cumulative sum.


def test_cusum_estimates_what_the_multiple_model_filter_does():
    y = THREE.simulate(steps=6, runs=4, seed=1)[1]
    detector = ParticleCusum(particles=100)
    plain = MultipleModelParticleFilter(particles=100, threshold=detector.threshold).run(THREE.model, y, 1)
    found = detector.run(THREE.model, y, 1)
    for part in ("mean", "cov", "loglik", "ess", "ancestors", "mode"):
        np.testing.assert_array_equal(getattr(found, part), getattr(plain, part))
    assert not np.array_equal(found.statistic, plain.statistic)


@pytest.mark.parametrize("nominal", [0, 1, 2])
def test_cusum_is_the_recursion_of_its_own_particles(nominal):
    """From the weights that particles have before y_k, and their likelihoods by scipy, without logarithms of sums."""
    y = THREE.simulate(steps=12, runs=6, seed=2)[1]
    y[4] = np.nan
    y[7, 0] = np.nan
    model = dataclasses.replace(THREE.model, nominal=nominal)
    detector, rng = ParticleCusum(particles=300), generators(6, "recursion", nominal)
    belief, total, seen = detector.init(model, rng), np.zeros(6), []
    for k, z in enumerate(y, start=1):
        belief = detector.step(model, belief, z, k, rng)
        x, modes, weights = belief.cloud.particles.x, belief.cloud.modes, np.exp(belief.cloud.before)
        np.testing.assert_allclose(weights.sum(1), 1)
        for r in range(6):
            rows, pi, joint = np.flatnonzero(~np.isnan(z[:, r])), np.zeros(3), np.zeros(3)
            for j, p in enumerate(THREE.modes):
                inside = modes[r] == j
                error = (z[:, r] - p.h - p.v)[rows] - (p.H @ x[:, r, inside]).T[:, rows]
                likelihood = (
                    stats.multivariate_normal(np.zeros(len(rows)), p.R[np.ix_(rows, rows)]).pdf(error) if len(rows) else 1
                )
                pi[j], joint[j] = weights[r, inside].sum(), (weights[r, inside] * likelihood).sum()
            others = [j for j in range(3) if j != nominal]
            if pi[nominal] and pi[others].any():  # a side without particles predicts nothing
                ratio = joint[others].sum() / pi[others].sum() / (joint[nominal] / pi[nominal])
                total[r] = max(0.0, total[r] + np.log(ratio))
        np.testing.assert_allclose(detector.read(belief).statistic, total, rtol=1e-9, atol=1e-9)
        seen.append(total.copy())
    assert np.max(seen) > 1
    assert np.diff(seen, axis=0).min() < -0.1


def test_cusum_of_known_likelihoods_is_pages():
    y = measured(0.1, 60, 5, "page")
    y[20:23, 0, 2:] = np.nan
    ratio = np.nan_to_num(density(y, 0.7) - density(y, -0.5))[:, 0]
    sums = np.concatenate([np.zeros((1, 5)), np.cumsum(ratio, axis=0)])
    expected = (sums - np.minimum.accumulate(sums))[1:]  # the rise above the least value so far
    found = ParticleCusum(particles=200).run(FORGETFUL, y, 3)
    np.testing.assert_allclose(found.statistic, expected, atol=1e-10)
    assert (expected == 0).any()


@pytest.mark.parametrize(("truth", "sign"), [(-0.5, -1), (0.7, 1)], ids=["nominal", "manoeuvre"])
def test_evidence_points_to_what_is_true_by_kullback_and_leiblers_divergence(truth, sign):
    # 1.2² / (2 R) = 1.44 in either direction. 5 standard errors: a false alarm has probability below 6e-7.
    y = measured(truth, 20, 200, "divergence")
    detector, rng = ParticleCusum(particles=100), generators(200, "divergence")
    belief, ratios = detector.init(FORGETFUL, rng), []
    for k, z in enumerate(y, start=1):
        belief = detector.step(FORGETFUL, belief, z, k, rng)
        ratios.append(belief.cloud.evidence[1] - belief.cloud.evidence[0])
    ratios = np.concatenate(ratios)
    error = ratios.std() / np.sqrt(ratios.size)
    assert abs(ratios.mean() - sign * 1.44) < 5 * error
    assert error < 0.05
    # The sum grows by as much a step, or stays within a few nats of zero.
    growth = belief.total / 20
    assert (np.abs(growth.mean() - 1.44) < 0.15) if sign > 0 else (growth.mean() < 0.05)


# The repeated sequential probability ratio test.


def repeated_test(y, lower, odds, ahead):
    """Scalar recursion of one run: statistic, mean, variance, log-likelihood and manoeuvre's probability, a row each.

    ahead(steps since time 0, steps since the test began, hypothesis): where the target would be.
    """
    total, since, found = 0.0, 0, []
    for k, z in enumerate(y, start=1):
        at = np.array([ahead(k, since + 1, h) for h in (0, 1)])
        share = expit(odds + total)
        fit = np.zeros(2) if np.isnan(z) else density(z, at)
        loglik = np.log((1 - share) * np.exp(fit[0]) + share * np.exp(fit[1]))
        total += fit[1] - fit[0]
        begins = total <= lower or (np.isnan(z) and since == 0)
        total, since = (0.0, 0) if begins else (total, since + 1)
        share = 0.0 if begins else expit(odds + total)  # a new test begins with two equal filters
        mean = (1 - share) * at[0] + share * at[1]
        found.append((total, mean, share * (1 - share) * (at[1] - at[0]) ** 2, loglik, share))
    return np.array(found).T


@pytest.mark.parametrize(
    ("memory", "ahead"),
    [(0.0, lambda k, since, h: (-0.5, 0.7)[h]), (1.0, lambda k, since, h: -0.5 * k + 1.2 * since * h)],
    ids=["forgetful", "drifting"],
)
def test_sprt_of_known_likelihoods_is_the_scalar_recursion(memory, ahead):
    """Of a drifting target the second filter remembers where the first was when the test began: gaps, restarts and all."""
    model = certain(memory, [-0.5, 0.7], STICKY)
    detector = ParticleSprt(particles=30, false_alarm=0.1, miss=0.2)
    y = measured(0.0, 40, 6, "sprt")
    if memory:
        y += (-0.5 * np.arange(1, 41) + 1.2 * np.clip(np.arange(40) - 25, 0, 6))[:, None, None]
    y[[0, 1, 9, 10, 28]] = np.nan
    y[15:18, 0, 3:] = np.nan
    found = detector.run(model, y, 1)
    exact = [repeated_test(y[:, 0, r], wald(0.1, 0.2)[0], logit(0.1), ahead) for r in range(6)]
    total, mean, variance, loglik, share = np.stack(exact, axis=-1)
    np.testing.assert_allclose(found.statistic, total, atol=1e-9)
    np.testing.assert_allclose(found.mean[:, 0], mean, atol=1e-9)
    np.testing.assert_allclose(found.cov[:, 0, 0], variance, atol=1e-9)
    np.testing.assert_allclose(found.loglik, loglik, atol=1e-9)
    np.testing.assert_allclose(found.mode, np.stack([1 - share, share], axis=1), atol=1e-9)
    np.testing.assert_allclose(found.ess, 30, rtol=1e-9)
    np.testing.assert_array_equal(found.ancestors, 30)
    assert (total == 0).any(0).all()
    assert (total < 0).any()
    assert (total.max(0) > 2).all()


@pytest.mark.parametrize("problem", [TWO, THREE], ids=["two", "three"])
def test_a_test_that_never_ends_compares_two_models_exactly(problem):
    # With a lower threshold out of reach the filter is a Bayesian one of two hypotheses: nominal for ever, or manoeuvring for
    # ever. Both are exactly known, and so are the figures' expectations. 6 standard errors of 3000 runs, fewer than 100
    # figures: a false alarm has probability below 1e-6.
    y = problem.simulate(steps=4, runs=1, seed=3)[1]
    y[1] = np.nan
    y[2, 1] = np.nan
    count = len(problem.modes)
    leaving = problem.P[0].copy()
    leaving[0] = 0.0
    stay = np.where(np.arange(count) == 0, 1.0, np.zeros((count, count)))
    go = np.where(np.arange(count) == 0, 0.0, problem.P)
    rivals = [enumeration(dataclasses.replace(problem, P=P / P.sum(1, keepdims=True)), y) for P in (stay, go)]
    prior = np.array([1 - leaving.sum(), leaving.sum()])
    joint = prior[:, None] * np.exp([np.cumsum(rival.loglik[:, 0]) for rival in rivals])
    share = joint / joint.sum(0)
    means, covs, modes = (np.stack([getattr(rival, part)[..., 0] for rival in rivals]) for part in ("mean", "cov", "mode"))
    mean = np.einsum("ht,htn->tn", share, means)
    away = means - mean
    cov = np.einsum("ht,htij->tij", share, covs + away[..., None] * away[..., None, :])
    loglik = np.diff(np.log(joint.sum(0)), prepend=0.0)

    estimate = ParticleSprt(particles=60, miss=1e-300).run(problem.model, repeated(y, 3000), 4)
    assert np.abs(unbiased(estimate, mean, cov, loglik)).max() < 6
    ratio = np.exp(np.cumsum(estimate.loglik - loglik[:, None], axis=0))
    mode = np.einsum("ht,htm->tm", share, modes)
    assert np.abs(scores(ratio[:, None] * (estimate.mode - mode[:, :, None]), 0.0)).max() < 6
    # Both hypotheses have a say: the test would notice if one were left out.
    assert 0.02 < share[1, -1] < 0.98


def test_each_rival_keeps_to_its_modes_and_restarts_from_the_nominal_one():
    y = THREE.simulate(steps=15, runs=8, seed=4)[1]
    detector, rng = ParticleSprt(particles=50), generators(8, "rivals")
    belief, began = detector.init(THREE.model, rng), 0
    for k, z in enumerate(y, start=1):
        belief = detector.step(THREE.model, belief, z, k, rng)
        rest = belief.total == 0
        began += rest.sum()
        assert (belief.nominal.modes == 0).all()
        assert (belief.manoeuvre.modes[~rest] > 0).all()
        np.testing.assert_array_equal(belief.manoeuvre.modes[rest], 0)
        np.testing.assert_array_equal(belief.manoeuvre.particles.x[:, rest], belief.nominal.particles.x[:, rest])
        np.testing.assert_array_equal(belief.manoeuvre.particles.logw[rest], belief.nominal.particles.logw[rest])
    assert began > 8


def test_a_model_of_nominal_motion_alone_is_refused():
    only = JumpModel(TWO.model.modes[:1], [[1.0]], [1.0])
    assert "no mode but the nominal one" in ParticleSprt().accepts(only)
    assert ParticleSprt().accepts(TWO.modes[0].model) == "the model has a single mode"
    assert ParticleSprt().accepts(TWO.model) is None


# Both.


@pytest.mark.parametrize("detector", DETECTORS, ids=lambda d: d.name)
def test_missing_measurements_add_nothing(detector):
    """Not even the rounding of sums of weights: in so many runs it would show."""
    y = np.tile(THREE.simulate(steps=12, runs=20, seed=6)[1], 20)
    y[[0, 4, 5, 11]] = np.nan
    y[7, :, 2:60] = np.nan
    statistic = dataclasses.replace(detector, particles=50).run(THREE.model, y, 1).statistic
    before = np.concatenate([np.zeros((1, 400)), statistic[:-1]])
    empty = np.isnan(y).all(1)
    np.testing.assert_array_equal(statistic[empty], before[empty])
    assert (statistic[~empty] != before[~empty]).mean() > 0.5


@pytest.mark.parametrize("detector", DETECTORS, ids=lambda d: d.name)
def test_the_statistic_rises_in_a_manoeuvre_and_not_before(detector):
    """Twelve steps of constant velocity, then a push of seven standard deviations a step: hardly a matter of chance."""
    steps, runs = 18, 20
    push = np.where(np.arange(steps) < 12, 0.0, 1.5)
    velocity = 1.0 + np.cumsum(push)
    position = np.cumsum(velocity - push / 2)
    x = np.stack([position, velocity])
    noise = np.linalg.cholesky(TWO.modes[0].R) @ generators(runs, "push").standard_normal((2, runs, steps)).reshape(2, -1)
    y = (TWO.modes[0].H @ x).T[:, :, None] + noise.reshape(2, runs, steps).transpose(2, 0, 1)
    statistic = dataclasses.replace(detector, particles=500).run(TWO.model, y, 1).statistic
    assert (statistic[:12].max(0) < statistic[12:].max(0)).all()
    assert np.median(statistic[11]) <= 0.5
    assert (statistic[14:].max(0) > 4).all()


def gamma_model():
    """Measurements are above the position: at y < 5 the nominal mode is impossible, at y < 0 both are."""
    return certain(0.0, [5.0, 0.0], STICKY, noise=Gamma([2.0], [3.0]))


@pytest.mark.parametrize("detector", DETECTORS, ids=lambda d: d.name)
def test_what_is_impossible_in_one_mode_settles_it_and_in_both_loses_that_run_alone(detector):
    y = np.full((4, 1, 3), 9.0)
    y[1, 0, 1], y[1, 0, 2] = 3.0, -1.0
    found = detector.run(gamma_model(), y, 1)
    alone = detector.run(gamma_model(), y[:, :, :1], 1)
    np.testing.assert_array_equal(found.mean[..., 0], alone.mean[..., 0])
    assert [found.status[r] == LOST for r in range(3)] == [False, False, True]
    assert found.reason[2].startswith("step 2: ")
    assert "zero likelihood" in found.reason[2]
    assert np.isfinite(found.statistic[:, :2]).all()
    assert (found.statistic[1:, 1] >= LARGEST / 2).all()
    np.testing.assert_allclose(found.mean[1, 0, 1], 0.0, atol=1e-12)
    np.testing.assert_allclose(found.mode[1, :, 1], [0.0, 1.0], atol=1e-12)


def test_a_manoeuvre_that_becomes_impossible_ends_the_test():
    """The second filter loses all its particles, and goes on from the first's."""
    model = certain(0.0, [0.0, 5.0], STICKY, noise=Gamma([2.0], [3.0]))
    y = np.array([9.0, 9.5, 3.0, 9.0])[:, None, None]
    found = ParticleSprt(particles=40).run(model, y, 1)
    ratio = (stats.gamma(2, scale=3).logpdf(y - 5) - stats.gamma(2, scale=3).logpdf(y))[:, 0, 0]
    np.testing.assert_allclose(found.statistic[:, 0], [ratio[0], ratio[:2].sum(), 0.0, ratio[3]], atol=1e-10)
    assert found.ok.all()
    np.testing.assert_allclose(found.mean[2], 0.0, atol=1e-12)
