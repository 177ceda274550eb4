"""Filters with the linearised proposal, and filters that move: guided, ISIR, resample-move."""

import dataclasses

import numpy as np
import pytest
from scipy import stats
from scipy.special import logsumexp

from cases import CASES
from estimators.bootstrap import Bootstrap
from estimators.guided import Guided
from estimators.isir import Isir
from estimators.resample_move import ResampleMove
from suite.model import StateSpaceModel
from suite.noise import Gaussian
from suite.random import Streams
from tests.estimators.references import PAIR, SIDES, normal, repeated, scores, unbiased, without_gain
from tests.oracles import filterpy_kalman

LINEARISED = pytest.mark.parametrize("make", [Guided, Isir])


@LINEARISED
def test_on_a_linear_sensor_weights_do_not_depend_on_the_draw(make):
    """The first step's weights follow from the prior draws alone: they are N(y; H f(x) + h, H Q H' + R)."""
    y = PAIR.simulate(steps=1, runs=4, seed=1)[1]
    model = without_gain(PAIR)
    estimate = make(particles=50).run(model, y, 3)
    x = model.prior.sample(Streams.of(3).batch(0, 4), (4, 50))
    expected = np.einsum("mi,ij,jrn->mrn", PAIR.H, PAIR.A, x) + (PAIR.H @ PAIR.a + PAIR.h)[:, None, None]
    innovation = stats.multivariate_normal(np.zeros(2), PAIR.H @ PAIR.Q @ PAIR.H.T + PAIR.R)
    logw = innovation.logpdf(np.moveaxis(y[0][:, :, None] - expected, 0, -1))
    total = logsumexp(logw, axis=-1)
    np.testing.assert_allclose(estimate.loglik[0], total - np.log(50), rtol=1e-10)
    np.testing.assert_allclose(estimate.ess[0], np.exp(2 * total - logsumexp(2 * logw, axis=-1)), rtol=1e-9)


def test_on_a_linear_sensor_every_move_is_accepted():
    estimate = Isir(particles=50).run(without_gain(PAIR), PAIR.simulate(steps=15, runs=20, seed=1)[1], 3)
    moved = np.isfinite(estimate.acceptance[1:])
    np.testing.assert_array_equal(moved, estimate.ess[:-1] < 0.6 * 50)
    assert 0 < moved.mean() < 1
    assert np.isnan(estimate.acceptance[0]).all()
    np.testing.assert_array_equal(estimate.acceptance[1:][moved], 1)


def test_a_sharp_sensor_costs_the_guided_filter_nothing():
    # The transition knows nothing of a sensor a tenth as wide as itself: the bootstrap filter keeps few particles, the other
    # nearly all; their errors over 200 runs differ by more than a factor of 2.
    sharp = dataclasses.replace(PAIR, R=PAIR.R / 200)
    _, y = sharp.simulate(steps=6, runs=1, seed=2)
    mean, _, _ = filterpy_kalman(sharp, y[:, :, 0])
    guided, blind = (make(particles=100).run(without_gain(sharp), repeated(y, 200), 1) for make in (Guided, Bootstrap))
    errors = [np.sqrt(((e.mean[1:] - mean[1:, :, None]) ** 2).mean()) for e in (guided, blind)]
    assert errors[0] < errors[1] / 2
    assert guided.ess[1:].mean() > 2 * blind.ess[1:].mean()


@pytest.mark.parametrize("scheme", ["multinomial", "stratified"])
@pytest.mark.parametrize("make", [Isir, ResampleMove])
def test_figures_are_unbiased_when_every_step_moves(make, scheme):
    # 4 steps x 6 figures in four tests, 6 standard errors: a false alarm has probability below 1e-6.
    _, y = PAIR.simulate(steps=4, runs=1, seed=3)
    estimate = make(particles=30, threshold=1.0, resampling=scheme).run(without_gain(PAIR), repeated(y, 2000), 1)
    worst = np.abs(unbiased(estimate, *filterpy_kalman(PAIR, y[:, :, 0]))).max()
    assert worst < 6
    assert np.isfinite(estimate.acceptance[1:]).all()


