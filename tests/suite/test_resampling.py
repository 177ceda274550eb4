"""Resampling: every scheme against its definition over the same random numbers, and against its law."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from suite.random import Generators
from suite.resampling import SCHEMES, multinomial, residual, select, stratified, systematic
from tests.oracles import Given, generators, offspring_law, offspring_variance

ALMOST_ONE = float(np.nextafter(1.0, 0.0))
schemes = pytest.mark.parametrize("scheme", SCHEMES.values(), ids=SCHEMES)


def first_beyond(points, weights):
    """The first particle whose cumulative weight exceeds each point."""
    edges = np.cumsum(weights)
    return np.searchsorted(edges / edges[-1], points, side="right")


def ascending(exponential):
    """Uniform numbers in ascending order from one exponential number more: partial sums over their sum (Rényi, 1953)."""
    return np.cumsum(exponential)[:-1] / np.sum(exponential)


def systematic_by_definition(w, rng):
    return first_beyond((np.arange(len(w)) + rng.random((1, 1, 1)).item()) / len(w), w)


def stratified_by_definition(w, rng):
    return first_beyond((np.arange(len(w)) + rng.random((1, 1, len(w)))[0, 0]) / len(w), w)


def multinomial_by_definition(w, rng):
    return first_beyond(ascending(rng.standard_exponential((1, 1, len(w) + 1))[0, 0]), w)


def residual_by_definition(w, rng):
    copies = np.floor(len(w) * w).astype(int)
    slots = len(w) - copies.sum()
    drawn = first_beyond(ascending(rng.standard_exponential((1, 1, slots + 1))[0, 0]), len(w) * w - copies) if slots else []
    return np.sort(np.concatenate([np.repeat(np.arange(len(w)), copies), drawn]).astype(int))


DEFINITIONS = {
    "systematic": systematic_by_definition,
    "stratified": stratified_by_definition,
    "residual": residual_by_definition,
    "multinomial": multinomial_by_definition,
}


def counts(indices):
    runs, count = indices.shape
    return np.bincount((indices + count * np.arange(runs)[:, None]).ravel(), minlength=runs * count).reshape(runs, count)


def offspring(scheme, weights, runs, *key):
    """Offspring counts [runs, N] of one set of weights in many runs, all from one stream: it is quicker to set up."""
    stream = Generators(generators(1, "offspring", scheme.__name__, *key).generators * runs)
    return counts(scheme(np.tile(weights, (runs, 1)), stream))


def check(scheme, weights, indices):
    """What every result must satisfy, whatever the random numbers: in order, in range, and the scheme's own bounds."""
    count = weights.shape[1]
    assert indices.shape == weights.shape
    assert indices.dtype.kind == "i"
    assert ((indices >= 0) & (indices < count)).all()
    assert (np.diff(indices, axis=1) >= 0).all()
    found, rounding = counts(indices), 1e-9 * count
    assert (found[weights == 0] == 0).all()
    if scheme is systematic:
        assert (np.abs(found - count * weights) < 1 + rounding).all()
    if scheme is stratified:
        assert (np.abs(found - count * weights) < 2 + rounding).all()
    if scheme is residual:
        assert (found >= np.floor(count * weights * (1 - 1e-14))).all()


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
    return weights, draw(st.sampled_from([None, 0.0, 0.5, ALMOST_ONE])), draw(st.integers(0, 2**32 - 1))


@schemes
@settings(max_examples=120, deadline=None, derandomize=True)
@given(weights_of_runs())
def test_the_bounds_hold_whatever_the_weights_and_the_numbers(scheme, drawn):
    weights, number, seed = drawn
    runs, count = weights.shape
    if number is None:
        rng = generators(runs, seed)
    elif scheme is systematic:
        rng = Given(np.full((runs, 1), number))
    else:
        rng = Given(np.full((runs, count + (scheme in (multinomial, residual))), number or 1e-300))
    check(scheme, weights, scheme(weights, rng))


@schemes
@settings(max_examples=80, deadline=None, derandomize=True)
@given(st.integers(1, 200), st.sampled_from([0.05, 0.5, 5.0, 500.0]), st.integers(0, 2**32 - 1))
def test_equals_the_definition(scheme, count, concentration, seed):
    weights = np.random.default_rng(seed).dirichlet(np.full(count, concentration), 3)
    indices, rng = scheme(weights, generators(3, seed)), generators(3, seed)
    for r in range(3):
        np.testing.assert_array_equal(indices[r], DEFINITIONS[scheme.__name__](weights[r], rng.of([r])))


