"""Metrics by hand, and on filters whose quality is known."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

from cases import CASES
from estimators.kalman import Kalman
from suite.case import Card, Divergence, StateBlock, Truth
from suite.divergence import streak
from suite.estimator import FAILED, LOST, Estimate
from suite.metrics import METRICS, Evidence
from suite.metrics.evidence import mahalanobis

CARD = Card(
    name="toy", title="", summary="", steps=3, interval=1.0, state=("x", "y", "v"),
    blocks=(StateBlock("position", (0, 1), "m"), StateBlock("speed", (2,), "m/s")),
    divergence=Divergence("position", 5.0, 2), reference="",
)  # fmt: skip

# Errors (x, y, v) of two runs over three steps.
ERRORS = np.array([[[3, 4, 1], [0, 0, 2]], [[0, 5, -1], [6, 8, 0]], [[1, 0, 3], [0, 1, 4]]], float).transpose(0, 2, 1)


def pair(errors=ERRORS, cov=None, **rest):
    """A truth and an estimate with these errors[T, n, R]."""
    x = np.random.default_rng(0).standard_normal(errors.shape)
    cov = np.tile(np.eye(errors.shape[1])[:, :, None], (len(errors), 1, 1, errors.shape[2])) if cov is None else cov
    return Truth(x, np.zeros((len(errors), 1, errors.shape[2]))), Estimate(x + errors, cov, **rest)


def close(score, value, unit, runs=2, total=2):
    assert score.value == pytest.approx(value)
    assert (score.unit, score.runs, score.total) == (unit, runs, total)


def test_rmse_by_hand():
    scores = METRICS["rmse"](CARD, *pair())
    position = np.mean([np.sqrt((25 + 0) / 2), np.sqrt((25 + 100) / 2), np.sqrt((1 + 1) / 2)])
    speed = np.mean([np.sqrt((1 + 4) / 2), np.sqrt((1 + 0) / 2), np.sqrt((9 + 16) / 2)])
    assert list(scores) == ["position", "speed", "position, surviving runs", "speed, surviving runs"]
    close(scores["position"], position, "m")
    close(scores["speed"], speed, "m/s")


def test_eta_by_hand():
    norms = [np.sqrt(26 / 3), np.sqrt(4 / 3), np.sqrt(26 / 3), np.sqrt(100 / 3), np.sqrt(10 / 3), np.sqrt(17 / 3)]
    close(METRICS["eta"](CARD, *pair())["state"], np.mean(norms), "mixed")


def test_brier_by_hand():
    card = dataclasses.replace(CARD, modes=("a", "b"))
    truth, estimate = pair()
    truth = dataclasses.replace(truth, mode=np.array([[0, 1], [1, 1], [0, 0]]))
    first = np.array([[0.7, 0.1], [0.4, 0.0], [1.0, 0.5]])  # P(a) in two runs over three steps
    estimate.mode = np.stack([first, 1 - first], axis=1)
    squares = [0.3, 0.1, 0.4, 0.0, 0.0, 0.5]  # of what is missing to certainty, once for each of two modes
    close(METRICS["brier"](card, truth, estimate)["modes"], 2 * np.mean(np.square(squares)), "")


def test_without_modes_there_is_no_brier_score():
    truth, estimate = pair()
    assert METRICS["brier"](CARD, truth, estimate) == {}
    estimate.mode = np.ones((3, 1, 2))
    assert METRICS["brier"](CARD, truth, estimate) == {}


def test_nees_by_hand():
    cov = np.tile(np.diag([4.0, 1.0, 0.25])[:, :, None], (3, 1, 1, 2))
    squares = (ERRORS**2 / np.array([4.0, 1.0, 0.25])[:, None]).sum(1) / 3
    close(METRICS["nees"](CARD, *pair(cov=cov))["state"], squares.mean(), "")


def test_nees_of_correlated_errors_of_mixed_size():
    rng = np.random.default_rng(1)
    scale = np.array([1e6, 1.0, 1e-6])
    root = rng.standard_normal((5, 3, 3)) * scale[:, None]
    cov, error = root @ np.swapaxes(root, 1, 2), rng.standard_normal((5, 3)) * scale
    expected = [(np.linalg.solve(b, e) ** 2).sum() for b, e in zip(root, error, strict=True)]
    np.testing.assert_allclose(mahalanobis(error, cov), expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("cov", "expected"),
    [
        (np.diag([4.0, 1.0]), 1.25),
        (np.ones((2, 2)), np.inf),
        (np.array([[1.0, 2.0], [2.0, 4.0]]), np.inf),
        (np.diag([1.0, 0.0]), np.inf),
        (np.zeros((2, 2)), np.inf),
        (np.diag([1.0, -1.0]), np.inf),
        (np.array([[1.0, 2.0], [2.0, 1.0]]), np.inf),
        (np.diag([1.0, np.nan]), np.nan),
        (np.array([[1.0, np.nan], [np.nan, 1.0]]), np.nan),
        (np.diag([1.0, np.inf]), np.nan),
    ],
)
def test_mahalanobis_of_bad_covariances(cov, expected):
    stack = np.stack([np.eye(2), cov, np.eye(2)])
    np.testing.assert_array_equal(mahalanobis(np.ones((3, 2)), stack), [2.0, expected, 2.0])


@pytest.mark.parametrize(("n", "rank"), [(2, 1), (3, 2), (4, 3), (6, 5), (6, 1)])
def test_covariances_of_too_few_particles_are_singular(n, rank):
    root = np.random.default_rng(0).standard_normal((200, n, rank))
    assert np.isinf(mahalanobis(np.ones((200, n)), root @ np.swapaxes(root, 1, 2))).all()


def test_nan_errors_stay_nan():
    assert np.isnan(mahalanobis(np.array([np.nan, 1.0]), np.eye(2)))


def test_nees_of_the_exact_filter_is_one_within_its_interval_at_its_rate():
    # 60 groups of 40 runs: the 95 % interval must hold 1 in about as many. BCa intervals of 40 skew numbers cover 93 to 95 %;
    # of 60 at 93 %, fewer than 46 has probability below 1e-5.
    case = CASES["linear-gaussian"]
    truth = case.simulate(2400, seed=2)
    estimate = Kalman().run(case.model, truth.y)
    values = METRICS["nees"].contributions(Evidence(case, truth, estimate))["state"][::10]
    scores = [METRICS["nees"].score(values[:, i : i + 40], "", 40) for i in range(0, 2400, 40)]
    assert sum(s.low <= 1 <= s.high for s in scores) >= 46
    # Of all runs together the mean is 1 within 5 standard errors; and at any one step 4 nees follows chi² of 4 degrees.
    per_run = values.mean(0)
    assert abs(per_run.mean() - 1) < 5 * per_run.std() / np.sqrt(2400)
    assert stats.kstest(4 * values[-1], stats.chi2(4).cdf).pvalue > 1e-6


def test_position_error_of_the_exact_filter_is_what_the_divergence_limit_assumes():
    case = CASES["linear-gaussian"]
    truth = case.simulate(300, seed=3)
    estimate = Kalman().run(case.model, truth.y)
    score = METRICS["rmse"](case, truth, estimate)["position"]
    steady = np.sqrt(estimate.cov[-1, 0, 0, 0] + estimate.cov[-1, 2, 2, 0])
    assert 7 < steady < 9
    assert abs(score.value / steady - 1) < 0.1
    assert METRICS["divergence"](case, truth, estimate)["runs"].value == 0


def far(*flags):
    """Errors in position [T, 3, R] beyond the limit of 5 m where a run's flag is set, on it elsewhere."""
    return np.stack([5.0 + np.array(flags, float).T, *[np.zeros(np.shape(flags)).T] * 2], axis=1)


