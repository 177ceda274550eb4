"""Recordings against filters, transitions and geometry written down once more; what is not known; what reads the same."""

import functools
import json

import numpy as np
import pandas
import pytest
from scipy import constants, special, stats
from scipy.integrate import solve_ivp
from scipy.linalg import block_diag

from estimators import ESTIMATORS
from estimators.bootstrap import ESTIMATORS as BOOTSTRAP
from estimators.ekf import Extended
from estimators.kalman import Kalman
from estimators.ukf import ESTIMATORS as UKF
from suite.case import RECORDED
from suite.description import TIME, TURN_DENSITY
from suite.estimator import OK
from suite.jacobian import value_and_derivative
from suite.kinematics import sinc
from suite.metrics import METRICS
from suite.registry import Catalog, Registry
from suite.section import LENGTH, SPEED
from tests.oracles import generators
from tests.recordings import (
    CSV,
    FLIGHT,
    GPS,
    OWN,
    POLAR,
    PRIOR_MEAN,
    PRIOR_STD,
    SECOND,
    THREE,
    TOML,
    TRUTH,
    changed,
    fix,
    integrated,
    own_steps,
    polar,
    simulated,
    textbook,
    without,
    write,
)


@pytest.fixture
def made(tmp_path):
    """A function that writes the files and loads the case."""
    return functools.partial(write, tmp_path)


def agrees(estimator, case, expected):
    """Assert that means and covariances are the expected ones, to 1e-9 of each component's size, in every run."""
    estimate = estimator.run(case.model, case.simulate(2).y, 0)
    for found, given in zip((estimate.mean, estimate.cov), expected, strict=True):
        size = np.abs(given).max(0)
        for r in range(2):
            assert (np.abs(found[..., r] - given) <= 1e-9 * size).all()


def test_ekf_on_two_sensors_at_irregular_times_agrees_with_a_textbook(made):
    csv, steps = simulated(POLAR)
    case = made(without(TOML, "truth"), csv)
    y = case.simulate(1).y
    assert case.steps == 30
    assert case.model.sensor.angles == (1,)
    assert np.isnan(y[0, 2:]).all()
    assert np.isnan(y[1, :2]).all()
    assert not np.isnan(y[2]).any()
    agrees(Extended(), case, textbook(PRIOR_MEAN, np.diag(PRIOR_STD**2), -2.5, steps))


def test_kalman_takes_positions_and_agrees_with_a_textbook(made):
    toml = changed(without(without(TOML, "truth"), "place"), "range-bearing", "position")
    toml = changed(changed(toml, '"km", "deg"', '"km", "m"'), '"0.4 deg"', '"9 m"')
    csv, steps = simulated(SECOND)
    agrees(Kalman(), made(toml, csv), textbook(PRIOR_MEAN, np.diag(PRIOR_STD**2), -2.5, steps))


def test_acceleration_agrees_with_a_textbook(made):
    toml = changed(without(TOML, "truth"), "constant-velocity", "constant-acceleration").replace("m^2/s^3", "m^2/s^5")
    toml = toml.replace("0.5 m^2", "0.0005 m^2").replace("0.2 m^2", "0.0002 m^2") + 'acceleration_std = "0.3 m/s^2"'
    csv, steps = simulated(POLAR, 2, (0.0005, 0.0002))
    case = made(toml, csv)
    assert case.state == ("x", "y", "vx", "vy", "ax", "ay")
    std = np.concat([PRIOR_STD, [0.3, 0.3]])
    mean = np.concat([PRIOR_MEAN, np.zeros(2)])
    agrees(Extended(), case, textbook(mean, np.diag(std**2), -2.5, steps, 2, (0.0005, 0.0002)))