def test_systematic_counts_are_unbiased():
    """Over an even grid of uniform numbers the mean count is N w, up to one grid step a particle."""
    weights = np.random.default_rng(0).dirichlet(np.ones(7))
    grid = (np.arange(20_000) + 0.5) / 20_000
    indices = systematic(np.tile(weights, (len(grid), 1)), Given(grid[:, None]))
    np.testing.assert_allclose(counts(indices).mean(0), 7 * weights, atol=2 / 20_000)


@schemes
@pytest.mark.parametrize("order", [[0, 1, 2, 3], [3, 0, 2, 1], [2, 3, 1, 0]], ids=str)
def test_the_counts_follow_the_exact_law(scheme, order):
    """Also with the particles in another order, in which the law of multinomial and residual counts is the same, permuted."""
    # Chi-square test of the joint law: each of the 12 tests fails by chance with probability 1e-9.
    weights, runs = np.array([0.41, 0.29, 0.19, 0.11]), 20_000
    law = offspring_law(scheme.__name__, weights[order])
    assert sum(law.values()) == pytest.approx(1)
    found = {key: 0 for key, p in law.items() if p > 1e-12}
    rows, times = np.unique(offspring(scheme, weights[order], runs, *order), axis=0, return_counts=True)
    for row, number in zip(rows.tolist(), times, strict=True):
        found[tuple(row)] += number  # a KeyError says: impossible counts
    expected = np.array([runs * law[key] for key in found])
    rare = expected < 5
    seen = np.array(list(found.values()))
    seen = np.append(seen[~rare], seen[rare].sum())
    expected = np.append(expected[~rare], expected[rare].sum())
    keep = expected > 0
    assert stats.chisquare(seen[keep], expected[keep] * (runs / expected.sum())).pvalue > 1e-9
    if scheme in (multinomial, residual):
        same = offspring_law(scheme.__name__, weights)
        assert law == pytest.approx({tuple(np.array(key)[order].tolist()): p for key, p in same.items()})


@pytest.mark.parametrize(("scheme", "apart"), [(systematic, 1 / 2), (stratified, 1 / 4)], ids=["systematic", "stratified"])
def test_the_order_of_the_particles_matters_to_systematic_and_stratified(scheme, apart):
    """Two particles that each fill half a slot share one, so never both survive; apart, both do."""
    # 5.5 standard errors: a false alarm has probability below 1e-7.
    together = offspring(scheme, np.array([0.5, 0.5, 1.5, 1.5]) / 4, 10_000)
    assert (together[:, 0] + together[:, 1] == 1).all()
    away = offspring(scheme, np.array([0.5, 1.5, 0.5, 1.5]) / 4, 10_000)
    both = ((away[:, 0] == 1) & (away[:, 2] == 1)).mean()
    assert abs(both - apart) < 5.5 * np.sqrt(apart * (1 - apart) / 10_000)


@schemes
def test_the_counts_are_unbiased(scheme):
    # 5.5 standard errors, 4 sets x 30 particles x 4 schemes: a false alarm has probability below 2e-5. Their variance is
    # known for multinomial counts; for the others it is no larger.
    for concentration in (0.1, 0.5, 2.0, 20.0):
        weights = np.random.default_rng(1).dirichlet(np.full(30, concentration))
        found = offspring(scheme, weights, 10_000, str(concentration))
        spread = np.sqrt(30 * weights * (1 - weights) / 10_000)
        assert (np.abs(found.mean(0) - 30 * weights) < 5.5 * spread + 1e-3).all()


