"""Errors against bounds, skill and lag: by hand, and on the exact filter, of which they must say that nothing is wrong."""

import dataclasses

import numpy as np
import pytest

from cases import CASES
from estimators.kalman import Kalman
from suite.bounds import NONE, POSTERIOR
from suite.case import FROM_ANOTHER, GIVEN_TRACK, RECORDED, Card, Divergence, StateBlock, Truth
from suite.case_bounds import BlockBound, bounds_of
from suite.estimator import FAILED, OK, Estimate
from suite.metrics import METRICS, Evidence
from suite.metrics.bound import ratio
from suite.statistics import jackknife, means, positive_jackknife

CARD = Card(
    name="toy", title="", summary="", steps=3, interval=1.0, state=("x", "y", "v"),
    blocks=(StateBlock("position", (0, 1), "m"), StateBlock("speed", (2,), "m/s")),
    divergence=Divergence("position", 1e9, 2), reference="",
)  # fmt: skip

# Errors (x, y, v) of two runs over three steps, and bounds on the RMSE of position and speed.
ERRORS = np.array([[[3, 4, 1], [0, 0, 2]], [[0, 5, -1], [6, 8, 0]], [[1, 0, 3], [0, 1, 4]]], float).transpose(0, 2, 1)
RMSE = np.sqrt([[12.5, 2.5], [62.5, 0.5], [1.0, 12.5]])
BOUND = np.array([[1.0, 2.0], [5.0, 0.5], [0.5, 1.0]])


def bound(value=BOUND, kind=POSTERIOR):
    return BlockBound(kind, "", np.asarray(value, float), np.zeros((3, 2)), np.zeros((3, 3, 3)))


def evidence(*bounds, errors=ERRORS, **rest):
    x = np.random.default_rng(0).standard_normal(errors.shape)
    cov = np.tile(np.eye(3)[:, :, None], (len(errors), 1, 1, errors.shape[2]))
    return Evidence(CARD, Truth(x, np.zeros((len(errors), 1, errors.shape[2]))), Estimate(x + errors, cov, **rest), bounds)


def values(name, found):
    metric = METRICS[name]
    return {block: metric.score(part, "", part.shape[-1]).value for block, part in metric.contributions(found).items()}


def test_ratio_and_efficiency_by_hand():
    for name, expected in (("crlb-ratio", (RMSE / BOUND).mean(0)), ("efficiency", ((BOUND / RMSE) ** 2).mean(0))):
        assert values(name, evidence(bound())) == pytest.approx({"position": expected[0], "speed": expected[1]})


def test_steps_of_no_bound_are_left_out():
    some = BOUND.copy()
    some[0, 0], some[1, 1], some[2, 1] = 0.0, np.nan, np.inf
    expected = {"position": (RMSE / BOUND)[1:, 0].mean(), "speed": (RMSE / BOUND)[0, 1]}
    assert values("crlb-ratio", evidence(bound(some))) == pytest.approx(expected)


@pytest.mark.parametrize("nothing", [0.0, np.nan, 1e-12])
def test_a_block_without_any_bound_has_no_ratio(nothing):
    """Zero to rounding is zero: the state is known."""
    only = BOUND.copy()
    only[:, 0] = nothing
    for name in ("crlb-ratio", "efficiency"):
        assert [*values(name, evidence(bound(only)))] == ["speed"]


def test_where_there_is_no_bound_there_is_no_ratio():
    for name in ("crlb-ratio", "efficiency"):
        assert values(name, evidence()) == {}
        assert values(name, evidence(bound(kind=NONE), bound())) == {}
        assert values(name, evidence(bound(np.full((3, 2), np.nan)))) == {}


def test_of_two_bounds_the_first_counts():
    assert values("crlb-ratio", evidence(bound(), bound(7 * BOUND))) == values("crlb-ratio", evidence(bound()))
    twice = values("crlb-ratio", evidence(bound(2 * BOUND), bound()))
    assert twice == pytest.approx({k: v / 2 for k, v in values("crlb-ratio", evidence(bound())).items()})


def test_failed_runs_and_unknown_steps_are_left_out():
    errors = np.concatenate([ERRORS, 1e6 * np.ones((3, 3, 1))], axis=2)
    found = evidence(bound(), errors=errors, status=[OK, OK, FAILED])
    assert values("crlb-ratio", found) == pytest.approx(values("crlb-ratio", evidence(bound())))
    gap = ERRORS.copy()
    gap[1] = np.nan
    expected = (RMSE / BOUND)[[0, 2], 0].mean()
    assert values("crlb-ratio", evidence(bound(), errors=gap))["position"] == pytest.approx(expected)


