"""How well particles are used, by hand and on filters that say it."""

import dataclasses

import numpy as np
import pytest

from cases import CASES
from estimators import ESTIMATORS
from suite.case import Card, Divergence, StateBlock, Truth
from suite.estimator import LOST, Estimate
from suite.metrics import METRICS
from suite.metrics.metric import share

CARD = Card(
    name="toy", title="", summary="", steps=3, interval=1.0, state=("x",), blocks=(StateBlock("position", (0,), "m"),),
    divergence=Divergence("position", 5.0, 2), reference="",
)  # fmt: skip
HEALTH = ("ess", "ess-share", "least-ess", "ancestors", "acceptance")


def scores(name, particles=None, **parts):
    """Scores of an estimate that has these parts [T, R]."""
    parts = {part: np.array(value, float) if part != "status" else value for part, value in parts.items()}
    count = len(parts["status"]) if "status" in parts else next(iter(parts.values())).shape[1]
    zero = np.zeros((3, 1, count))
    return METRICS[name](CARD, Truth(zero, zero), Estimate(zero, zero[:, None] + 1, **parts), particles=particles)


def test_effective_sample_size_by_hand():
    ess = [[10, 30], [20, 40], [2, 60]]
    mean, least, part = (scores(name, 80, ess=ess)["particles"] for name in ("ess", "least-ess", "ess-share"))
    assert (mean.value, mean.unit, mean.runs) == (pytest.approx(162 / 6), "particles", 2)
    assert (least.value, least.unit) == (pytest.approx((2 + 30) / 2), "particles")
    assert (part.value, part.unit) == (pytest.approx(162 / 6 / 80), "")
    np.testing.assert_allclose((part.low, part.high), share(np.array(ess) / 80)[1:])


def test_steps_at_which_nothing_is_said_are_left_out():
    ess = [[10, 30], [np.nan, 40], [2, np.nan]]
    mean, least, part = (scores(name, 80, ess=ess)["particles"].value for name in ("ess", "least-ess", "ess-share"))
    assert mean == pytest.approx((20 + 40 + 2) / 3)
    assert least == pytest.approx((2 + 30) / 2)
    assert part == pytest.approx(mean / 80)


def test_ancestors_and_acceptance_by_hand():
    nan = np.nan
    ancestors = scores("ancestors", ancestors=[[10, 20], [30, 40], [50, 60]])["particles"]
    assert (ancestors.value, ancestors.unit) == (35, "particles")
    # The mean over runs of a step in which any moved, then over such steps: 0.4, then (0.2 + 0.6) / 2.
    acceptance = scores("acceptance", acceptance=[[0.4, nan], [nan, nan], [0.2, 0.6]])["particles"]
    assert (acceptance.value, acceptance.unit, acceptance.runs) == (pytest.approx(0.4), "", 2)
    never = scores("acceptance", acceptance=[[0.4, nan], [0.2, nan], [0.6, nan]])["particles"]
    assert (never.value, never.runs, never.total) == (pytest.approx(0.4), 1, 2)


def test_shares_stay_within_zero_and_one():
    for rows in ([[0.99, 0.97, 1.0]] * 3, [[0.01, 0.0, 0.03]] * 3):
        score = scores("acceptance", acceptance=rows)["particles"]
        assert 0 <= score.low < score.value < score.high <= 1


@pytest.mark.parametrize("name", HEALTH)
def test_lost_runs_do_not_count(name):
    part = "ess" if "ess" in name else name
    values = np.array([[0.2, 0.4, 0.9], [0.3, 0.5, 0.9], [0.1, 0.6, np.nan]])
    found = scores(name, 2, **{part: values}, status=["ok", "ok", LOST])["particles"]
    expected = scores(name, 2, **{part: values[:, :2]})["particles"]
    assert found == dataclasses.replace(expected, total=3)


@pytest.mark.parametrize("name", HEALTH)
def test_what_an_estimator_does_not_say_has_no_score(name):
    assert scores(name, 100, loglik=np.zeros((3, 2))) == {}


def test_without_a_number_of_particles_there_is_no_share_of_them():
    assert scores("ess-share", None, ess=np.ones((3, 2))) == {}
    assert scores("ess", None, ess=np.ones((3, 2))) != {}


def test_nobody_is_best_by_the_health_of_its_particles():
    assert {name for name in METRICS if METRICS[name].family == "particles" and not METRICS[name].ranked} >= set(HEALTH)


@pytest.mark.parametrize("label", ["bootstrap[particles=60]", "resample-move[particles=60]"])
def test_of_a_filter_they_are_numbers_of_its_particles(label):
    case = CASES["linear-gaussian"]
    truth = case.simulate(6, seed=1)
    estimate = ESTIMATORS[label].run(case.model, truth.y, seed=1)
    found = {name: METRICS[name](case, truth, estimate, particles=60) for name in HEALTH}
    ess, least, part, ancestors = (found[name]["particles"].value for name in ("ess", "least-ess", "ess-share", "ancestors"))
    assert 1 <= least < ess < 60
    assert part == pytest.approx(ess / 60, rel=1e-12)
    assert 1 < ancestors <= 60
    if label.startswith("resample-move"):
        assert 0 < found["acceptance"]["particles"].low < found["acceptance"]["particles"].high < 1
    else:
        assert not found["acceptance"] or found["acceptance"]["particles"].runs == 0
