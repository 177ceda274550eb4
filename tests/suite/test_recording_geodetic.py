"""Recordings on the globe: places, stations far from the origin, times with zones."""

import functools
import time

import numpy as np
import pymap3d
import pytest

from tests.recordings import FLIGHT, THREE, changed, without, write


@pytest.fixture
def made(tmp_path):
    """A function that writes the files and loads the case."""
    return functools.partial(write, tmp_path)


def test_geodetic_places_are_converted_as_published(made):
    y = made(THREE, FLIGHT).simulate(1).y
    # The Matterhorn seen from Zermatt: example of geodetic2enu in the documentation of MathWorks' Mapping Toolbox.
    np.testing.assert_allclose(y[0, :3, 0], [-7134.8, -4556.3, 2852.4], atol=0.05)
    # From the equator at Greenwich, the semi-axes of WGS84 themselves.
    origin = changed(THREE, '["46.017 deg", "7.750 deg", "1673 m"]', '["0 deg", "0 deg", "0 m"]')
    places = "2024-05-01,gps,0,0,0,\n2024-05-02,gps,0,90,0,\n2024-05-03,gps,90,0,0,\n2024-05-04,gps,0,-90,1000,\n"
    y = made(origin, FLIGHT.splitlines()[0] + "\n" + places).simulate(1).y[:, :3, 0]
    a, b = 6378137.0, 6356752.314245
    np.testing.assert_allclose(y, [[a, 0, -a], [0, b, -a], [-a - 1000, 0, -a]], atol=1e-5)


def test_the_origin_is_the_first_fix_unless_it_is_stated(made):
    case = made(without(THREE, "origin"), FLIGHT)
    np.testing.assert_allclose(case.model.prior.mean, np.zeros(6), atol=1e-9)
    np.testing.assert_allclose(np.diag(case.model.prior.cov), [25, 25, 25, 1e4, 1e4, 1e4])


def test_a_radar_far_from_the_origin_has_its_own_north_and_horizon(made):
    case = made(THREE, FLIGHT)
    rng = np.random.default_rng(3)
    latitude, longitude, height = rng.uniform(44, 49, 20), rng.uniform(5, 11, 20), rng.uniform(0, 12e3, 20)
    x = np.zeros((6, 20))
    x[:3] = pymap3d.geodetic2enu(latitude, longitude, height, 46.017, 7.75, 1673.0)
    x[3:] = rng.normal(0, 100, (3, 20))
    azimuth, elevation, distance = pymap3d.geodetic2aer(latitude, longitude, height, 46.5, 8.7, 300.0)
    found = case.model.sensor.mean(x, 1)
    assert case.model.sensor.angles == (4, 5)
    np.testing.assert_allclose(found[3], distance, rtol=1e-10)
    np.testing.assert_allclose(np.rad2deg(found[4]) % 360, azimuth, atol=1e-9)
    np.testing.assert_allclose(np.rad2deg(found[5]), elevation, atol=1e-9)
    assert np.abs(np.rad2deg(np.atan2(*(x[:2] - np.array(case.landmarks[0][1:])[:, None]))) % 360 - azimuth).max() > 0.5
    later = np.concat([x[:3] + 1e-3 * x[3:], x[3:]])
    np.testing.assert_allclose(found[6], (case.model.sensor.mean(later, 1)[3] - found[3]) / 1e-3, atol=1e-3)


def test_times_in_iso_8601_have_zones_and_fractions(made):
    case = made(THREE, FLIGHT)
    assert case.steps == 2
    assert case.model.dynamics.mean.matrix(1)[0, 3] == 2.5
    assert case.model.dynamics.mean.matrix(2)[0, 3] == 7.625
    np.testing.assert_allclose(case.simulate(1).y[1, 3:, 0], [1e5, np.deg2rad(-130), np.deg2rad(1.2), -300 * 1852 / 3600])
    assert np.isnan(case.simulate(1).y[0, 3:]).all()


def test_a_first_fix_in_space_is_where_the_radar_sees_it(made):
    rows = FLIGHT.splitlines()
    swapped = [rows[0], rows[3].replace("12:00:10.125", "11:00:00"), *rows[1:3]]
    case = made(THREE, "\n".join(swapped))
    seen, slope = (f(case.model.prior.mean[:, None], 1)[..., 0] for f in (case.model.sensor.mean, case.model.sensor.jacobian))
    np.testing.assert_allclose(seen[3:6], [1e5, np.deg2rad(-130), np.deg2rad(1.2)], rtol=1e-10)
    back = slope[3:6, :3] @ case.model.prior.cov[:3, :3] @ slope[3:6, :3].T
    np.testing.assert_allclose(back, np.diag([20, np.deg2rad(0.2), 5e-3]) ** 2, rtol=1e-8, atol=1e-7)
    assert case.steps == 2


