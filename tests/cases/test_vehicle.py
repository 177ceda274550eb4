"""The vehicle: the paper's equation recoded, the driver's references, the exact optimum, what is simulated, and its sweep."""

from pathlib import Path

import numpy as np
import pytest

from cases import vehicle
from estimators import ESTIMATORS
from estimators.ekf import Extended
from estimators.sir import SequentialImportanceResampling
from estimators.ukf import Unscented
from suite.case import Truth
from suite.metrics import METRICS
from suite.parameters import label
from suite.registry import Catalog, Registry

CASES = {case.name: case for case in vehicle.CASES}
KNOWN = ("vehicle/1", "vehicle/2", "vehicle/3")
NOISES = {"vehicle/1": (5, 10), "vehicle/2": (10, 15), "vehicle/3": (15, 20), "vehicle/uncertain": (5, 10)}  # variances
OPTIMUM = {"vehicle/1": 1.0749, "vehicle/2": 1.3968, "vehicle/3": 1.6515}


LEVELS = {1: (5, 10), 2: (10, 15), 3: (15, 20)}
PLUGIN = Path(vehicle.__file__).with_name("sweeps") / "vehicle.py"
SWEEP = Catalog(Registry("estimator", ()), Registry("case", ()), {}).with_plugins([str(PLUGIN)]).cases


def successor(x, throttle, steering, T=0.5):
    """Velozo and Souza, eq. 4, for one state."""
    e, n, v, th = x
    acceleration = 100_000 / 1250 * throttle / v - 1 * 0.3 / 1250 * v**2
    return np.array([T * v * np.cos(th) + e, T * v * np.sin(th) + n, T * acceleration + v, T * v * np.tan(steering) / 2.5 + th])


def inputs_at(k, T=0.5):
    return vehicle.throttle(T, k), vehicle.steering(T, k)


def slope(x, throttle, steering):
    """Derivative of `successor`, as worked out by hand."""
    _, _, v, th = x
    F = np.eye(4)
    F[0, 2:] = 0.5 * np.cos(th), -0.5 * v * np.sin(th)
    F[1, 2:] = 0.5 * np.sin(th), 0.5 * v * np.cos(th)
    F[2, 2] += 0.5 * (-80 * throttle / v**2 - 2 * 0.00024 * v)
    F[3, 2] = 0.5 * np.tan(steering) / 2.5
    return F


def eta_of(variances, steps, T=0.5):
    """The exact optimum: a scalar Kalman filter for each coordinate, whose two errors have a norm with Rayleigh's law."""
    process, measurement = variances
    p, total = 0.0, 0.0
    for _ in range(steps):
        prior = p + T**2 * process
        p = prior * measurement / (prior + measurement)
        total += np.sqrt(np.pi * p / 2) / np.sqrt(4)
    return total / steps


@pytest.fixture(scope="module")
def drawn():
    """Three hundred runs of every case."""
    return {name: case.simulate(300, seed=1) for name, case in CASES.items()}


def per_run(estimate, truth):
    """η of each run."""
    return np.sqrt(((estimate.mean - truth.x) ** 2).mean(1)).mean(0)


@pytest.mark.parametrize("k", [1, 30, 60, 105, 119, 205, 410, 560])
def test_motion_and_its_slope_are_the_papers(k):
    law, inputs = CASES["vehicle/1"].model.dynamics, inputs_at(k)
    x = np.array([[3.0, -40, 5, 0.1], [0, 0, 0.6, -2], [900, 20, 25, 3], [-1, 1, 14, 6.3]]).T
    value, derivative = law.linearised(x, k)
    np.testing.assert_allclose(value.T, [successor(s, *inputs) for s in x.T], rtol=1e-13)
    np.testing.assert_allclose(np.moveaxis(derivative, -1, 0), [slope(s, *inputs) for s in x.T], rtol=1e-12, atol=1e-14)


