"""Scores and operating points of detectors: by hand, on noise, and against Page's run lengths."""

import dataclasses

import numpy as np
import pytest
from scipy import stats
from sklearn.metrics import roc_auc_score

from suite import operating, roc
from suite.case import Card, Divergence, StateBlock, Truth
from suite.errors import BadInput
from suite.estimator import FAILED, LOST, OK, Estimate
from suite.metrics import METRICS, Evidence
from tests.suite.test_detection import average_run_length

NAMES = ("auc", "pauc", "detection-rate", "detection-delay")
CARD = Card(
    name="toy", title="", summary="", steps=12, interval=0.5, state=("x",), blocks=(StateBlock("position", (0,), "m"),),
    divergence=Divergence("position", 1.0, 1), reference="", modes=("straight", "turn"), nominal="straight", calm="twin",
)  # fmt: skip
TURNS = np.repeat((np.isin(np.arange(1, 13), (6, 7, 8, 11)))[:, None], 30, axis=1).astype(int)


def estimate(statistic, **rest):
    nothing = np.zeros((len(statistic), 1, statistic.shape[1]))
    return Estimate(nothing, nothing[:, None], statistic=statistic, **rest)


def evidence(statistic, mode=TURNS, calm=None, card=CARD, **rest):
    x = np.zeros((len(statistic), 1, statistic.shape[1]))
    truth = Truth(x, x, mode[:, : statistic.shape[1]])
    return Evidence(card, truth, estimate(statistic, **rest), calm=None if calm is None else estimate(calm))


def scores(e, name):
    return METRICS[name](e.case, e.truth, e.estimate, calm=e.calm)


def noise(seed, runs=30, steps=12, rise=0.0):
    return np.random.default_rng(seed).standard_normal((steps, runs)) + rise * TURNS[:steps, :1]


def test_areas_are_scikit_learns_over_scans_and_over_first_manoeuvres():
    e = evidence(noise(0, rise=1.0))
    s = e.estimate.statistic
    first = np.concatenate([s[2:5].max(0), s[5:8].max(0)])
    for name, limit in (("auc", None), ("pauc", 0.1)):
        found = scores(e, name)
        assert list(found) == ["scan", "manoeuvre"]
        assert found["scan"].value == pytest.approx(roc_auc_score(TURNS.ravel(), s.ravel(), max_fpr=limit))
        assert found["manoeuvre"].value == pytest.approx(roc_auc_score(np.repeat([0, 1], 30), first, max_fpr=limit))
        for score in found.values():
            assert 0 < score.low < score.value < score.high < 1
            assert (score.runs, score.total) == (30, 30)


def test_intervals_of_perfect_and_of_inverted_detectors_are_within_what_is_possible():
    for name, lowest in (("auc", 0.0), ("pauc", 0.9 / 1.9)):
        best, worst = (scores(evidence(sign * (TURNS + 0.1 * noise(1))), name)["scan"] for sign in (1.0, -1.0))
        assert best.value == best.high == 1.0
        assert 0.8 < best.low < 1
        assert worst.value == worst.low == pytest.approx(lowest)
        assert lowest < worst.high < lowest + 0.2


def test_the_whole_area_ranks_a_detector_above_a_noisier_one():
    good, bad = (METRICS["auc"].resampled(METRICS["auc"].contributions(evidence(noise(2, rise=r)))["scan"]) for r in (2, 0.5))
    value, error = (good - bad).centre_and_error
    assert value[0] > 5 * error[0] > 0
    assert METRICS["auc"].better == METRICS["pauc"].better == "higher"


@pytest.mark.parametrize("block", ["scan", "manoeuvre"])
def test_a_detector_of_noise_has_an_area_of_one_half_within_its_interval(block):
    # 300 sets: a rate of 0.95 has a standard deviation of 0.0126; band 0.02, see the intervals, and 5 of them: below 1e-6.
    inside = [s.low <= 0.5 <= s.high for s in (scores(evidence(noise(seed)), "auc")[block] for seed in range(300))]
    assert abs(np.mean(inside) - 0.95) < 0.02 + 0.063


def test_runs_that_did_not_come_through_do_not_count():
    statistic = noise(3, rise=1.0)
    statistic[:, :2] = 100.0 * TURNS[:, :2]
    bad = {"status": [FAILED, LOST] + [OK] * 28, "reason": ["", ""] + [""] * 28}
    e, rest = evidence(statistic, calm=noise(4), **bad), evidence(statistic[:, 2:], calm=noise(4))
    for name in NAMES:
        found, expected = (scores(each, name)["manoeuvre"] for each in (e, rest))
        assert (found.value, found.low, found.high) == pytest.approx((expected.value, expected.low, expected.high))
        assert (found.runs, found.total) == (28, 30)
    points, without = (operating.operating_points(each, [0.1, 0.5]) for each in (e, rest))
    assert points.equals(without)


