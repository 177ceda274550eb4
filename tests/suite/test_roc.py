"""Curves, areas and calibrated thresholds against scikit-learn, brute force, exact laws and survival analysis."""

import numpy as np
import pytest
from scipy import stats
from sklearn.metrics import roc_auc_score, roc_curve

from cases import CASES
from suite import roc
from suite.case import Card, Divergence, StateBlock, Truth
from suite.estimator import LOST, OK, Estimate
from suite.statistics import bounded

NAN = np.nan


def card(steps, times=()):
    """A case on a line that flies straight, or turns left or right; the names are not in the order of the numbers."""
    return Card(
        name="toy", title="", summary="", steps=steps, interval=2.0, state=("x",), blocks=(StateBlock("position", (0,), "m"),),
        divergence=Divergence("position", 1.0, 1), reference="", modes=("left", "straight", "right"), nominal="straight",
        times=times,
    )  # fmt: skip


def estimate(statistic, **rest):
    nothing = np.zeros((len(statistic), 1, statistic.shape[1]))
    return Estimate(nothing, nothing[:, None], statistic=statistic, **rest)


def onsets(statistic, mode, times=()):
    x = np.zeros((len(mode), 1, mode.shape[1]))
    return roc.onsets(card(len(mode), times), Truth(x, x, mode), estimate(statistic))


def scans(seed, digits):
    """Scores[2, 30, 8] of eight runs, higher in manoeuvres, tied to few digits; run 3 has no manoeuvre, run 5 nothing else."""
    rng = np.random.default_rng(seed)
    manoeuvre = rng.random((30, 8)) < rng.uniform(0.1, 0.9, 8)
    manoeuvre[:, 3], manoeuvre[:, 5] = False, True
    score = np.round(rng.standard_normal((30, 8)) + rng.standard_normal(8) + 0.7 * manoeuvre, digits)
    score[4, 2] = NAN
    return np.where([~manoeuvre, manoeuvre], score, NAN)


def pairs(seed, digits):
    rng = np.random.default_rng(seed)
    return np.round(rng.standard_normal((2, 1, 12)) + rng.standard_normal(12) + [[[0]], [[1]]], digits)


def flat(scores):
    """Labels and scores as scikit-learn takes them."""
    parts = [part[~np.isnan(part)] for part in scores]
    return np.repeat([0, 1], [len(part) for part in parts]), np.concatenate(parts)


SCORES = [make(seed, digits) for make in (scans, pairs) for seed in (0, 1) for digits in (0, 1, 9)]


@pytest.mark.parametrize("scores", SCORES)
def test_the_curve_is_scikit_learns(scores):
    false_alarm, detection, threshold = roc_curve(*flat(scores), drop_intermediate=False)
    found = roc.curve(scores)
    np.testing.assert_array_equal(found.threshold, threshold)
    np.testing.assert_allclose([found.false_alarm, found.detection], [false_alarm, detection], atol=1e-15)


@pytest.mark.parametrize("scores", SCORES)
@pytest.mark.parametrize("limit", [None, 0.03, 0.1, 0.5, 0.9])
def test_areas_are_scikit_learns_for_all_runs_and_without_each(scores, limit):
    found = (
        roc.area(scores) if limit is None else roc.partial_area(scores, limit).map(lambda mean: roc.standardised(mean, limit))
    )
    assert found.value == pytest.approx([roc_auc_score(*flat(scores), max_fpr=limit)], abs=1e-12)
    left_out = [roc_auc_score(*flat(np.delete(scores, r, axis=2)), max_fpr=limit) for r in range(scores.shape[2])]
    np.testing.assert_allclose(found.left_out, [left_out], atol=1e-12)


@pytest.mark.parametrize("scores", SCORES[:2])
def test_the_partial_area_up_to_one_is_the_area(scores):
    whole, part = roc.area(scores), roc.partial_area(scores, 1.0)
    np.testing.assert_allclose(part.value, whole.value, rtol=1e-12)
    np.testing.assert_allclose(part.left_out, whole.left_out, rtol=1e-12)
    assert roc.standardised(np.array([0.3]), 1.0) == pytest.approx(0.3)