def test_a_vehicle_at_rest_or_rolling_back_is_pushed_as_at_half_a_metre_a_second():
    law, u = CASES["vehicle/1"].model.dynamics, vehicle.throttle(0.5, 3)
    for v in (-3.0, 0.0, 0.2, 0.5):
        assert np.isfinite(law.jacobian(np.array([[0.0], [0], [v], [0]]), 3)).all()
        moved = law.mean(np.array([[0.0], [0], [v], [0]]), 3)[2, 0]
        assert moved == pytest.approx(v + 0.5 * (100_000 * u / 0.5 - 0.3 * v**2) / 1250, rel=1e-12)


@pytest.mark.parametrize("T", [0.5, 0.35, 2.0])
def test_inputs_reproduce_the_references_and_stay_within_bounds(T):
    # Corners of the drive, in seconds; between them everything is linear.
    time, v = [0, 20, 45, 60, 100, 120, 200, 212, 260, 272, 300], [5, 25, 25, 5, 5, 20, 20, 25, 25, 15, 15]
    turns, th = [0, 100, 106, 200, 206, 275, 290, 300], np.pi * np.array([0, 0, 0.5, 0.5, 1, 1, 2, 2])
    inputs = np.array([inputs_at(k, T) for k in range(1, round(300 / T) + 1)])
    x, path = np.array([0.0, 0, 5, 0]), []
    for u in inputs:
        x = successor(x, *u, T)
        path.append(x)
    seconds = T * np.arange(1, len(inputs) + 1)
    np.testing.assert_allclose(np.array(path)[:, 2], np.interp(seconds, time, v), rtol=1e-9)
    np.testing.assert_allclose(np.array(path)[:, 3], np.interp(seconds, turns, th), atol=1e-9)
    if T == 0.5:
        throttle, steering = np.abs(inputs).max(0)
        assert 0.36 < throttle <= 0.37
        assert np.radians(7.4) < steering <= np.radians(7.5)


@pytest.mark.parametrize("name", CASES)
def test_noises_prior_and_length_are_as_stated(name):
    case, (process, measurement) = CASES[name], NOISES[name]
    known = name in KNOWN
    np.testing.assert_array_equal(case.model.dynamics.noise_cov(1), np.diag([process / 4, process / 4, 0, 0]))
    np.testing.assert_array_equal(case.model.sensor.noise.cov, measurement * np.eye(3))
    np.testing.assert_array_equal(case.model.sensor.mean(np.array([[1.0], [2], [3], [4]]), 1), [[1], [2], [3]])
    np.testing.assert_array_equal(case.model.prior.mean, [0, 0, 5, 0])
    np.testing.assert_array_equal(case.model.prior.cov, np.diag([0.0] * 4 if known else [10, 10, 0.25, 0.01]))
    assert (case.steps, case.interval) == (200 if known else 600, 0.5)


def test_published_figures_are_those_of_the_table():
    table = {1: (1.0929, 4.9375), 2: (1.3458, 5.3851), 3: (1.6726, 10.3337)}
    for scenario, figures in table.items():
        printed = [p for p in CASES[f"vehicle/{scenario}"].published if p.value is not None]
        assert [(p.estimator, p.value, p.metric, p.block, p.runs) for p in printed] == [
            ("sir[particles=300]", figures[0], "eta", "state", 100), ("ukf", figures[1], "eta", "state", 100)
        ]  # fmt: skip
        assert CASES[f"vehicle/{scenario}"].experiment.runs == 100
    assert CASES["vehicle/uncertain"].published == ()
    assert CASES["vehicle/uncertain"].experiment is None


@pytest.mark.parametrize("name", [*KNOWN, "sweep:vehicle:1:mistuned:T0.5:100s"])
def test_what_the_paper_ran_can_be_run(name):
    case = (CASES | dict(SWEEP))[name]
    for ran in case.experiment.estimators:
        assert label(ESTIMATORS[ran]) == ran
        assert ESTIMATORS[ran].accepts(case.model) is None
    assert {p.estimator for p in case.published} <= set(case.experiment.estimators)
    assert {p.metric for p in case.published} <= set(METRICS)