def test_turns_solve_their_differential_equation(made):
    toml = changed(TOML, "constant-velocity", "coordinated-turn").replace("start", 'turn_rate_std = "3 deg/s"\nstart')
    case = made(changed(toml, "[motion]", '[motion]\nturn_noise_density = "0.01 deg^2/s^3"'), truth="time,x,y\n0,1,2\n9,1,2\n")
    dynamics, time = case.model.dynamics, 7.5  # before the last step
    rates = np.array([0.0, 1e-9, -1e-4, 0.9e-2 / time, 1.1e-2 / time, 0.3, -0.5])
    x = np.repeat(np.array([100.0, -50.0, 12.0, 5.0, 0.0])[:, None], len(rates), axis=1)
    x[4] = rates

    def flow(t, s):
        return [s[2], s[3], -s[4] * s[3], s[4] * s[2], 0.0]

    ends = [solve_ivp(flow, (0, time), s, rtol=1e-11, atol=1e-11, method="DOP853").y[:, -1] for s in x.T]
    np.testing.assert_allclose(dynamics.mean(x, 3), np.transpose(ends), rtol=1e-8, atol=1e-8)
    step = 1e-4 * np.array([1, 1, 1, 1, 0.01])
    for j in range(5):
        aside = step[j] * np.eye(5)[:, j, None]
        slope = (dynamics.mean(x + aside, 3) - dynamics.mean(x - aside, 3)) / (2 * step[j])
        np.testing.assert_allclose(dynamics.jacobian(x, 3)[:, j], slope, rtol=1e-5, atol=1e-5)
    straight = integrated(1, time, np.array([0.5, 0.2]))[1]
    np.testing.assert_allclose(dynamics.noise_cov(3), block_diag(straight, 0.01 * np.deg2rad(1) ** 2 * time), rtol=1e-12)
    assert case.model.linear == (2, 3)
    assert [b.name for b in case.blocks] == ["position", "velocity", "turn rate"]


def test_parquet_and_csv_give_the_same_case(made, tmp_path):
    expected = made(THREE, FLIGHT)
    frame = pandas.read_csv(tmp_path / "ferry.csv")
    frame["time"] = pandas.to_datetime(frame["time"], format="ISO8601", utc=True)
    frame.to_parquet(tmp_path / "ferry.parquet")
    found = made(changed(THREE, "ferry.csv", "ferry.parquet"), None)
    np.testing.assert_array_equal(found.simulate(1).y, expected.simulate(1).y)
    for k in (1, 2):
        np.testing.assert_array_equal(found.model.dynamics.noise_cov(k), expected.model.dynamics.noise_cov(k))
    expected = made()
    pandas.read_csv(tmp_path / "ferry.csv").to_parquet(tmp_path / "ferry.parquet")
    pandas.read_csv(tmp_path / "truth.csv").to_parquet(tmp_path / "truth.parquet")
    found = made(changed(changed(TOML, "ferry.csv", "ferry.parquet"), "truth.csv", "truth.parquet"), None, None)
    for a, b in zip(vars(found.simulate(1)).values(), vars(expected.simulate(1)).values(), strict=True):
        np.testing.assert_array_equal(a, b)


def test_units_do_not_change_the_case(made):
    case = made()
    toml = changed(changed(TOML, '"15 m"', '"0.015 km"'), 'time = "s"', 'time = "ms"').replace("-2.5", "-2500")
    toml = changed(changed(toml, '["km", "deg"]', '["m", "rad"]'), '"0.4 deg"', '"6.981317007977318 mrad"')
    csv = f"time,sensor,range,bearing,x,y\n0,pier,2200,{np.deg2rad(38.5)},,\n1500,gps,,,1090,1930\n"
    csv += f"1500,pier,2200,{np.deg2rad(38)},,\n9000,gps,,,1040,1990\n"
    other = made(toml, csv, TRUTH.replace("-2.5", "-2500").replace("1e3", "1e6"))
    np.testing.assert_allclose(other.simulate(1).y, case.simulate(1).y, rtol=1e-12)
    np.testing.assert_allclose(other.simulate(1).x, case.simulate(1).x, rtol=1e-12)
    np.testing.assert_allclose(other.model.sensor.noise.cov, case.model.sensor.noise.cov, rtol=1e-12)
    for k in (1, 2, 3):
        np.testing.assert_allclose(other.model.dynamics.noise_cov(k), case.model.dynamics.noise_cov(k), rtol=1e-12)