def test_scores_of_any_size_are_compared_exactly():
    scores = np.array([[[1e300, -np.inf]], [[np.inf, 1e300]]])
    assert roc.area(scores).value == pytest.approx(3.5 / 4)


def test_without_the_only_run_of_a_kind_there_is_no_area_and_no_interval():
    scores = scans(0, 2)[..., [3, 3, 5]]
    for sample in (roc.area(scores), roc.partial_area(scores, 0.1)):
        assert np.isfinite(sample.value[0])
        assert np.isnan(sample.left_out[0, 2])
        assert np.isnan(bounded(sample)).all()
    for sample in (roc.area(scores[..., :0]), roc.area(scores[..., :1])):
        assert np.isnan(sample.value[0])
    alone = roc.area(pairs(0, 2)[..., :1])
    assert alone.left_out.shape == (1, 0)
    assert np.isnan(bounded(alone)).all()


# Intervals within 0 to 1.


@pytest.mark.parametrize("limit", [None, 0.2])
@pytest.mark.parametrize(("runs", "steps", "shift"), [(12, 1, 0.0), (40, 6, 0.0), (40, 6, 1.5)], ids=str)
def test_intervals_hold_the_true_area_at_their_rate(limit, runs, steps, shift):
    # 400 sets: a rate of 0.95 has a standard deviation of 0.0109. Exact intervals cover rather too often; below, an
    # approximation may cost 0.02, and 5 standard deviations more have a probability below 1e-6.
    rng, inside = np.random.default_rng(runs + steps), 0
    weight = np.sqrt([0.3, 0.7])  # the steps of a run are correlated, manoeuvres or not
    if limit is None:
        exact = stats.norm.cdf(shift / np.sqrt(2))
    else:
        rate = (np.arange(100_000) + 0.5) / 100_000 * limit
        exact = stats.norm.sf(stats.norm.isf(rate) - shift).mean()
    for _ in range(400):
        scores = weight[0] * rng.standard_normal((2, 1, runs)) + weight[1] * rng.standard_normal((2, steps, runs))
        scores[1] += shift
        low, high = bounded(roc.area(scores) if limit is None else roc.partial_area(scores, limit))
        inside += low <= exact <= high
    assert inside / 400 > 0.93 - 0.0545


# The first manoeuvre of a run.

S, L, R = 1, 0, 2
MODES = np.array(
    [
        [S, S, S, S, L, R, L, S, R, R],  # turns from one side to the other are one manoeuvre
        [S, S, S, S, S, S, S, S, S, S],
        [S, S, L, L, S, S, S, R, R, S],  # begins before alarms count
        [S, S, S, S, S, S, S, S, S, R],  # lasts to the end
        [S, S, S, R, R, S, L, S, S, S],
    ]
).T
STATISTIC = np.array(
    [
        [9, 9, 1, 3, 2, 5, 4, 9, 9, 9],
        [9, 9, 1, 3, 2, 5, 4, 9, 9, 9],
        [9, 9, 1, 3, 2, 5, 4, 9, 9, 9],
        [0, 0, 1, 2, NAN, 1, 0, 0, 1, 7],
        [0, 0, 4, 3, 6, 9, 9, 9, 9, 9],
    ]
).T


def test_scores_of_first_manoeuvres_by_hand():
    first = onsets(STATISTIC, MODES)
    np.testing.assert_array_equal(first.before, [3, NAN, NAN, 2, 4])
    np.testing.assert_array_equal(first.scores, np.array([[3, NAN, NAN, 2, 4], [5, NAN, NAN, 7, 6]])[:, None])