def test_times_without_a_zone_are_universal_wherever_they_are_read(made, monkeypatch):
    try:
        monkeypatch.setenv("TZ", "EST+5")
        time.tzset()
        assert made(THREE, FLIGHT).model.dynamics.mean.matrix(2)[0, 3] == 7.625
    finally:
        monkeypatch.undo()
        time.tzset()


PLANE = """
title = "A boat on a mountain lake"
measurements = "ferry.csv"
truth = "truth.csv"
time = "s"
coordinates = {kind = "geodetic", dimensions = 2, origin = ["47 deg", "9 deg", "420 m"]}
motion = {kind = "constant-velocity", noise_density = "0.1 m^2/s^3"}
prior = {start = "first fix", velocity_std = "3 m/s"}
sensors.gps = {kind = "position", units = "deg", std = "5 m"}
sensors.mast = {kind = "range", place = ["47.01 deg", "9.02 deg"], units = "m", std = "5 m"}
"""


def test_in_the_plane_all_is_at_the_height_of_the_origin(made):
    csv = "time,sensor,z1,z2,cov11,cov12,cov22\n0,gps,47.02,9.03,4,1,9\n2,gps,47.021,9.031,,,\n3,mast,1600,,,,\n"
    case = made(PLANE, csv, "time,latitude,longitude\n0,47.02,9.03\n4,47.024,9.034\n")
    places = np.array([[47.02, 9.03], [47.024, 9.034], [47.01, 9.02]])
    first, last, mast = np.transpose(pymap3d.geodetic2enu(*places.T, 420.0, 47, 9, 420.0)[:2])
    np.testing.assert_allclose(case.model.prior.mean, [*first, 0, 0], rtol=1e-12)
    np.testing.assert_array_equal(case.model.prior.cov[:2, :2], [[9, 1], [1, 4]])
    truth = case.simulate(1)
    np.testing.assert_allclose(truth.x[:, :2, 0], [(first + last) / 2, first + 0.75 * (last - first)], rtol=1e-10)
    np.testing.assert_allclose(case.landmarks[0][1:], mast, rtol=1e-12)
    seen = case.model.sensor.mean(np.array([*last, 0, 0])[:, None], 1)
    away = pymap3d.geodetic2aer(47.024, 9.034, 420.0, 47.01, 9.02, 420.0)[2]
    np.testing.assert_allclose(seen[:, 0], [*last, away], rtol=1e-10)
    assert any("height of the origin" in said for said in case.assumptions)


def test_deviations_and_covariances_stand_in_the_order_of_latitude_longitude_height(made):
    toml = changed(THREE, 'std = "5 m"', 'std = ["1 m", "100 m", "6 m"]')
    rows = FLIGHT.splitlines()
    own = "\n".join([rows[0] + ",cov11,cov12,cov13,cov22,cov23,cov33", *(r + ",,,,,," for r in (rows[1], rows[3]))])
    own += "\n2024-05-01T13:00:00Z,gps,45.976,7.658,4531,,4,1,2,100,3,49\n"
    case = made(toml, own)
    # Latitude grows to the north, the second axis of the state.
    np.testing.assert_allclose(np.diag(case.model.prior.cov)[:3], np.square([100, 1, 6]), rtol=1e-12)
    np.testing.assert_allclose(np.diag(case.model.sensor.noise(1).cov)[:3], np.square([100, 1, 6]), rtol=1e-12)
    np.testing.assert_array_equal(case.model.sensor.noise(2).cov[:3, :3], [[100, 1, 3], [1, 4, 2], [3, 2, 49]])
    place = 'position = ["46 deg", "8 deg", "7 m"]\nposition_std = ["2 m", "30 m", "4 m"]\n'
    stated = made(changed(toml, '"first fix"', "2024-05-01T11:00:00Z") + place, FLIGHT).model.prior
    np.testing.assert_allclose(stated.mean[:3], pymap3d.geodetic2enu(46, 8, 7, 46.017, 7.75, 1673), rtol=1e-9)
    np.testing.assert_allclose(np.diag(stated.cov)[:3], np.square([30, 2, 4]), rtol=1e-12)
    plane = made(changed(PLANE, 'units = "deg", std = "5 m"', 'units = "deg", std = ["1 m", "8 m"]'), *PLANE_FILES)
    np.testing.assert_allclose(np.diag(plane.model.prior.cov)[:2], [64, 1], rtol=1e-12)
    np.testing.assert_allclose(np.diag(plane.model.sensor.noise.cov)[:2], [64, 1], rtol=1e-12)


