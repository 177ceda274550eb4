"""The series with Gamma noise: its formulas at every step, its skew noise, and filters near the end of what can be known."""

import numpy as np
import pytest

from cases.gamma_series import CASES
from cases.sweeps.gamma_series import CASES as SWEEP
from estimators.bootstrap import ESTIMATORS as BOOTSTRAP
from suite import gaussian

(CASE,) = CASES
MODEL = CASE.model


def test_formulas_are_the_published_ones():
    """x_{k+1} = 1 + sin(0.04 pi k) + 0.5 x_k + v_k, y_k = 0.2 x² up to k = 30 and 0.5 x - 2 after it."""
    assert CASE.steps == 60
    for x in (0.3, 5.0, 9.7):
        state = np.array([[x]])
        for k in range(60):
            assert MODEL.dynamics.mean(state, k + 1)[0, 0] == pytest.approx(1 + np.sin(0.04 * np.pi * k) + 0.5 * x, rel=1e-14)
        for k in range(1, 61):
            expected, slope = (0.2 * x**2, 0.4 * x) if k <= 30 else (0.5 * x - 2, 0.5)
            value, found = MODEL.sensor.linearised(state, k)
            assert value[0, 0] == pytest.approx(expected, rel=1e-14)
            assert found[0, 0, 0] == pytest.approx(slope, rel=1e-14)
            assert MODEL.dynamics.jacobian(state, k)[0, 0, 0] == 0.5
    assert gaussian.differentiable(MODEL) is None


def test_noises_and_start_are_the_stated_ones():
    noise = MODEL.dynamics.noise_at(1)
    assert (noise.mean[0], noise.cov[0, 0]) == (1.5, 0.75)
    assert MODEL.sensor.noise.cov[0, 0] == 1e-5
    assert (MODEL.prior.mean[0], MODEL.prior.cov[0, 0]) == (1.0, 0.0)


@pytest.fixture(scope="module")
def truth():
    """A thousand runs."""
    return CASE.simulate(1000, seed=3)


def test_simulated_noises_are_those_of_the_model(truth):
    # 60 000 noises of both kinds, the process noise from x_0 = 1 on. Gamma(3, rate 2) has mean 3/2, variance 3/4 and third
    # central moment 2 · 3 / 2³ = 3/4. 7 figures of 5 standard errors: below 1e-5.
    x, count = truth.x[:, 0], 60_000
    before = np.concatenate([np.ones((1, 1000)), x[:-1]])
    v = x - (1 + np.sin(0.04 * np.pi * np.arange(60))[:, None] + 0.5 * before)
    assert v.min() > 0
    centred = v - 1.5
    for power, expected in ((1, 0.0), (2, 0.75), (3, 0.75)):
        sample = centred**power
        assert abs(sample.mean() - expected) < 5 * sample.std() / np.sqrt(count)
    assert abs((centred[1:] * centred[:-1]).mean()) < 5 * 0.75 / np.sqrt(count)
    n = truth.y[:, 0] - np.where(np.arange(1, 61)[:, None] <= 30, 0.2 * x**2, 0.5 * x - 2)
    assert abs(n.mean()) < 5 * np.sqrt(1e-5 / count)
    assert abs((n**2).mean() - 1e-5) < 5 * 1e-5 * np.sqrt(2 / count)
    assert abs((n[1:] * n[:-1]).mean()) < 5 * 1e-5 / np.sqrt(count)


def test_a_measurement_alone_says_nearly_all(truth):
    """Inverted, with x positive, it is good to 0.003 / slope: 0.0063 on the line, and less on the square."""
    y, x = truth.y[:, 0], truth.x[:, 0]
    assert x.min() > 0.5
    line = 2 * (y[30:] + 2) - x[30:]
    assert abs((line**2).mean() - 4e-5) < 5 * 4e-5 * np.sqrt(2 / line.size)
    square = np.sqrt(5 * y[:30]) - x[:30]
    assert (square**2).mean() < 4e-5


def test_a_good_filter_does_not_diverge(truth):
    estimate = BOOTSTRAP[0].run(MODEL, truth.y[..., :30], 1)
    error = np.abs(estimate.mean - truth.x[..., :30])[:, 0]
    assert estimate.ok.all()
    assert (error > CASE.divergence.limit).sum(0).max() < CASE.divergence.steps


def test_the_sweep_tells_filters_of_centred_noise_of_the_same_variance():
    """The published Kalman filters take it so; the truth stays that of the series."""
    (centred,) = SWEEP
    told, real = centred.model.dynamics, CASE.model.dynamics
    assert told.noise_mean(1) == 0.0
    np.testing.assert_allclose(told.noise_cov(1), real.noise_cov(1), rtol=1e-12)
    truth = centred.simulate(2000, seed=1)
    driven = truth.x[1:, 0] - np.stack([real.mean(x, k) for k, x in enumerate(truth.x[:-1], start=2)])[:, 0]
    # The mean of 118 000 draws of a law of variance 0.75, within six standard errors.
    assert abs(driven.mean() - 1.5) < 6 * np.sqrt(0.75 / driven.size)
