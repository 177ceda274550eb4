"""Systematic resampling against its definition, one slot at a time."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from suite.resampling import select, systematic
from tests.oracles import Fixed, generators

ALMOST_ONE = float(np.nextafter(1.0, 0.0))


def by_definition(weights, u):
    """Slot s takes the first particle whose cumulative weight exceeds (s + u) / N."""
    count = len(weights)
    edges = np.cumsum(weights)
    return np.searchsorted(edges / edges[-1], (np.arange(count) + u) / count, side="right")


def counts(indices, count):
    return np.stack([np.bincount(row, minlength=count) for row in indices])


@st.composite
def weights_of_runs(draw):
    runs, count = draw(st.integers(1, 4)), draw(st.integers(1, 40))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    weights = rng.dirichlet(np.full(count, draw(st.sampled_from([0.05, 0.5, 5.0, 500.0]))), runs)
    if draw(st.booleans()):  # zeros, at the end too
        keep = rng.random((runs, count)) < 0.6
        keep[:, rng.integers(count)] = True
        weights = weights * keep + 1e-300 * keep
        weights /= weights.sum(1, keepdims=True)
    uniform = draw(st.sampled_from([None, 0.0, 0.5, ALMOST_ONE]))
    return weights, rng.random(runs) if uniform is None else np.full(runs, uniform)


@settings(max_examples=400, deadline=None, derandomize=True)
@given(weights_of_runs())
def test_counts_are_floor_or_ceil_and_nothing_without_weight_survives(drawn):
    weights, uniform = drawn
    count = weights.shape[1]
    indices = systematic(weights, Fixed(uniform))
    assert indices.shape == weights.shape
    assert (np.diff(indices, axis=1) >= 0).all()
    offspring = counts(indices, count)
    assert (offspring.sum(1) == count).all()
    assert (np.abs(offspring - count * weights) < 1 + 1e-9 * count).all()
    assert (offspring[weights == 0] == 0).all()


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.integers(1, 200), st.integers(0, 2**32 - 1))
def test_equals_the_definition(count, seed):
    rng = np.random.default_rng(seed)
    weights, uniform = rng.dirichlet(np.ones(count), 3), rng.random(3)
    indices = systematic(weights, Fixed(uniform))
    for r in range(3):
        np.testing.assert_array_equal(indices[r], by_definition(weights[r], uniform[r]))


def test_expected_counts_are_the_weights():
    """Over an even grid of uniform numbers the mean count is N w, up to one grid step a particle."""
    weights = np.random.default_rng(0).dirichlet(np.ones(7))
    grid = (np.arange(20_000) + 0.5) / 20_000
    indices = systematic(np.tile(weights, (len(grid), 1)), Fixed(grid))
    np.testing.assert_allclose(counts(indices, 7).mean(0), 7 * weights, atol=2 / 20_000)


@pytest.mark.parametrize("uniform", [0.0, 0.3, 0.999999])
@pytest.mark.parametrize(
    ("weights", "expected"),
    [
        ([1.0], [0]),
        ([1.0, 0.0, 0.0, 0.0], [0, 0, 0, 0]),
        ([0.0, 0.0, 0.0, 1.0], [3, 3, 3, 3]),
        ([0.0, 1.0, 0.0, 0.0], [1, 1, 1, 1]),
        ([0.25, 0.25, 0.25, 0.25], [0, 1, 2, 3]),
        ([0.5, 0.0, 0.5, 0.0], [0, 0, 2, 2]),
    ],
)
def test_by_hand(weights, expected, uniform):
    np.testing.assert_array_equal(systematic(np.array([weights]), Fixed([uniform])), [expected])


def test_weights_that_sum_to_one_by_rounding_only():
    weights = np.full((1, 1_000_003), 1 / 1_000_003)
    weights[0, -3:] = 0
    for uniform in (0.0, ALMOST_ONE):
        indices = systematic(weights, Fixed([uniform]))
        assert indices.max() == 1_000_003 - 4
        assert indices.min() == 0


def test_a_lost_run_does_not_disturb_its_neighbours():
    weights = np.random.default_rng(0).dirichlet(np.ones(6), 3)
    alone = systematic(weights, Fixed([0.1, 0.5, 0.9]))
    for bad in (np.full(6, np.nan), np.array([0.2, np.nan, 0.2, 0.2, 0.2, 0.2])):
        broken = weights.copy()
        broken[1] = bad
        with np.errstate(invalid="ignore"):
            indices = systematic(broken, Fixed([0.1, 0.5, 0.9]))
        np.testing.assert_array_equal(indices[[0, 2]], alone[[0, 2]])
        assert ((indices >= 0) & (indices < 6)).all()


def test_one_uniform_number_a_run():
    weights = np.random.default_rng(0).dirichlet(np.ones(6), 3)
    rng, plain = generators(3, "one"), generators(3, "one")
    indices = systematic(weights, rng)
    np.testing.assert_array_equal(indices, systematic(weights, Fixed(plain.random((1, 3, 1))[0, :, 0])))
    np.testing.assert_array_equal(rng.random((1, 3)), plain.random((1, 3)))


def test_select_picks_within_each_run():
    x = np.random.default_rng(0).standard_normal((2, 3, 5))
    indices = np.array([[0, 0, 1, 4, 4], [4, 3, 2, 1, 0], [2, 2, 2, 2, 2]])
    expected = np.stack([x[:, r, indices[r]] for r in range(3)], axis=1)
    np.testing.assert_array_equal(select(x, indices), expected)
    np.testing.assert_array_equal(select(np.asfortranarray(x), indices), expected)
