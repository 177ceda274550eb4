"""Many dimensions: the exact filter's variance is the root of a quadratic, and particle filters pay for every dimension."""

import dataclasses
import itertools

import numpy as np
import pytest

from cases.high_dimensional import CASES
from estimators.kalman import ESTIMATORS as KALMAN
from estimators.sir import ESTIMATORS as SIR
from suite import gaussian

DIMENSIONS = (5, 10, 20, 50)


def test_models_are_the_stated_ones():
    assert [case.name for case in CASES] == [f"high-dimensional/{d}" for d in DIMENSIONS]
    for d, case in zip(DIMENSIONS, CASES, strict=True):
        one, model = np.eye(d), case.model
        np.testing.assert_array_equal(model.dynamics.mean.matrix(1), 0.5 * one)
        np.testing.assert_array_equal(model.dynamics.noise.cov, one)
        np.testing.assert_array_equal(model.sensor.mean.matrix(1), one)
        np.testing.assert_array_equal(model.sensor.noise.cov, one)
        np.testing.assert_array_equal(model.prior.mean, np.zeros(d))
        np.testing.assert_allclose(model.prior.cov, 4 / 3 * one)
        assert gaussian.differentiable(model) is None
        assert case.steps == 10


@pytest.mark.parametrize("case", CASES, ids=DIMENSIONS)
def test_truth_follows_the_model(case):
    # 1000 runs, 10 steps, d components: the stationary variance 4/3 at the first step and in all, where squares correlate by
    # 1/4 from step to step; noises with variance 1, and no correlation with the step before or between components. 10 figures
    # of 5 standard errors in each of 4 cases: below 3e-5.
    truth = case.simulate(1000, seed=3)
    x, v = truth.x, truth.y - truth.x
    assert abs((x[0] ** 2).mean() - 4 / 3) < 5 * 4 / 3 * np.sqrt(2 / x[0].size)
    assert abs((x**2).mean() - 4 / 3) < 5 * 4 / 3 * np.sqrt(2 / x.size * (1 + 1 / 4) / (1 - 1 / 4))
    w = x[1:] - x[:-1] / 2
    for noise in (w, v):
        assert abs(noise.mean()) < 5 / np.sqrt(noise.size)
        assert abs((noise**2).mean() - 1) < 5 * np.sqrt(2 / noise.size)
        assert abs((noise[1:] * noise[:-1]).mean()) < 5 / np.sqrt(noise.size)
        assert abs((noise[:, 1:] * noise[:, :-1]).mean()) < 5 / np.sqrt(noise.size)


@pytest.mark.parametrize("case", CASES, ids=DIMENSIONS)
def test_the_exact_filter_has_the_stated_variance(case):
    # The predicted variance solves p² - p/4 - 1 = 0, and p+ = p / (p + 1) = 0.53113. Errors of one step are 0.5 / (p + 1) = rho
    # of those before, their squares correlate by rho²: those of 80 runs from step 6 on agree with p+ within 5 standard errors.
    truth = case.simulate(80, seed=4)
    estimate = KALMAN[0].run(case.model, truth.y, 0)
    p = (1 / 4 + np.sqrt(1 / 16 + 4)) / 2
    assert p / (p + 1) == pytest.approx(0.53113, abs=5e-6)
    np.testing.assert_allclose(estimate.cov[-1, :, :, 0], p / (p + 1) * np.eye(case.model.n), rtol=1e-9, atol=1e-12)
    error = estimate.mean - truth.x
    late, rho = error[5:], 0.5 / (p + 1)
    assert abs((late**2).mean() / (p / (p + 1)) - 1) < 5 * np.sqrt(2 / late.size * (1 + rho**2) / (1 - rho**2))
    size = np.sqrt((error**2).sum(1))
    assert (size > case.divergence.limit).sum(0).max() < case.divergence.steps


def test_particles_lose_more_with_every_dimension():
    """The excess of 300 particles' mean square error over the exact filter's, paired: each case's above that of the one before.

    Differences of 3 standard errors and more, where they are expected to be 8 at least.
    """
    found = []
    for case in CASES:
        truth = case.simulate(40, seed=5)
        estimate = dataclasses.replace(SIR[0], particles=300).run(case.model, truth.y, 0)
        exact = KALMAN[0].run(case.model, truth.y, 0)
        excess = ((estimate.mean - truth.x) ** 2 - (exact.mean - truth.x) ** 2).mean((0, 1))
        found.append((excess.mean(), excess.std(ddof=1) / np.sqrt(40)))
    for (low, a), (high, b) in itertools.pairwise(found):
        assert high - low > 3 * np.hypot(a, b), found