def test_the_variances_are_those_of_theory_and_in_their_order():
    """Multinomial >= residual, and multinomial >= stratified >= systematic, in the mean over a family without order.

    The family: Dirichlet weights of 20 particles with concentrations from 0.1 to 50, and functions x, cos 3x and exp x of
    independent normal x. That residual and stratified stay below multinomial is a theorem for all weights and functions
    (Douc, Cappé and Moulines, 2005); that systematic stays below stratified is measured, and no theorem: see the tests below.
    """
    # A variance estimated from 2000 runs: standard error sqrt((kurtosis - 1) / 2000), with the kurtosis estimated too.
    # Band 6 of these for 96 figures: a false alarm has probability below 1e-6 even where that estimate is poor.
    rng, runs = np.random.default_rng(2), 2000
    total = dict.fromkeys(SCHEMES, 0.0)
    for concentration in (0.1, 0.5, 0.5, 0.5, 5.0, 5.0, 5.0, 50.0):
        weights, x = rng.dirichlet(np.full(20, concentration)), rng.standard_normal(20)
        functions = np.stack([x, np.cos(3 * x), np.exp(x)])
        unit = [offspring_variance("multinomial", weights, phi) for phi in functions]
        for name, scheme in SCHEMES.items():
            sums = functions @ offspring(scheme, weights, runs, str(weights[0])).T
            exact = np.array([offspring_variance(scheme.__name__, weights, phi) for phi in functions])
            error = 6 * np.sqrt((stats.kurtosis(sums, axis=1, fisher=False) - 1) / runs)
            assert (np.abs(sums.var(1) / exact - 1) < error).all(), (name, concentration)
            total[name] += (sums.var(1) / unit).mean() / 8
    assert total["multinomial"] > total["residual"] + 0.1
    assert total["multinomial"] > total["stratified"] + 0.1
    assert total["stratified"] > total["systematic"] + 0.05


def test_systematic_is_worse_than_stratified_where_a_function_ascends_with_the_index():
    """One uniform number moves all slots the same way, so what they pick is positively correlated: strictly a theorem."""
    rng = np.random.default_rng(3)
    for concentration in (0.1, 0.5, 5.0, 50.0):
        weights, phi = rng.dirichlet(np.full(20, concentration)), np.sort(rng.standard_normal(20))
        grid = (np.arange(5000) + 0.5) / 5000
        found = counts(systematic(np.tile(weights, (5000, 1)), Given(grid[:, None]))) @ phi
        exact = offspring_variance("stratified", weights, phi)
        assert found.var() > 1.2 * exact
        # 6 standard errors of a variance whose kurtosis is that of a sum of independent slots, below 6 here.
        assert (offspring(stratified, weights, 3000) @ phi).var() == pytest.approx(exact, rel=6 * np.sqrt(5 / 3000))


def test_systematic_can_be_worse_than_multinomial():
    """Weights in step with the slots: all the odd particles survive or none (after Douc, Cappé and Moulines, 2005)."""
    # The band of 6 standard errors is a relative 0.1 or less; a false alarm has probability below 1e-8.
    weights, phi = np.tile([0.5, 1.5], 10) / 20, np.tile([1.0, 0.0], 10)
    for scheme, expected in ((systematic, 25.0), (multinomial, 3.75), (stratified, 2.5)):
        assert offspring_variance(scheme.__name__, weights, phi) == pytest.approx(expected)
        assert (offspring(scheme, weights, 8000) @ phi).var() == pytest.approx(expected, rel=0.1)


@schemes
@pytest.mark.parametrize(
    ("weights", "expected"),
    [
        ([1.0], [0]),
        ([1.0, 0.0, 0.0, 0.0], [0, 0, 0, 0]),
        ([0.0, 0.0, 0.0, 1.0], [3, 3, 3, 3]),
        ([0.0, 1.0, 0.0, 0.0], [1, 1, 1, 1]),
        ([1e-300, 1.0, 1e-300, 1e-300], [1, 1, 1, 1]),
        ([0.25, 0.25, 0.25, 0.25], [0, 1, 2, 3]),
        ([0.5, 0.0, 0.5, 0.0], [0, 0, 2, 2]),
    ],
)
def test_by_hand(scheme, weights, expected):
    indices = scheme(np.tile(weights, (50, 1)), generators(50, "by hand"))
    if scheme is multinomial and max(weights) < 1:
        assert len(np.unique(indices, axis=0)) > 3
    else:
        np.testing.assert_array_equal(indices, np.tile(expected, (50, 1)))


@pytest.mark.parametrize("scheme", [systematic, stratified, residual], ids=lambda s: s.__name__)
@pytest.mark.parametrize("count", [3, 10, 49, 1000, 9973])
def test_multiples_of_one_slot_survive_exactly_so_often(scheme, count):
    """Whatever rounding makes of them: 49 times 1/49 is below one."""
    # A weight is wrong by rounding when a uniform number falls that close to it: probability below 1e-7 in all.
    for copies in (np.ones(count, int), np.random.default_rng(count).multinomial(count, np.full(count, 1 / count))):
        for weights in (copies / count, copies * (1 / count), np.exp(np.log(np.maximum(copies, 1e-300) / count))):
            weights /= weights.sum()
            np.testing.assert_array_equal(offspring(scheme, weights, 20), np.tile(copies, (20, 1)))


