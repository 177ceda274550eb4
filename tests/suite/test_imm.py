"""The parts of the interacting multiple model algorithm, against sums written out."""

import dataclasses

import numpy as np

from suite import imm, moment_rules
from suite.gaussian import prior
from suite.jump import JumpModel
from suite.jump_filter import filtered, priors
from suite.model import AdditiveSensor, Affine
from tests.jump_oracles import THREE, TWO


def mixture(seed, count, runs, n):
    """Weights [R, M], one of them zero, means [M, R, n] and factors [M, R, n, n] of covariances, some of them singular."""
    rng = np.random.default_rng(seed)
    weights = rng.dirichlet(np.ones(count), runs)
    weights[0] = np.eye(count)[0]
    roots = rng.standard_normal((count, runs, n, n)) * (rng.random((count, runs, n, 1)) > 0.3)
    return weights, 5 * rng.standard_normal((count, runs, n)), roots


def moments(weights, means, covs):
    """Mean and covariance of a mixture: weights[M], means[M, n], covs[M, n, n]."""
    mean = sum(w * m for w, m in zip(weights, means, strict=True))
    return mean, sum(w * (P + np.outer(m - mean, m - mean)) for w, m, P in zip(weights, means, covs, strict=True))


def test_modes_start_from_what_leads_to_them():
    rng = np.random.default_rng(1)
    weights, means, roots = mixture(2, 3, 4, 2)
    begin = dataclasses.replace(imm.init(THREE.model, 4), mean=means, root=roots, logp=np.log(weights.T + 1e-300))
    mixing = rng.dirichlet(np.ones(3), (3, 4)).transpose(2, 0, 1)
    found_mean, found_root = imm.mixed(begin, mixing)
    for j, r in np.ndindex(3, 4):
        mean, cov = moments(mixing[:, j, r], means[:, r], roots[:, r] @ np.swapaxes(roots[:, r], -1, -2))
        np.testing.assert_allclose(found_mean[j, r], mean, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(found_root[j, r] @ found_root[j, r].T, cov, rtol=1e-11, atol=1e-11)


def test_the_belief_keeps_what_a_detector_needs():
    """ahead are the log-probabilities before the measurement, fits its log-likelihoods: together they give all the others."""
    _, y, _ = THREE.simulate(steps=3, runs=2, seed=1)
    model = THREE.model
    belief = imm.init(model, 2)
    for k in (1, 2, 3):
        before, belief = belief, imm.step(moment_rules.affine, model, belief, y[k - 1], k)
        np.testing.assert_allclose(np.exp(belief.ahead), THREE.P.T @ np.exp(before.logp), rtol=1e-12)
        joint = np.exp(belief.ahead + belief.fits)
        np.testing.assert_allclose(np.exp(belief.loglik), joint.sum(0), rtol=1e-12)
        np.testing.assert_allclose(np.exp(belief.logp), joint / joint.sum(0), rtol=1e-12)


def test_priors_are_those_of_the_modes():
    mean, root = priors(THREE.model, 2)
    for j, p in enumerate(THREE.modes):
        np.testing.assert_array_equal(mean[j], [p.m0, p.m0])
        np.testing.assert_allclose(root[j] @ np.swapaxes(root[j], 1, 2), [p.P0, p.P0], rtol=1e-12)


def test_modes_that_share_a_sensor_are_filtered_as_if_each_had_its_own():
    model = THREE.model
    first, second, third = model.modes
    shared = JumpModel((first, second, dataclasses.replace(third, sensor=first.sensor)), THREE.P, THREE.p0)
    alike = AdditiveSensor(first.sensor.mean, first.sensor.noise)
    apart = JumpModel((first, second, dataclasses.replace(third, sensor=alike)), THREE.P, THREE.p0)
    _, y, _ = THREE.simulate(steps=1, runs=5, seed=1)
    y[0, 0, 1] = y[0, 1, 2] = y[0, :, 3] = np.nan
    start = priors(model, 5)
    for one, other in zip(*(filtered(moment_rules.affine, m, *start, y[0], 1) for m in (shared, apart)), strict=True):
        np.testing.assert_array_equal(one, other)


def test_all_modes_may_start_from_one_belief():
    _, y, _ = TWO.simulate(steps=1, runs=3, seed=1)
    start = prior(TWO.model.modes[0], 3)
    common = filtered(moment_rules.affine, TWO.model, start.mean, start.root, y[0], 1)
    repeated = filtered(moment_rules.affine, TWO.model, *(np.stack([a, a]) for a in (start.mean, start.root)), y[0], 1)
    for one, other in zip(common, repeated, strict=True):
        np.testing.assert_array_equal(one, other)


def test_numbers_that_are_lost_become_zeros_of_likelihood_zero():
    """In one mode and run: a sensor that gives no number, and a measurement too far away to square."""
    model = TWO.model
    blind = AdditiveSensor(Affine(np.full((2, 2), np.nan)), model.modes[1].sensor.noise)
    broken = dataclasses.replace(model, modes=(model.modes[0], dataclasses.replace(model.modes[1], sensor=blind)))
    y = np.array([[0.0, 1e200], [0.0, 0.0]])
    start = priors(model, 2)
    with np.errstate(all="ignore"):
        mean, root, fits = filtered(moment_rules.affine, broken, *start, y, 1)
        sound = filtered(moment_rules.affine, model, *start, y, 1)
    np.testing.assert_array_equal(mean[0, 0], sound[0][0, 0])
    np.testing.assert_array_equal(root[0, 0], sound[1][0, 0])
    assert np.isfinite(fits[0, 0])
    for j, r in ((1, 0), (1, 1), (0, 1)):
        assert (mean[j, r] == 0).all()
        assert (root[j, r] == 0).all()
        assert fits[j, r] == -np.inf
