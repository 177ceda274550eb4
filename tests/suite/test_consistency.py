"""Consistency: chi-square bands, the non-credibility index, whiteness of many runs; on the exact filter and on wrong ones."""

import dataclasses

import numpy as np
import pytest
from scipy import special, stats

from estimators.kalman import Kalman
from suite.case import Card, Divergence, StateBlock, Truth
from suite.diagnosis import remarks
from suite.estimator import Estimate
from suite.metrics import METRICS, Evidence
from suite.metrics.consistency import chi_square_band, portmanteau
from suite.results import CaseResults, Cell
from tests.oracles import random_linear

CARD = Card(
    name="toy", title="", summary="", steps=3, interval=1.0, state=("x", "y", "v"),
    blocks=(StateBlock("position", (0, 1), "m"), StateBlock("speed", (2,), "m/s")),
    divergence=Divergence("position", 1e9, 2), reference="",
)  # fmt: skip
KNOWN = random_linear(3, n=3, m=2, q=2)
CREDIBILITY = ("nci", "inclination")
DECIBEL = 10 / np.log(10)


def exact(steps, runs, seed=0):
    """Truths of a linear model and what the exact filter says of them."""
    x, y = KNOWN.simulate(steps, runs, seed)
    return Truth(x, y), Kalman().run(KNOWN.model, y)


def scaled(estimate, factor):
    return dataclasses.replace(estimate, cov=factor * estimate.cov)


def found(name, truth, estimate, card=CARD):
    (values,) = METRICS[name].contributions(Evidence(card, truth, estimate)).values()
    return values


def test_band_is_that_of_the_chi_square_law():
    runs = np.array([1, 12, 100])
    low, high = chi_square_band(4, runs)
    np.testing.assert_allclose(low, stats.chi2(4 * runs).ppf(0.025) / (4 * runs), rtol=1e-10)
    np.testing.assert_allclose(high, stats.chi2(4 * runs).ppf(0.975) / (4 * runs), rtol=1e-10)
    low, high = chi_square_band(np.array([2.0, np.nan, 0.0]), 20, 0.9)
    np.testing.assert_allclose([low[0], high[0]], stats.chi2(40).ppf([0.05, 0.95]) / 40, rtol=1e-10)
    assert np.isnan([low[1:], high[1:]]).all()


@pytest.mark.parametrize(("name", "dimension"), [("nees", 3), ("nis", 2)])
def test_the_exact_filter_is_in_its_band_at_the_stated_rate_and_a_wrong_one_is_not(name, dimension):
    # 1000 groups of 20 runs at one step: the share inside is binomial, 0.95 with a standard deviation of 0.0069 for the right
    # one. Bands of 5 of them: a false alarm has probability below 1e-5, also where the share is small.
    truth, estimate = exact(4, 20_000)
    averages = found(name, truth, estimate)[-1].reshape(1000, 20).mean(1)
    low, high = chi_square_band(dimension, 20)
    for factor in (0.5, 1.0, 2.0):  # NEES and NIS of a filter that says so much of the covariance
        inside = np.mean((low < averages / factor) & (averages / factor < high))
        law = stats.chi2(20 * dimension, scale=1 / (20 * dimension * factor))
        expected = law.cdf(high) - law.cdf(low)
        assert abs(inside - expected) < 5 * np.sqrt(expected * (1 - expected) / 1000)
        assert factor == 1 or expected < 0.5


def at_step(distance, error):
    """10 log10 of rho of each run, as it is written: the runs that are known, their mean square error matrix, its inverse."""
    known = np.flatnonzero(~np.isnan(distance))
    if len(known) <= len(error):
        return np.array([])
    actual = sum(np.outer(error[:, r], error[:, r]) for r in known) / len(known)
    return np.array([10 * np.log10(distance[r] / (error[:, r] @ np.linalg.solve(actual, error[:, r]))) for r in known])


def by_definition(name, truth, estimate, runs):
    """The metric over some runs; components of known truth or none."""
    error, over_time = estimate.mean - truth.x, []
    for k, at in enumerate(error):
        distance = np.array([at[:, r] @ np.linalg.solve(estimate.cov[k, :, :, r], at[:, r]) for r in range(at.shape[1])])
        logs = at_step(distance[runs], at[:, runs])
        if len(logs):
            over_time.append(np.mean(np.abs(logs) if name == "nci" else logs))
    return np.mean(over_time)


