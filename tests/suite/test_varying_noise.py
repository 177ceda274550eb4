"""Measurement noise that differs from step to step, against the exact Kalman filter: every filter takes the law of its step."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

from estimators import ESTIMATORS
from suite import parameters
from suite.bounds import NONE, bound, trajectories
from suite.estimator import Filter, StepError
from suite.jump import JumpModel
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian, StudentT
from tests.oracles import generators

STEPS, RUNS = 4, 8
A, Q = np.array([[1.0, 0.5, 0.0], [0.0, 0.9, 0.1], [0.0, 0.0, 1.0]]), np.diag([0.6, 0.8, 0.5])
H = np.array([[1.0, 0.0, 0.0], [0.3, 1.0, 0.0]])
# What a coordinate tells changes a hundredfold from step to step, and so does the correlation.
LAWS = [Gaussian.noise(s * np.array([[1.0, c], [c, 0.5]])) for s, c in ((30.0, -0.6), (0.3, 0.5), (60.0, 0.7), (0.6, 0.0))]
VARYING = StateSpaceModel(
    Gaussian(np.array([1.0, -2.0, 0.5]), np.diag([2.0, 1.0, 1.5])),
    AdditiveTransition(Affine(A), Gaussian.noise(Q)),
    AdditiveSensor(Affine(H), lambda k: LAWS[k - 1]),
    linear=(1, 2),
)
INEXACT = ("filterpy:ckf",)
"""Gaussian filters that are not the Kalman filter on a linear model, as their own texts say."""


def measured():
    """Measurements [T, 2, R] with gaps."""
    rng = np.random.default_rng(4)
    x = rng.multivariate_normal(VARYING.prior.mean, VARYING.prior.cov, RUNS).T
    y = []
    for law in LAWS:
        x = A @ x + rng.multivariate_normal(np.zeros(3), Q, RUNS).T
        y.append(H @ x + rng.multivariate_normal(np.zeros(2), law.cov, RUNS).T)
    found = np.array(y)
    found[1, 0, 2], found[2, 1, 3], found[2, :, 4] = np.nan, np.nan, np.nan
    return found


def textbook(y, laws=LAWS):
    """Means [T, 3, R], covariances [T, 3, 3, R] and log-likelihoods [T, R] of the Kalman filter, with inverses."""
    means, covs, fits = np.empty((STEPS, 3, RUNS)), np.empty((STEPS, 3, 3, RUNS)), np.zeros((STEPS, RUNS))
    for r in range(RUNS):
        x, P = VARYING.prior.mean, VARYING.prior.cov
        for k, law in enumerate(laws):
            x, P = A @ x, A @ P @ A.T + Q
            rows = np.flatnonzero(~np.isnan(y[k, :, r]))
            if len(rows):
                seen, S = H[rows], H[rows] @ P @ H[rows].T + law.cov[np.ix_(rows, rows)]
                fits[k, r] = stats.multivariate_normal(seen @ x, S).logpdf(y[k, rows, r])
                gain = P @ seen.T @ np.linalg.inv(S)
                x, P = x + gain @ (y[k, rows, r] - seen @ x), P - gain @ seen @ P
            means[k, :, r], covs[k, :, :, r] = x, P
    return means, covs, fits


def told(estimator):
    """The model as an estimator is told it: where it takes modes, two that are alike."""
    if isinstance(estimator, Filter) and estimator.takes_modes:
        return JumpModel((VARYING, VARYING), np.array([[0.9, 0.1], [0.2, 0.8]]), np.array([0.5, 0.5]))
    return VARYING


def by_kind(sampling):
    """Names of the estimators that draw particles, or do not."""
    return [name for name, e in ESTIMATORS.items() if ("particles" in parameters.fields(e)) == sampling]


def test_no_estimator_refuses_it():
    for name, estimator in ESTIMATORS.items():
        assert estimator.accepts(told(estimator)) is None, name


@pytest.mark.parametrize("name", [n for n in by_kind(False) if n not in INEXACT])
def test_gaussian_filters_are_the_kalman_filter(name):
    y, estimator = measured(), ESTIMATORS[name]
    found, (means, covs, fits) = estimator.run(told(estimator), y, 0), textbook(y)
    np.testing.assert_allclose(found.mean, means, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.cov, covs, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.loglik, fits, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", ["kalman", "ukf", "filterpy:ekf", "filterpy:ukf", "rao-blackwellised"])
def test_a_mean_of_the_noise_is_that_of_its_step(name):
    y, shifts, estimator = measured(), np.array([[0.0, 0.0], [5.0, -3.0], [-2.0, 1.0], [0.0, 7.0]]), ESTIMATORS[name]
    laws = [Gaussian(shift, law.cov) for shift, law in zip(shifts, LAWS, strict=True)]
    biased = dataclasses.replace(VARYING, sensor=AdditiveSensor(Affine(H), lambda k: laws[k - 1]))
    found, expected = estimator.run(biased, y + shifts[:, :, None], 0), estimator.run(VARYING, y, 0)
    np.testing.assert_allclose(found.mean, expected.mean, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", by_kind(True))
def test_particle_filters_come_near_the_kalman_filter(name):
    """Within half a standard deviation of the posterior: with the noise of other steps they would be 2.5 or more away."""
    estimator = parameters.variant(ESTIMATORS[name], {"particles": "400" if name == "progressive" else "2000"})
    y = measured()
    found, (means, covs, _) = estimator.run(told(estimator), y, 0), textbook(y)

    def away(other):
        return np.sqrt(((other - means)[:, :2] ** 2 / np.einsum("tiir->tir", covs)[:, :2]).mean())

    assert found.ok.all()
    assert away(found.mean) < 0.5
    for wrong in ([LAWS[0]] * 4, [LAWS[3]] * 4, [LAWS[0], *LAWS[:3]], [*LAWS[1:], LAWS[3]]):
        assert away(textbook(y, wrong)[0]) > 2.5
    spread = np.einsum("tiir->tr", found.cov) / np.einsum("tiir->tr", covs)
    assert ((spread.mean(1) > 1 / 3) & (spread.mean(1) < 3)).all()


def test_a_function_of_time_that_is_constant_gives_the_bits_of_the_law():
    y, law = measured(), LAWS[0]
    for name in INEXACT:
        found, expected = (
            ESTIMATORS[name].run(dataclasses.replace(VARYING, sensor=AdditiveSensor(VARYING.sensor.mean, noise)), y, 0)
            for noise in (lambda k: law, law)
        )
        np.testing.assert_array_equal(found.mean, expected.mean)
        np.testing.assert_array_equal(found.cov, expected.cov)


def test_the_posterior_bound_is_the_covariance_of_the_kalman_filter():
    y = measured()
    drawn = trajectories(VARYING, STEPS, generators(3, "varying"))
    for r in (0, 2, 3, 4):
        found = bound(VARYING, drawn, np.repeat(y[:, :, r : r + 1], 3, axis=2))
        np.testing.assert_allclose(found.cov, textbook(y)[1][..., r], rtol=1e-9, atol=1e-12)


def test_a_step_without_information_has_no_bound():
    """Where any step's noise has none, and not only the first's."""
    laws = [LAWS[0], LAWS[1], Gaussian.noise(np.ones((2, 2))), LAWS[3]]
    model = dataclasses.replace(VARYING, sensor=AdditiveSensor(Affine(H), lambda k: laws[k - 1]))
    found = bound(model, trajectories(VARYING, STEPS, generators(3, "varying")))
    assert found.kind == NONE
    assert found.reason == "its measurement noise has no finite Fisher information: a singular covariance"


def test_draws_and_densities_are_those_of_the_step():
    x = np.zeros((3, 4000, 1))
    for k, law in enumerate(LAWS, start=1):
        v = VARYING.sensor.sample(generators(4000, "varying"), x, k)[:, :, 0]
        white = np.linalg.solve(np.linalg.cholesky(law.cov), v)
        # Second moments of standard normals, 6 sigma: false alarms below 3e-8 in all.
        assert (np.abs(white @ white.T / 4000 - np.eye(2)) < 6 * np.sqrt((1 + np.eye(2)) / 4000)).all()
        z = np.array([[0.3, np.nan], [-0.2, 1.0]])
        found = VARYING.sensor.logpdf(z, x[:, :2], k)[:, 0]
        both = stats.multivariate_normal(np.zeros(2), law.cov).logpdf(z[:, 0])
        np.testing.assert_allclose(found, [both, stats.norm(0, np.sqrt(law.cov[1, 1])).logpdf(1.0)], rtol=1e-12)


@pytest.mark.parametrize("name", ["guided", "isir", "progressive", "rao-blackwellised"])
def test_a_law_of_another_kind_at_a_later_step_is_not_taken_for_a_gaussian(name):
    laws = [LAWS[0], LAWS[1], StudentT(np.eye(2), 4.0), LAWS[3]]
    model = dataclasses.replace(VARYING, sensor=AdditiveSensor(Affine(H), lambda k: laws[k - 1]))
    assert ESTIMATORS[name].accepts(model) is None
    with pytest.raises(StepError, match="step 3: ValueError: the measurement noise of this step is not Gaussian"):
        ESTIMATORS[name].run(model, measured(), 0)


def test_what_is_no_law_is_named():
    with pytest.raises(ValueError, match=r"AdditiveSensor\.noise is of type float, not a Law"):
        AdditiveSensor(Affine(H), lambda k: 1.0)


@pytest.mark.parametrize("name", ["glr", "nis-chi2"])
def test_detectors_see_what_they_see_when_measurements_are_whitened_beforehand(name):
    y = np.nan_to_num(measured(), nan=1.5)
    whiten = [np.linalg.inv(np.linalg.cholesky(law.cov)) for law in LAWS]
    white = AdditiveSensor(Affine(lambda k: whiten[k - 1] @ H), Gaussian.noise(np.eye(2)))
    expected = ESTIMATORS[name].run(dataclasses.replace(VARYING, sensor=white), np.einsum("tij,tjr->tir", whiten, y), 0)
    np.testing.assert_allclose(ESTIMATORS[name].run(VARYING, y, 0).statistic, expected.statistic, rtol=1e-9)