@pytest.mark.parametrize("make", [Isir, ResampleMove])
def test_moves_are_accepted_as_often_as_the_proposal_says(make):
    """From a known state all particles share an origin: the share accepted is E min(1, w(x')/w(x)), a double sum on a grid.

    x' is from the proposal q, x from the posterior p f, and w = p f / q. The second of two steps reports it.
    """
    model = StateSpaceModel(Gaussian([3.0], [[0.0]]), SIDES.dynamics, SIDES.sensor)
    y = np.array([[[2.2]], [[1.0]]])
    grid = np.linspace(-3, 8, 1101)
    step, noise = grid[1] - grid[0], model.dynamics.noise_cov(1)[0, 0]
    ahead = 0.8 * 3 + 2 * np.sin(3.0) + 0.5 * np.cos(1.0)
    prior, likelihood = normal(grid - ahead, noise), normal(y[0, 0, 0] - np.sqrt(1 + grid**2), 2.0)
    if make is Isir:
        slope = ahead / np.sqrt(1 + ahead**2)
        gain = noise * slope / (slope**2 * noise + 2.0)
        proposal = normal(grid - ahead - gain * (y[0, 0, 0] - np.sqrt(1 + ahead**2)), (1 - gain * slope) * noise)
    else:
        proposal = prior
    posterior, weight = prior * likelihood, prior * likelihood / proposal
    ratio = np.minimum(1.0, weight[:, None] / weight)
    expected = proposal @ ratio @ posterior / posterior.sum() * step
    assert 0.5 < expected < 0.999
    estimate = make(particles=400, threshold=1.0).run(model, repeated(y, 300), 4)
    worst = abs(scores(estimate.acceptance[1], expected))
    assert worst < 6  # of 300 runs: a false alarm has probability below 1e-8; the bias of order 1/400 is a tenth of it


@pytest.mark.parametrize("make", [Isir, ResampleMove])
def test_moves_make_copies_differ(make):
    estimator, case = make(particles=100, threshold=1.0), CASES["ungm"]
    y, rng = case.simulate(10, seed=1).y[:6], Streams.of(1).batch(0, 10)
    belief = estimator.init(case.model, rng)
    for k, z in enumerate(y, start=1):
        belief = estimator.step(case.model, belief, z, k, rng)
    distinct = np.array([len(np.unique(origins)) for origins in belief.origins[0]])
    moved = np.rint(100 * belief.particles.acceptance)
    assert (distinct >= moved).all()  # a fresh draw equals no other
    assert (distinct > belief.particles.ancestors).all()


def test_isir_and_bootstrap_err_nearly_the_same_on_the_ballistic_case():
    # Root mean square position errors of 40 paired runs at the paper's noise. Their log-ratio has a standard deviation of
    # about 0.2 over runs, so that a difference of 25 % would stand out at 5 standard errors. Longer comparisons say that ISIR
    # errs by (0.7 ± 1.0) % less at N = 1000, 300 runs, and by (0.7 ± 0.8) % more at N = 8000, 60 runs, one standard error.
    case = CASES["ballistic/1"]
    truth = case.simulate(40, seed=1)
    errors = []
    for estimator in (Isir(particles=400), Bootstrap(particles=400)):
        estimate = estimator.run(case.model, truth.y, 1)
        assert estimate.ok.all()
        errors.append(np.sqrt(((estimate.mean - truth.x)[:, [0, 2]] ** 2).sum(1).mean(0)))
    log_ratio = np.log(errors[0] / errors[1])
    error = log_ratio.std(ddof=1) / np.sqrt(40)
    assert 5 * error < 0.25
    assert abs(log_ratio.mean()) < 0.1 + 5 * error
