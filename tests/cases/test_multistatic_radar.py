"""The radar on the recorded flight: geometry recomputed another way, outages, noise, and the extract itself."""

import numpy as np
import pandas
import pytest

from cases import multistatic_radar
from cases.multistatic_radar import FLIGHT, OUTAGES, PAIRS, SITES, bistatic, flight, observed

CASES = {case.name: case for case in multistatic_radar.CASES}
NAMES = list(CASES)
TRACK = pandas.read_csv(FLIGHT)
RADIUS = 6_371_000.0  # m, of a round earth


def test_extract_is_as_described():
    assert len(TRACK) == 1193
    np.testing.assert_array_equal(TRACK.t_s, np.arange(2734, 3927))
    assert np.isfinite(TRACK.to_numpy()).all()
    assert abs((TRACK.roll_deg.abs() > 15).mean() - 0.28) < 0.005


@pytest.mark.parametrize("name", NAMES)
def test_shapes_truth_and_outages(name):
    truth = CASES[name].simulate(3, seed=1)
    assert truth.x.shape == (1192, 6, 3)
    assert truth.y.shape == (1192, 8, 3)
    assert np.isfinite(truth.x).all()
    for r in range(3):
        np.testing.assert_array_equal(truth.x[..., r], flight()[1:])
    # The outages in words, written down once more: pairs are Rx1-Tx1, Rx1-Tx2, Rx2-Tx1, Rx2-Tx2, ranges then rates.
    missing = np.zeros((1192, 8), bool)
    missing[100:115] = missing[900:920] = True
    missing[420:480, [1, 3, 5, 7]] = True
    missing[1000:1060, [0, 2, 4, 6]] = True
    for r in range(3):
        np.testing.assert_array_equal(np.isnan(truth.y[..., r]), missing)
    np.testing.assert_array_equal(observed(), ~missing)
    assert [o[:2] for o in OUTAGES] == [(101, 115), (421, 480), (901, 920), (1001, 1060)]


def test_sites_are_the_corners_of_twenty_kilometres():
    around = [SITES[s] for s in ("Rx1", "Tx1", "Rx2", "Tx2")]
    for a, b in zip(around, around[1:] + around[:1], strict=True):
        assert np.hypot(a[0] - b[0], a[1] - b[1]) == 20_000
    assert all(20 <= height <= 60 for _, _, height in SITES.values())


@pytest.mark.parametrize("name", NAMES)
def test_blocks_and_the_quadrilateral(name):
    case = CASES[name]
    components = {block.name: block.components for block in case.blocks}
    assert (components["position"], components["velocity"], components["height"]) == ((0, 1, 2), (3, 4, 5), (2,))
    (region,) = case.regions
    x, y = flight()[:, 0], flight()[:, 1]
    np.testing.assert_array_equal(region.holds(x, y), (np.abs(x) < 10_000) & (np.abs(y) < 10_000))


def test_bistatic_by_plain_loops():
    rng = np.random.default_rng(0)
    states = [*flight()[::100], *rng.uniform(-30_000, 30_000, (10, 6))]
    for x in states:
        expected = []
        for what in ("range", "rate"):
            for rx, tx in PAIRS:
                total = 0.0
                for site in (SITES[rx], SITES[tx]):
                    away = [x[i] - site[i] for i in range(3)]
                    distance = sum(d * d for d in away) ** 0.5
                    total += distance if what == "range" else sum(d * x[3 + i] for i, d in enumerate(away)) / distance
                expected.append(total)
        np.testing.assert_allclose(bistatic(x, 1), expected, rtol=1e-12, atol=1e-9)
    batch = np.stack(states, axis=-1)[:, :, None] * np.ones(3)
    np.testing.assert_allclose(bistatic(batch, 1)[:, 0, 2], bistatic(states[0], 1), rtol=1e-13)


def test_range_rate_is_the_derivative_of_range():
    """Along straight flight exactly; along the recorded flight as well as central differences over 2 s can tell."""
    t = np.linspace(-1e-3, 1e-3, 3)
    for x in flight()[::50]:
        moving = np.stack([*(x[:3, None] + x[3:, None] * t), *(x[3:, None] * np.ones(3))])
        values = bistatic(moving, 1)
        np.testing.assert_allclose((values[:4, 2] - values[:4, 0]) / 2e-3, values[4:, 1], rtol=1e-5, atol=1e-4)
    along = bistatic(flight().T, 1)
    difference = (along[:4, 2:] - along[:4, :-2]) / 2
    assert np.abs(difference - along[4:, 1:-1]).max() < 0.3  # m/s, of up to about 200