def test_detections_and_delays_by_hand():
    first, threshold = onsets(STATISTIC, MODES), np.array([np.inf, 6.0, 5.0, 4.0, 2.5, 1.0])
    np.testing.assert_array_equal(
        first.detected(threshold)[:, [0, 3, 4]], [[0, 0, 0], [0, 1, 0], [0, 1, 1], [1, 1, 1], [NAN, 1, NAN], [NAN] * 3]
    )
    assert np.isnan(first.detected(threshold)[:, 1:3]).all()
    # Steps are 2 s apart: a missed manoeuvre of three steps counts 6 s.
    np.testing.assert_array_equal(
        first.delay(threshold)[:, [0, 3, 4]], [[6, 2, 4], [6, 0, 4], [6, 0, 2], [2, 0, 2], [NAN, 0, NAN], [NAN] * 3]
    )
    assert np.isnan(first.delay(threshold)[:, 1:3]).all()


def test_delays_follow_the_times_of_steps():
    times = (1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0, 21.0, 22.0, 23.0)
    first = onsets(STATISTIC, MODES, times)
    assert first.delay(np.array([np.inf, 4.0]))[:, 0].tolist() == [13.0, 4.0]  # from 8 s to 21 s, and to 12 s
    assert first.delay(np.array([np.inf]))[0, 3] == 2.0  # what follows the last step is as long as usual


def test_the_delay_is_the_restricted_mean_of_kaplan_and_meier():
    rng = np.random.default_rng(0)
    mode = np.full((16, 200), S)
    mode[6:14] = L
    statistic = rng.standard_normal((16, 200))
    threshold = 1.2
    found = onsets(statistic, mode).delay(np.array([threshold]))[0]
    known = ~np.isnan(found)
    alarm = statistic[6:14, known] > threshold
    detected = alarm.any(0)
    since = 2.0 * alarm.argmax(0)
    sample = stats.CensoredData(uncensored=since[detected], right=np.full((~detected).sum(), 16.0))
    survival = stats.ecdf(sample).sf
    at = np.concatenate([[0.0], survival.quantiles[survival.quantiles < 16], [16.0]])
    restricted = (np.diff(at) * survival.evaluate(at[:-1])).sum()
    assert found[known].mean() == pytest.approx(restricted, rel=1e-12)
    assert 0.3 < detected.mean() < 0.9
    assert known.sum() < 200


@pytest.mark.parametrize("name", ["naval", "naval-loose", "aircraft-loose"])
def test_naval_onsets_are_scans_3_to_10_against_11_to_20(name):
    case = CASES[f"manoeuvre-detection/{name}"]
    truth = case.simulate(6, seed=1)
    statistic = np.random.default_rng(0).standard_normal((case.steps, 6))
    first = roc.onsets(case, truth, estimate(statistic))
    np.testing.assert_array_equal(first.before, statistic[2:10].max(0))
    np.testing.assert_array_equal(first.scores[1, 0], statistic[10:20].max(0))
    scan = 1 + (statistic[10:20] > 1.0).argmax(0)  # the first scan with an alarm, counted from scan 11 on
    late = np.where((statistic[10:20] > 1.0).any(0), scan - 1, 10) * case.interval
    expected = np.where(statistic[2:10].max(0) > 1.0, NAN, late)
    np.testing.assert_allclose(first.delay(np.array([1.0]))[0], expected)
    labels = roc.manoeuvres(case, truth)
    np.testing.assert_array_equal(np.flatnonzero(labels[:, 0]) + 1, [*range(11, 21), *range(31, 41)])
    twin = CASES[f"manoeuvre-detection/{name}-straight"]
    assert roc.onsets(twin, twin.simulate(6, seed=1), estimate(statistic)) is None


# Thresholds from manoeuvre-free runs.


def test_peaks_are_of_the_runs_that_came_through_from_the_third_step_on():
    statistic = np.array([[9.0, 9, 1, 2], [0, 0, 5, 4], [9, 9, 8, 8], [0, 9, 3, 3]]).T
    calm = estimate(statistic, status=[OK, OK, LOST, OK], reason=["", "", "gone", ""])
    np.testing.assert_array_equal(roc.peaks(calm), [5, 3, 2])
    assert roc.peaks(None).size == roc.peaks(estimate(statistic[:2])).size == 0
    assert [roc.place(0.1, count) for count in (0, 8, 9, 18, 19, 99, 100)] == [0, 0, 1, 1, 2, 10, 10]


