"""Lorenz's ring: its flow held against an adaptive integrator and against what is known exactly, and what is simulated."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cases import lorenz96
from estimators.ukf import Unscented
from suite import gaussian

CASES = {case.name: case for case in lorenz96.CASES}
TEN, FORTY = CASES["lorenz96/10"], CASES["lorenz96/40"]
RUNS = {"lorenz96/10": 200, "lorenz96/40": 120}


def velocity(t, s, d):
    """The equations component by component, on indices that go round."""
    x = s.reshape(d, -1)
    return np.stack([(x[(i + 1) % d] - x[i - 2]) * x[i - 1] - x[i] + 8 for i in range(d)]).reshape(s.shape)


def integrated(x, time):
    """States [d, R] after a time, or before it, by an adaptive rule of order 8."""
    found = solve_ivp(velocity, (0, time), x.ravel(), method="DOP853", rtol=1e-11, atol=1e-11, args=(len(x),))
    return found.y[:, -1].reshape(x.shape)


@pytest.fixture(scope="module")
def truths():
    """Some runs of both cases."""
    return {name: case.simulate(RUNS[name], seed=3) for name, case in CASES.items()}


@pytest.mark.parametrize("name", CASES)
def test_flow_is_lorenzs(name, truths):
    model, x = CASES[name].model, truths[name].x[::20, :, :5].transpose(1, 0, 2).reshape(CASES[name].model.n, -1)
    # Here this rule errs by less than 0.01, one of second order by 0.26 and more.
    np.testing.assert_allclose(model.dynamics.mean(x, 1), integrated(x, 0.05), rtol=0, atol=0.03)
    rest = np.full((model.n, 1), 8.0)
    np.testing.assert_array_equal(model.dynamics.mean(rest, 1), rest)


def test_the_rule_is_of_fourth_order_with_steps_of_a_twentieth(truths):
    """The textbook rule, recoded."""
    s = truths[TEN.name].x[50, :, 0]
    a = velocity(0, s, 10)
    b = velocity(0, s + 0.025 * a, 10)
    c = velocity(0, s + 0.025 * b, 10)
    d = velocity(0, s + 0.05 * c, 10)
    found = TEN.model.dynamics.mean(s[:, None], 1)[:, 0]
    np.testing.assert_allclose(found, s + 0.05 / 6 * (a + 2 * b + 2 * c + d), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", CASES)
def test_jacobian_is_that_of_differences_and_shrinks_volumes_as_known(name, truths):
    # The divergence of the flow is -d everywhere, so the determinant over 0.05 is exp(-0.05 d), up to the rule's error.
    model, x = CASES[name].model, truths[name].x[50, :, :3]
    assert gaussian.differentiable(model) is None
    J = model.dynamics.jacobian(x, 1)
    for i in range(model.n):
        shift = 1e-5 * np.eye(model.n)[:, i : i + 1]
        difference = (model.dynamics.mean(x + shift, 1) - model.dynamics.mean(x - shift, 1)) / 2e-5
        np.testing.assert_allclose(J[:, i], difference, atol=1e-7)
    np.testing.assert_allclose(np.linalg.det(np.moveaxis(J, -1, 0)), np.exp(-0.05 * model.n), rtol=0.05)


@pytest.mark.parametrize(("case", "every", "sigma"), [(TEN, 2, 1.5), (FORTY, 1, 1.0)], ids=CASES)
def test_models_are_the_stated_ones(case, every, sigma):
    d = case.model.n
    np.testing.assert_array_equal(case.model.dynamics.noise.cov, np.zeros((d, d)))
    np.testing.assert_array_equal(case.model.sensor.mean.matrix(1), np.eye(d)[::every])
    np.testing.assert_allclose(case.model.sensor.noise.cov, sigma**2 * np.eye(d // every))
    np.testing.assert_array_equal(case.model.prior.cov, np.eye(d))
    assert (case.steps, case.interval) == (200 if case is TEN else 60, 0.05)


@pytest.mark.parametrize("name", CASES)
def test_truth_is_one_orbit_and_its_measurements(name, truths):
    # 7200 and more measurement errors a component: means and covariances within 6 standard errors, 20 and 860 figures, below
    # 2e-6.
    case, truth = CASES[name], truths[name]
    for k in (1, 2, 50):
        np.testing.assert_array_equal(truth.x[k], case.model.dynamics.mean(truth.x[k - 1], k + 1))
    every, sigma = (2, 1.5) if case is TEN else (1, 1.0)
    v = np.moveaxis(truth.y - truth.x[:, ::every], 1, 0).reshape(case.model.m, -1) / sigma
    count = v.shape[1]
    assert (np.abs(v.mean(1)) < 6 / np.sqrt(count)).all()
    assert (np.abs(v @ v.T / count - np.eye(len(v))) < 6 * np.sqrt((1 + np.eye(len(v))) / count)).all()


def test_orbits_start_at_the_stated_law(truths):
    # Traced back from the first measurement's time: 10 + 55 figures of 200 runs within 5.5 standard errors, below 3e-6.
    error = integrated(truths[TEN.name].x[0], -0.05) - TEN.model.prior.mean[:, None]
    assert (np.abs(error.mean(1)) < 5.5 / np.sqrt(200)).all()
    assert (np.abs(error @ error.T / 200 - np.eye(10)) < 5.5 * np.sqrt((1 + np.eye(10)) / 200)).all()


@pytest.mark.parametrize("name", CASES)
def test_late_states_balance_and_the_start_is_one_of_them(name, truths):
    # On the attractor averages do not change: that of d(sum x²)/dt / 2 = sum(-x² + 8 x) is zero, for the products of neighbours
    # cancel. Of late steps over independent runs: 2 figures of 5 standard errors, below 2e-6.
    late = truths[name].x[40:]
    run = (8 * late - late**2).mean((0, 1))
    assert abs(run.mean()) < 5 * run.std(ddof=1) / np.sqrt(len(run))
    spread = (late**2).mean(1)
    assert spread.min() < (CASES[name].model.prior.mean ** 2).mean() < spread.max()
    assert 3.4 < late.std() < 3.9


def test_the_limit_of_divergence_is_that_of_the_mean_of_the_attractor(truths):
    for name, case in CASES.items():
        late = truths[name].x[40:]
        error = np.sqrt(((late - late.mean()) ** 2).sum(1).mean())
        assert error == pytest.approx(case.divergence.limit, rel=0.1)


PRINTED = {
    "lorenz96/10": {
        "regularized[particles=50]": 1.15, "regularized[particles=100]": 0.43, "regularized[particles=800]": 0.29,
        "particle filter, optimal proposal, 50 particles": 0.75, "particle filter, optimal proposal, 100 particles": 0.44,
        "particle filter, optimal proposal, 800 particles": 0.28,
    },
    "lorenz96/40": {"ensemble Kalman filter": 0.18, "ekf": 0.24, "regularized[particles=3000]": 0.26},
}  # fmt: skip


def test_published_figures_are_the_printed_ones():
    for name, case in CASES.items():
        assert {p.estimator: p.value for p in case.published} == PRINTED[name]
        assert case.experiment.estimators == tuple(p.estimator for p in case.published if p.metric)


@pytest.mark.parametrize(("case", "runs", "lost"), [(TEN, 30, 15), (FORTY, 4, 0)], ids=CASES)
def test_sigma_points_follow_the_orbit(case, runs, lost, truths):
    """All of few orbits where all is measured, most where half is: better than the measurements alone would say."""
    truth = truths[case.name]
    estimate = Unscented().run(case.model, truth.y[..., :runs])
    error = np.sqrt(((estimate.mean - truth.x[..., :runs]) ** 2).sum(1))
    assert estimate.ok.all()
    assert ((error > case.divergence.limit).sum(0) >= case.divergence.steps).sum() <= lost
    assert np.median(error[30:]) / np.sqrt(case.model.n) < 0.5
