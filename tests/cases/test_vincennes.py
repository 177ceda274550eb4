"""The recorded drive through Vincennes: the extract, its map projection, its clock, and what its fixes are like."""

import itertools

import numpy as np
import pandas
import pytest

from cases.vincennes import CASES, FIRST, FIXES, LAST, REFERENCE, drive, lambert93
from estimators.ekf import Extended
from estimators.kalman import Kalman
from estimators.ukf import Unscented

CASE = CASES[0]
FIX, WAY = pandas.read_csv(FIXES), pandas.read_csv(REFERENCE)
FIXED, STATES = drive()
ERROR = FIXED - STATES[:, :2]
KNOWN = ~np.isnan(ERROR).any(1)


def deviation(x):
    """Median absolute deviation along the first axis, scaled to the standard deviation of a Gaussian."""
    return np.median(np.abs(x - np.median(x, 0)), 0) / 0.6744897501960817


def test_the_extract_holds_the_original_numbers():
    assert (len(FIX), len(WAY)) == (465, 587)
    np.testing.assert_array_equal(FIX.iloc[0], [47231, 48.843882989, 2.431385758])
    np.testing.assert_array_equal(FIX.iloc[-1], [47700, 48.842538530, 2.431879537])
    np.testing.assert_array_equal(WAY.iloc[0], [392812.705421, 658272.796, 6860574.600])
    np.testing.assert_array_equal(WAY.iloc[4], [392820.970522, 658259.090, 6860560.055])
    assert FIXES.stat().st_size + REFERENCE.stat().st_size < 300_000


def test_time_runs_forward_and_has_the_stated_gaps():
    assert (np.diff(WAY.t_utc_s) > 0).all()
    between = np.diff(WAY.t_utc_s)
    np.testing.assert_allclose(between[between > 3], [22.565, 4.440, 9.255, 23.110], atol=0.001)
    seconds = FIX.t_gps_s.to_numpy()
    assert np.abs(seconds - np.rint(seconds)).max() < 0.0011
    assert (np.diff(np.rint(seconds)) >= 1).all()
    assert (np.rint(seconds[[0, -1]]) == [FIRST, LAST]).all()
    missing = sorted(set(range(FIRST, LAST + 1)) - set(np.rint(seconds).astype(int).tolist()))
    assert (np.flatnonzero(np.isnan(FIXED[:, 0])) + FIRST).tolist() == missing
    assert len(missing) == 5


@pytest.mark.parametrize(
    ("easting", "northing", "latitude", "longitude"),
    [
        (700000.0, 6600000.0, 46.5, 3.0),
        (658272.796, 6860574.600, 48.84386630536, 2.43144007724),
        (659279.825, 6859487.899, 48.83415788636, 2.44526505812),
        (489353.59, 6587552.20, 46.35499996430, 0.26000003105),
    ],
)
def test_lambert_93_agrees_with_proj(easting, northing, latitude, longitude):
    # Its origin by definition, the others by PROJ from EPSG:2154 to EPSG:4171; 1e-9 degrees are 0.1 mm.
    found = lambert93(np.array(easting), np.array(northing))
    np.testing.assert_allclose(found, (latitude, longitude), rtol=0, atol=1e-9)


def test_distances_on_the_way_are_those_of_the_map():
    """Rows of the reference are 3 m or 6 m of way apart; the projection's scale in Paris is 1 - 7e-5, so metres are metres."""
    length = np.hypot(np.diff(WAY.easting_m), np.diff(WAY.northing_m))
    near = (np.abs(length - 3) < 0.2) | (np.abs(length - 6) < 0.2)
    assert near.mean() > 0.98
    # The way from second to second, against that along the map's own coordinates at the same instants.
    at = np.arange(FIRST, LAST + 1) - 18 + 4 * 86400
    east, north = (np.interp(at, WAY.t_utc_s, axis) for axis in (WAY.easting_m, WAY.northing_m))
    here, there = STATES[1:, :2], STATES[:-1, :2]
    step, expected = np.hypot(*(here - there).T), np.hypot(np.diff(east), np.diff(north))
    known = ~np.isnan(step)
    np.testing.assert_allclose(step[known], expected[known], rtol=2e-4, atol=0.002)


def test_axes_point_east_and_north():
    """Latitude and longitude of the fixes in metres on a sphere with the earth's radii of curvature in Vincennes."""
    seen = ~np.isnan(FIXED[:, 0])
    east = (FIX.lon_deg - FIX.lon_deg.median()) * np.pi / 180 * 6_390_310 * np.cos(np.radians(48.843))
    north = (FIX.lat_deg - FIX.lat_deg.median()) * np.pi / 180 * 6_371_650
    np.testing.assert_allclose(FIXED[seen], np.stack([east, north], axis=1), rtol=1e-3, atol=0.1)


