"""filterpy's extended and cubature filters: what they are to give, and what filterpy gets wrong.

A test of a defect fails when filterpy mends it; then the words in estimators/peers are to be changed.
"""

import dataclasses

import numpy as np
import pytest
from filterpy.kalman import CubatureKalmanFilter
from scipy import stats

from cases import CASES
from cases.multistatic_radar import flight
from estimators.peers.filterpy import FilterpyCubature, FilterpyExtended, FilterpyUnscented
from suite import gaussian, moment_rules
from suite.case import draw
from suite.estimator import LOST, OK
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian, StudentT
from tests.estimators.references import from_both_sides
from tests.oracles import filterpy_kalman, generators, random_linear, range_bearing

SHAPES = pytest.mark.parametrize("shape", [(1, 1, 1), (2, 1, 1), (3, 2, 1), (4, 2, 2), (6, 2, 3)], ids=str)
NEW = pytest.mark.parametrize("make", [FilterpyExtended, FilterpyCubature], ids=["ekf", "ckf"])
ALL = pytest.mark.parametrize("make", [FilterpyExtended, FilterpyUnscented, FilterpyCubature], ids=["ekf", "ukf", "ckf"])


def near(actual, expected, tolerance=1e-9):
    np.testing.assert_allclose(actual, expected, rtol=tolerance, atol=tolerance * np.abs(expected).max())


def same(estimate, mean, cov, loglik, tolerance=1e-9):
    assert estimate.ok.all()
    near(estimate.mean, mean, tolerance)
    near(estimate.cov, cov, tolerance)
    near(estimate.loglik, loglik, tolerance)


def with_outages(y):
    y = y.copy()
    y[np.random.default_rng(0).random(y.shape) < 0.3] = np.nan
    y[3] = np.nan
    return y


def ours(rule, model, y):
    """Means [T, n, R], covariances [T, n, n, R] and log-likelihoods [T, R] of the Gaussian filter with a moment rule."""
    belief, found = gaussian.prior(model, y.shape[2]), []
    for k, z in enumerate(y, start=1):
        belief = gaussian.update(rule, gaussian.predict(rule, belief, model.dynamics, k), model.sensor, z, k)
        found.append(belief.read())
    return tuple(np.stack([getattr(each, part) for each in found]) for part in ("mean", "cov", "loglik"))


def bend(x, k):
    return np.stack([x[0] + 0.1 * np.sin(x[1]), 0.9 * x[1] + 0.2 * np.cos(x[0] + 0.1 * k)])


def look(x, k):
    return np.stack([x[0] * x[0] * np.sin(k) + x[1], np.exp(0.2 * x[1] + 0.3 * np.cos(k)), np.atan2(x[1], 0.3 + x[0])])


CURVED = StateSpaceModel(
    Gaussian([1.0, -0.5], [[0.5, 0.1], [0.1, 0.3]]),
    AdditiveTransition(bend, Gaussian([0.3], [[0.2]]), gain=np.array([[1.0], [0.5]])),
    AdditiveSensor(look, Gaussian([0.1, 0.0, -0.2], [[0.5, 0.1, 0.0], [0.1, 0.4, 0.1], [0.0, 0.1, 0.6]]), angles=(2,)),
)
"""Curved functions, of time as well; noises that are correlated, have means, and drive the state through a gain."""


def test_ekf_equals_ours_on_a_curved_model_with_correlated_noise():
    y = with_outages(draw(CURVED, 25, generators(3, "curved")).y)
    same(FilterpyExtended().run(CURVED, y), *ours(moment_rules.taylor, CURVED, y))


@pytest.mark.parametrize("west", [False, True])
def test_ekf_equals_ours_where_bearings_wrap(west):
    model = range_bearing(west)
    y = with_outages(draw(model, 25, generators(3, "wrap")).y)
    same(FilterpyExtended().run(model, y), *ours(moment_rules.taylor, model, y))


@pytest.mark.parametrize("start", [0, 85, 400])
def test_ekf_equals_ours_on_the_radar_with_its_outages(start):
    # From step 85 the total outage of steps 101-115 is crossed, from 400 the loss of one transmitter at 421.
    case = CASES["multistatic-radar/phlab-climb"]
    model = dataclasses.replace(case.model, prior=Gaussian(flight()[start], case.model.prior.cov))
    y = case.simulate(2, seed=3).y[start : start + 50]
    assert np.isnan(y).any() == (start > 0)
    same(FilterpyExtended().run(model, y), *ours(moment_rules.taylor, model, y))


