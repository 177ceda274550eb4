"""What an estimator costs: by hand, against other computations, and as the engine measures and stores it."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

from cases import CASES
from estimators.bootstrap import Bootstrap
from estimators.ekf import Extended
from suite import results
from suite.case import Truth, draw
from suite.effort import FULL
from suite.estimator import FAILED, LOST, OK, Estimate
from suite.metrics import METRICS, Evidence
from suite.metrics.cost import Calls, quantile_ranks
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian
from suite.random import Streams
from suite.work import SHORT, TAIL_STEPS, TRACED, measure_time

CASE = CASES["linear-gaussian"]
VOLATILE = CASES["stochastic-volatility"]
NOTHING = Truth(np.empty((0, 0, 0)), np.empty((0, 0, 0)))


def calls(seconds, batch, **more):
    nothing = np.full((len(seconds), 1, len(batch)), np.nan)
    return Calls(nothing, nothing[:, None], seconds=np.asarray(seconds, float), batch=batch, **more)


def score(name, estimate, particles=None):
    return METRICS[name](CASE, NOTHING, estimate, particles=particles)


@pytest.mark.parametrize("share", [0.5, 0.99])
@pytest.mark.parametrize("count", [1, 5, 6, 8, 9, 100, 367, 368, 2000])
def test_ranks_are_the_tightest_that_hold_at_their_rate(count, share):
    low, high = quantile_ranks(count, share)
    law = stats.binom(count, share)
    assert law.cdf(low - 1) <= 0.025 < law.cdf(low)  # P(fewer than `low` numbers below the quantile)
    assert law.sf(high - 1) <= 0.025 + 1e-15
    assert high == 1 or law.sf(high - 2) > 0.025


def test_the_tail_has_an_upper_limit_from_as_many_steps_as_are_timed_for_it():
    assert [quantile_ranks(count, 0.99)[1] - count for count in (TAIL_STEPS - 1, TAIL_STEPS)] == [1, 0]


def test_tail_latency_by_hand():
    rng = np.random.default_rng(0)
    times = rng.permutation(np.arange(1.0, 401.0))  # µs: the 99th percentile is the 396th
    estimate = calls(1e-6 * np.column_stack([times.reshape(50, 8), np.full(50, 5e-3)]), [1] * 8 + [20])
    found = score("latency-p99", estimate)["step"]
    low, high = stats.binom.ppf(0.025, 400, 0.99), stats.binom.ppf(0.975, 400, 0.99) + 1  # ranks
    assert (found.value, found.unit, found.runs, found.total) == (pytest.approx(396), "µs", 8, 8)
    assert (found.low, found.high) == (pytest.approx(low), pytest.approx(high))
    fewer = score("latency-p99", calls(estimate.seconds[:, :7], [1] * 7))["step"]
    assert fewer.low < fewer.value < fewer.high == np.inf


def test_the_interval_of_the_tail_holds_at_its_rate():
    # 1000 repetitions of 500 skew times: the rate is within 5 standard errors of the exact one for these ranks, but for 6e-7.
    times = np.random.default_rng(1).lognormal(size=(1000, 500, 1))
    truth = np.exp(stats.norm.ppf(0.99))
    found = [METRICS["latency-p99"].exact(one) for one in times]
    held = np.mean([low <= truth <= high for _, low, high in found])
    low, high = quantile_ranks(500, 0.99)
    rate = stats.binom.cdf(high - 1, 500, 0.99) - stats.binom.cdf(low - 1, 500, 0.99)
    assert rate >= 0.95
    assert abs(held - rate) < 5 * np.sqrt(rate * (1 - rate) / 1000)


def test_an_estimator_that_does_not_time_its_steps_has_no_tail():
    found = score("latency-p99", calls(np.full((50, 8), 1e-3), [1] * 8))["step"]
    assert np.isnan([found.value, found.low, found.high]).all()
    assert score("latency", calls(np.full((50, 8), 1e-3), [1] * 8))["step"].value == pytest.approx(1000)


def test_throughput_of_particles_is_that_of_runs_times_their_number():
    estimate = calls([[1e-3, 1e-4, 3e-4]] * 4, [1, 20, 20])
    plain, found = score("throughput", estimate)["step"], score("particle-throughput", estimate, particles=500)["step"]
    assert (found.value, found.unit) == (pytest.approx(500 / 2e-4), "particle-steps/s")
    assert (found.low, found.high) == (pytest.approx(500 * plain.low), pytest.approx(500 * plain.high))
    assert score("particle-throughput", estimate) == {}


def test_memory_by_hand():
    estimate = calls(np.ones((3, 5)), [1, 1, 20, 20, 20], memory=2.0**20 * np.array([0.5, 0.5, 7, 7, 7]))
    found = score("memory", estimate)
    assert {block: (s.value, s.unit) for block, s in found.items()} == {"one run": (0.5, "MiB"), "20 runs": (7.0, "MiB")}
    assert all(np.isnan([s.low, s.high]).all() for s in found.values())
    assert score("memory", calls(np.ones((3, 5)), [1] * 5)) == {}


def variance(logliks, steps):
    """The score from log-likelihoods [calls, runs]; a call of one run goes before."""
    logliks = np.vstack([np.r_[logliks[0, 0] - 99, np.full(logliks.shape[1] - 1, np.nan)], logliks])
    batch = [1] + [logliks.shape[1]] * (len(logliks) - 1)
    return score("loglik-variance", calls(np.ones((steps, len(batch))), batch, logliks=logliks))


def test_variance_of_the_log_likelihood_by_hand():
    logliks = np.array([[-10.0, -20.0, -5.0], [-12.0, -20.0, np.nan], [-14.0, -23.0, -5.0]])
    found = variance(logliks, steps=10)["measurement"]  # variances 4 and 3; the third run was lost once
    assert (found.value, found.unit, found.runs) == (pytest.approx((4 + 3) / 2 / 10), "nat²/step", 2)
    assert variance(logliks, steps=9) == {}
    assert variance(logliks[:1], steps=10) == {}
    assert score("loglik-variance", calls(np.ones((10, 5)), [20] * 5)) == {}


def test_numbers_that_are_all_the_same_have_no_variance():
    logliks = np.random.default_rng(0).normal(0, 100, (1, 20))
    assert np.tile(logliks, (5, 1)).var(axis=0).any(), "rounding of the mean"
    found = variance(np.tile(logliks, (5, 1)), steps=10)["measurement"]
    assert (found.value, found.low, found.high) == (0, 0, 0)


def repeated(particles, seed, repeats=40, runs=20, steps=12):
    """Log-likelihoods [repeats, runs] of the same data, by bootstrap filters that are all run in one call.

    Measurements are vague, so that 100 particles are enough in every run.
    """
    vague = StateSpaceModel(
        prior=Gaussian([0.0], [[1.0]]),
        dynamics=AdditiveTransition(Affine([[0.5]]), Gaussian.noise([[1.0]])),
        sensor=AdditiveSensor(Affine([[1.0]]), Gaussian.noise([[4.0]])),
    )
    y = draw(vague, steps, Streams(("vague",)).batch(0, runs)).y
    estimate = Bootstrap(particles=particles).run(vague, np.tile(y, (1, 1, repeats)), seed=seed)
    return estimate.loglik.sum(0).reshape(repeats, runs)


def test_variance_falls_as_one_over_the_number_of_particles_and_is_that_of_brute_force():
    # Of 40 repetitions in 20 runs a mean variance has a relative error of about √(2 / (39 · 20)) = 5 %, measured 5.5 %. Ratios
    # of two are then good to 8 %, and 0.4 is beyond 5 standard errors: probability 6e-7.
    few, many = (variance(repeated(n, seed=2), 12)["measurement"].value for n in (100, 1600))
    assert abs(np.log(few / many / 16)) < 0.4
    by_force = np.mean([np.var(one, ddof=1) for one in repeated(100, seed=3).T]) / 12
    assert abs(np.log(few / by_force)) < 0.4


@pytest.mark.parametrize("steps", [30, 20])
def test_what_is_timed(steps):
    case = dataclasses.replace(VOLATILE, steps=steps, generate=lambda rng: cut(VOLATILE.generate(rng), steps))
    timing = measure_time(case, Extended(), seed=1)
    alone = timing.batch.count(1)
    assert timing.status == OK
    assert timing.batch == (1,) * alone + (FULL.runs,) * FULL.repeats
    assert timing.seconds.shape[1] == len(timing.batch) == len(timing.memory) == len(timing.logliks)
    assert SHORT <= len(timing.seconds) <= steps
    assert alone == FULL.repeats or TAIL_STEPS <= alone * len(timing.seconds) < TAIL_STEPS + len(timing.seconds)
    y = case.simulate(FULL.runs, seed=1).y[: len(timing.seconds)]
    expected = Extended().run(case.model, y).loglik.sum(0)
    np.testing.assert_array_equal(timing.logliks[alone:], np.tile(expected, (FULL.repeats, 1)))
    np.testing.assert_allclose(timing.logliks[:alone, 0], np.resize(expected, alone), rtol=1e-12)
    assert np.isnan(timing.logliks[:alone, 1:]).all()


def cut(truth, steps):
    return Truth(truth.x[:steps], truth.y[:steps])


class Greedy:
    """Returns what one must, in arrays of known size; takes `extra` bytes in between, and does as it is told."""

    name, reference = "greedy", "none"

    def __init__(self, extra=0, **spoil):
        self.extra, self.spoil = extra, spoil

    def accepts(self, model):
        return None

    def run(self, model, y, seed=0):
        np.ones(self.extra // 8)
        steps, _, runs = y.shape
        cov = np.tile(np.eye(model.n)[None, :, :, None], (steps, 1, 1, runs))
        estimate = Estimate(np.zeros((steps, model.n, runs)), cov)
        for name, value in self.spoil.items():
            setattr(estimate, name, value(steps, runs))
        return estimate


def test_memory_is_the_peak_of_a_call_and_not_what_it_leaves():
    """16 MiB that are given back within the call are seen, to a hundredth, and what other calls take is not."""
    plain, greedy = (measure_time(CASE, Greedy(extra), 1).memory for extra in (0, 2**24))
    assert plain[-1] < 2**17
    assert abs(greedy[0] / 2**24 - 1) < 0.01
    assert abs(greedy[-1] / 2**24 - 1) < 0.01
    returned = 8 * TRACED * FULL.runs * (4 + 16)
    assert returned < plain[-1] < 3 * returned + 2**14


def test_what_is_quick_is_timed_over_as_many_steps_as_the_tail_needs():
    timing = measure_time(CASE, Greedy(), 1)
    alone = timing.batch.count(1)
    assert alone > FULL.repeats
    assert TAIL_STEPS <= alone * len(timing.seconds) < TAIL_STEPS + len(timing.seconds)


def test_lost_runs_have_no_log_likelihood():
    status = lambda steps, runs: [LOST] + [OK] * (runs - 1)  # noqa: E731
    timing = measure_time(CASE, Greedy(loglik=lambda *shape: np.ones(shape), status=status), 1)
    many = timing.logliks[-FULL.repeats :]
    assert np.isnan(many[:, 0]).all()
    np.testing.assert_array_equal(many[:, 1:], len(timing.seconds))


@pytest.mark.parametrize("value", [-1e-9, np.nan, np.inf])
def test_times_that_cannot_be_fail_the_timing(value):
    timing = measure_time(CASE, Greedy(seconds=lambda *shape: np.full(shape, value)), 1)
    assert (timing.status, timing.reason) == (FAILED, "ValueError: seconds are negative or not finite")


def test_what_is_measured_is_stored_and_scored(tiny, tmp_path):
    """Smoothing with noise of standard deviation 0.5 in what it gives out as log-likelihoods: of 20 steps, 0.25 a step."""
    assert tiny("-e", "smoothed[jitter=0.5]", "last", "--profile", "paper", "--runs", "12").code == 0
    cells = results.load(tmp_path / "results").cases["tiny"].cells
    cell = cells["smoothed[jitter=0.5]"]
    assert isinstance(cell.timing, Calls)
    assert cell.timing.logliks.shape == (len(cell.timing.batch), FULL.runs)
    # 20 runs with 4 degrees of freedom each: 80 in all, and a chi-square of 80 is within 0.33 to 2.1 times its mean but for
    # 1e-6 of the time on each side.
    found = cell.scores(METRICS["loglik-variance"])["measurement"]
    assert found.runs == FULL.runs
    assert stats.chi2.ppf(1e-6, 80) / 80 < found.value / 0.25 < stats.chi2.isf(1e-6, 80) / 80
    one, many = (set(cell.timing.memory[np.equal(cell.timing.batch, runs)]) for runs in (1, FULL.runs))
    assert len(one) == len(many) == 1, "all steps of all calls with as many runs say the same"
    assert max(one) < min(many)
    assert list(cell.scores(METRICS["memory"])) == ["one run", f"{FULL.runs} runs"]
    assert cells["last"].timing.logliks is None
    assert cells["last"].scores(METRICS["loglik-variance"]) == {}


def test_an_estimate_that_is_no_timed_calls_has_neither_memory_nor_variance():
    plain = Estimate(np.zeros((3, 1, 2)), np.ones((3, 1, 1, 2)), seconds=np.ones((3, 2)), batch=[1, 20])
    assert [METRICS[name].contributions(Evidence(CASE, NOTHING, plain)) for name in ("memory", "loglik-variance")] == [{}, {}]
