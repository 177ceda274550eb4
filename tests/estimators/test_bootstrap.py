"""The bootstrap filter against the exact posterior: rate of convergence, unbiased likelihood, a grid filter."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

from cases import CASES
from estimators.bootstrap import CACHE, Bootstrap
from estimators.kalman import Kalman
from suite.case import draw
from suite.estimator import LOST
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian, StudentT
from suite.random import Streams
from tests.oracles import Linear, from_west, generators, grid_filter, joint_loglik, random_linear, range_bearing

PLANE = Linear(
    A=np.array([[1.0, 1.0], [0.0, 0.9]]), a=np.array([0.2, -0.1]),
    G=np.eye(2), w=np.array([0.1, 0.3]), Q=np.array([[0.5, 0.2], [0.2, 0.4]]),
    H=np.array([[1.0, 0.5]]), h=np.array([-1.0]), v=np.array([0.4]), R=np.array([[2.0]]),
    m0=np.array([1.0, 0.0]), P0=np.array([[1.0, -0.3], [-0.3, 0.5]]),
)  # fmt: skip
"""A linear model whose measurements say about as much as its prediction, so that weights are uneven but not wild."""


def repeated(y, runs):
    """One run's measurements in many runs: these differ by the filter's random numbers alone."""
    return np.repeat(y[:, :, :1], runs, axis=2)


def test_error_falls_as_one_over_the_root_of_particles():
    # Over R = 600 runs the logarithm of a root mean square has a standard deviation of at most about 0.04 (kurtosis up to
    # 5), so the slope over four points log 4 apart has one of 0.04 / (log 4 · sqrt 5) = 0.013. The band is six of these:
    # a false alarm has probability below 1e-8.
    _, y = PLANE.simulate(steps=4, runs=600, seed=1)
    exact = Kalman().run(PLANE.model, y)
    counts = [100, 400, 1600, 6400]
    errors = []
    for count in counts:
        estimate = Bootstrap(particles=count).run(PLANE.model, y, 2)
        scale = np.sqrt(np.einsum("tiir->tir", exact.cov))
        errors.append(np.sqrt((((estimate.mean - exact.mean) / scale)[-1] ** 2).mean()))
    slope = np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert -0.58 < slope < -0.42


def test_likelihood_is_unbiased():
    # 5 standard errors of 6000 independent runs: a false alarm has probability below 1e-6.
    _, y = PLANE.simulate(steps=4, runs=1, seed=3)
    y[1] = np.nan
    exact = joint_loglik(PLANE, y[:, :, 0])
    estimate = Bootstrap(particles=60).run(PLANE.model, repeated(y, 6000), 4)
    ratio = np.exp(estimate.loglik.sum(0) - exact)
    assert ratio.std() < 3
    assert abs(ratio.mean() - 1) < 5 * ratio.std() / np.sqrt(len(ratio))
    # Its logarithm is biased: the test above is not so blunt that it would miss that.
    assert np.log(ratio).mean() < -5 * np.log(ratio).std() / np.sqrt(len(ratio))


def test_moments_agree_with_the_kalman_filter():
    # Means over 300 independent runs of 3000 particles; the bias of order 1/N is far below the standard error of order
    # 1/sqrt(300 N). Band 5.5 sigma: for 5 steps x (2 + 4 + 1) figures a false alarm has probability below 3e-6.
    _, y = PLANE.simulate(steps=5, runs=1, seed=5)
    exact = Kalman().run(PLANE.model, y)
    estimate = Bootstrap(particles=3000).run(PLANE.model, repeated(y, 300), 6)
    for name in ("mean", "cov", "loglik"):
        found, expected = getattr(estimate, name), getattr(exact, name)[..., 0]
        score = (found.mean(-1) - expected) / (found.std(-1, ddof=1) / np.sqrt(300))
        assert np.abs(score).max() < 5.5, name


def test_growth_model_agrees_with_a_grid_filter():
    """The univariate growth model (Gordon, Salmond and Smith, 1993): a square law sensor, two modes."""

    def drift(x, k):
        return 0.5 * x + 25 * x / (1 + x * x) + 8 * np.cos(1.2 * k)

    model = StateSpaceModel(
        Gaussian([0.0], [[5.0]]),
        AdditiveTransition(drift, Gaussian.diagonal([10.0])),
        AdditiveSensor(lambda x, k: x * x / 20, Gaussian.diagonal([1.0])),
    )
    y = draw(model, 6, generators(1, "growth")).y
    y[3] = np.nan
    grid = np.linspace(-60, 60, 1201)
    mean, variance, loglik = grid_filter(
        grid,
        stats.norm.pdf(grid, 0, np.sqrt(5)),
        drift,
        np.sqrt(10),
        lambda z, x: stats.norm.pdf(z, x * x / 20, 1.0),
        y[:, 0, 0],
    )
    assert (np.sqrt(variance) > 4).any()  # two modes, far apart
    # 64 independent runs of 20000 particles; the bias of order 1/N stays a fifth of the standard error. Band 6 of Student's
    # 63 degrees of freedom: for 18 figures a false alarm has probability below 1e-5.
    estimate = Bootstrap(particles=20_000).run(model, repeated(y, 64), 1)
    for found, expected in ((estimate.mean[:, 0], mean), (estimate.cov[:, 0, 0], variance), (estimate.loglik, loglik)):
        error = found.std(-1, ddof=1) / np.sqrt(64)
        assert (np.abs(found.mean(-1) - expected) < 6 * error + 1e-12).all()


def test_heavy_tailed_noise_agrees_with_a_grid_filter():
    # As above: 4 steps x 3 figures, band 6.
    heavy = StudentT([[0.5]], 3.0)
    model = StateSpaceModel(
        Gaussian([1.0], [[2.0]]),
        AdditiveTransition(Affine([[0.9]]), Gaussian.diagonal([1.0])),
        AdditiveSensor(Affine([[1.0]]), heavy),
    )
    y = np.array([1.0, 9.0, 0.0, -1.0])
    grid = np.linspace(-25, 25, 1001)
    exact = grid_filter(
        grid,
        stats.norm.pdf(grid, 1, np.sqrt(2)),
        lambda x, k: 0.9 * x,
        1.0,
        lambda z, x: stats.t.pdf((z - x) / np.sqrt(0.5), 3) / np.sqrt(0.5),
        y,
    )
    estimate = Bootstrap(particles=20_000).run(model, repeated(y[:, None, None], 64), 2)
    for found, expected in zip((estimate.mean[:, 0], estimate.cov[:, 0, 0], estimate.loglik), exact, strict=True):
        assert (np.abs(found.mean(-1) - expected) < 6 * found.std(-1, ddof=1) / np.sqrt(64)).all()


def test_bearings_wrap():
    east, west = range_bearing(), range_bearing(west=True)
    truth = draw(east, 25, generators(4, "wrap"))
    a = Bootstrap(particles=500).run(east, truth.y, 3)
    b = Bootstrap(particles=500).run(west, from_west(truth.y), 3)
    assert a.ok.all()
    np.testing.assert_allclose(a.mean, b.mean, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(a.loglik, b.loglik, rtol=1e-7)
    assert np.abs(a.mean - truth.x)[:, [0, 2]].max() < 100


def test_one_particle_carries_its_own_prediction():
    _, y = PLANE.simulate(steps=5, runs=3, seed=7)
    estimate = Bootstrap(particles=1).run(PLANE.model, y, 1)
    assert estimate.ok.all()
    assert (estimate.cov == 0).all()
    assert (estimate.ess == 1).all()
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
    # Without measurements at all the particles are draws of the predicted law: unweighted means.
    blind = Bootstrap(particles=200).run(model, np.full_like(y, np.nan), 1)
    rng = Streams.of(1).batch(0, 4)
    x = model.prior.sample(rng, (4, 200))
    for k in range(1, 4):
        if k > 1:
            rng.random((1, 4, 1))  # equal weights: every particle survives once, in its place
        x = model.dynamics.sample(rng, x, k)
        np.testing.assert_allclose(blind.mean[k - 1], x.mean(-1), rtol=1e-10)


@pytest.mark.parametrize("bad", [1e200, -1e200, np.inf])
@pytest.mark.parametrize("particles", [1, 50])
@pytest.mark.parametrize("name", list(CASES))
def test_an_impossible_measurement_loses_that_run_alone(name, particles, bad):
    case = CASES[name]
    y = case.simulate(4).y[:20].copy()
    clean = Bootstrap(particles=particles).run(case.model, y, 1)
    y[10, 0, 2] = bad
    estimate = Bootstrap(particles=particles).run(case.model, y, 1)
    assert list(estimate.status) == ["ok", "ok", LOST, "ok"]
    assert estimate.reason[2] == "step 11: every particle has zero likelihood"
    keep = [0, 1, 3]
    for part in ("mean", "cov", "loglik", "ess"):
        a, b = getattr(estimate, part), getattr(clean, part)
        np.testing.assert_array_equal(a[..., keep], b[..., keep])
        np.testing.assert_array_equal(a[:10, ..., 2], b[:10, ..., 2])
        assert np.isnan(a[10:, ..., 2]).all()


def test_groups_of_runs_do_not_show():
    """Runs are carried in groups that fit the cache; the numbers are those of each run alone."""
    count = CACHE // 2 - 1
    model = dataclasses.replace(PLANE.model)
    _, y = PLANE.simulate(steps=3, runs=5, seed=9)
    estimator = Bootstrap(particles=count)
    assert estimator.runs_at_once(model) == 2
    together = estimator.run(model, y, Streams(("groups",)))
    assert list(together.batch) == [5] * 5
    for r in range(5):
        alone = estimator.run(model, y[:, :, r : r + 1], Streams(("groups",), r))
        for name in ("mean", "cov", "loglik", "ess"):
            np.testing.assert_array_equal(getattr(together, name)[..., r], getattr(alone, name)[..., 0])