def drawn(runs, steps=3, seed=0):
    """Errors of mixed size and correlation, with a covariance of its own for every run and step."""
    rng = np.random.default_rng(seed)
    scale = np.array([1e4, 1.0, 1e-5])
    root = rng.standard_normal((steps, runs, 3, 3)) + 2 * np.eye(3)
    cov = np.moveaxis(root @ np.swapaxes(root, 2, 3) * scale[:, None] * scale, 1, -1)
    error = np.moveaxis(np.einsum("trij,trj->tri", root, rng.standard_normal((steps, runs, 3))) * scale, 1, -1)
    return Truth(np.zeros_like(error), np.zeros((steps, 1, runs))), Estimate(error, cov)


@pytest.mark.parametrize("name", CREDIBILITY)
@pytest.mark.parametrize("gaps", [False, True])
def test_credibility_is_as_defined_and_so_it_is_without_each_run_in_turn(name, gaps):
    truth, estimate = drawn(9)
    if gaps:
        truth.x[1, :, [2, 5]] = truth.x[0, 1, 7] = np.nan
        truth.x[2, :, :6] = np.nan  # three runs of three dimensions are too few at this step
    sample = METRICS[name].resampled(found(name, truth, estimate))
    everyone = np.arange(9)
    assert sample.value == pytest.approx([by_definition(name, truth, estimate, everyone)], rel=1e-9)
    expected = [by_definition(name, truth, estimate, np.delete(everyone, r)) for r in everyone]
    np.testing.assert_allclose(sample.left_out, [expected], rtol=1e-7)


@pytest.mark.parametrize("name", CREDIBILITY)
@pytest.mark.parametrize("factor", [1e3, 1e5, 1e9])
def test_a_run_that_is_far_off_takes_no_digits_from_the_others(name, factor):
    truth, estimate = drawn(12)
    estimate.mean[:, :, 4] *= factor
    sample = METRICS[name].resampled(found(name, truth, estimate))
    assert sample.left_out[0, 4] == pytest.approx(by_definition(name, truth, estimate, np.delete(np.arange(12), 4)), rel=1e-7)


@pytest.mark.parametrize("name", CREDIBILITY)
def test_components_that_are_certain_do_not_count_and_a_run_without_error_is_left_out(name):
    truth, estimate = drawn(9)
    plain = {n: np.delete(getattr(estimate, n), 1, axis=1) for n in ("mean", "cov")}
    plain["cov"] = np.delete(plain["cov"], 1, axis=2)
    expected = METRICS[name](CARD, Truth(truth.x[:, :2], truth.y), Estimate(**plain))["state"]
    truth.x[:, 1], estimate.cov[:, 1], estimate.cov[:, :, 1] = 1, 0, 0
    estimate.mean[:, 1] = 1 + 1e-15 * estimate.mean[:, 0]  # rounding
    score = METRICS[name](CARD, truth, estimate)["state"]
    assert [score.value, score.low, score.high] == pytest.approx(
        [expected.value, expected.low, expected.high], rel=1e-9, nan_ok=name == "nci"
    )
    estimate.mean[1, :, 3] = truth.x[1, :, 3]
    assert METRICS[name](CARD, truth, estimate)["state"].value == pytest.approx(
        by_definition(name, *without_component(truth, estimate, nobody=(1, 3)), np.arange(9)), rel=1e-9
    )


def without_component(truth, estimate, nobody):
    """The same without the second component of the state; of one run at one step nothing is known."""
    x = np.delete(truth.x, 1, axis=1)
    x[nobody[0], :, nobody[1]] = np.nan
    return Truth(x, truth.y), Estimate(np.delete(estimate.mean, 1, axis=1), np.delete(np.delete(estimate.cov, 1, 1), 1, 2))


@pytest.mark.parametrize("name", CREDIBILITY)
def test_there_must_be_more_runs_than_dimensions(name):
    scores = {runs: METRICS[name](CARD, *drawn(runs))["state"] for runs in (1, 3, 4, 5)}
    assert [np.isfinite(s.value) for s in scores.values()] == [False, False, True, True]
    bounded = [np.isfinite(s.low) and np.isfinite(s.high) for s in scores.values()]
    assert bounded == [False, False, False, name == "inclination"]


