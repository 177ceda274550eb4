"""The growth model: its formulas, its draws, and the published comparison of filters beside the exact posterior."""

import numpy as np
import pytest

from cases.ungm import TOOLBOX
from cases.ungm import TUTORIAL as CASE
from estimators.bootstrap import ESTIMATORS as BOOTSTRAP
from suite import gaussian
from tests.estimators.references import on_a_grid, takers, with_particles

RUNS = 300


def test_formulas_are_the_published_ones():
    """Arulampalam et al., 2002, eqs 75 and 76, recoded number by number."""
    for x, k in [(0.0, 1), (-3.2, 7), (14.5, 100), (1e-3, 42)]:
        state = np.array([[x]])
        assert CASE.model.dynamics.mean(state, k)[0, 0] == pytest.approx(x / 2 + 25 * x / (1 + x**2) + 8 * np.cos(1.2 * k))
        assert CASE.model.sensor.mean(state, k)[0, 0] == pytest.approx(x**2 / 20)
    model = CASE.model
    noises = (model.prior.cov, model.dynamics.noise.cov, model.sensor.noise.cov)
    assert [float(cov[0, 0]) for cov in noises] == [5.0, 10.0, 1.0]
    assert model.prior.mean[0] == 0
    assert CASE.steps == 100


def test_jacobians_are_those_of_differences():
    x, d = np.linspace(-20, 20, 41)[None], 1e-5
    for law in (CASE.model.dynamics, CASE.model.sensor):
        slope = (law.mean(x + d, 3) - law.mean(x - d, 3)) / (2 * d)
        np.testing.assert_allclose(law.jacobian(x, 3)[0, 0], slope[0], rtol=1e-6, atol=1e-8)


@pytest.fixture(scope="module")
def drawn():
    """A thousand runs."""
    return CASE.simulate(1000, seed=5)


def test_simulated_noises_are_those_of_the_model(drawn):
    # 99 000 process and 100 000 measurement noises: mean, variance, correlation from step to step; 6 figures of 5 standard
    # errors: a false alarm has probability below 1e-5. The recursion is recoded, with k from 1.
    x, k = drawn.x[:, 0], np.arange(2, 101)[:, None]
    w = x[1:] - (x[:-1] / 2 + 25 * x[:-1] / (1 + x[:-1] ** 2) + 8 * np.cos(1.2 * k))
    for noise, variance in ((w, 10.0), (drawn.y[:, 0] - x**2 / 20, 1.0)):
        white, count = noise / np.sqrt(variance), noise.size
        assert abs(white.mean()) < 5 / np.sqrt(count)
        assert abs((white**2).mean() - 1) < 5 * np.sqrt(2 / count)
        assert abs((white[1:] * white[:-1]).mean()) < 5 / np.sqrt(count)


def test_the_first_state_follows_the_prior(drawn):
    # x_1 - 8 cos 1.2 = g(x_0) + w: mean zero by symmetry, and the variance of g by a sum over the normal law of x_0, plus 10.
    x = drawn.x[0, 0] - 8 * np.cos(1.2)
    grid = np.linspace(-15, 15, 3001)
    density = np.exp(-(grid**2) / 10)
    variance = ((grid / 2 + 25 * grid / (1 + grid**2)) ** 2 * density).sum() / density.sum() + 10
    assert abs(x.mean()) < 5 * np.sqrt(variance / 1000)
    # The law has two bumps, its square less spread than 2 variance².
    assert abs((x**2).mean() - variance) < 5 * variance * np.sqrt(2 / 1000)


@pytest.fixture(scope="module")
def exact():
    """Measurements of many runs, and the mean square error per run of the posterior mean, from a grid filter."""
    truth = CASE.simulate(RUNS, seed=7)
    mean, _, _ = on_a_grid(np.arange(-40, 40.01, 0.25), CASE.model, truth.y)
    return truth, ((mean - truth.x[:, 0]) ** 2).mean(0)


def squares(name, truth, runs):
    """Mean square error of each of the first runs, with the 50 particles of the published comparison."""
    estimate = with_particles(name, 50).run(CASE.model, truth.y[..., :runs], 1)
    assert estimate.ok.all()
    return ((estimate.mean - truth.x[..., :runs])[:, 0] ** 2).mean(0)


@pytest.mark.parametrize("name", takers(CASE.model))
def test_no_filter_errs_less_than_the_posterior_mean(name, exact):
    # Paired over 120 runs, 5 standard errors; these are about 1.3, of a floor of 21.6.
    truth, floor = exact
    excess = squares(name, truth, 120) - floor[:120]
    assert excess.mean() > -5 * excess.std(ddof=1) / np.sqrt(120)