@pytest.mark.parametrize("name", CASES)
def test_simulated_noises_are_those_of_the_model(name, drawn):
    # White noises of 300 runs: mean, variance, and correlation with the step before and with each other; 5 + 5 + 5 + 4 figures
    # a case of 5 standard errors: a false alarm has probability below 5e-5 over the four cases.
    case, truth = CASES[name], drawn[name]
    process, measurement = NOISES[name]
    inputs = [inputs_at(k) for k in range(2, case.steps + 1)]
    w = truth.x[1:] - np.stack([successor(x, *u) for x, u in zip(truth.x[:-1], inputs, strict=True)])
    np.testing.assert_allclose(w[:, 2:], 0, atol=1e-12)  # no noise on speed and heading
    white = [*w[:, :2].swapaxes(0, 1) / (0.5 * process**0.5), *(truth.y - truth.x[:, :3]).swapaxes(0, 1) / measurement**0.5]
    for noise in white:
        assert abs(noise.mean()) < 5 / np.sqrt(noise.size)
        assert abs((noise**2).mean() - 1) < 5 * np.sqrt(2 / noise.size)
        assert abs((noise[1:] * noise[:-1]).mean()) < 5 / np.sqrt(noise[1:].size)
    for a, b in ((0, 1), (2, 3), (2, 4), (3, 4)):
        assert abs((white[a] * white[b]).mean()) < 5 / np.sqrt(white[a].size)


def test_the_uncertain_start_is_drawn_and_the_known_one_is_not(drawn):
    # The first speed and heading follow the start's, the speed less what drag and throttle change: 300 runs, 2 variances and 2
    # means within 5 standard errors, false alarm below 3e-6.
    first = drawn["vehicle/uncertain"].x[0, 2:]
    v = 5 + 0.5 * np.linspace(-6, 6, 4001)
    share = np.exp(-(np.linspace(-6, 6, 4001) ** 2) / 2) / np.exp(-(np.linspace(-6, 6, 4001) ** 2) / 2).sum()
    after = successor([0, 0, v, 0], *inputs_at(1))[2]
    mean = share @ after
    for sample, centre, variance in ((first[0], mean, share @ (after - mean) ** 2), (first[1], 0.0, 0.01)):
        assert abs(sample.mean() - centre) < 5 * np.sqrt(variance / 300)
        assert abs(((sample - centre) ** 2).mean() / variance - 1) < 5 * np.sqrt(2 / 300)
    for name in KNOWN:
        expected = successor([0, 0, 5, 0], *inputs_at(1))[2:]
        np.testing.assert_allclose(drawn[name].x[0, 2:], np.repeat(expected[:, None], 300, axis=1), atol=1e-12)


@pytest.mark.parametrize("name", KNOWN)
def test_the_exact_optimum_follows_from_the_model(name):
    """Two scalar Kalman filters, and the whole filter's covariance with the slope worked out by hand, have the stated η."""
    assert eta_of(NOISES[name], 200) == pytest.approx(OPTIMUM[name], abs=5e-5)
    model, x, P, total = CASES[name].model, np.array([0.0, 0, 5, 0]), np.zeros((4, 4)), 0.0
    H, Q, R = np.eye(3, 4), model.dynamics.noise_cov(1), model.sensor.noise.cov
    for k in range(1, 201):
        inputs = inputs_at(k)
        F = slope(x, *inputs)
        x, P = successor(x, *inputs), F @ P @ F.T + Q
        P = P - P @ H.T @ np.linalg.solve(H @ P @ H.T + R, H @ P)
        total += np.sqrt(np.pi * P[0, 0] / 8) / 200
        np.testing.assert_allclose(P, P[0, 0] * np.diag([1, 1, 0, 0]), atol=1e-12)
    assert total == pytest.approx(OPTIMUM[name], abs=5e-5)