@pytest.mark.parametrize("dirac", [False, True], ids=["uncertain", "known"])
@SHAPES
def test_ekf_equals_the_kalman_filter_on_linear_models(shape, dirac):
    problem = random_linear(sum(shape), *shape, dirac=dirac)
    y = with_outages(problem.simulate(steps=10, runs=2, seed=1)[1])
    estimate = FilterpyExtended().run(problem.model, y)
    for r in range(2):
        mean, cov, loglik = filterpy_kalman(problem, y[:, :, r])
        near(estimate.mean[..., r], mean)
        near(estimate.cov[..., r], cov)
        near(estimate.loglik[:, r], loglik)


@NEW
def test_bearings_wrap(make):
    truth, a, b = from_both_sides(make())
    same(a, b.mean, b.cov, b.loglik, 1e-8)
    # A range error of 5 m and a bearing error of 20 m across: nowhere near the kilometres of a bearing gone wrong.
    assert np.abs(a.mean - truth.x)[:, [0, 2]].max() < 100


def test_ckf_equals_ours_for_a_state_that_stands_still():
    """Without process noise its points are those that a filter would draw anew, where the transition is the identity."""
    model = dataclasses.replace(CURVED, dynamics=AdditiveTransition(lambda x, k: x, Gaussian.noise(np.zeros((2, 2)))))
    y = with_outages(draw(model, 25, generators(3, "still")).y)
    same(FilterpyCubature().run(model, y), *ours(moment_rules.cubature(), model, y), tolerance=1e-8)


@SHAPES
def test_ckf_equals_the_kalman_filter_without_process_noise(shape):
    problem = dataclasses.replace(random_linear(sum(shape), *shape), Q=np.zeros((shape[2], shape[2])))
    y = with_outages(problem.simulate(steps=5, runs=1, seed=1)[1])
    estimate = FilterpyCubature().run(problem.model, y)
    mean, cov, loglik = filterpy_kalman(problem, y[:, :, 0])
    same(estimate, mean[..., None], cov[..., None], loglik[:, None], 1e-6)


def without_noise_in_the_update(p, y):
    """The Kalman filter of one run's y[T, m] whose innovation and gain take A P Aᵀ for A P Aᵀ + G Q Gᵀ."""
    x, P, found = p.m0, p.P0, []
    for z in y:
        x, came, loglik = p.A @ x + p.a + p.G @ p.w, p.A @ P @ p.A.T, 0.0
        P = came + p.G @ p.Q @ p.G.T
        rows = np.flatnonzero(~np.isnan(z))
        if len(rows):
            H, error = p.H[rows], (z - p.H @ x - p.h - p.v)[rows]
            S = H @ came @ H.T + p.R[np.ix_(rows, rows)]
            gain = came @ H.T @ np.linalg.inv(S)
            x, P = x + gain @ error, P - gain @ S @ gain.T
            loglik = stats.multivariate_normal(np.zeros(len(rows)), S).logpdf(error)
        found.append((x, P, loglik))
    return (np.stack([np.asarray(part) for part in parts])[..., None] for parts in zip(*found, strict=True))


@SHAPES
def test_ckf_leaves_the_process_noise_out_of_its_update(shape):
    problem = random_linear(sum(shape), *shape)
    y = with_outages(problem.simulate(steps=10, runs=1, seed=1)[1])
    same(FilterpyCubature().run(problem.model, y), *without_noise_in_the_update(problem, y[:, :, 0]))


def test_ckf_is_a_golden_ratio_off_where_all_matrices_are_one():
    # Kalman: P = (P + 1) / (P + 2). Without Q in the update: P = P + 1 - P² / (P + 1). Hence (sqrt(5) ∓ 1) / 2.
    law = Gaussian.diagonal([1.0])
    model = StateSpaceModel(law, AdditiveTransition(Affine([[1.0]]), law), AdditiveSensor(Affine([[1.0]]), law))
    y = np.zeros((60, 1, 1))
    near(FilterpyExtended().run(model, y).cov[-1], (np.sqrt(5) - 1) / 2)
    near(FilterpyCubature().run(model, y).cov[-1], (np.sqrt(5) + 1) / 2)