def test_rate_and_delay_by_hand():
    """Nineteen peaks 1, 2, .. 19: the threshold is the second largest, 18."""
    calm = np.tile(np.arange(1.0, 20.0), (12, 1))
    calm[:2] = 99.0  # before alarms count
    statistic = np.zeros((12, 5))
    statistic[6, 0] = 18.5  # detected at the second of three steps
    statistic[5, 1] = 18.5  # at the first
    statistic[6, 2] = 18.0  # reached, not exceeded: missed
    statistic[[3, 5], 3] = 18.5  # a false alarm before
    statistic[[1, 7], 4] = 18.5  # what comes before alarms count is none; at the third
    e = evidence(statistic, calm=calm)
    rate, delay = (scores(e, name)["manoeuvre"] for name in ("detection-rate", "detection-delay"))
    assert (rate.value, rate.unit, rate.runs) == (0.75, "", 5)
    assert (delay.value, delay.unit) == (pytest.approx((0.5 + 0 + 1.5 + 1.0) / 4), "s")
    assert 0 <= rate.low < rate.value < rate.high <= 1
    assert 0 <= delay.low < delay.value < delay.high <= 1.5
    for name in ("detection-rate", "detection-delay"):
        assert not METRICS[name].ranked
        values = METRICS[name].contributions(e)["manoeuvre"]
        assert METRICS[name].resampled(values).value == pytest.approx([scores(e, name)["manoeuvre"].value])


def test_what_is_always_detected_at_once_has_an_interval():
    e = evidence(100.0 * TURNS, calm=noise(10, 100))
    rate, delay = (scores(e, name)["manoeuvre"] for name in ("detection-rate", "detection-delay"))
    assert (rate.value, rate.high, delay.value, delay.low) == (1.0, 1.0, 0.0, 0.0)
    # At every peak all of thirty runs are detected, so the threshold adds nothing: Jeffreys' interval, of 1.5 s for the delay.
    end = stats.beta.ppf(0.025, 30.5, 0.5)
    assert (rate.low, delay.high) == pytest.approx((end, 1.5 * (1 - end)), abs=2e-3)


def test_what_is_missing_gives_no_score():
    whole = evidence(noise(5), calm=noise(6))
    assert all(scores(whole, name) for name in NAMES)
    for without in (evidence(noise(5)), evidence(noise(5), calm=noise(6)[:, :8])):
        assert [name for name in NAMES if scores(without, name)] == ["auc", "pauc"]
    never = evidence(noise(5), mode=np.zeros_like(TURNS), calm=noise(6))
    unknown = dataclasses.replace(whole, truth=dataclasses.replace(whole.truth, mode=None))
    silent = dataclasses.replace(whole, estimate=dataclasses.replace(whole.estimate, statistic=None))
    for nothing in (never, unknown, silent):
        assert not any(scores(nothing, name) for name in NAMES)
        with pytest.raises(BadInput, match="toy: no manoeuvre, or no statistic"):
            operating.operating_points(nothing)


def test_few_manoeuvre_free_runs_do_not_tell_how_high_the_threshold_is():
    # 0.9^35 = 0.0250 and 0.9^36 = 0.0225: whether all peaks are below the threshold with a probability above 0.025 or not.
    found = {calm: roc.calibrated(np.concatenate([np.zeros((1, 50)), np.ones((calm, 50))]), 0.1) for calm in (12, 35, 36, 100)}
    assert {value for value, _, _ in found.values()} == {1.0}
    assert max(found[12][1], found[35][1]) < 0.1
    assert min(found[36][1], found[100][1]) > 0.8


def test_a_threshold_below_which_every_run_alarms_before_has_no_rate():
    values = np.full((21, 5), np.nan)
    values[0] = 0.0
    assert np.isnan(roc.calibrated(values, 0.1)).all()


# Operating points.


def test_operating_points_by_hand():
    calm = np.zeros((12, 9))
    calm[4, :4], calm[2, 4], calm[0, 5] = [5.0, 4.0, 3.0, 2.0], 1.0, 99.0
    statistic = np.zeros((12, 4))
    statistic[6, 0], statistic[5, 1], statistic[3, 2] = 3.5, 4.5, 4.5
    points = operating.operating_points(evidence(statistic, calm=calm), [0.1, 0.3])
    assert points.threshold.tolist() == [5.0, 3.0]
    # Over ten steps of half a second: one run alarms at the third of them and eight fly on; then three of them do.
    np.testing.assert_allclose(points.run_length, [(1.5 + 8 * 5) / 1, (3 * 1.5 + 6 * 5) / 3])
    for p, alarms in zip(points.itertuples(), (1, 3), strict=True):
        ends = stats.chi2.ppf([0.975, 0.025], 2 * alarms)
        np.testing.assert_allclose([p.run_length_low, p.run_length_high], 2 * p.run_length * alarms / ends)
        assert p.false_alarm == pytest.approx(alarms / 10)
        assert (p.false_alarm_low, p.false_alarm_high) == pytest.approx(stats.beta(alarms, 10 - alarms).interval(0.95))
    assert points.detection.tolist() == [0.0, pytest.approx(2 / 3)]
    assert points.runs.tolist() == [4, 3]
    exact = stats.binomtest(2, 3).proportion_ci(method="exact")
    assert (points.detection_low[1], points.detection_high[1]) == pytest.approx((exact.low, exact.high))
    np.testing.assert_allclose(points.delay, [1.5, (0.5 + 0.0 + 1.5) / 3])
    assert ((points.delay_low <= points.delay) & (points.delay <= points.delay_high)).all()
    assert points.calm_runs.tolist() == [9, 9]


