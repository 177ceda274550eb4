"""Streams: a run's numbers depend on its key and number alone."""

import numpy as np
import pytest
from scipy import stats

from suite.random import Generators, Streams

DRAWS = {
    "standard_normal": lambda g, shape: g.standard_normal(shape),
    "random": lambda g, shape: g.random(shape),
    "standard_exponential": lambda g, shape: g.standard_exponential(shape),
    "standard_gamma": lambda g, shape: g.standard_gamma(1.7, shape),
}


@pytest.mark.parametrize("draw", DRAWS.values(), ids=DRAWS)
@pytest.mark.parametrize("rest", [(), (5,), (2, 3)], ids=str)
def test_numbers_do_not_depend_on_the_batch(draw, rest):
    streams = Streams(("case", 3))
    whole = draw(streams.batch(0, 7), (4, 7, *rest))
    assert whole.shape == (4, 7, *rest)
    for first, count in [(0, 1), (3, 1), (6, 1), (2, 3), (4, 3)]:
        shape = (4, count, *rest)
        np.testing.assert_array_equal(draw(streams.batch(first, count), shape), whole[:, first : first + count])
        np.testing.assert_array_equal(draw(Streams(streams.key, first).batch(0, count), shape), whole[:, first : first + count])
    np.testing.assert_array_equal(draw(Streams(streams.key, 2).batch(3, 1), (4, 1, *rest))[:, 0], whole[:, 5])


def test_one_run_draws_what_its_own_generator_draws():
    """The stream is documented: SFC64 of a seed sequence whose spawn key is the run's number."""
    rng = Streams((1,)).batch(4, 1)
    plain = Streams((1,)).batch(4, 1).generators[0]
    np.testing.assert_array_equal(rng.standard_normal((3, 1, 6))[:, 0], plain.standard_normal((3, 6)))
    np.testing.assert_array_equal(rng.random((1, 1, 2))[:, 0], plain.random((1, 2)))
    np.testing.assert_array_equal(rng.standard_exponential((2, 1, 5))[:, 0], plain.standard_exponential((2, 5)))
    np.testing.assert_array_equal(rng.standard_gamma(0.3, (2, 1, 5))[:, 0], plain.standard_gamma(0.3, (2, 5)))
    assert isinstance(plain.bit_generator, np.random.SFC64)
    assert plain.bit_generator.seed_seq.spawn_key == (4,)


def test_draws_follow_one_another():
    rng = Streams((1,)).batch(0, 2)
    a, b = rng.standard_normal((2, 2)), rng.standard_normal((2, 2))
    assert not np.isin(a, b).any()


def test_keys_and_runs_give_different_numbers():
    keys = [("a", "bc"), ("ab", "c"), ("abc",), ("a", "b", "c"), ("abc", ""), ("", "abc"), (1, 2), (12,), (2, 1), (0,), ()]
    numbers = np.concatenate([Streams(key).batch(0, 50).random((1, 50)) for key in keys])
    assert len(np.unique(numbers)) == numbers.size


def test_of_a_plain_seed():
    assert Streams.of(3) == Streams((3,))
    assert Streams.of(np.int64(3)) == Streams((3,))
    streams = Streams(("a",), 5)
    assert Streams.of(streams) is streams


def test_streams_are_uncorrelated():
    # 400 runs x 500 normals: of the 79800 correlations between runs, each normal with standard deviation 1/sqrt(500), none
    # beyond 6.5 sigma: a false alarm has probability below 1e-5. Their mean square is 1/500 within 2 %, about 4 sigma each
    # way: sqrt(2 / 79800) = 0.5 %.
    x = Streams(("correlation",)).batch(0, 400).standard_normal((500, 400))
    r = np.corrcoef(x.T)[np.triu_indices(400, 1)]
    assert np.abs(r).max() < 6.5 / np.sqrt(500)
    assert abs((r**2).mean() * 500 - 1) < 0.025


@pytest.mark.parametrize(
    ("draw", "law"),
    [
        (lambda g, shape: g.standard_normal(shape), stats.norm()),
        (lambda g, shape: g.random(shape), stats.uniform()),
        (lambda g, shape: g.standard_exponential(shape), stats.expon()),
        (lambda g, shape: g.standard_gamma(1.7, shape), stats.gamma(1.7)),
    ],
    ids=DRAWS,
)
def test_numbers_follow_their_law(draw, law):
    # Each Kolmogorov-Smirnov test fails by chance with probability 1e-9.
    assert stats.kstest(draw(Streams(("law",)).batch(0, 4), (2, 4, 5000)).ravel(), law.cdf).pvalue > 1e-9


@pytest.mark.parametrize("draw", DRAWS.values(), ids=DRAWS)
@pytest.mark.parametrize("some", [[2], [0, 3], [4, 1, 2], [0, 1, 2, 3, 4], np.array([1, 3]), []], ids=str)
def test_some_runs_draw_their_own_numbers_and_move_no_others(draw, some):
    rng, plain = Streams(("of",)).batch(0, 5), Streams(("of",)).batch(0, 5)
    first, second = draw(plain, (2, 5, 3)), draw(plain, (2, 5, 3))
    chosen = rng.of(some)
    assert chosen.runs == len(some)
    np.testing.assert_array_equal(draw(chosen, (2, len(some), 3)), first[:, list(some)])
    now = draw(rng, (2, 5, 3))
    for r in range(5):
        np.testing.assert_array_equal(now[:, r], (second if r in some else first)[:, r])


def test_shape_must_fit_the_runs():
    rng = Streams((1,)).batch(0, 3)
    assert rng.runs == 3
    with pytest.raises(ValueError, match="4 runs were asked of generators for 3"):
        rng.standard_normal((2, 4))
    assert Generators([]).runs == 0