PLANE_FILES = "time,sensor,z1,z2\n0,gps,47.02,9.03\n3,mast,1600,\n", "time,latitude,longitude\n0,47,9\n4,47,9\n"
COAST = (
    changed(without(PLANE, "sensors.mast"), "420 m", "4000 m")
    + """
[sensors.radar]
kind = "range-bearing-rate"
place = ["48.5 deg", "10.5 deg"]
units = ["m", "deg", "m/s"]
std = ["10 m", "0.1 deg", "1 m/s"]
"""
)
COASTS = "time,sensor,z1,z2,z3\n0,gps,47,9,\n1,radar,1,2,3\n", "time,latitude,longitude\n0,47,9\n4,47,9\n"


def test_in_the_plane_what_is_far_is_seen_over_the_curve_of_the_earth(made):
    sensor, rng = made(COAST, *COASTS).model.sensor, np.random.default_rng(4)
    latitude, longitude, height = rng.uniform(38, 56, 40), rng.uniform(-5, 23, 40), np.full(40, 4000.0)
    radar, x = (48.5, 10.5, 4000.0), np.zeros((4, 40))

    def placed(latitude, longitude):
        return np.array(pymap3d.geodetic2enu(latitude, longitude, height, 47, 9, 4000.0)[:2])

    turns = rng.normal(0, 1e-3, (2, 40))  # degrees a second
    x[:2] = placed(latitude, longitude)
    x[2:] = (placed(latitude + 0.01 * turns[0], longitude + 0.01 * turns[1]) - x[:2]) / 0.01
    azimuth, _, distance = pymap3d.geodetic2aer(latitude, longitude, height, *radar)
    later = pymap3d.geodetic2aer(latitude + 0.01 * turns[0], longitude + 0.01 * turns[1], height, *radar)[2]
    found = sensor.mean(x, 1)[2:]
    assert distance.max() > 1e6
    np.testing.assert_allclose(found[0], distance, rtol=0, atol=1e-3)
    np.testing.assert_allclose(np.rad2deg(found[1]) % 360, azimuth, atol=1e-7)
    np.testing.assert_allclose(found[2], (later - distance) / 0.01, atol=1e-3)
    for j, step in enumerate((10.0, 10.0, 1.0, 1.0)):
        aside = step * np.eye(4)[:, j, None]
        slope = (sensor.mean(x + aside, 1) - sensor.mean(x - aside, 1)) / (2 * step)
        np.testing.assert_allclose(sensor.jacobian(x, 1)[:, j], slope, rtol=1e-5, atol=1e-10)


def test_in_the_plane_points_beyond_the_edge_of_the_earth_are_seen_somewhere(made):
    sensor = made(COAST, *COASTS).model.sensor
    away = np.array([6.3e6, 6.4e6, 1e7, 1e9])
    for x in (np.outer([1, 0, 3, 0], away), np.outer([0, -1, 0, 3], away), np.outer([-1, 1, 1, 2], away)):
        assert np.isfinite(sensor.mean(x, 1)).all()
        assert np.isfinite(sensor.jacobian(x, 1)).all()
        assert (np.diff(sensor.mean(x, 1)[2]) > 0).all()


@pytest.mark.parametrize("target", [(45.2, 14.1, 4000.0), (49.5, 3.0, 4000.0)], ids=["in the south-east", "in the west"])
def test_a_first_fix_in_the_plane_is_where_a_far_radar_sees_it(made, target):
    azimuth, _, distance = pymap3d.geodetic2aer(*target, 48.5, 10.5, 4000.0)
    assert distance > 4e5
    csv = changed(COASTS[0], "0,gps,47,9,\n1,radar,1,2,3", f"0,radar,{distance:.6f},{azimuth:.12f},0\n1,gps,47,9,")
    model = made(COAST, csv, COASTS[1]).model
    np.testing.assert_allclose(model.prior.mean[:2], pymap3d.geodetic2enu(*target, 47, 9, 4000.0)[:2], rtol=0, atol=1e-3)
    slope = model.sensor.jacobian(model.prior.mean[:, None], 1)[2:4, :2, 0]
    back = slope @ model.prior.cov[:2, :2] @ slope.T
    np.testing.assert_allclose(back, np.diag([10, np.deg2rad(0.1)]) ** 2, rtol=1e-8, atol=1e-8)


def test_a_range_as_wide_as_the_sky_is_no_fix(made):
    csv = changed(COASTS[0], "0,gps,47,9,\n1,radar,1,2,3", "0,radar,1e12,2,0\n1,gps,47,9,\n2,gps,47,9,")
    model = made(COAST, csv, COASTS[1]).model
    np.testing.assert_allclose(model.prior.mean, np.zeros(4), atol=1e-6)