@pytest.mark.parametrize("name", KNOWN)
@pytest.mark.parametrize("estimator", [Extended(), Unscented()], ids=["ekf", "ukf"])
def test_gaussian_filters_reach_the_optimum(name, estimator, drawn):
    # The mean over 300 independent runs within 5 standard errors, below 2 percent: 6 figures, false alarm below 4e-6.
    estimate = estimator.run(CASES[name].model, drawn[name].y)
    eta = per_run(estimate, drawn[name])
    error = eta.std(ddof=1) / np.sqrt(len(eta))
    assert 5 * error < 0.02 * OPTIMUM[name]
    assert abs(eta.mean() - OPTIMUM[name]) < 5 * error
    np.testing.assert_allclose(estimate.mean[:, 2:], drawn[name].x[:, 2:], atol=1e-9)  # known, and nothing to correct
    assert METRICS["eta"](CASES[name], drawn[name], estimate)["state"].value == pytest.approx(eta.mean(), rel=1e-12)


@pytest.mark.parametrize("name", KNOWN)
def test_a_particle_filter_of_the_papers_size_is_a_few_thousandths_above_the_optimum(name, drawn):
    # Paired with the exact filter over 60 runs: never below it by more than 5 standard errors, and within 3 percent.
    model, y = CASES[name].model, drawn[name].y[..., :60]
    truth = Truth(drawn[name].x[..., :60], y)
    found, exact = SequentialImportanceResampling(particles=300).run(model, y, 1), Extended().run(model, y)
    excess = per_run(found, truth) - per_run(exact, truth)
    error = excess.std(ddof=1) / np.sqrt(60)
    assert excess.mean() > -5 * error
    assert excess.mean() + 5 * error < 0.03 * OPTIMUM[name]


def test_printed_levels_cannot_be_standard_deviations():
    """Doubling both standard deviations doubles η, and the third scenario's are no less than twice the first's."""
    for steps in (50, 200, 600):
        first, doubled, third = (eta_of((a**2, b**2), steps) for a, b in ((5, 10), (10, 20), (15, 20)))
        assert doubled == pytest.approx(2 * first, rel=1e-12)
        assert third > doubled
    assert 1.6726 < 2 * 1.0929


def test_speed_and_heading_are_found_where_the_start_is_uncertain(drawn):
    """Where the start is uncertain, the filter's errors are those that its covariance tells, and speed becomes known."""
    case, truth = CASES["vehicle/uncertain"], drawn["vehicle/uncertain"]
    estimate = Unscented().run(case.model, truth.y)
    # Normalised squared errors of single steps are chi-square numbers of four degrees: mean 4, variance 8, 300 runs; the
    # filter is nearly exact here. Three steps of 5 standard errors: false alarm below 2e-6.
    for k in (50, 300, 599):
        e = (estimate.mean - truth.x)[k].T
        squared = np.einsum("ri,rij,rj->r", e, np.linalg.inv(np.moveaxis(estimate.cov[k], -1, 0)), e)
        assert abs(squared.mean() - 4) < 5 * np.sqrt(8 / 300)
    assert (estimate.cov[-1, 2, 2] < 0.25 / 30).all()
    assert (truth.x[:, 2] > 0.5).all()  # no vehicle stalls: the clip of the engine's force is never at work


PERIODS, HORIZONS = (0.1, 0.2, 0.35, 0.5, 0.7, 1.0, 2.0), (100, 300)


def test_the_sweep_has_every_period_horizon_and_reading():
    kinds = ("variances", "deviations", "mistuned")
    swept = {f"{i}:{kind}:T{T:g}:{t}s" for i in LEVELS for kind in kinds for T in PERIODS for t in HORIZONS}
    assert {name.removeprefix("sweep:vehicle:") for name in SWEEP} == swept
    assert not set(SWEEP) & set(CASES)