def test_velocity_is_the_derivative_of_position():
    x = flight()
    np.testing.assert_allclose(x[1:-1, 3:], (x[2:, :3] - x[:-2, :3]) / 2, atol=6e-4)
    np.testing.assert_allclose(x[[0, -1], 3:], [x[1, :3] - x[0, :3], x[-1, :3] - x[-2, :3]], atol=6e-4)
    ground_speed = np.hypot(x[:, 3], x[:, 4])
    assert (ground_speed > 40).all()
    assert (ground_speed < 250).all()
    assert np.abs(x[:, 5]).max() < 25


def test_distances_agree_with_the_haversine_formula():
    latitude, longitude = np.radians(TRACK.lat_deg.to_numpy()), np.radians(TRACK.lon_deg.to_numpy())
    x = flight()
    pairs = np.random.default_rng(0).integers(0, len(x), (200, 2))
    for i, j in pairs:
        half = np.sin((latitude[i] - latitude[j]) / 2) ** 2
        half += np.cos(latitude[i]) * np.cos(latitude[j]) * np.sin((longitude[i] - longitude[j]) / 2) ** 2
        ground = 2 * RADIUS * np.arcsin(np.sqrt(half))
        found = np.hypot(*(x[i, :2] - x[j, :2]))
        # A round earth is wrong by up to 0.4 % here, flat distances at height by 0.1 %; a height profile by metres.
        assert abs(found - ground) < 0.005 * ground + 5


def test_axes_point_east_north_and_up_from_the_median_position():
    x = flight()
    east, north = TRACK.lon_deg - TRACK.lon_deg.median(), TRACK.lat_deg - TRACK.lat_deg.median()
    height = TRACK.alt_gnss_ft * 0.3048
    assert np.corrcoef(x[:, 0], east)[0, 1] > 0.9999
    assert np.corrcoef(x[:, 1], north)[0, 1] > 0.9999
    # Up is height less the sagitta of the earth below the tangent plane.
    np.testing.assert_allclose(x[:, 2], height - (x[:, 0] ** 2 + x[:, 1] ** 2) / (2 * RADIUS), atol=0.5)
    assert (x[:, 2] > 100).all()
    assert np.hypot(np.median(x[:, 0]), np.median(x[:, 1])) < 200


def test_measurement_noise():
    # About 1080 steps x 20 runs a component, 16 figures: 5 standard errors, false alarm below 1e-5; and independence.
    case = CASES[NAMES[0]]
    truth = case.simulate(20, seed=2)
    e = truth.y - bistatic(np.moveaxis(truth.x, 1, 0), 1).swapaxes(0, 1)
    sigma = np.array([20.0] * 4 + [2.0] * 4)
    for i in range(8):
        seen = e[:, i][~np.isnan(e[:, i])] / sigma[i]
        assert len(seen) > 20_000
        assert abs(seen.mean()) < 5 / np.sqrt(len(seen))
        assert abs((seen**2).mean() - 1) < 5 * np.sqrt(2 / len(seen))
    whole = (e[~np.isnan(e).any((1, 2))] / sigma[:, None]).swapaxes(0, 1).reshape(8, -1)
    across = np.corrcoef(whole)[np.triu_indices(8, 1)]
    assert np.abs(across).max() < 5.5 / np.sqrt(whole.shape[1])


@pytest.mark.parametrize(("name", "vertical"), [(NAMES[0], 1e-6), (NAMES[1], 1.0)])
def test_filters_are_told_the_papers_model(name, vertical):
    model = CASES[name].model
    variances = [700, 700, 1, 70, 70, vertical]
    np.testing.assert_array_equal(model.dynamics.noise.cov, np.diag(variances))
    np.testing.assert_array_equal(model.prior.cov, np.diag(variances))
    np.testing.assert_array_equal(model.prior.mean, flight()[0])
    x = np.array([1.0, 2, 3, 4, 5, 6])[:, None]
    np.testing.assert_array_equal(model.dynamics.mean(x, 1)[:, 0], [5, 7, 9, 4, 5, 6])
    np.testing.assert_array_equal(np.diag(model.sensor.noise.cov), [400] * 4 + [4] * 4)


def test_vertical_speed_changes_as_the_climbing_model_says():
    change = np.diff(flight()[:, 2], n=2)
    assert abs(np.sqrt((change**2).mean()) - 0.9) < 0.1