def test_run_lengths_follow_the_times_of_steps():
    calm = np.zeros((12, 9))
    calm[4, 0] = 5.0
    times = (1.0, 3.0, 10.0, *range(11, 20))  # alarms count from 3 s on
    card = dataclasses.replace(CARD, times=times)
    points = operating.operating_points(evidence(np.zeros((12, 4)), calm=calm, card=card), [0.1])
    assert points.run_length.tolist() == [(12 - 3) + 8 * (19 - 3)]


def test_without_a_twin_there_are_points_of_the_curve():
    e = evidence(noise(7, rise=1.5))
    points = operating.operating_points(e)
    first = roc.onsets(e.case, e.truth, e.estimate)
    curve = roc.curve(first.scores)
    assert points.level.tolist() == [0.05, 0.1, 0.2, 0.5]  # 31 places: for 0.01 and 0.02 runs are too few
    for p in points.itertuples():
        above = curve.threshold > p.threshold  # alarms are above the threshold, points of the curve at or above theirs
        assert p.detection == pytest.approx(curve.detection[above][-1])
        assert p.false_alarm == pytest.approx((30 * curve.false_alarm[above][-1] + 1) / 31)
    assert points[["run_length", "run_length_low", "delay", "delay_high"]].isna().all(axis=None)
    assert (points.runs == 30).all()
    assert (points.calm_runs == 0).all()


def test_a_level_that_runs_are_too_few_for_is_bad_input():
    with pytest.raises(BadInput, match=r"toy: a false-alarm level of 0.01 needs 99 runs without manoeuvres, there are 30"):
        operating.operating_points(evidence(noise(8), calm=noise(9)), [0.5, 0.01])
    with pytest.raises(BadInput, match=r"of 0.1 needs 9 runs without manoeuvres, there are 8"):
        operating.operating_points(evidence(noise(8), calm=noise(9)[:, :8]), [0.1])


def cusum(rng, steps, runs, turns=()):
    """Page's cumulative sum for N(1, 1) against N(0, 1), from 0 at the third step on; in turns N(1, 1) is true."""
    total, found = np.zeros(runs), np.zeros((steps, runs))
    for k in range(2, steps):
        total = np.maximum(total + rng.standard_normal(runs) + (k in turns) - 0.5, 0.0)
        found[k] = total
    return found


def flights(rng, steps, runs, calm_runs):
    """Evidence of cumulative sums on flights that turn at the end, and on flights that never do."""
    turns = range(steps - 5, steps)
    mode = np.repeat(np.isin(np.arange(steps), turns)[:, None], runs, axis=1).astype(int)
    card = dataclasses.replace(CARD, steps=steps, interval=2.0)
    return evidence(cusum(rng, steps, runs, turns), mode, cusum(rng, steps, calm_runs), card)


@pytest.mark.parametrize(("level", "error"), [(0.2, 0.02), (0.999, 0.0)])
def test_the_run_length_of_cusum_is_that_of_pages_integral_equation(level, error):
    # Of 4000 runs 800 alarm, or all but a few: 5 standard errors, a false alarm below 1e-6. Run lengths that are cut off seem
    # longer by what the sum takes to rise from 0, some steps of 900; where all end in an alarm nothing is assumed.
    e = flights(np.random.default_rng(1), 200, 30, 4000)
    point = operating.operating_points(e, [level]).iloc[0]
    exact = 2.0 * average_run_length(point.threshold, 1.0, 0.0)
    assert abs(point.run_length / exact - 1) < 5 / np.sqrt(4000 * level) + error
    assert point.run_length_low < point.run_length < point.run_length_high


def test_intervals_of_false_alarms_and_run_lengths_of_cusum_hold():
    # 200 sets: a rate of 0.95 has a standard deviation of 0.0154; 5 of them: a false alarm below 6e-7. What the sum takes to
    # rise from 0 is a step or two in a hundred of the run length, against a relative error of 0.3: it costs less than 0.01.
    rng = np.random.default_rng(2)
    fresh = np.sort(cusum(rng, 80, 20_000).max(0))
    alarms = lengths = 0
    for _ in range(200):
        p = operating.operating_points(flights(rng, 80, 2, 50), [0.2]).iloc[0]
        true = 1 - np.searchsorted(fresh, p.threshold) / len(fresh)
        alarms += p.false_alarm_low <= true <= p.false_alarm_high
        lengths += p.run_length_low <= 2.0 * average_run_length(p.threshold, 1.0, 0.0) <= p.run_length_high
    assert alarms / 200 > 0.95 - 0.077
    assert lengths / 200 > 0.94 - 0.077
