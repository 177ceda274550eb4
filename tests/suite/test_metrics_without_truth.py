"""What metrics say where the truth has gaps or is not known at all."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

from cases import CASES
from estimators.kalman import Kalman
from suite.case import Card, Divergence, StateBlock, Truth
from suite.estimator import LOST, Estimate
from suite.metrics import METRICS, SURVIVING, Evidence
from suite.metrics.consistency import portmanteau
from tests.oracles import joint_loglik, random_linear

CARD = Card(
    name="toy", title="", summary="", steps=5, interval=1.0, state=("x", "y", "v"),
    blocks=(StateBlock("position", (0, 1), "m"), StateBlock("speed", (2,), "m/s")),
    divergence=Divergence("position", 5.0, 2), reference="",
)  # fmt: skip
OF_TRUTH = ("rmse", "eta", "mean-error", "maximum-error", "mse", "run-rmse", "run-rmse-sd", "nees", "divergence")
WITHOUT_TRUTH = ("nis", "whiteness", "loglik")


def pair(x, error, y=None, **rest):
    """A truth x[T, n, R] and an estimate that is off by so much."""
    cov = np.tile(np.diag([1.0, 4.0, 9.0])[:, :, None], (len(x), 1, 1, x.shape[2]))
    return Truth(x, np.zeros((len(x), 1, x.shape[2])) if y is None else y), Estimate(np.nan_to_num(x) + error, cov, **rest)


def drawn(runs=3, steps=5):
    rng = np.random.default_rng(0)
    return rng.normal(size=(steps, 3, runs)), rng.normal(0, 4, (steps, 3, runs))


@pytest.mark.parametrize("name", OF_TRUTH)
def test_steps_of_unknown_truth_are_as_if_they_were_not_there(name):
    x, error = drawn()
    x[[1, 4]] = np.nan
    found = METRICS[name](CARD, *pair(x, error))
    expected = METRICS[name](CARD, *pair(x[[0, 2, 3]], error[[0, 2, 3]]))
    assert [*found] == [*expected]
    for block, score in found.items():
        survivors = block.endswith(SURVIVING)  # of which there may be one or none
        assert survivors or np.isfinite(score.value)
        for field in ("value", "low", "high", "runs", "total"):
            assert getattr(score, field) == pytest.approx(getattr(expected[block], field), rel=1e-12, nan_ok=survivors), field


def test_each_run_has_its_own_gaps():
    x, error = drawn(2, 3)
    x[0, :, 0] = x[2, 0, 1] = np.nan
    off = np.sqrt((error**2).sum(1))
    norms = [np.array([off[1, 0], off[2, 0]]), np.array([off[0, 1], off[1, 1]])]
    # Eta is the mean over runs of those that are known at a step, then over steps: [run 1], [both], [run 0].
    expected = np.mean([norms[1][0], (norms[0][0] + norms[1][1]) / 2, norms[0][1]]) / np.sqrt(3)
    assert METRICS["eta"](CARD, *pair(x, error))["state"].value == pytest.approx(expected, rel=1e-12)
    speed = np.mean([abs(error[0, 2, 1]), np.sqrt((error[1, 2] ** 2).mean()), np.sqrt((error[2, 2] ** 2).mean())])
    assert METRICS["rmse"](CARD, *pair(x, error))["speed"].value == pytest.approx(speed, rel=1e-12)


@pytest.mark.parametrize("name", OF_TRUTH)
def test_without_any_truth_there_is_no_score(name):
    x, error = drawn()
    for score in METRICS[name](CARD, *pair(np.full_like(x, np.nan), error, status=["ok", LOST, "ok"])).values():
        assert np.isnan([score.value, score.low, score.high]).all()
        assert (score.runs, score.total) == (0, 3)


def test_a_streak_goes_on_over_steps_of_unknown_truth():
    far, near, gap = 9.0, 1.0, np.nan
    runs = np.array([
        [far, gap, far, near, near],
        [far, gap, near, far, near],
        [far, gap, gap, gap, gap],
        [gap, near, gap, far, far],
        [gap, gap, gap, gap, gap],
    ]).T  # fmt: skip
    x = np.zeros((5, 3, 5))
    x[:, 1] = np.where(np.isnan(runs), np.nan, 0.0)
    truth, estimate = pair(x, np.stack([np.nan_to_num(runs), np.zeros_like(runs), np.zeros_like(runs)], axis=1))
    found = METRICS["divergence"].contributions(Evidence(CARD, truth, estimate))["runs"]
    np.testing.assert_array_equal(found, [[1, 0, 0, 1, np.nan]])
    score = METRICS["divergence"](CARD, truth, estimate)["runs"]
    assert (score.value, score.runs, score.total) == (0.5, 4, 5)
    once = dataclasses.replace(CARD, divergence=Divergence("position", 5.0, 1))
    found = METRICS["divergence"].contributions(Evidence(once, truth, estimate))["runs"]
    np.testing.assert_array_equal(found, [[1, 1, 1, 1, np.nan]])


def test_nis_and_likelihood_by_hand():
    innovation = np.array([[[1.0, 2.0], [3.0, np.nan]], [[np.nan, 0.5], [np.nan, -1.0]], [[-2.0, 0.0], [np.nan, 1.0]]])
    y = np.where(np.isnan(innovation), np.nan, 7.0)
    loglik = np.array([[-1.0, -2.0], [0.0, -4.0], [-6.0, 3.0]])
    x, error = np.full((3, 3, 2), np.nan), np.zeros((3, 3, 2))
    truth, estimate = pair(x, error, y, innovation=innovation, loglik=loglik)
    # Run 0 measured nothing at step 1.
    expected = [((1 + 9) / 2 + 4) / 2, (0.25 + 1) / 2, (4 + (0 + 1) / 2) / 2]
    assert METRICS["nis"](CARD, truth, estimate)["innovation"].value == pytest.approx(np.mean(expected))
    found = METRICS["loglik"](CARD, truth, estimate)["measurement"]
    assert found.value == pytest.approx(((-1 - 6) / 2 + (-2 - 4 + 3) / 3) / 2)
    alike = pair(x, error, y, loglik=np.where(np.isnan(y).all(1), 0.0, -2.5))
    assert METRICS["loglik"](CARD, *alike)["measurement"].value == pytest.approx(-2.5)


def test_what_is_not_stored_is_not_scored():
    x, error = drawn()
    for name in WITHOUT_TRUTH:
        assert METRICS[name](CARD, *pair(x, error)) == {}


def ljung_box(v):
    """Q over its lags of one series without gaps, with sums written out."""
    n, reach = len(v), min(10, len(v) // 5)
    total = 0.0
    for lag in range(1, reach + 1):
        r = sum(v[i] * v[i - lag] for i in range(lag, n)) / sum(e * e for e in v)
        total += r * r / (n - lag)
    return n * (n + 2) * total, reach


def test_whiteness_by_hand():
    rng = np.random.default_rng(2)
    long, short = rng.normal(size=80), rng.normal(size=17)
    series = np.full((120, 3), np.nan)
    series[np.sort(rng.choice(120, 80, replace=False)), 0] = long
    series[np.sort(rng.choice(120, 17, replace=False)), 1] = short
    series[[3, 50, 51, 99], 2] = 1.0  # four are too few
    (a, h), (b, i) = ljung_box(long), ljung_box(short)
    assert (h, i) == (10, 3)
    assert portmanteau(series) == pytest.approx((a + b) / 13, rel=1e-12)
    assert np.isnan(portmanteau(series[:, 2:]))


@pytest.mark.parametrize("count", [6, 30, 200])
def test_white_innovations_have_a_whiteness_of_one(count):
    """Exactly so on average, as their mean is known; 4000 series, 5 sigma: false alarms below 6e-7."""
    found = [portmanteau(v[:, None]) for v in np.random.default_rng(count).normal(size=(4000, count))]
    assert abs(np.mean(found) - 1) < 5 * np.std(found) / np.sqrt(4000)
    if count == 200:  # 5 % above the 95 % point of chi-square, 5 sigma, and half a per cent for the approximation
        assert abs(np.mean(np.array(found) > stats.chi2(10).ppf(0.95) / 10) - 0.05) < 5 * np.sqrt(0.05 * 0.95 / 4000) + 0.01
    assert stats.chi2(10).ppf(0.95) / 10 == pytest.approx(1.83, abs=0.005)
    assert stats.chi2(20).ppf(0.95) / 20 == pytest.approx(1.57, abs=0.005)


def test_a_right_filter_has_white_innovations_of_unit_size_and_a_wrong_one_has_not():
    case = CASES["linear-gaussian"]
    truth = case.simulate(200, seed=5)
    right = Kalman().run(case.model, truth.y)
    stiff = dataclasses.replace(case.model, dynamics=dataclasses.replace(
        case.model.dynamics, noise=type(case.model.dynamics.noise).noise(1e-4 * case.model.dynamics.noise.cov)))  # fmt: skip
    wrong = Kalman().run(stiff, truth.y)
    unknown = Truth(np.full_like(truth.x, np.nan), truth.y)
    scores = {name: [METRICS[name](case, unknown, e) for e in (right, wrong)] for name in WITHOUT_TRUTH}
    for name in ("nis", "whiteness"):
        good, bad = (found["innovation"] for found in scores[name])
        # Means over 200 runs, 5 standard errors (an interval reaches 1.97): false alarms below 6e-7.
        assert abs(good.value - 1) < 5 / 1.97 * (good.high - good.low) / 2
        assert bad.low > 1.5
    good, bad = (found["measurement"] for found in scores["loglik"])
    assert good.low > bad.high
    # 2 nis of one step with two components is chi-square of two degrees.
    values = METRICS["nis"].contributions(Evidence(case, unknown, right))["innovation"]
    assert stats.kstest(2 * values[-1], stats.chi2(2).cdf).pvalue > 1e-6


def test_the_likelihood_of_the_exact_filter_is_that_of_all_measurements_together():
    known = random_linear(3, n=3, m=2, q=2)
    x, y = known.simulate(6, 4)
    y[2, 0, 1], y[4, :, :] = np.nan, np.nan  # at step 5 nobody measured
    card = dataclasses.replace(CARD, steps=6)
    found = METRICS["loglik"](card, Truth(np.full_like(x, np.nan), y), Kalman().run(known.model, y))["measurement"]
    expected = np.mean([joint_loglik(known, y[..., r]) for r in range(4)]) / 5
    assert found.value == pytest.approx(expected, rel=1e-9)