@pytest.mark.parametrize("runs", [12, 29, 99])
def test_the_calibrated_threshold_raises_false_alarms_at_the_level(runs):
    # The probability of an alarm above a threshold is known here; over sets of runs it is beta (Wilks, 1941), with a mean of
    # j / (runs + 1). 5 standard errors, and a p-value of 1e-6: false alarms below 2e-6.
    rng, sets, steps = np.random.default_rng(runs), 1500, 6
    statistic = rng.standard_normal((sets, steps, runs))
    statistic[:, :2] += 10
    place = roc.place(0.1, runs)
    threshold = np.array([roc.peaks(estimate(each))[place - 1] for each in statistic])
    alarm = 1 - stats.norm.cdf(threshold) ** (steps - 2)
    expected = place / (runs + 1)
    assert abs(alarm.mean() - expected) < 5 * alarm.std() / np.sqrt(sets)
    assert stats.kstest(alarm, stats.beta(place, runs + 1 - place).cdf).pvalue > 1e-6
    assert 0.1 - 1 / (runs + 1) < expected <= 0.1 + 1e-12


def shares(rng, calm, runs, shift):
    """Whether manoeuvres are detected [C + 1, R], for unit normal peaks."""
    threshold = np.append(np.inf, np.sort(rng.standard_normal(calm))[::-1])[:, None]
    before, within = rng.standard_normal(runs) - 1, rng.standard_normal(runs) + shift
    return np.where(before <= threshold, within > threshold, NAN)


@pytest.mark.parametrize(("calm", "runs", "shift"), [(12, 12, 1.5), (60, 30, 0.5), (100, 100, 3.0)], ids=str)
def test_calibrated_intervals_are_the_quantiles_of_their_mixture(calm, runs, shift):
    # By sampling: a threshold above all but a binomial number of peaks, and there a share from Jeffreys' beta law. Quantiles
    # of 200 000 draws are known to 0.003 where the density is above 0.1; the band is five times that.
    rng = np.random.default_rng(calm)
    values = shares(rng, calm, runs, shift)
    caught, of = np.nansum(values, axis=1), (~np.isnan(values)).sum(1)
    drawn = rng.binomial(calm, 0.1, 200_000)
    ends = [
        np.quantile(rng.beta(caught[row] + 0.5, of[row] - caught[row] + 0.5), [0.025, 0.975])
        for row in (drawn, np.minimum(drawn + 1, calm))
    ]
    value, low, high = roc.calibrated(values, 0.1)
    row = int(0.1 * (calm + 1))
    assert value == pytest.approx(caught[row] / of[row])
    assert (low, high) == pytest.approx((min(e[0] for e in ends), max(e[1] for e in ends)), abs=0.015)


@pytest.mark.parametrize(("calm", "runs"), [(12, 12), (60, 40)])
@pytest.mark.parametrize("shift", [0.3, 2.0])
def test_calibrated_intervals_hold_the_rate_at_the_true_level(calm, runs, shift):
    # 250 sets: a rate of 0.95 has a standard deviation of 0.0138; 5 of them: a false alarm below 3e-7. They hold more often.
    rng, exact = np.random.default_rng(calm), stats.norm.sf(stats.norm.isf(0.1) - shift)
    found = np.array([roc.calibrated(shares(rng, calm, runs, shift), 0.1) for _ in range(250)])
    assert ((found[:, 1] <= exact) & (exact <= found[:, 2])).mean() > 0.95 - 0.069
    assert ((found[:, 1] <= found[:, 0]) & (found[:, 0] <= found[:, 2])).all()
    assert ((found >= 0) & (found <= 1)).all()