def test_skill_is_one_minus_the_squared_error_over_the_spread():
    rng = np.random.default_rng(1)
    x, error = rng.normal(0, [[[3.0]], [[1.0]], [[2.0]]], (3, 3, 7)), rng.standard_normal((3, 3, 7))
    found = Evidence(CARD, Truth(x, np.zeros((3, 1, 7))), Estimate(x + error, np.zeros((3, 3, 3, 7))))
    for block, at in (("position", [0, 1]), ("speed", [2])):
        expected = 1 - (error[:, at] ** 2).sum() / 7 / x[:, at].var(2, ddof=1).sum()
        assert values("skill", found)[block] == pytest.approx(expected)


def test_saying_the_mean_of_all_truths_has_no_skill():
    # Twelve truths of 24 steps, independent: the sample mean of skill over 500 repetitions is 0 within 5 standard errors,
    # for the prediction that is best without measurements.
    rng = np.random.default_rng(2)
    found = []
    for _ in range(500):
        x = rng.normal(5, 2, (24, 3, 12))
        guess = Evidence(CARD, Truth(x, np.zeros((24, 1, 12))), Estimate(np.full_like(x, 5), np.zeros((24, 3, 3, 12))))
        found.append(values("skill", guess)["position"])
    assert abs(np.mean(found)) < 5 * np.std(found) / np.sqrt(500)
    assert np.std(found) < 0.1


@pytest.mark.parametrize("origin", [GIVEN_TRACK, RECORDED])
def test_tracks_that_are_not_drawn_have_no_spread_to_explain(origin):
    found = evidence()
    assert values("skill", dataclasses.replace(found, case=dataclasses.replace(CARD, origin=origin))) == {}
    assert values("skill", dataclasses.replace(found, case=dataclasses.replace(CARD, origin=FROM_ANOTHER))) != {}


def test_truths_that_do_not_differ_have_no_spread_to_explain():
    x = np.tile(np.arange(9.0).reshape(3, 3, 1), (1, 1, 4))
    x[:, 2] += np.arange(4.0)
    found = Evidence(CARD, Truth(x, np.zeros((3, 1, 4))), Estimate(x + 1, np.zeros((3, 3, 3, 4))))
    assert [*values("skill", found)] == ["speed"]
    alone = Evidence(CARD, Truth(x[..., :1], np.zeros((3, 1, 1))), Estimate(x[..., :1] + 1, np.zeros((3, 3, 3, 1))))
    assert values("skill", alone) == {}


def moving(lag, runs=2):
    """Truths on a straight line, and estimates that say where they were so many steps ago."""
    time = np.arange(8.0)[:, None, None] * np.array([1.0, -2.0, 0.5])[:, None] * np.arange(1, runs + 1)
    behind = (np.arange(8.0) - lag)[:, None, None] * np.array([1.0, -2.0, 0.5])[:, None] * np.arange(1, runs + 1)
    return Truth(time, np.zeros((8, 1, runs))), Estimate(behind, np.zeros((8, 3, 3, runs)))


@pytest.mark.parametrize("steps", [0, 1, 2.5, -1])
def test_lag_on_a_steady_course_is_the_number_of_steps(steps):
    assert values("lag", Evidence(CARD, *moving(steps))) == pytest.approx({"position": steps, "speed": steps})


def test_lag_by_hand_with_gaps():
    rng = np.random.default_rng(3)
    x, mean = rng.standard_normal((2, 5, 3, 4))
    mean[3:, :, 1] = np.nan  # lost
    x[2, :, 2] = np.nan  # not known
    x[:, :, 3] = np.nan  # never known
    found = Evidence(CARD, Truth(x, np.zeros((5, 1, 4))), Estimate(mean, np.zeros((5, 3, 3, 4))))
    above = below = 0.0
    for run, steps in ((0, (1, 2, 3, 4)), (1, (1, 2)), (2, (1, 3, 4))):
        for k in steps:
            moved = mean[k, :2, run] - mean[k - 1, :2, run]
            above, below = above + moved @ (x[k, :2, run] - mean[k, :2, run]), below + moved @ moved
    assert np.isnan(METRICS["lag"].contributions(found)["position"][:, 3]).all()
    assert values("lag", found)["position"] == pytest.approx(above / below)


CASE = CASES["linear-gaussian"]
GROUPS, RUNS = 60, 20
TRUTH = CASE.simulate(GROUPS * RUNS, seed=4)
EXACT = Kalman().run(CASE.model, TRUTH.y)
LIMITS = bounds_of(CASE, seed=1)


