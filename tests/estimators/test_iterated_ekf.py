"""The iterated extended Kalman filter: its updates are Gauss-Newton steps."""

import numpy as np
import pytest
from scipy import optimize

from cases import CASES
from estimators.ekf import Extended
from estimators.iterated_ekf import IteratedExtended
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian
from suite.nonadditive import NonadditiveSensor
from tests.estimators.references import near, same_filter, with_outages

WIDE = Gaussian([1.2, 0.4], [[0.5, 0.1], [0.1, 0.4]])


def eye(x, k):
    return np.stack([x[0] * x[0] + x[1], np.sin(x[1]) + x[0], np.exp(0.3 * x[0])])


def eye_slope(x):
    return np.array([[2 * x[0], 1.0], [1.0, np.cos(x[1])], [0.3 * np.exp(0.3 * x[0]), 0.0]])


NOISE = np.array([[0.3, 0.1, 0.0], [0.1, 0.4, 0.0], [0.0, 0.0, 0.2]])
STILL = AdditiveTransition(Affine(np.eye(2)), Gaussian.noise(np.zeros((2, 2))))
EYE = StateSpaceModel(WIDE, STILL, AdditiveSensor(eye, Gaussian.noise(NOISE)))
SEEN = np.array([[[3.0], [1.0], [1.9]]])


def gauss_newton(iterations, rows=(0, 1, 2)):
    """Bell and Cathey's steps in information form: x <- x + inv(inv P + H' inv R H) (H' inv R (y - h(x)) + inv P (m - x))."""
    rows, x = list(rows), WIDE.mean
    prior, noise = np.linalg.inv(WIDE.cov), np.linalg.inv(NOISE[np.ix_(rows, rows)])
    for _ in range(iterations):
        H = eye_slope(x)[rows]
        information = prior + H.T @ noise @ H
        x = x + np.linalg.solve(information, H.T @ noise @ (SEEN[0, rows, 0] - eye(x, 1)[rows]) + prior @ (WIDE.mean - x))
    return x, np.linalg.inv(information)


@pytest.mark.parametrize("rows", [(0, 1, 2), (0, 2), (1,)], ids=str)
@pytest.mark.parametrize("iterations", [1, 2, 3, 7])
def test_iterations_are_gauss_newton_steps(iterations, rows):
    y = np.full_like(SEEN, np.nan)
    y[:, rows] = SEEN[:, rows]
    found = IteratedExtended(iterations).run(EYE, y)
    mean, cov = gauss_newton(iterations, rows)
    near(found.mean[0, :, 0], mean)
    near(found.cov[0, :, :, 0], cov)


def test_iterations_end_at_the_most_probable_state():
    """There the likelihood is Laplace's, with the Hessian that Gauss and Newton take."""
    prior, noise = np.linalg.inv(WIDE.cov), np.linalg.inv(NOISE)

    def cost(x):
        e, d = SEEN[0, :, 0] - eye(x, 1), x - WIDE.mean
        return 0.5 * (e @ noise @ e + d @ prior @ d)

    best = optimize.minimize(cost, WIDE.mean, method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-15, "maxiter": 4000})
    found = IteratedExtended(200).run(EYE, SEEN)
    np.testing.assert_allclose(found.mean[0, :, 0], best.x, atol=1e-7)
    H = eye_slope(best.x)
    laplace = -best.fun - 0.5 * np.log(np.linalg.det(2 * np.pi * (H @ WIDE.cov @ H.T + NOISE)))
    np.testing.assert_allclose(found.loglik[0, 0], laplace, rtol=1e-6)
    assert np.abs(Extended().run(EYE, SEEN).mean[0, :, 0] - best.x).max() > 0.01


@pytest.mark.parametrize("name", ["ballistic/1", "ungm"])
def test_one_iteration_is_the_extended_filter(name):
    case = CASES[name]
    y = with_outages(case.simulate(3, seed=2).y[:20])
    same_filter(IteratedExtended(1).run(case.model, y), Extended().run(case.model, y), 1e-12)