def test_rows_with_covariances_of_their_own_agree_with_a_textbook(made):
    agrees(Extended(), made(csv=OWN), textbook(PRIOR_MEAN, np.diag(PRIOR_STD**2), -2.5, own_steps()))


def test_kalman_takes_positions_with_covariances_of_their_own(made):
    toml = changed(without(without(TOML, "truth"), "place"), "range-bearing", "position")
    toml = changed(changed(toml, '"km", "deg"', '"m", "m"'), '"0.4 deg"', '"9 m"')
    csv = "time,sensor,z1,z2,cov11,cov12,cov22\n0,pier,1100,1960,900,50,400\n1.5,gps,1090,1930,4,,9\n3,pier,1085,1915,,,\n"
    expected = [
        (0.0, [(fix, np.array([1100.0, 1960.0]), np.array([[900.0, 50.0], [50.0, 400.0]]), GPS[2])]),
        (1.5, [(fix, np.array([1090.0, 1930.0]), np.diag([4.0, 9.0]), GPS[2])]),
        (3.0, [(fix, np.array([1085.0, 1915.0]), np.diag([15.0, 9.0]) ** 2, GPS[2])]),
    ]
    agrees(Kalman(), made(toml, csv), textbook(PRIOR_MEAN, np.diag(PRIOR_STD**2), -2.5, expected))


def test_no_filter_minds_covariances_of_rows(made):
    with_them, without_them = made(csv=OWN).model, made().model
    for name, estimator in ESTIMATORS.items():
        assert estimator.accepts(with_them) == estimator.accepts(without_them), name


def test_irregular_times_are_those_of_the_steps(made):
    case = made()
    assert case.origin == RECORDED
    np.testing.assert_allclose(case.time, [2.5, 4.0, 11.5], rtol=1e-15)
    even = made(csv="time,sensor,range,bearing,x,y\n-2.4,gps,,,1,2\n-2.3,gps,,,1,2\n-2.2,gps,,,1,2\n")
    assert (even.times, even.interval) == ((), pytest.approx(0.1))
    np.testing.assert_allclose(even.time, [0.1, 0.2, 0.3])
    assert not any("time" in said for said in (*case.assumptions, *even.assumptions))


def test_rows_with_covariances_of_their_own_have_their_density(made):
    case = made(csv=OWN)
    y = case.simulate(2).y
    x = PRIOR_MEAN[:, None, None] + np.random.default_rng(2).normal(0, 5, (4, 2, 3))
    for k, (_, seen) in enumerate(own_steps(), start=1):
        found = case.model.sensor.logpdf(y[k - 1], x, k)
        for r, i in np.ndindex(2, 3):
            expected = 0.0
            for look, z, R, angles in seen:
                error = z - look(x[:, r, i])[0]
                error[angles] = np.angle(np.exp(1j * error[angles]))
                expected += stats.multivariate_normal(np.zeros(2), R).logpdf(error)
            np.testing.assert_allclose(found[r, i], expected, rtol=1e-9)


def test_the_density_of_rows_with_covariances_is_that_of_their_draws(made):
    sensor, draws = made(csv=OWN).model.sensor, 20_000
    y = sensor.sample(generators(1, "own"), np.repeat(PRIOR_MEAN[:, None, None], draws, axis=2), 2)[:, 0]
    error = sensor.residual(y, np.concat([polar(PRIOR_MEAN)[0], PRIOR_MEAN[:2]])[:, None])
    R = block_diag(own_steps()[1][1][0][2], own_steps()[1][1][1][2])
    white = np.linalg.solve(np.linalg.cholesky(R), error)
    # Means, and second moments, of independent standard normals: 6 sigma, false alarms below 3e-8 in all.
    assert (np.abs(white.mean(1)) < 6 / np.sqrt(draws)).all()
    assert (np.abs(white @ white.T / draws - np.eye(4)) < 6 * np.sqrt((1 + np.eye(4)) / draws)).all()