@pytest.mark.parametrize("name", CREDIBILITY)
def test_singular_covariances_are_infinitely_incredible(name):
    truth, estimate = drawn(9)
    estimate.cov[1, :, :, 2] = 0
    assert METRICS[name](CARD, truth, estimate)["state"].value == np.inf


def test_errors_in_one_direction_are_held_against_the_covariance_along_it():
    rng = np.random.default_rng(0)
    error = np.array([1.0, -2.0, 3.0])[None, :, None] * rng.standard_normal((3, 1, 9))
    cov = np.tile(2.0 * np.eye(3)[None, :, :, None], (3, 1, 1, 9))
    score = METRICS["inclination"](CARD, Truth(np.zeros_like(error), np.zeros((3, 1, 9))), Estimate(error, cov))["state"]
    assert score.value == pytest.approx(np.mean(10 * np.log10((error**2).sum(1).mean(1) / 2)), rel=1e-9)


def test_a_covariance_half_or_twice_as_large_is_inclined_by_three_decibels():
    truth, estimate = exact(4, 400)
    right = METRICS["inclination"](CARD, truth, estimate)["state"]
    for factor in (0.5, 2.0):
        wrong = METRICS["inclination"](CARD, truth, scaled(estimate, factor))["state"]
        assert wrong.value - right.value == pytest.approx(-10 * np.log10(factor), abs=1e-9)
        assert METRICS["nci"](CARD, truth, scaled(estimate, factor))["state"].value == pytest.approx(10 * np.log10(2), abs=0.3)
        assert (wrong.low > 2) if factor < 1 else (wrong.high < -2)


def test_what_a_right_filter_has_by_chance_is_as_stated():
    # 400 groups of 12 runs. For Gaussian errors e' (R Sigma)^-1 e is a Beta variable, of which the mean logarithm is known.
    # 5 standard errors: a false alarm has probability 6e-7.
    truth, estimate = exact(1, 4800)
    groups = np.split(np.arange(4800), 400)
    for name, mean, slack in (
        ("inclination", -DECIBEL * (np.log(6) - special.digamma(6)), 0.0),
        ("nci", 5 / np.sqrt(12), 0.15),  # "about 5 / sqrt(R)" is meant to a tenth
    ):
        values = found(name, truth, estimate)
        got = np.array([METRICS[name].resampled(values[..., g]).value[0] for g in groups])
        assert abs(got.mean() - mean) < 5 * got.std() / 20 + slack


def test_the_interval_of_the_inclination_holds_zero_for_a_right_filter_at_its_rate():
    # 400 groups of 15 runs: a coverage of 0.95 has a standard deviation of 0.011; band of 5 of them, and 0.015 for what
    # 15 runs are too few.
    truth, estimate = exact(2, 6000, seed=1)
    values = found("inclination", truth, estimate)
    scores = [METRICS["inclination"].score(values[..., i : i + 15], "dB", 15) for i in range(0, 6000, 15)]
    assert abs(np.mean([s.low < 0 < s.high for s in scores]) - 0.95) < 0.055 + 0.015
    assert all(s.low <= s.value <= s.high for s in scores)


@pytest.mark.parametrize(("factor", "kinds"), [(0.5, ["optimistic"]), (1.0, []), (2.0, ["pessimistic"])])
def test_wrong_covariances_are_named(factor, kinds):
    cell = Cell(CaseResults(dataclasses.replace(CARD, steps=20), 0, []), "made", {})
    cell.runs = list(range(40))
    cell.truth, right = exact(20, 40)
    cell.estimate = scaled(right, factor)
    assert [remark.kind for remark in remarks(cell)] == kinds


@pytest.mark.parametrize("gaps", [False, True])
def test_whiteness_of_many_runs_at_once_is_that_of_each(gaps):
    series = np.random.default_rng(0).standard_normal((40, 2, 7))
    if gaps:
        series[np.random.default_rng(1).random(series.shape) < 0.4] = np.nan
        series[4:, :, 3] = series[:, 1, 5] = np.nan
    expected = [portmanteau(series[:, :, r]) for r in range(7)]
    np.testing.assert_allclose(portmanteau(series), expected, rtol=1e-12)
    assert np.isnan(expected[3]) == gaps
