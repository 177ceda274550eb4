"""The ballistic cases: the paper's equations recoded with matrices, Jacobians, what is simulated, who follows, the sweep."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cases import ballistic
from estimators import ESTIMATORS
from estimators.bootstrap import Bootstrap
from estimators.ekf import Extended
from estimators.isir import Isir
from estimators.ukf import Unscented
from suite.metrics import METRICS
from suite.noise import Gaussian
from suite.parameters import label
from suite.registry import Catalog, Registry
from tests.oracles import generators

CASES = {case.name: case for case in ballistic.CASES}
CASE = CASES["ballistic/1"]
MODEL = CASE.model
SETTINGS = {  # range, initial velocity, elevation: standard deviations in m, m/s, rad; density of the acceleration in m²/s³
    "ballistic/1": (100.0, 20.0, 0.017, 5.0),
    "ballistic/2": (150.0, 50.0, 0.017, 5.0),
    "ballistic/hard": (2.0, 50.0, 0.2, 200.0),
}
PLUGIN = Path(ballistic.__file__).with_name("sweeps") / "ballistic.py"
SWEEP = Catalog(Registry("estimator", ()), Registry("case", ()), {}).with_plugins([str(PLUGIN)]).cases
GRAVITY, DELTA = 9.8, 2.0

# Pavlov and Bruno, eqs 1-5: s' = Phi s + G (f(s) + (0, -g)).
PHI = np.eye(5)
PHI[0, 1] = PHI[2, 3] = DELTA
PUSH = np.array([[DELTA**2 / 2, 0], [DELTA, 0], [0, DELTA**2 / 2], [0, DELTA], [0, 0]])


def drag(s):
    _, vx, y, vy, beta = s
    c1, c2 = (1.227, 1.093e-4) if y < 9144 else (1.754, 1.49e-4)
    return -0.5 * (GRAVITY / beta) * c1 * np.exp(-c2 * y) * np.linalg.norm([vx, vy]) * np.array([vx, vy])


def successor(s):
    return PHI @ s + PUSH @ (drag(s) - np.array([0, GRAVITY]))


def slope(s):
    """Derivative of `successor`, as worked out by hand."""
    _, vx, y, vy, beta = s
    c1, c2 = (1.227, 1.093e-4) if y < 9144 else (1.754, 1.49e-4)
    density, v, k = c1 * np.exp(-c2 * y), np.hypot(vx, vy), -GRAVITY / (2 * beta)
    df = np.zeros((2, 5))
    df[:, [1, 3]] = k * density * np.array([[v + vx**2 / v, vx * vy / v], [vx * vy / v, v + vy**2 / v]])
    df[:, 2] = -c2 * k * density * v * np.array([vx, vy])
    df[:, 4] = -k / beta * density * v * np.array([vx, vy])
    return PHI + PUSH @ df


@pytest.fixture(scope="module")
def truth():
    """A thousand runs, k = 1 to 50."""
    return CASE.simulate(1000, seed=3)


@pytest.fixture(scope="module")
def states(truth):
    """States along trajectories, from 90 km down, and two on either side of where the density changes its law."""
    edge = np.array([[1e4, -900.0, 9143.9, -200.0, 4e4], [1e4, -900.0, 9144.0, -200.0, 4e4]])
    return np.concatenate([truth.x[::7, :, 0], truth.x[::7, :, 1], edge])


def test_motion_is_the_papers(states):
    found = MODEL.dynamics.mean(states.T, 1).T
    np.testing.assert_allclose(found, [successor(s) for s in states], rtol=1e-13, atol=1e-9)
    assert (states[:, 2] < 9144).any()  # below, and above, the change of law
    assert (states[:, 2] > 20_000).any()


def test_measurements_are_range_and_elevation(states):
    found = MODEL.sensor.mean(states.T, 1)
    z = states[:, 0] + 1j * states[:, 2]
    np.testing.assert_allclose(found, [np.abs(z), np.angle(z)], rtol=1e-14)


def test_jacobians_are_those_worked_out_by_hand_and_by_differences(states):
    F, H = MODEL.dynamics.jacobian(states.T, 1), MODEL.sensor.jacobian(states.T, 1)
    x, y = states[:, 0], states[:, 2]
    r, zero = np.hypot(x, y), np.zeros(len(x))
    np.testing.assert_allclose(H, [[x / r, zero, y / r, zero, zero], [-y / r**2, zero, x / r**2, zero, zero]], rtol=1e-12)
    np.testing.assert_allclose(np.moveaxis(F, -1, 0), [slope(s) for s in states], rtol=1e-10, atol=1e-18)
    inside = states[:-2].T  # a difference does not cross the change of law there
    for law, jacobian in ((MODEL.dynamics, F), (MODEL.sensor, H)):
        for i, d in enumerate((1.0, 0.01, 1.0, 0.01, 1.0)):
            shift = np.zeros((5, 1))
            shift[i] = d
            difference = (law.mean(inside + shift, 1) - law.mean(inside - shift, 1)) / (2 * d)
            np.testing.assert_allclose(jacobian[:, i, :-2], difference, rtol=1e-4, atol=2e-7)


@pytest.mark.parametrize(("name", "setting"), SETTINGS.items())
def test_noises_and_prior_are_as_stated(name, setting):
    case, (sigma_r, sigma_v, sigma_e, q) = CASES[name], setting
    axis = q * np.array([[8 / 3, 2], [2, 2]])
    zero = np.zeros((2, 2))
    process = np.block([[axis, zero, np.zeros((2, 1))], [zero, axis, np.zeros((2, 1))], [np.zeros((1, 4)), np.array([[10.0]])]])
    np.testing.assert_allclose(case.model.dynamics.noise.cov, process)
    np.testing.assert_allclose(case.model.sensor.noise.cov, np.diag([sigma_r**2, sigma_e**2]))
    heading = 190 / 180 * np.pi
    np.testing.assert_allclose(case.model.prior.mean, [232e3, 2290 * np.cos(heading), 88e3, 2290 * np.sin(heading), 40e3])
    np.testing.assert_allclose(case.model.prior.cov, np.diag([1e6, sigma_v**2, 1e6, sigma_v**2, 6.25e6]))
    assert (case.steps, case.interval) == (50, 2.0)
    assert case.model.dynamics.mean is MODEL.dynamics.mean
    assert case.model.sensor.mean is MODEL.sensor.mean
    assert case.model.sensor.angles == (1,)


def test_no_two_cases_share_numbers_and_all_are_given():
    assert list(CASES) == list(SETTINGS)
    noises = [case.simulate(1).y[0, 0, 0] for case in CASES.values()]
    assert len(set(noises)) == 3


@pytest.mark.parametrize("name", SETTINGS)
def test_simulated_noises_are_those_of_the_model(name):
    # 1000 runs, 49 000 process and 50 000 measurement noises: 5 + 2 means and 15 + 3 covariances within 5 standard errors, and
    # those with the step before, 25 + 4: a false alarm has probability below 1e-4 over the three cases.
    model, truth = CASES[name].model, CASES[name].simulate(1000, seed=3)
    x = np.moveaxis(truth.x, 1, 0)
    w = x[:, 1:] - model.dynamics.mean(x[:, :-1], 1)
    v = np.moveaxis(truth.y, 1, 0) - model.sensor.mean(x, 1)
    v[1] = np.angle(np.exp(1j * v[1]))
    for noise, cov in ((w, model.dynamics.noise.cov), (v, model.sensor.noise.cov)):
        deviations = np.sqrt(np.diag(cov))
        flat = noise.reshape(len(cov), -1)
        count, power = flat.shape[1], np.outer(np.diag(cov), np.diag(cov))
        assert (np.abs(flat.mean(1)) < 5 * deviations / np.sqrt(count)).all()
        assert (np.abs(flat @ flat.T / count - cov) < 5 * np.sqrt((power + cov**2) / count)).all()
        lagged = np.einsum("itr,jtr->ij", noise[:, 1:], noise[:, :-1]) / count
        assert (np.abs(lagged) < 5 * np.sqrt(power / count)).all()


def test_first_states_follow_the_prior(truth):
    # x_1 has the mean of f under the prior, nearly f at its mean, and covariance F P0 F' + Q to first order, which is good to
    # a thousandth here; 5 + 5 figures within 5 standard errors of 1000 runs: below 1e-5.
    x = truth.x[0]
    mean, F = successor(MODEL.prior.mean), slope(MODEL.prior.mean)
    variance = np.diag(F @ MODEL.prior.cov @ F.T + MODEL.dynamics.noise.cov)
    assert (np.abs(x.mean(1) - mean) < 5 * np.sqrt(variance / 1000)).all()
    assert (np.abs(x.var(1) - variance) < 5 * variance * np.sqrt(2 / 1000)).all()


def test_elevation_wraps():
    """A target straight to the west is seen at pi or -pi: these are the same measurement."""
    x = np.array([-1000.0, 0.0, 0.0, 0.0, 4e4])[:, None, None]
    z = np.array([[1000.0, 1000.0], [np.pi - 1e-3, -np.pi + 1e-3]])
    density = MODEL.sensor.logpdf(z, np.repeat(x, 2, axis=1), 1)[:, 0]
    assert density[0] == pytest.approx(density[1], rel=1e-9)
    assert np.isfinite(density).all()


def test_trajectories_stay_physical(truth):
    # The ballistic coefficient walks by sqrt(50 · 10) = 22 from a start 16 standard deviations above zero, and a start of
    # three quarters of its mean is 4 deviations off: none of 1000 runs comes near zero.
    x, vx, y, vy, beta = np.moveaxis(truth.x, 1, 0)
    assert np.isfinite(truth.x).all()
    assert np.isfinite(truth.y).all()
    assert beta.min() > 25_000
    assert np.abs(beta - beta[0]).max() < 6 * 22.4
    speed = np.hypot(vx, vy)
    assert (speed[0] > 2200).all()
    assert (np.diff(y.mean(1)) < 0).all()  # the target comes down, and approaches
    assert (np.diff(x.mean(1)) < 0).all()
    assert (speed.mean(1)[-1] < speed.mean(1)[0] / 2).all()  # drag, in the last part
    assert y.min() > 0


def test_below_height_zero_the_air_goes_on_growing_denser():
    np.testing.assert_allclose(ballistic.air_density(np.array([0.0, -1000.0])), [1.227, 1.227 * np.exp(0.1093)], rtol=1e-12)
    deep = np.array([1e4, -900.0, -2000.0, -200.0, 4e4])
    np.testing.assert_allclose(MODEL.dynamics.mean(deep[:, None], 1)[:, 0], successor(deep), rtol=1e-13)


def test_at_rest_there_is_no_drag_and_no_slope():
    rest = np.array([1e4, 0.0, 2e4, 0.0, 4e4])[:, None]
    fallen = [1e4, 0, 2e4 - GRAVITY * DELTA**2 / 2, -GRAVITY * DELTA, 4e4]
    np.testing.assert_allclose(MODEL.dynamics.mean(rest, 1)[:, 0], fallen, rtol=1e-14)
    with np.errstate(invalid="ignore", divide="ignore"):
        assert np.isnan(MODEL.dynamics.jacobian(rest, 1)[[1, 3]]).any()


def test_particles_of_negative_ballistic_coefficient_run_away_and_lose_their_weight():
    """A negative coefficient pushes forward; where a twelfth of the first particles has one, the filter outlives them."""
    forward = np.array([1e5, -2000.0, 2e4, -300.0, -4e4])[:, None]
    assert MODEL.dynamics.mean(forward, 1)[1, 0] < -2000
    truth = CASE.simulate(6, seed=1)
    spread = MODEL.prior.cov + np.diag([0, 0, 0, 0, 28_900.0**2 - 2500.0**2])
    unsure = replace(MODEL, prior=Gaussian(MODEL.prior.mean, spread))
    first = unsure.prior.sample(generators(6, "negative"), (6, 1000))[4]
    assert 0.05 < (first < 0).mean() < 0.12
    estimate = Bootstrap(particles=1000).run(unsure, truth.y, 1)
    assert estimate.ok.all()
    # The last mean is that of particles of positive coefficient: its deviation is far below its distance from zero.
    assert (estimate.mean[-1, 4] > 2 * np.sqrt(estimate.cov[-1, 4, 4])).all()


@pytest.mark.parametrize("name", ["ballistic/1", "ballistic/2"])
def test_what_the_paper_ran_can_be_run(name):
    case = CASES[name]
    assert case.experiment.runs == 100
    for ran in case.experiment.estimators:
        assert label(ESTIMATORS[ran]) == ran
        assert ESTIMATORS[ran].particles == 8000
    assert {p.estimator for p in case.published} <= set(case.experiment.estimators)
    assert {(p.metric, p.block) for p in case.published} <= {("rmse", "position"), ("divergence", "runs")}
    assert CASES["ballistic/hard"].experiment is None


@pytest.mark.parametrize("scenario", [1, 2])
def test_the_sweep_changes_one_thing_at_a_time(scenario):
    """Against the scenario: the variances of q, q̃ (by Δ = 2 s), elevation and first ballistic coefficient that are changed."""
    plain = CASES[f"ballistic/{scenario}"].model
    axis, walk, elevation, beta = 10.0, 10.0, 0.017**2, 2500.0**2
    changed = {
        "q1": (2.0, 2.0, elevation, beta),
        "q0.05": (0.1, walk, elevation, beta),
        "q500": (1000.0, walk, elevation, beta),
        "constant-beta": (axis, 0.0, elevation, beta),
        "degrees": (axis, walk, (0.017 / 180 * np.pi) ** 2, beta),
        "1mrad": (axis, walk, 1e-6, beta),
        "beta10000": (axis, walk, elevation, 1e8),
    }
    assert {n.split(":")[-1] for n in SWEEP if n.startswith(f"sweep:ballistic:{scenario}:")} == set(changed)
    for name, expected in changed.items():
        case = SWEEP[f"sweep:ballistic:{scenario}:{name}"]
        Q, R, P0 = case.model.dynamics.noise.cov, case.model.sensor.noise.cov, case.model.prior.cov
        np.testing.assert_allclose((Q[1, 1], Q[4, 4], R[1, 1], P0[4, 4]), expected, rtol=1e-12)
        np.testing.assert_allclose(Q[:4, :4], plain.dynamics.noise.cov[:4, :4] * Q[1, 1] / 10, rtol=1e-12)
        np.testing.assert_array_equal(np.diag(P0)[:4], np.diag(plain.prior.cov)[:4])
        assert R[0, 0] == plain.sensor.noise.cov[0, 0]
        assert (case.published, case.experiment) == ((), None)
        assert np.isfinite(case.simulate(2).y).all()


@pytest.fixture(scope="module")
def hard():
    """Sixty runs of the hard case, and the estimates of four filters with their default numbers of particles."""
    case = CASES["ballistic/hard"]
    truth = case.simulate(60, seed=1)
    filters = {"ekf": Extended(), "ukf": Unscented(), "bootstrap": Bootstrap(), "isir": Isir()}
    return case, truth, {name: estimator.run(case.model, truth.y, 1) for name, estimator in filters.items()}


def log_error(estimate, truth):
    """Logarithm of each run's root mean square error of the position over the last ten steps."""
    return np.log(((estimate.mean - truth.x)[-10:, [0, 2]] ** 2).sum(1).mean(0)) / 2