def test_ckf_loses_digits_far_from_the_origin():
    # It subtracts squares of 1e7 and more, whose last digit is worth 0.01 to 1; the variances are about one.
    cov = np.array([[1.0, 0.3], [0.3, 0.5]])
    still = AdditiveTransition(Affine(np.eye(2)), Gaussian.noise(np.zeros((2, 2))))
    model = StateSpaceModel(Gaussian([1e8 / 3, -2e8 / 7], cov), still, AdditiveSensor(Affine(np.eye(2)), Gaussian.noise(cov)))
    y = np.full((1, 2, 1), np.nan)
    near(FilterpyUnscented().run(model, y).cov[0, :, :, 0], cov, 1e-6)
    assert np.abs(FilterpyCubature().run(model, y).cov[0, :, :, 0] - cov).max() > 1e-2


def test_ckf_never_calls_its_mean_of_measurements():
    def mean(points, weights):
        raise AssertionError

    ckf = CubatureKalmanFilter(1, 1, 1.0, lambda x: x, lambda x, dt: x, z_mean_fn=mean)
    ckf.predict()
    ckf.update(np.array([[1.0]]))


@ALL
def test_the_log_likelihood_lacks_what_filterpy_takes_for_singular(make):
    size = np.array([1e5, 1.0])
    still = AdditiveTransition(Affine(np.eye(2)), Gaussian.noise(np.zeros((2, 2))))
    sensor = AdditiveSensor(Affine(np.eye(2)), Gaussian.diagonal(0.5 * size**2))
    model = StateSpaceModel(Gaussian.diagonal(0.5 * size**2), still, sensor)  # the innovation's covariance is size²
    estimate = make().run(model, size[None, :, None])
    near(estimate.mean[0, :, 0], size / 2)
    near(estimate.loglik[0, 0], stats.norm.logpdf(size[0], scale=size[0]))
    near(ours(moment_rules.affine, model, size[None, :, None])[2][0, 0], stats.norm.logpdf(size, scale=size).sum())


@NEW
def test_takes_other_noises_by_their_moments(make):
    model = random_linear(2, 2, 1, 2).model
    heavy, alike = StudentT([[2.0]], 5.0), Gaussian.noise([[2.0 * 5 / 3]])
    y = draw(model, 8, generators(2, "moments")).y
    a, b = (make().run(dataclasses.replace(model, sensor=AdditiveSensor(model.sensor.mean, n)), y) for n in (heavy, alike))
    same(a, b.mean, b.cov, b.loglik)


@NEW
def test_refuses_what_filterpy_cannot_express(make):
    model = random_linear(1, 2, 1, 2).model

    class Law:
        dim = 1

    assert make().accepts(model) is None
    assert "process noise" in make().accepts(dataclasses.replace(model, dynamics=Law()))
    assert "measurement noise" in make().accepts(dataclasses.replace(model, sensor=Law()))


def test_ckf_cannot_start_from_a_known_state():
    assert "singular" in FilterpyCubature().accepts(random_linear(1, 3, 2, 2, dirac=True).model)


def test_ekf_refuses_functions_without_a_derivative():
    rounded = dataclasses.replace(CURVED, sensor=AdditiveSensor(lambda x, k: np.rint(x), Gaussian.diagonal([1.0, 1.0])))
    assert "cannot be differentiated" in FilterpyExtended().accepts(rounded)


@NEW
def test_an_impossible_measurement_loses_its_own_run(make):
    y = draw(CURVED, 6, generators(3, "alone")).y
    spoilt = y.copy()
    spoilt[2, 0, 1] = np.inf
    plain, found = make().run(CURVED, y), make().run(CURVED, spoilt)
    assert list(found.status) == [OK, LOST, OK]
    np.testing.assert_array_equal(found.mean[:, :, [0, 2]], plain.mean[:, :, [0, 2]])


@NEW
def test_an_ill_conditioned_innovation_raises_no_warning(make):
    still = AdditiveTransition(Affine(np.eye(2)), Gaussian.noise(np.eye(2)))
    model = StateSpaceModel(
        Gaussian.diagonal([1.0, 1.0]), still, AdditiveSensor(Affine(np.diag([1e12, 1e-12])), Gaussian.diagonal([1.0, 1e-20]))
    )
    make().run(model, np.ones((2, 2, 1)))