def test_divergence_needs_its_steps_on_end():
    errors = far([0, 0, 0, 0], [1, 0, 1, 0], [0, 1, 1, 0], [1, 1, 1, 1], [0, 0, 1, 1])
    score = METRICS["divergence"](CARD, *pair(errors))["runs"]
    close(score, 3 / 5, "", 5, 5)
    assert (score.low, score.high) == pytest.approx((stats.beta.ppf(0.025, 3, 3), stats.beta.ppf(0.975, 4, 2)), abs=1e-9)
    long = dataclasses.replace(CARD, divergence=Divergence("position", 5.0, 3))
    close(METRICS["divergence"](long, *pair(errors))["runs"], 1 / 5, "", 5, 5)
    speed = dataclasses.replace(CARD, divergence=Divergence("speed", 5.0, 1))
    close(METRICS["divergence"](speed, *pair(errors))["runs"], 0, "", 5, 5)


def test_streak_begins_where_the_first_long_enough_one_does():
    flags = np.array([[1, 1, 0, 1, 1, 1], [0, 1, 0, 1, 1, 0], [0, 0, 0, 0, 1, 1]], bool).T
    counted = np.ones_like(flags)
    np.testing.assert_array_equal(streak(flags, counted, 1), [1, 2, 5])
    np.testing.assert_array_equal(streak(flags, counted, 2), [1, 4, 5])
    np.testing.assert_array_equal(streak(flags, counted, 3), [4, np.inf, np.inf])
    counted[2] = False  # what does not count neither ends nor lengthens a streak
    np.testing.assert_array_equal(streak(flags, counted, 3), [1, 2, np.inf])


