"""The bearings-only cases are the stated ones."""

import numpy as np
import pytest

from cases.manoeuvre_detection import CASES, DEGREE, NAVAL, NAVAL_LOOSE, observer, prior, turned

BY_NAME = {case.name.removeprefix("manoeuvre-detection/"): case for case in CASES}


def test_ranges_are_the_stated_ones():
    own = observer(NAVAL)
    x = BY_NAME["naval"].simulate(1).x[:, :, 0]
    ranges = np.hypot(x[:, 0] - own[0, 1:], x[:, 2] - own[1, 1:])
    np.testing.assert_allclose(ranges[4::5], [4.15, 3.33, 2.80, 2.82, 2.92, 3.04, 2.47, 1.85], atol=0.0051)


def test_the_target_turns_when_it_is_said_to():
    truth = BY_NAME["naval"].simulate(2)
    course = np.unwrap(np.arctan2(truth.x[:, 3, 0], truth.x[:, 1, 0]))
    turns = np.diff(course) / DEGREE
    np.testing.assert_allclose(turns[truth.mode[1:, 0] == 1], 18.04, atol=0.01)  # counter-clockwise
    np.testing.assert_allclose(turns[truth.mode[1:, 0] == 0], 0, atol=1e-9)
    assert (np.flatnonzero(truth.mode[:, 0]) + 1).tolist() == [*range(11, 21), *range(31, 41)]
    np.testing.assert_array_equal(truth.x[..., 0], truth.x[..., 1])
    assert (truth.y[..., 0] != truth.y[..., 1]).all()


@pytest.mark.parametrize("name", [name for name in BY_NAME if name.endswith("-straight")])
def test_the_twin_never_turns_and_is_the_same_otherwise(name):
    twin, case = BY_NAME[name], BY_NAME[name.removesuffix("-straight")]
    truth, other = twin.simulate(1), case.simulate(1)
    assert not truth.mode.any()
    np.testing.assert_array_equal(truth.x[:10], other.x[:10])
    np.testing.assert_array_equal(twin.model.modes[0].prior.mean, case.model.modes[0].prior.mean)


@pytest.mark.parametrize("scene", [NAVAL, NAVAL_LOOSE], ids=["known", "loose"])
def test_prior_has_the_moments_of_range_bearing_speed_and_course(scene):
    # 400 000 draws; 14 moments within 5.5 standard errors: false alarm below 1e-6.
    rng, count = np.random.default_rng(1), 400_000
    r, s = rng.normal(scene.range, scene.range_std, count), rng.normal(scene.speed, scene.speed_std, count)
    b = DEGREE * rng.normal(scene.bearing, scene.sigma, count)
    c = DEGREE * rng.normal(scene.course_guess, scene.course_std, count)
    x = np.stack([r * np.sin(b), s * np.sin(c), r * np.cos(b), s * np.cos(c)])
    law = prior(scene)
    error = x - law.mean[:, None]
    assert (np.abs(error.mean(1)) < 5.5 * error.std(1) / np.sqrt(count)).all()
    products = error[:, None] * error[None]
    assert (np.abs(products.mean(-1) - law.cov) < 5.5 * products.std(-1) / np.sqrt(count)).all()


def test_a_turn_keeps_the_speed_and_a_circle():
    x = np.array([[1.0], [0.003], [2.0], [-0.001]])
    centre = None
    for k in range(5):
        vx, vy = x[1, 0], x[3, 0]
        rate = NAVAL.acceleration / np.hypot(vx, vy)
        here = np.array([x[0, 0] - vy / rate, x[2, 0] + vx / rate])
        centre = here if centre is None else centre
        np.testing.assert_allclose(here, centre, rtol=1e-9)
        x = turned(NAVAL, x, k)
        np.testing.assert_allclose(np.hypot(x[1, 0], x[3, 0]), np.hypot(0.003, 0.001), rtol=1e-12)
