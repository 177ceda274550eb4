"""The bootstrap filter: what is its own, beside what `test_particle_filters` asks of all."""

import numpy as np
from scipy import stats

from estimators.bootstrap import Bootstrap
from suite.case import draw
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian, StudentT
from suite.random import Streams
from tests.estimators.references import PLANE, repeated, unbiased
from tests.oracles import generators, grid_filter, joint_loglik, random_linear


def test_likelihood_is_unbiased_and_its_logarithm_is_not():
    # 5 standard errors of 6000 independent runs: a false alarm has probability below 1e-6. Here the likelihood comes from one
    # joint Gaussian, without a recursion.
    _, y = PLANE.simulate(steps=4, runs=1, seed=3)
    y[1] = np.nan
    exact = joint_loglik(PLANE, y[:, :, 0])
    estimate = Bootstrap(particles=60).run(PLANE.model, repeated(y, 6000), 4)
    ratio = np.exp(estimate.loglik.sum(0) - exact)
    assert ratio.std() < 3
    assert abs(ratio.mean() - 1) < 5 * ratio.std() / np.sqrt(len(ratio))
    # Its logarithm is biased: the test above is not so blunt that it would miss that.
    assert np.log(ratio).mean() < -5 * np.log(ratio).std() / np.sqrt(len(ratio))


def test_heavy_tailed_noise_agrees_with_a_grid_filter():
    # 4 steps x 3 figures of 3000 runs, 6 standard errors: a false alarm has probability below 1e-7.
    model = StateSpaceModel(
        Gaussian([1.0], [[2.0]]),
        AdditiveTransition(Affine([[0.9]]), Gaussian.diagonal([1.0])),
        AdditiveSensor(Affine([[1.0]]), StudentT([[0.5]], 3.0)),
    )
    y = np.array([1.0, 9.0, 0.0, -1.0])
    grid = np.linspace(-25, 25, 1001)
    mean, variance, loglik = grid_filter(
        grid,
        stats.norm.pdf(grid, 1, np.sqrt(2)),
        lambda x, k: 0.9 * x,
        1.0,
        lambda z, x: stats.t.pdf((z - x) / np.sqrt(0.5), 3) / np.sqrt(0.5),
        y,
    )
    estimate = Bootstrap(particles=200).run(model, repeated(y[:, None, None], 3000), 2)
    worst = np.abs(unbiased(estimate, mean[:, None], variance[:, None, None], loglik)).max()
    assert worst < 6


def test_one_particle_carries_its_own_prediction():
    _, y = PLANE.simulate(steps=5, runs=3, seed=7)
    estimate = Bootstrap(particles=1).run(PLANE.model, y, 1)
    # With one particle there is nothing to weight: the mean is a path of the dynamics, the likelihood that of the path.
    error = y - np.einsum("mn,tnr->tmr", PLANE.H, estimate.mean) - (PLANE.h + PLANE.v)[:, None]
    np.testing.assert_allclose(estimate.loglik, stats.norm.logpdf(error[:, 0], 0, np.sqrt(PLANE.R[0, 0])), rtol=1e-9)


def test_missing_measurements_change_no_weight():
    model = random_linear(9, 3, 2, 2).model
    y = draw(model, 6, generators(4, "missing")).y
    y[2] = np.nan
    y[4, :, 1] = np.nan
    estimate = Bootstrap(particles=200).run(model, y, 1)
    for step, run in [(2, slice(None)), (4, 1)]:
        np.testing.assert_allclose(estimate.loglik[step, run], 0, atol=1e-13)
        np.testing.assert_allclose(estimate.ess[step, run], 200, rtol=1e-12)
    # Without measurements at all the particles are draws of the predicted law: unweighted means, and nothing is resampled.
    blind = Bootstrap(particles=200).run(model, np.full_like(y, np.nan), 1)
    rng = Streams.of(1).batch(0, 4)
    x = model.prior.sample(rng, (4, 200))
    for k in range(1, 4):
        x = model.dynamics.sample(rng, x, k)
        np.testing.assert_allclose(blind.mean[k - 1], x.mean(-1), rtol=1e-10)