@pytest.mark.parametrize("T", PERIODS)
@pytest.mark.parametrize(("reading", "power"), [("variances", 1), ("deviations", 2)])
def test_a_swept_case_is_the_scenario_with_another_period_horizon_or_reading(T, reading, power):
    x = np.array([3.0, -40, 14, 2])
    for scenario, (process, measurement) in LEVELS.items():
        for horizon in HORIZONS:
            case = SWEEP[f"sweep:vehicle:{scenario}:{reading}:T{T:g}:{horizon}s"]
            model, k = case.model, round(103 / T)
            assert (case.interval, case.steps, case.origin) == (T, round(horizon / T), "drawn from the model")
            np.testing.assert_allclose(model.dynamics.noise_cov(1), np.diag([T**2 * process**power] * 2 + [0, 0]), rtol=1e-14)
            np.testing.assert_array_equal(model.sensor.noise.cov, measurement**power * np.eye(3))
            np.testing.assert_array_equal(model.prior.cov, np.zeros((4, 4)))
            moved = successor(x, *inputs_at(k, T), T)
            np.testing.assert_allclose(model.dynamics.mean(x[:, None], k)[:, 0], moved, rtol=1e-13)
            assert [p.value for p in case.published] == [p.value for p in CASES[f"vehicle/{scenario}"].published]


@pytest.mark.parametrize(
    ("reading", "optimum"), [("variances", (1.4001, 1.7965, 2.1123)), ("deviations", (3.9094, 6.5099, 9.0290))]
)
def test_the_optimum_of_a_swept_case_follows_from_its_model(reading, optimum):
    """Two scalar Kalman filters with the covariances of the swept model have the stated η."""
    for scenario, eta in zip(LEVELS, optimum, strict=True):
        case = SWEEP[f"sweep:vehicle:{scenario}:{reading}:T1:300s"]
        told = case.model.dynamics.noise_cov(1)[0, 0], case.model.sensor.noise.cov[0, 0]
        assert eta_of(told, case.steps, 1.0) == pytest.approx(eta, abs=5e-5)


@pytest.mark.parametrize("scenario", LEVELS)
def test_filters_told_identities_are_far_from_the_optimum_though_the_truth_is_the_papers(scenario):
    case, (process, measurement) = SWEEP[f"sweep:vehicle:{scenario}:mistuned:T0.5:100s"], LEVELS[scenario]
    model, truth = case.model, case.simulate(40, seed=1)
    assert case.origin == "drawn from another model than the filters are told"
    for told in (model.prior.cov, model.dynamics.noise_cov(1), model.sensor.noise.cov):
        np.testing.assert_array_equal(told, np.eye(len(told)))
    # 16 000 process and 24 000 measurement noises: 2 variances within 5 standard errors, below 2e-6 over the scenarios.
    w, v = (truth.x[1:, :2] - truth.x[:-1, :2]), truth.y - truth.x[:, :3]
    w[:, 0] -= 0.5 * truth.x[:-1, 2] * np.cos(truth.x[:-1, 3])
    w[:, 1] -= 0.5 * truth.x[:-1, 2] * np.sin(truth.x[:-1, 3])
    for noise, variance in ((w, process / 4), (v, measurement)):
        assert abs((noise**2).mean() / variance - 1) < 5 * np.sqrt(2 / noise.size)
    np.testing.assert_allclose(truth.x[:, 3], 0, atol=1e-12)  # the first 100 s lead to the east, without noise on the heading
    assert per_run(Unscented().run(model, truth.y), truth).mean() > 1.5 * OPTIMUM[f"vehicle/{scenario}"]
    (printed,) = case.published
    assert (printed.estimator, printed.value) == ("ukf[alpha=0.001]", CASES[f"vehicle/{scenario}"].published[1].value)