@schemes
def test_a_million_weights_whose_sum_is_one_by_rounding_only(scheme):
    count = 1_000_003
    equal = np.append(np.full(count - 3, 1 / (count - 3)), np.zeros(3))
    uneven = np.random.default_rng(3).standard_gamma(0.3, count) * (np.arange(count) < count - 5)
    uneven /= math.fsum(uneven)
    weights = np.stack([equal, uneven])
    indices = scheme(weights, generators(2, "million"))
    check(scheme, weights, indices)
    # 6 standard deviations of multinomial counts, no less than those of the others, over a thousand particles each.
    edges = np.arange(0, count, 1000)
    share = np.add.reduceat(weights, edges, axis=1)
    error = np.add.reduceat(counts(indices), edges, axis=1) - count * share
    assert (np.abs(error) < 6 * np.sqrt(count * share) + 1).all()


def test_systematic_fills_the_last_slots_at_both_ends_of_the_uniform_number():
    weights = np.full((1, 1_000_003), 1 / 1_000_003)
    weights[0, -3:] = 0
    for uniform in (0.0, ALMOST_ONE):
        indices = systematic(weights, Given([[uniform]]))
        assert indices.max() == 1_000_003 - 4
        assert indices.min() == 0


@schemes
def test_a_lost_run_does_not_disturb_its_neighbours(scheme):
    weights = np.random.default_rng(0).dirichlet(np.ones(6), 3)
    alone = scheme(weights, generators(3, "lost"))
    for bad in (np.full(6, np.nan), np.array([0.2, np.nan, 0.2, 0.2, 0.2, 0.2])):
        broken = weights.copy()
        broken[1] = bad
        rng = generators(3, "lost")
        with np.errstate(invalid="ignore"):
            indices = scheme(broken, rng)
        np.testing.assert_array_equal(indices[[0, 2]], alone[[0, 2]])
        assert ((indices >= 0) & (indices < 6)).all()


@schemes
@pytest.mark.parametrize("count", [1, 2, 7, 333])
def test_a_run_has_the_same_bits_alone_and_leaves_its_stream_at_the_same_place(scheme, count):
    weights = np.random.default_rng(count).dirichlet(np.full(count, 0.5), 5)
    rng, plain = generators(5, "alone"), generators(5, "alone")
    indices = scheme(weights, rng)
    for r in range(5):
        np.testing.assert_array_equal(scheme(weights[r : r + 1], plain.of([r]))[0], indices[r])
    np.testing.assert_array_equal(rng.random((3, 5)), plain.random((3, 5)))


def test_a_residual_slot_goes_to_a_particle_with_a_rest_even_at_the_very_end():
    """An exponential number of zero puts the one drawn point at the end of the rests, where rounding may put it too."""
    indices = residual(np.array([[1.5, 0.5, 1.0]]) / 3, Given([[1.0, 0.0, 0.0, 0.0]]))
    np.testing.assert_array_equal(indices, [[0, 1, 2]])


def test_how_many_numbers_a_run_draws_does_not_depend_on_its_weights():
    weights = np.random.default_rng(0).dirichlet(np.full(6, 0.3), 3)
    for scheme, draw in (
        (systematic, lambda g: g.random((1, 3, 1))),
        (stratified, lambda g: g.random((1, 3, 6))),
        (residual, lambda g: g.standard_exponential((1, 3, 7))),
        (multinomial, lambda g: g.standard_exponential((1, 3, 7))),
    ):
        rng, plain = generators(3, "numbers"), generators(3, "numbers")
        scheme(weights, rng)
        draw(plain)
        np.testing.assert_array_equal(rng.random((1, 3)), plain.random((1, 3)))


def test_select_picks_within_each_run():
    x = np.random.default_rng(0).standard_normal((2, 3, 5))
    indices = np.array([[0, 0, 1, 4, 4], [4, 3, 2, 1, 0], [2, 2, 2, 2, 2]])
    expected = np.stack([x[:, r, indices[r]] for r in range(3)], axis=1)
    np.testing.assert_array_equal(select(x, indices), expected)
    np.testing.assert_array_equal(select(np.asfortranarray(x), indices), expected)
    np.testing.assert_array_equal(select(x[:, :1], indices[:1]), expected[:, :1])
