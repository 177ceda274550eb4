"""Sequential importance sampling with and without resampling: when it resamples, and what the weights are if it never does."""

import dataclasses

import numpy as np
from scipy import stats
from scipy.special import logsumexp, softmax

from estimators.bootstrap import Bootstrap
from estimators.guided import Guided
from estimators.isir import Isir
from estimators.resample_move import ResampleMove
from estimators.sir import SequentialImportanceResampling
from estimators.sis import SequentialImportanceSampling
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian
from suite.random import Streams
from tests.estimators.references import PAIR, SIDES, repeated, without_gain

Y = PAIR.simulate(steps=12, runs=20, seed=1)[1]


def same(a, b):
    for part in ("mean", "cov", "loglik", "ess", "ancestors"):
        np.testing.assert_array_equal(getattr(a, part), getattr(b, part))


def test_the_threshold_leads_from_importance_sampling_to_the_bootstrap_filter():
    sir = SequentialImportanceResampling(particles=50)
    model = without_gain(PAIR)
    never, always = (dataclasses.replace(sir, threshold=t).run(model, Y, 1) for t in (0.0, 1.0))
    same(never, SequentialImportanceSampling(particles=50).run(model, Y, 1))
    same(always, Bootstrap(particles=50).run(model, Y, 1))
    same(never, ResampleMove(particles=50, threshold=0.0).run(model, Y, 1))
    assert not np.array_equal(sir.run(model, Y, 1).mean, never.mean)
    # Nor does a filter move that never resamples.
    same(*(make(particles=50, threshold=0.0).run(SIDES, Y[:, :1], 1) for make in (Guided, Isir)))


def test_it_resamples_when_few_particles_are_effective():
    """A run that was not resampled has as many ancestors as particles; one that was has fewer."""
    for threshold in (0.2, 0.5, 0.8):
        estimate = SequentialImportanceResampling(particles=80, threshold=threshold).run(without_gain(PAIR), Y, 2)
        low = estimate.ess[:-1] < threshold * 80
        np.testing.assert_array_equal(estimate.ancestors[1:] < 80, low)
        assert 0 < low.mean() < 1
        assert (estimate.ancestors[0] == 80).all()


def test_weights_of_a_constant_state_are_the_products_of_its_likelihoods():
    model = StateSpaceModel(
        Gaussian([1.0], [[4.0]]),
        AdditiveTransition(Affine([[1.0]]), Gaussian.noise([[0.0]])),
        AdditiveSensor(Affine([[1.0]]), Gaussian.noise([[0.3]])),
    )
    y = np.array([2.0, np.nan, 1.5, 2.4, 2.2, 1.9, 2.1])
    estimate = SequentialImportanceSampling(particles=60).run(model, repeated(y[:, None, None], 4), 5)
    x = model.prior.sample(Streams.of(5).batch(0, 4), (4, 60))[0]
    logw = np.cumsum(np.nan_to_num(stats.norm.logpdf(y[:, None, None], x, np.sqrt(0.3))), axis=0)
    weights = softmax(logw, axis=-1)
    mean = (weights * x).sum(-1)
    np.testing.assert_allclose(estimate.mean[:, 0], mean, rtol=1e-10)
    np.testing.assert_allclose(estimate.cov[:, 0, 0], (weights * x**2).sum(-1) - mean**2, rtol=1e-7)
    np.testing.assert_allclose(estimate.ess, 1 / (weights**2).sum(-1), rtol=1e-9)
    np.testing.assert_allclose(np.cumsum(estimate.loglik, axis=0), logsumexp(logw, axis=-1) - np.log(60), rtol=1e-9)


def test_without_resampling_the_weights_degenerate():
    y = PAIR.simulate(steps=40, runs=50, seed=2)[1]
    model = without_gain(PAIR)
    without = np.median(SequentialImportanceSampling(particles=100).run(model, y, 1).ess, axis=1)
    resampled = np.median(SequentialImportanceResampling(particles=100).run(model, y, 1).ess, axis=1)
    assert (without[20:] < 5).all()
    assert (resampled[20:] > 20).all()