def test_failed_and_lost_runs():
    """Errors are those of the runs that came through; a lost run counts as diverged, a failed one as neither."""
    errors = np.concatenate([ERRORS, 1e6 * np.ones((3, 3, 2))], axis=2)
    errors[1:, :, 2:] = np.nan
    truth, estimate = pair(errors, status=["ok", "ok", LOST, FAILED], reason=["", "", "gone", "broke"])
    plain = METRICS["rmse"](CARD, *pair())["position"]
    score = METRICS["rmse"](CARD, truth, estimate)["position"]
    close(score, plain.value, "m", 2, 4)
    assert (score.low, score.high) == (plain.low, plain.high)
    close(METRICS["nees"](CARD, truth, estimate)["state"], METRICS["nees"](CARD, *pair())["state"].value, "", 2, 4)
    close(METRICS["divergence"](CARD, truth, estimate)["runs"], 1 / 3, "", 3, 4)


@pytest.mark.parametrize("name", [m for m in METRICS if not METRICS[m].timed and m != "failed"])
def test_nothing_came_through(name):
    truth, estimate = pair(status=[FAILED] * 2)
    for score in METRICS[name](CARD, truth, estimate).values():
        assert np.isnan([score.value, score.low, score.high]).all()
        assert (score.runs, score.total) == (0, 2)


def test_unknown_truth_at_some_steps_is_left_out():
    errors = ERRORS.copy()
    errors[1] = np.nan
    expected = np.mean([np.sqrt(25 / 2), np.sqrt(2 / 2)])
    close(METRICS["rmse"](CARD, *pair(errors))["position"], expected, "m")


def test_singular_covariances_make_nees_infinite_not_nan():
    cov = np.tile(np.eye(3)[:, :, None], (3, 1, 1, 2))
    cov[1, :, :, 1] = 0
    score = METRICS["nees"](CARD, *pair(cov=cov))["state"]
    assert score.value == np.inf
    assert score.high == np.inf
    assert not np.isnan(score.low)


def timed(seconds, batch):
    calls = len(batch)
    nothing = np.full((len(seconds), 1, calls), np.nan)
    return Estimate(nothing, nothing[:, None], seconds=np.array(seconds), batch=batch)


def test_latency_and_throughput_by_hand():
    # Three steps; two calls with a single run, two with twenty.
    seconds = [[1e-3, 2e-3, 1e-4, 3e-4], [2e-3, 4e-3, 1e-4, 3e-4], [9e-3, 3e-3, 1e-4, 3e-4]]
    estimate = timed(seconds, [1, 1, 20, 20])
    nothing = Truth(np.empty((0, 0, 0)), np.empty((0, 0, 0)))
    close(METRICS["latency"](CARD, nothing, estimate)["step"], (2000 + 3000) / 2, "µs")
    close(METRICS["throughput"](CARD, nothing, estimate)["step"], 1 / 2e-4, "run-steps/s")
    alone = timed([row[:2] for row in seconds], [1, 1])
    assert np.isnan(METRICS["throughput"](CARD, nothing, alone)["step"].value)


def test_metrics_over_time():
    values = METRICS["rmse"].contributions(Evidence(CARD, *pair()))["position"]
    value, low, high = METRICS["rmse"].over_time(values)
    np.testing.assert_allclose(value, np.sqrt([12.5, 62.5, 1.0]))
    assert (low <= value).all()
    assert (value <= high).all()


def test_scores_read_well():
    text = str(METRICS["rmse"](CARD, *pair())["position"])
    assert text.endswith("(2 of 2 runs)")
    assert " m [" in text


@pytest.mark.parametrize("name", list(METRICS))
def test_every_metric_says_what_it_is(name):
    metric = METRICS[name]
    assert metric.title
    assert metric.formula
    assert metric.words
    assert metric.reference
    assert metric.better in ("lower", "higher") or isinstance(metric.better, float)
