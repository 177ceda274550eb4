"""Divergence against a loop over runs, rates and times by hand, and the interval of a share by its coverage."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from suite.case import Card, Divergence, StateBlock, Truth
from suite.divergence import onset, streak
from suite.estimator import FAILED, LOST, OK, Estimate
from suite.metrics import METRICS
from suite.metrics.metric import share

CARD = Card(
    name="toy", title="", summary="", steps=4, interval=0.5, state=("x", "y", "v"),
    blocks=(StateBlock("position", (0, 1), "m"), StateBlock("speed", (2,), "m/s")),
    divergence=Divergence("position", 5.0, 2), reference="",
)  # fmt: skip
FAR, NEAR = 6.0, 1.0


def runs(*errors, status=(), known=None):
    """A truth and an estimate with these errors in x [R, T], NaN where a run was lost; truth only where it is known [R, T]."""
    error = np.array(errors, float).T
    x = np.zeros((len(error), 3, error.shape[1]))
    if known is not None:
        x[:, 1] = np.where(np.array(known, bool).T, 0.0, np.nan)
    mean = np.stack([error, *[np.where(np.isnan(error), np.nan, 0.0)] * 2], axis=1)
    cov = np.tile(np.eye(3)[:, :, None], (len(error), 1, 1, error.shape[1]))
    return Truth(x, np.zeros((len(error), 1, error.shape[1]))), Estimate(mean, cov, status=status)


def first_long_streak(flags, counted, length):
    """The step from which on `length` of the steps that count are set on end, by looking at every beginning."""
    steps = [k for k, counts in enumerate(counted, start=1) if counts]
    for i, k in enumerate(steps):
        following = steps[i : i + length]
        if len(following) == length and all(flags[j - 1] for j in following):
            return k
    return np.inf


def flags(draw, shape, share):
    return np.random.default_rng(draw(st.integers(0, 2**32 - 1))).random(shape) < share


@st.composite
def streaks(draw):
    shape, often = (draw(st.integers(1, 12)), draw(st.integers(1, 4))), st.sampled_from([0.0, 0.2, 0.5, 0.8, 1.0])
    return flags(draw, shape, draw(often)), flags(draw, shape, draw(often)), draw(st.integers(1, 5))


@given(streaks())
@settings(max_examples=200, deadline=None)
def test_a_streak_begins_where_a_loop_finds_it(drawn):
    beyond, counted, length = drawn
    expected = [first_long_streak(*columns, length) for columns in zip(beyond.T, counted.T, strict=True)]
    np.testing.assert_array_equal(streak(beyond, counted, length), expected)


@given(streaks(), st.data())
@settings(max_examples=150, deadline=None)
def test_a_run_is_away_from_its_loss_or_from_its_streak_on(drawn, data):
    beyond, known, length = drawn
    steps, count = beyond.shape
    status = data.draw(st.lists(st.sampled_from([OK, LOST, FAILED]), min_size=count, max_size=count))
    gone = [data.draw(st.integers(1, steps)) if each == LOST else np.inf for each in status]
    error = np.where(beyond, FAR, NEAR)
    for r, k in enumerate(gone):
        error[int(min(k, steps + 1)) - 1 :, r] = np.nan
    card = dataclasses.replace(CARD, steps=steps, divergence=Divergence("position", 5.0, length))
    expected = []
    for r in range(count):
        begin = first_long_streak(np.nan_to_num(error[:, r]) > 5, known[:, r], length)
        expected.append(min(begin, gone[r]) if known[:, r].any() else np.nan)
    np.testing.assert_array_equal(onset(card, *runs(*error.T, status=status, known=known.T)), expected)


def test_a_run_lost_without_a_gap_is_away_at_its_last_step():
    np.testing.assert_array_equal(onset(CARD, *runs([NEAR] * 4, [NEAR] * 4, status=[OK, LOST])), [np.inf, 4])


def test_errors_beyond_floating_point_are_beyond_the_limit():
    np.testing.assert_array_equal(onset(CARD, *runs([NEAR, 1e200, np.inf, 1e300])), [2])


def test_rates_of_lost_and_failed_runs_by_hand():
    """Of five runs one is lost, two failed: lost is one of the three that did not fail, failed two of all."""
    made = runs(*[[NEAR] * 4] * 5, status=[OK, LOST, FAILED, OK, FAILED])
    gone, broke = (METRICS[name](CARD, *made)["runs"] for name in ("lost", "failed"))
    assert (gone.value, gone.runs, gone.total) == (1 / 3, 3, 5)
    assert (broke.value, broke.runs, broke.total) == (2 / 5, 5, 5)
    for score, count, total in ((gone, 1, 3), (broke, 2, 5)):
        expected = stats.beta.ppf(0.025, count, total - count + 1), stats.beta.ppf(0.975, count + 1, total - count)
        assert (score.low, score.high) == pytest.approx(expected, abs=1e-9)


def test_where_all_runs_failed_nothing_else_is_known():
    made = runs(*[[np.nan] * 4] * 3, status=[FAILED] * 3)
    score = METRICS["failed"](CARD, *made)["runs"]
    assert (score.value, score.high, score.runs) == (1, 1, 3)
    assert all(METRICS[name](CARD, *made)["runs"].runs == 0 for name in ("lost", "divergence", "time-to-divergence"))


def test_lost_runs_count_also_where_the_truth_is_not_known():
    made = runs([NEAR] * 4, [NEAR] * 4, status=[OK, LOST], known=np.zeros((2, 4)))
    assert METRICS["lost"](CARD, *made)["runs"].value == 1 / 2
    assert METRICS["time-to-divergence"](CARD, *made)["runs"].runs == 0


BY_HAND = (
    ([NEAR, NEAR, NEAR, NEAR], OK, 4),  # stays for all four steps
    ([NEAR, FAR, NEAR, FAR], OK, 4),  # never for two steps on end
    ([FAR, FAR, NEAR, NEAR], OK, 0),  # away from the first step on
    ([NEAR, NEAR, FAR, FAR], OK, 2),
    ([NEAR, np.nan, np.nan, np.nan], LOST, 1),
    ([NEAR, FAR, FAR, np.nan], LOST, 1),  # away before it was lost
)


@pytest.mark.parametrize("times", [(), (1.0, 1.5, 4.0, 10.0)])
def test_time_to_divergence_by_hand(times):
    card = dataclasses.replace(CARD, times=times)
    errors, status, stayed = zip(*BY_HAND, ([NEAR] * 4, FAILED, None), strict=True)
    score = METRICS["time-to-divergence"](card, *runs(*errors, status=status))["runs"]
    ends = [0, *(times or (0.5, 1.0, 1.5, 2.0))]
    expected = [ends[k] for k in stayed[:-1]]
    assert score.value == pytest.approx(np.mean(expected), rel=1e-14)
    assert (score.unit, score.runs, score.total) == ("s", 6, 7)
    low, high = share(np.array([expected]) / ends[-1])[1:]
    assert (score.low, score.high) == pytest.approx((low * ends[-1], high * ends[-1]), rel=1e-14)
    assert 0 < score.low < score.value < score.high < ends[-1]


def test_no_divergence_in_twelve_runs_does_not_prove_that_there_is_none():
    made = runs(*[[NEAR] * 4] * 12)
    time, rate = (METRICS[name](CARD, *made)["runs"] for name in ("time-to-divergence", "divergence"))
    assert (time.value, time.high) == (2.0, 2.0)
    assert time.low == pytest.approx(2.0 * (1 - rate.high), rel=1e-12)
    assert rate.high > 0.2


def test_estimators_are_ranked_by_how_often_they_diverge_alone():
    assert [name for name in METRICS if METRICS[name].family == "robustness" and METRICS[name].ranked] == ["divergence"]


def test_what_is_ranked_otherwise_sees_the_mean_time():
    """The value of all runs and without each of them, for whoever compares estimators."""
    moments = np.array([[1.0, 2.0, 6.0], [10.0, 10.0, 10.0]])
    sample = METRICS["time-to-divergence"].resampled(moments)
    np.testing.assert_allclose([sample.value[0], *sample.left_out[0]], [3, 4, 3.5, 1.5])