def test_nothing_measured_leaves_the_iterated_filter_a_prediction():
    model = CASES["ballistic/1"].model
    y = np.full((6, 2, 2), np.nan)
    found, plain = IteratedExtended().run(model, y), Extended().run(model, y)
    near(found.mean, plain.mean, 1e-14)
    near(found.cov, plain.cov, 1e-13)
    assert (found.loglik == 0).all()
    assert np.isnan(found.innovation).all()


def glance(x, v, k):
    return np.stack([np.sin(x[0]) * (1 + v[0]) + v[1], x[1] + x[0] * v[0] * v[1], np.exp(0.2 * x[0] + v[1])])


def complex_step(function, at):
    """Derivative [p, n] of a function of at[n] that is analytic: exact to rounding."""
    return np.stack([function(at + 1e-30j * unit).imag / 1e-30 for unit in np.eye(len(at))], axis=1)


@pytest.mark.parametrize("iterations", [1, 2, 4])
def test_noise_inside_the_function_is_expanded_about_its_mean(iterations):
    """x <- m + K (y - h(x, v) - H (m - x)), with H and V the derivatives by state and noise there, S = H P H' + V R V'."""
    noise = Gaussian([0.1, 0.2], [[0.3, 0.05], [0.05, 0.1]])
    model = StateSpaceModel(WIDE, STILL, NonadditiveSensor(glance, noise, dim=3))
    v, x = noise.mean, WIDE.mean
    for _ in range(iterations):
        H = complex_step(lambda at: glance(at, v, 1), x)
        V = complex_step(lambda at, x=x: glance(x, at, 1), v)
        S = H @ WIDE.cov @ H.T + V @ noise.cov @ V.T
        K = np.linalg.solve(S, H @ WIDE.cov).T
        x = WIDE.mean + K @ (SEEN[0, :, 0] - glance(x, v, 1) - H @ (WIDE.mean - x))
    found = IteratedExtended(iterations).run(model, SEEN)
    near(found.mean[0, :, 0], x, 1e-8)
    near(found.cov[0, :, :, 0], WIDE.cov - K @ S @ K.T, 1e-8)


@pytest.mark.parametrize("iterations", [1, 2, 5, 50])
def test_only_the_difference_to_the_expanded_value_wraps(iterations):
    """A target near a sensor of bearings: what a step extrapolates may exceed half a turn, and must not be taken for less."""
    mean, prior, variance, y = np.array([-0.34, -0.61]), np.diag([2.35, 3.08]), 0.09, 2.81
    model = StateSpaceModel(
        Gaussian(mean, prior),
        AdditiveTransition(Affine(np.eye(2)), Gaussian.noise(np.zeros((2, 2)))),
        AdditiveSensor(lambda x, k: np.stack([np.atan2(x[1], x[0])]), Gaussian.noise([[variance]]), angles=(0,)),
    )
    x, information = mean, np.linalg.inv(prior)
    beyond = 0.0
    for _ in range(iterations):
        square = x @ x
        H = np.array([-x[1], x[0]]) / square
        error = np.angle(np.exp(1j * (y - np.arctan2(x[1], x[0])))) - H @ (mean - x)
        beyond = max(beyond, abs(error))
        x = mean + prior @ H / (H @ prior @ H + variance) * error
    found = IteratedExtended(iterations=iterations).run(model, np.array([[[y]]]))
    near(found.mean[0, :, 0], x, 1e-8)
    if iterations == 50:
        assert beyond > np.pi  # else the example shows nothing
        H = np.array([-x[1], x[0]]) / (x @ x)
        slope = information @ (x - mean) - H * np.angle(np.exp(1j * (y - np.arctan2(x[1], x[0])))) / variance
        assert np.abs(slope).max() < 1e-6  # at the most probable state