def test_the_truth_is_unknown_in_the_gaps_of_the_reference_only():
    unknown = np.isnan(STATES[:, 0])
    clock = WAY.t_utc_s.to_numpy() + 18 - 4 * 86400
    inside = np.zeros(len(STATES), bool)
    for before, after in itertools.pairwise(clock):
        if after - before > 3:
            inside |= (np.arange(FIRST, LAST + 1) > before) & (np.arange(FIRST, LAST + 1) < after)
    np.testing.assert_array_equal(unknown, inside)
    assert (np.isnan(STATES[1:, 0]).sum(), np.isnan(STATES[1:, 2]).sum()) == (60, 68)
    np.testing.assert_array_equal(np.isnan(STATES[:, 0]), np.isnan(STATES[:, 1]))


def test_velocity_is_the_central_difference_of_position():
    inner = (STATES[2:, :2] - STATES[:-2, :2]) / 2
    known = ~np.isnan(STATES[1:-1, 2])
    np.testing.assert_allclose(STATES[1:-1, 2:][known], inner[known], atol=0.0011)
    speed = np.hypot(STATES[:, 2], STATES[:, 3])
    assert 8 < np.nanmax(speed) < 9
    assert np.nanmin(speed) > 0.1


def test_the_clocks_agree():
    """Shifted by whole seconds against each other, fixes and reference must fit worse: the leap seconds are right."""
    spread = []
    for shift in range(-3, 4):
        moved = np.roll(FIXED, shift, axis=0)[3:-3] - STATES[3:-3, :2]
        spread.append(np.nanmedian(np.hypot(*moved.T)))
    assert int(np.argmin(spread)) == 3
    assert spread[3] < 0.75 * min(spread[2], spread[4])


def test_the_fixes_are_as_stated():
    e = ERROR[KNOWN]
    assert len(e) == 406
    np.testing.assert_allclose(e.mean(0), [0.7, -2.1], atol=0.05)
    np.testing.assert_allclose(e.std(0), [3.3, 4.4], atol=0.05)
    np.testing.assert_allclose(deviation(e), [1.6, 3.1], atol=0.05)
    np.testing.assert_allclose(deviation((e - np.median(e, 0)).ravel()), 2.4, atol=0.05)
    assert abs(np.hypot(*e.T).max() - 29) < 0.5
    both = KNOWN[1:] & KNOWN[:-1]
    lagged = [np.corrcoef(ERROR[1:, i][both], ERROR[:-1, i][both])[0, 1] for i in (0, 1)]
    np.testing.assert_allclose(lagged, [0.6, 0.8], atol=0.05)


def test_filters_are_told_what_was_measured():
    np.testing.assert_array_equal(CASE.model.sensor.noise.cov, 2.4**2 * np.eye(2))
    change = np.diff(STATES[:, 2:], axis=0)
    intensity = CASE.model.dynamics.noise.cov[2, 2]
    np.testing.assert_allclose(np.nanmean(change**2), intensity, atol=0.005)
    # White acceleration of 0.15 m²/s³ over a second: position, velocity and both together.
    expected = np.kron([[0.05, 0.075], [0.075, 0.15]], np.eye(2))
    np.testing.assert_allclose(CASE.model.dynamics.noise.cov, expected, rtol=1e-12)
    np.testing.assert_allclose(CASE.model.dynamics.mean(np.array([1.0, 2, 3, 4])[:, None], 1)[:, 0], [4, 6, 3, 4])
    np.testing.assert_allclose(CASE.model.prior.mean, [*FIXED[0], 0, 0])
    np.testing.assert_allclose(np.sqrt(np.diag(CASE.model.prior.cov)), [2.4, 2.4, 7, 7])


def test_every_run_is_the_recorded_drive():
    truth = CASE.simulate(3, seed=1)
    assert (truth.x.shape, truth.y.shape) == ((469, 4, 3), (469, 2, 3))
    for r in range(3):
        np.testing.assert_array_equal(truth.x[..., r], STATES[1:])
        np.testing.assert_array_equal(truth.y[..., r], FIXED[1:])


@pytest.mark.parametrize("estimator", [Kalman(), Extended(), Unscented()], ids=lambda e: e.name)
def test_filters_run_through_and_are_as_good_as_the_fixes(estimator):
    """The raw fixes are 5.9 m off; as their errors last for seconds, a filter that takes them for white gains nothing."""
    truth = CASE.simulate(1)
    estimate = estimator.run(CASE.model, truth.y)
    assert estimate.ok.all()
    square = np.nanmean((estimate.mean - truth.x) ** 2, axis=(0, 2))
    position, velocity = np.sqrt(square[:2].sum()), np.sqrt(square[2:].sum())
    raw = np.sqrt(np.nanmean(np.sum((truth.y - truth.x[:, :2]) ** 2, axis=1)))
    assert abs(raw - 5.9) < 0.05
    assert 0.8 * raw < position < 1.2 * raw
    assert 0.5 < velocity < 3  # m/s