def test_truth_is_linear_between_its_rows(made):
    x = made().simulate(3).x
    share = np.array([2.5, 4.0, 11.5]) / 1002.5
    expected = (1 - share)[:, None] * [1100.0, 1900.0, 1.0, 9.0]
    for r in range(3):
        np.testing.assert_allclose(x[..., r], expected, rtol=1e-12)


def test_what_is_not_known_of_the_truth_is_nan_and_is_not_scored(made):
    case = made(truth="time,x,y\n-2.5,1100,1900\n1e3,0,0\n")
    truth = case.simulate(2)
    assert np.isfinite(truth.x[:, :2]).all()
    assert np.isnan(truth.x[:, 2:]).all()
    estimate = Extended().run(case.model, truth.y, 0)
    scores = METRICS["rmse"](case, truth, estimate)
    assert np.isfinite(scores["position"].value)
    assert scores["velocity"].runs == METRICS["nees"](case, truth, estimate)["state"].runs == 0
    truth = made(without(TOML, "truth")).simulate(2)
    assert np.isnan(truth.x).all()
    assert METRICS["rmse"](case, truth, estimate)["position"].runs == 0


@pytest.mark.parametrize("csv", [CSV, OWN], ids=["one covariance", "covariances of rows"])
def test_filters_of_all_kinds_run_on_a_recording(made, csv):
    case = made(csv=csv)
    y = case.simulate(2).y
    for estimator in (Extended(), *UKF, *BOOTSTRAP):
        assert estimator.accepts(case.model) is None
        found = estimator.run(case.model, y, 1)
        assert [*found.status] == [OK, OK]
        alone = estimator.run(case.model, y[..., :1], 1)
        np.testing.assert_array_equal(found.mean[..., :1], alone.mean)


def test_a_recording_is_a_case_of_a_plugin(made, tmp_path):
    case = made()
    (tmp_path / "mine.py").write_text(f"from suite.recording import load\nCASES = (load({str(case.data[0])!r}),)\n")
    known = Catalog(Registry("estimator", []), Registry("case", []), {}).with_plugins([str(tmp_path / "mine.py")])
    assert known.cases["ferry"].data == tuple(tmp_path / name for name in ("ferry.toml", "ferry.csv", "truth.csv"))
    assert json.loads(json.dumps(case.to_dict()))["divergence"]["limit"] == np.inf
    bounded = made(TOML + '[divergence]\nlimit = "0.5 km"\nsteps = 3\n')
    assert (bounded.divergence.limit, bounded.divergence.steps) == (500.0, 3)
    assert bounded.landmarks == (("pier", -300.0, 200.0),)


def test_units_are_those_of_the_tables():
    lengths = {"m": 1.0, "km": 1e3, "ft": constants.foot, "nmi": constants.nautical_mile}
    speeds = {"m/s": 1.0, "km/h": constants.kmh, "kn": constants.knot, "ft/s": constants.foot}
    times = {"s": 1.0, "ms": 1e-3, "min": constants.minute, "h": constants.hour, "ISO 8601": 1e-6}
    turns = {"rad^2/s^3": 1.0, "deg^2/s^3": constants.degree**2}
    for table, expected in ((LENGTH, lengths), (SPEED, speeds), (TIME, times), (TURN_DENSITY, turns)):
        assert table == pytest.approx(expected, rel=1e-14)


def test_sinc_and_its_slope_are_exact_about_zero():
    angle = np.array([[0.0, 1e-12, -1e-5, 9.99e-3, -1.001e-2, 0.5, -3.0]])
    value, slope = value_and_derivative(sinc, angle)
    np.testing.assert_allclose(value, np.sinc(angle / np.pi), rtol=4e-16)
    np.testing.assert_allclose(slope[0, 0], -special.spherical_jn(1, angle[0]), rtol=1e-9, atol=1e-15)