def apart(name, mean=EXACT.mean):
    """Contributions of the exact filter's runs, or of what was made of them, by block."""
    return METRICS[name].contributions(Evidence(CASE, TRUTH, Estimate(mean, EXACT.cov), LIMITS))


@pytest.mark.parametrize(("name", "target"), [("crlb-ratio", 1.0), ("efficiency", 1.0), ("lag", 0.0)])
def test_the_exact_filter_is_on_target_and_its_interval_says_so(name, target):
    # Of all 1200 runs the score is on target within 5 standard errors, that is 5 / 1.96 of the reach of its interval. In
    # groups of 20 runs 95 % of the intervals hold the target: of 60, fewer than 48 have probability below 1e-5.
    metric = METRICS[name]
    for block, found in apart(name).items():
        whole = metric.score(found, "", GROUPS * RUNS)
        assert abs(whole.value - target) < 5 / 1.96 * (whole.high - whole.low) / 2, block
        scores = [metric.score(found[..., i : i + RUNS], "", RUNS) for i in range(0, GROUPS * RUNS, RUNS)]
        assert sum(score.low <= target <= score.high for score in scores) >= 48, block


def test_a_step_late_the_exact_filter_lags_by_what_it_would_have_foreseen():
    """What the shifted estimate is behind, given its data, is the motion that the filter predicts: speed times time."""
    late = np.concat([EXACT.mean[:1], EXACT.mean[:-1]])
    found = METRICS["lag"].score(apart("lag", late)["position"], "", GROUPS * RUNS)
    moved, foreseen = np.diff(EXACT.mean[:-1, [0, 2]], axis=0), EXACT.mean[1:-1, [1, 3]] * CASE.interval
    expected = (moved * foreseen).sum() / (moved**2).sum()
    assert abs(found.value - expected) < 5 / 1.96 * (found.high - found.low) / 2
    assert 0.7 < expected < 1


def test_too_large_a_gain_is_a_negative_lag():
    """Half way from the exact estimate to the measurement the estimate overreacts, by the same law of orthogonality."""
    eager = EXACT.mean.copy()
    eager[:, [0, 2]] += 0.5 * (TRUTH.y - eager[:, [0, 2]])
    score = METRICS["lag"].score(apart("lag", eager)["position"], "", GROUPS * RUNS)
    assert score.high < 0


def test_too_small_a_gain_is_a_positive_lag():
    slow = EXACT.mean.copy()
    for k in range(1, len(slow)):
        slow[k, [0, 2]] = 0.5 * slow[k, [0, 2]] + 0.5 * (slow[k - 1, [0, 2]] + EXACT.mean[k - 1, [1, 3]] * CASE.interval)
    score = METRICS["lag"].score(apart("lag", slow)["position"], "", GROUPS * RUNS)
    assert score.low > 0


def test_signed_metrics_keep_plain_intervals_and_others_positive_ones():
    for name, kind in (("lag", jackknife), ("crlb-ratio", positive_jackknife)):
        found, metric = apart(name)["velocity"][..., :RUNS], METRICS[name]
        score, (low, high) = metric.score(found, "", RUNS), kind(metric.resampled(found))
        assert (score.low, score.high) == pytest.approx((low[0], high[0]))


def test_skill_leaves_out_what_is_not_known_of_the_truth():
    x = TRUTH.x[..., :6].copy()
    x[3, :, 0] = np.nan
    estimate = Estimate(EXACT.mean[..., :6], EXACT.cov[..., :6])
    found = METRICS["skill"](CASE, Truth(x, TRUTH.y[..., :6]), estimate)["position"]
    wrong = spread = 0.0
    for k in range(len(x)):
        known = ~np.isnan(x[k, 0])
        place = x[k][[0, 2]][:, known]
        wrong += ((estimate.mean[k][[0, 2]][:, known] - place) ** 2).sum()
        spread += place.var(axis=1, ddof=1).sum() * known.sum()
    assert found.value == pytest.approx(1 - wrong / spread)
    assert found.runs == 6


def test_the_interval_of_skill_stays_below_one():
    for runs in (2, 3, 12):
        found = apart("skill")["velocity"][..., :runs]
        score = METRICS["skill"].score(found, "", runs)
        assert score.low < score.value < score.high < 1
        low, high = positive_jackknife(means(found).map(ratio))
        assert (1 - score.high, 1 - score.low) == pytest.approx((low[0], high[0]))