@pytest.mark.parametrize("name", ["sir", "auxiliary", "regularized"])
def test_published_errors_of_particle_filters_are_reproduced(name, exact):
    # The root of the mean square over runs and steps, as the interval of 300 runs allows: 5 standard errors are about 0.4,
    # so that the printed order of the three, 0.2 apart, is not told. The mean over runs of the root is lower by 0.15.
    square = squares(name, exact[0], RUNS)
    error = np.sqrt(square.mean())
    published = next(p.value for p in CASE.published if p.estimator == f"{name}[particles=50]")
    margin = 5 * square.std(ddof=1) / np.sqrt(RUNS) / (2 * error)
    assert margin < 0.5
    assert abs(error - published) < margin


def test_the_published_error_of_the_grid_filter_is_not_that_of_the_posterior_mean(exact):
    """It is printed as 6.09, above the particle filters; the exact filter errs by 4.65."""
    error, spread = np.sqrt(exact[1].mean()), exact[1].std(ddof=1) / np.sqrt(RUNS)
    assert abs(error - 4.65) < 5 * spread / (2 * error)
    assert error < 5


def test_the_toolbox_counts_time_from_zero_and_has_noises_of_variance_one():
    """The toolbox's program: 8 cos(1.2 (n - 1)) for n = 1 to 500, from 0.1."""
    model = TOOLBOX.model
    for x, k in [(0.1, 1), (-3.2, 7), (14.5, 500)]:
        state = np.array([[x]])
        expected = x / 2 + 25 * x / (1 + x**2) + 8 * np.cos(1.2 * (k - 1))
        assert model.dynamics.mean(state, k)[0, 0] == pytest.approx(expected, rel=1e-14)
        assert model.sensor.mean(state, k)[0, 0] == pytest.approx(x**2 / 20)
    covs = (model.prior.cov, model.dynamics.noise.cov, model.sensor.noise.cov)
    assert [float(cov[0, 0]) for cov in covs] == [1.0, 1.0, 1.0]
    assert model.prior.mean[0] == 0.1
    assert TOOLBOX.steps == 500
    assert gaussian.differentiable(model) is None


@pytest.fixture(scope="module")
def toolbox():
    """Some runs of the toolbox's variant, with the mean square error of each by the exact filter, on a grid."""
    truth = TOOLBOX.simulate(60, seed=5)
    mean, _, _ = on_a_grid(np.arange(-36, 36.01, 0.4), TOOLBOX.model, truth.y)
    return truth, mean - truth.x[:, 0]


def test_the_toolboxs_truth_starts_at_a_point(toolbox):
    # 30 000 process noises, those of the first step from 0.1 exactly, and as many of measurements: mean, variance, correlation
    # from step to step within 5 standard errors, and the first steps' variance: 7 figures, a false alarm below 1e-5.
    x = toolbox[0].x[:, 0]
    before = np.concatenate([np.full((1, 60), 0.1), x[:-1]])
    w = x - (before / 2 + 25 * before / (1 + before**2) + 8 * np.cos(1.2 * np.arange(500))[:, None])
    for white in (w, toolbox[0].y[:, 0] - x**2 / 20):
        assert abs(white.mean()) < 5 / np.sqrt(white.size)
        assert abs((white**2).mean() - 1) < 5 * np.sqrt(2 / white.size)
        assert abs((white[1:] * white[:-1]).mean()) < 5 / np.sqrt(white.size)
    assert abs((w[0] ** 2).mean() - 1) < 5 * np.sqrt(2 / 60)


def test_the_toolboxs_bootstrap_filter_is_nearly_exact(toolbox):
    # Paired over 20 runs: its excess over the posterior mean, whose square error is about 10, is not below zero by 5 standard
    # errors, and small. Neither diverges.
    truth, exact = toolbox
    estimate = BOOTSTRAP[0].run(TOOLBOX.model, truth.y[..., :20], 1)
    error = (estimate.mean - truth.x[..., :20])[:, 0]
    excess = (error**2).mean(0) - (exact[:, :20] ** 2).mean(0)
    assert -5 * excess.std(ddof=1) / np.sqrt(20) < excess.mean() < 1
    for found in (exact, error):
        over = np.abs(found) > TOOLBOX.divergence.limit
        on_end = np.lib.stride_tricks.sliding_window_view(over, TOOLBOX.divergence.steps, axis=0).all(-1)
        assert not on_end.any()
