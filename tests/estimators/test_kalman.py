"""The Kalman filter against filterpy's, and against the joint Gaussian of everything at once."""

import dataclasses

import numpy as np
import pytest

from cases import CASES
from estimators.kalman import Kalman
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian, StudentT
from tests.oracles import Linear, filterpy_kalman, joint_loglik, joint_posterior, random_linear

KALMAN = Kalman()
SHAPES = [(1, 1, 1), (2, 1, 1), (3, 2, 1), (4, 2, 2), (5, 3, 2), (4, 4, 4), (2, 3, 1), (6, 2, 3)]
"""State, measurement and process noise dimensions; where the last is below the first, the noise is singular."""


def with_outages(y, seed=0):
    """Some components missing in some runs at some steps; one whole step, and one run almost for good."""
    y = y.copy()
    y[np.random.default_rng(seed).random(y.shape) < 0.3] = np.nan
    y[3] = np.nan
    y[2:, :, 0] = np.nan
    return y


def near(actual, expected):
    np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def against_filterpy(problem, y):
    estimate = KALMAN.run(problem.model, y)
    assert estimate.ok.all()
    for r in range(y.shape[2]):
        mean, cov, loglik = filterpy_kalman(problem, y[:, :, r])
        near(estimate.mean[:, :, r], mean)
        near(estimate.cov[..., r], cov)
        near(estimate.loglik[:, r], loglik)


@pytest.mark.parametrize("missing", [False, True], ids=["complete", "missing"])
@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_equals_filterpy_on_random_linear_models(shape, missing):
    problem = random_linear(sum(shape), *shape)
    _, y = problem.simulate(steps=12, runs=4, seed=1)
    against_filterpy(problem, with_outages(y) if missing else y)


def test_equals_filterpy_on_the_linear_gaussian_case():
    case = CASES["linear-gaussian"]
    model, zero = case.model, np.zeros
    problem = Linear(
        model.dynamics.mean.matrix(1), zero(4), np.eye(4), zero(4), model.dynamics.noise.cov, model.sensor.mean.matrix(1),
        zero(2), zero(2), model.sensor.noise.cov, model.prior.mean, model.prior.cov,
    )  # fmt: skip
    y = case.simulate(3, seed=5).y
    estimate = KALMAN.run(model, y)
    for r in range(3):
        mean, cov, loglik = filterpy_kalman(problem, y[:, :, r])
        near(estimate.mean[:, :, r], mean)
        near(estimate.cov[..., r], cov)
        near(estimate.loglik[:, r], loglik)


@pytest.mark.parametrize("missing", [False, True], ids=["complete", "missing"])
@pytest.mark.parametrize("dirac", [False, True], ids=["prior", "dirac prior"])
@pytest.mark.parametrize("shape", SHAPES[:6], ids=str)
def test_loglik_and_posterior_are_those_of_the_joint_gaussian(shape, dirac, missing):
    problem = random_linear(100 + sum(shape), *shape, dirac=dirac)
    _, y = problem.simulate(steps=5, runs=3, seed=2)
    y = with_outages(y, 1) if missing else y
    estimate = KALMAN.run(problem.model, y)
    for r in range(3):
        np.testing.assert_allclose(estimate.loglik[:, r].sum(), joint_loglik(problem, y[:, :, r]), rtol=1e-9)
        mean, cov = joint_posterior(problem, y[:, :, r])
        near(estimate.mean[-1, :, r], mean)
        near(estimate.cov[-1, :, :, r], cov)


def test_nothing_observed_is_pure_prediction():
    problem = random_linear(7, 3, 2, 2)
    estimate = KALMAN.run(problem.model, np.full((6, 2, 2), np.nan))
    mean, cov = problem.m0, problem.P0
    for k in range(6):
        mean = problem.A @ mean + problem.a + problem.G @ problem.w
        cov = problem.A @ cov @ problem.A.T + problem.G @ problem.Q @ problem.G.T
        near(estimate.mean[k, :, 0], mean)
        near(estimate.cov[k, :, :, 0], cov)
    assert (estimate.loglik == 0).all()
    assert np.isnan(estimate.innovation).all()


def test_matrices_and_noises_may_depend_on_time():
    steps = 6
    rng = np.random.default_rng(3)
    As, Hs, sizes = rng.standard_normal((steps + 1, 2, 2)), rng.standard_normal((1, 2)), rng.uniform(0.5, 2, steps + 1)
    model = StateSpaceModel(
        Gaussian([1.0, -1.0], np.eye(2)),
        AdditiveTransition(Affine(lambda k: As[k]), lambda k: Gaussian.diagonal([sizes[k], 2 * sizes[k]])),
        AdditiveSensor(Affine(Hs), Gaussian.diagonal([0.5])),
    )
    y = rng.standard_normal((steps, 1, 1))
    estimate = KALMAN.run(model, y)
    x, P = np.array([1.0, -1.0]), np.eye(2)
    for k in range(1, steps + 1):
        x, P = As[k] @ x, As[k] @ P @ As[k].T + sizes[k] * np.diag([1.0, 2.0])
        S = Hs @ P @ Hs.T + 0.5
        x = x + P @ Hs.T @ np.linalg.solve(S, y[k - 1, :, 0] - Hs @ x)
        P = P - P @ Hs.T @ np.linalg.solve(S, Hs @ P)
        near(estimate.mean[k - 1, :, 0], x)
        near(estimate.cov[k - 1, :, :, 0], P)


def test_innovations_are_white_and_of_unit_variance():
    # 100 steps x 2 components x 200 runs of independent standard normals: their mean has standard deviation 1/200, their
    # mean square sqrt(2)/200, a lag-one product 1/200. Bands of 5 sigma; a false alarm has probability below 2e-6.
    case = CASES["linear-gaussian"]
    e = KALMAN.run(case.model, case.simulate(200, seed=11).y).innovation
    assert e.shape == (100, 2, 200)
    assert abs(e.mean()) < 5 / 200
    assert abs((e**2).mean() - 1) < 5 * np.sqrt(2) / 200
    assert abs((e[1:] * e[:-1]).mean()) < 5 / 199


def test_accepts_only_linear_models_with_gaussian_noises():
    model = random_linear(1, 2, 1, 2).model
    assert KALMAN.accepts(model) is None
    curved = AdditiveSensor(lambda x, k: x[:1] ** 2, Gaussian.diagonal([1.0]))
    heavy = AdditiveSensor(Affine([[1.0, 0.0]]), StudentT(np.eye(1), 4.0))
    angle = AdditiveSensor(Affine([[1.0, 0.0]]), Gaussian.diagonal([1.0]), angles=(0,))
    for sensor in (curved, heavy, angle):
        assert "linear" in KALMAN.accepts(dataclasses.replace(model, sensor=sensor))
    shaken = AdditiveTransition(Affine(np.eye(2)), StudentT(np.eye(2), 4.0))
    assert "linear" in KALMAN.accepts(dataclasses.replace(model, dynamics=shaken))
