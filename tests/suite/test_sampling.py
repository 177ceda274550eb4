"""Sampling until intervals are narrow."""

import math

import numpy as np
import pytest

from suite.errors import BadInput
from suite.metrics import METRICS, Score
from suite.sampling import LEAST, Goal, Reach, goal, needed
from suite.statistics import means, positive_jackknife

RMSE = METRICS["rmse"]


def standing(half, runs, relative=True, width=0.05, value=2.0):
    score = Score(value, value - half, value + half, "m", runs, runs)
    return Reach("case", "filter", Goal(RMSE, "*", width, relative), "position", score)


def test_words_become_a_goal():
    assert goal("rmse:position", "5%") == Goal(RMSE, "position", 0.05, True)
    assert goal("rmse", "0.25 %") == Goal(RMSE, "*", 0.0025, True)
    assert goal("divergence:runs", "2e-2") == Goal(METRICS["divergence"], "runs", 0.02, False)


@pytest.mark.parametrize("width", ["0", "0%", "-5%", "five", "%", "5%%", "inf", "nan", "", "1-2", "."])
def test_a_width_that_is_none_is_refused(width):
    with pytest.raises(BadInput, match="the width must be such as"):
        goal("rmse:position", width)


def test_scores_that_do_not_narrow_are_refused():
    with pytest.raises(BadInput, match="running times"):
        goal("latency:step", "5%")
    with pytest.raises(BadInput, match="unknown metric 'rsme'"):
        goal("rsme:position", "5%")


def test_half_the_interval_counts():
    assert standing(0.1, 100).excess == pytest.approx(1)
    assert standing(0.1, 100, relative=False, width=0.05).excess == pytest.approx(2)
    assert standing(0.0, 100, value=0.0).excess == 0
    assert standing(0.5, 100, value=0.0).excess == math.inf
    assert math.isnan(standing(math.nan, 1).excess)


def test_an_interval_twice_too_wide_needs_four_times_the_runs():
    assert needed([standing(0.2, 100), standing(0.1, 100)], 100, 10_000) == 400  # and a tenth more, but for the growth
    assert needed([standing(0.15, 100)], 100, 10_000) == math.ceil(1.1 * 100 * 1.5**2)
    assert needed([standing(0.2, 100)], 100, 300) == 300
    assert needed([standing(0.2, 100)], 100, 60) == 100  # what is there stays
    assert needed([standing(0.0999, 100)], 100, 10_000) == 100
    assert needed([], 12, 10_000) == 12


def test_few_runs_are_not_trusted_to_be_enough():
    assert needed([standing(0.01, 6)], 6, 10_000) == LEAST
    assert not standing(0.01, 6).reached
    assert standing(0.01, LEAST).reached


def test_a_score_without_an_interval_asks_for_nothing():
    assert needed([standing(math.nan, 100)], 100, 10_000) == 100
    assert needed([standing(math.nan, 100), standing(0.2, 100)], 100, 10_000) == 400
    assert needed([standing(math.inf, 100)], 100, 10_000) == 400


def test_an_interval_that_stopped_the_sampling_covers_nearly_as_often():
    # 600 samples of skew runs: 0.94 has a standard deviation of 0.0097, the band is 5 of them.
    rng, inside, truth = np.random.default_rng(0), 0, math.exp(0.5)
    for _ in range(600):
        pool, runs = rng.lognormal(0, 1, 4000), 12
        while True:
            sample = means(pool[None, :runs])
            low, high = (float(end[0]) for end in positive_jackknife(sample))
            found = Reach("", "", Goal(RMSE, "*", 0.1, True), "", Score(float(sample.value[0]), low, high, "", runs, runs))
            more = needed([found], runs, 4000)
            if more == runs:
                break
            runs = more
        assert found.reached
        inside += low < truth < high
    assert inside / 600 > 0.94 - 0.049


def test_runs_are_added_until_the_interval_is_narrow(tiny):
    said = tiny("-e", "last", "--until", "rmse:position", "20%")
    assert said.code == 0
    assert "narrow enough" in said.out
    assert "stopped" not in said.out


def test_the_limit_is_told(tiny):
    said = tiny("-e", "last", "--until", "rmse", "0.01%", "--most-runs", 24)
    assert said.code == 0
    assert "stopped at 24 runs" in said.out
    assert "24 of 24" in said.out


def test_a_block_that_is_not_there_is_named_and_nothing_is_lost(tiny, cli, tmp_path):
    said = tiny("-e", "last", "--until", "rmse:altitude", "5%")
    assert said.code == 2
    assert len(said.errors) == 1
    assert "--until rmse:altitude: tiny has no such score; it has position" in said.errors[0]
    assert cli("score", "--results", tmp_path / "results").code == 0