@pytest.mark.parametrize("worse", ["bootstrap", "ekf"])
def test_a_look_at_the_measurement_pays_in_the_hard_case(hard, worse):
    # Paired over 60 runs: the mean logarithm of the ratio of errors is below zero by more than 3 standard errors. It is by
    # about 8 for the bootstrap and 5 for the extended filter; were there no gain, a false alarm would have probability 0.002.
    _, truth, estimates = hard
    gain = log_error(estimates["isir"], truth) - log_error(estimates[worse], truth)
    assert gain.mean() + 3 * gain.std(ddof=1) / np.sqrt(60) < 0


def test_linearising_at_one_point_is_too_sure_in_the_hard_case(hard):
    """The extended filter's errors are far beyond its covariance; sigma points, which see the bend, tell their own error."""
    case, truth, estimates = hard
    nees = {name: METRICS["nees"](case, truth, estimates[name])["state"].value for name in ("ekf", "ukf")}
    assert nees["ekf"] > 10
    assert 0.5 < nees["ukf"] < 2


def test_the_papers_scenarios_leave_nothing_to_gain_by_a_look_at_the_measurement():
    """There the noise of a step, seen in range, is a thousandth of the radar's variance; in the hard case, a hundredfold."""
    for name, low, high in (("ballistic/1", 1e-4, 2e-3), ("ballistic/2", 1e-4, 2e-3), ("ballistic/hard", 100, 200)):
        model = CASES[name].model
        H = model.sensor.jacobian(model.prior.mean[:, None], 1)[:, :, 0]
        seen, noise = H @ model.dynamics.noise_cov(1) @ H.T, model.sensor.noise.cov
        assert low < seen[0, 0] / noise[0, 0] < high
