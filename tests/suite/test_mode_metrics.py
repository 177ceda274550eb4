"""Modes told right, how surely and how soon: by hand, by loops over steps, and on the exact posterior of the modes."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cases import CASES
from estimators import ESTIMATORS
from suite.case import Card, Divergence, StateBlock, Truth
from suite.estimator import FAILED, LOST, Estimate
from suite.metrics import METRICS, Evidence
from suite.metrics.metric import share
from suite.metrics.modes import FLOOR
from tests.jump_oracles import THREE, TWO, enumeration

CARD = Card(
    name="toy", title="", summary="", steps=6, interval=0.5, state=("x",), blocks=(StateBlock("position", (0,), "m"),),
    divergence=Divergence("position", 5.0, 2), reference="", modes=("a", "b", "c"),
)  # fmt: skip
OF_MODES = ("brier", "mode-log-score", "mode-accuracy", "recognition-time", "missed-switches")


def evidence(mode, given, times=(), **rest):
    """Runs whose mode in force is mode[T, R] and whose modes were given probabilities [T, M, R]."""
    mode, given = np.asarray(mode), np.asarray(given, float)
    steps, count, runs = given.shape
    card = dataclasses.replace(CARD, steps=steps, modes=tuple("abcdef"[:count]), times=times)
    zero = np.zeros((steps, 1, runs))
    return Evidence(card, Truth(zero, zero, mode), Estimate(zero, zero[:, None] + 1, mode=given, **rest))


def score(name, *args, **rest):
    """The one score of such runs."""
    e = evidence(*args, **rest)
    (found,) = METRICS[name](e.case, e.truth, e.estimate).values()
    return found


def contributions(name, *args, **rest):
    """What each of such runs contributes."""
    (found,) = METRICS[name].contributions(evidence(*args, **rest)).values()
    return found


def sure(mode, count=3):
    """Probabilities [T, M, R] of a filter that is sure of mode[T, R]."""
    return np.moveaxis(np.eye(count)[np.asarray(mode)], -1, 1)


# Three modes, one run: the mode in force, and the probabilities of each step.
MODE = [0, 1, 1, 1, 2, 0]
GIVEN = [[0.6, 0.4, 0.0], [0.5, 0.3, 0.2], [0.4, 0.4, 0.2], [0.1, 0.8, 0.1], [0.0, 1.0, 0.0], [0.9, 0.05, 0.05]]


def by_hand(*runs):
    """The run above beside others."""
    modes, given = zip((MODE, GIVEN), *runs, strict=True)
    return np.stack(modes, axis=-1), np.stack(given, axis=-1)


def test_accuracy_by_hand():
    """Right, wrong, one of two that tie, right, wrong, right."""
    np.testing.assert_array_equal(contributions("mode-accuracy", *by_hand())[:, 0], [1, 0, 0.5, 1, 0, 1])
    found = score("mode-accuracy", *by_hand((MODE, sure(MODE))))
    assert (found.value, found.unit, found.runs) == (pytest.approx((3.5 / 6 + 1) / 2), "", 2)


def test_log_score_by_hand():
    """The mode that was held for impossible counts as if it had had a thousandth."""
    expected = -np.log([0.6, 0.3, 0.4, 0.8, 0.001, 0.9])
    np.testing.assert_allclose(contributions("mode-log-score", *by_hand())[:, 0], expected)
    found = score("mode-log-score", *by_hand((MODE, sure(MODE))))
    assert (found.value, found.unit) == (pytest.approx(expected.mean() / 2), "nat")


@pytest.mark.parametrize("times", [(), (1.0, 1.5, 4.0, 4.5, 7.0, 9.0)])
def test_recognition_by_hand(times):
    """Of three switches the first is recognised two steps late, the second never before the next, the third at once."""
    at = times or np.arange(1, 7) / 2
    expected = [at[3] - at[1], at[5] - at[4], 0]
    np.testing.assert_allclose(contributions("recognition-time", *by_hand(), times)[:, 0], [sum(expected), 3])
    np.testing.assert_array_equal(contributions("missed-switches", *by_hand(), times)[:, 0], [1, 3])


def test_a_switch_that_is_never_recognised_has_until_an_interval_after_the_end():
    mode = [[0], [1], [1], [1], [1], [2]]
    given = sure(np.zeros((6, 1), int))
    np.testing.assert_allclose(contributions("recognition-time", mode, given)[:, 0], [4 * 0.5 + 0.5, 2])
    np.testing.assert_array_equal(contributions("missed-switches", mode, given)[:, 0], [2, 2])


def test_all_switches_count_alike_however_they_are_spread_over_runs():
    """One run recognises its one switch at once, another misses both of its switches, a third has none."""
    mode = np.array([[0, 0, 0, 0, 1, 1], [0, 0, 1, 1, 2, 2], [1] * 6]).T
    given = np.stack([sure(mode)[..., 0], sure(np.zeros((6, 2), int))[..., 0], sure(mode)[..., 2]], axis=-1)
    time, missed = (score(name, mode, given) for name in ("recognition-time", "missed-switches"))
    assert (time.value, time.unit, time.runs, time.total) == (pytest.approx((0 + 1 + 1) / 3), "s", 2, 3)
    assert (missed.value, missed.unit, missed.runs, missed.total) == (pytest.approx(2 / 3), "", 2, 3)
    assert 0 <= missed.low < missed.value < missed.high <= 1


def test_equal_probabilities_are_no_recognition():
    mode = np.array([[0], [1], [1], [0], [0], [0]])
    np.testing.assert_array_equal(contributions("missed-switches", mode, np.full((6, 2, 1), 0.5))[:, 0], [2, 2])


def test_a_case_whose_mode_never_changes_has_no_time_of_recognition():
    mode = np.zeros((6, 3), int)
    for name in ("recognition-time", "missed-switches"):
        found = score(name, mode, sure(mode))
        assert (found.runs, found.total) == (0, 3)
        assert np.isnan(found.value)


@pytest.mark.parametrize("name", OF_MODES)
def test_without_modes_there_is_no_score(name):
    e = evidence(*by_hand())
    for truth, estimate in (
        (dataclasses.replace(e.truth, mode=None), e.estimate),
        (e.truth, dataclasses.replace(e.estimate, mode=None)),
    ):
        assert METRICS[name](e.case, truth, estimate) == {}


@pytest.mark.parametrize("name", OF_MODES)
def test_runs_that_did_not_come_through_or_say_nothing_are_left_out(name):
    other = (MODE[::-1], GIVEN)
    gone = np.array(GIVEN)
    gone[3:] = np.nan
    silent = np.full((6, 3), np.nan)
    mode, given = by_hand(other, (MODE, gone), (MODE, silent), (MODE, silent))
    found = score(name, mode, given, status=["ok", "ok", LOST, FAILED, "ok"])
    assert found == dataclasses.replace(score(name, *by_hand(other)), total=5)


@st.composite
def histories(draw):
    """Modes [T, R] that stay for a while, probabilities [T, M, R] with ties and zeros, and times that are not even."""
    steps, count, runs = draw(st.integers(1, 12)), draw(st.integers(1, 4)), draw(st.integers(1, 4))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    changes = rng.random((steps, runs)) < draw(st.sampled_from([0.1, 0.4, 1.0]))
    mode = (changes * rng.integers(1, 4, (steps, runs))).cumsum(0) % count
    weights = rng.integers(0, draw(st.sampled_from([2, 4, 1000])), (steps, count, runs)) + 0.0
    weights += weights.sum(1, keepdims=True) == 0
    times = tuple(np.cumsum(rng.exponential(size=steps) + 0.01).tolist()) if draw(st.booleans()) else ()
    return mode, weights / weights.sum(1, keepdims=True), times


def looked_up(mode, given, time, interval):
    """Accuracy and log score [T] of a run, its switches, and their times to recognition and how many were missed."""
    steps = range(len(mode))
    largest = [[j for j, p in enumerate(row) if p == max(row)] for row in given]
    accuracy = [(mode[k] in largest[k]) / len(largest[k]) for k in steps]
    surprise = [-np.log(max(given[k][mode[k]], FLOOR)) for k in steps]
    switches, waited, missed = [k for k in steps if k and mode[k] != mode[k - 1]], 0.0, 0
    for s, k in enumerate(switches):
        last = switches[s + 1] if s + 1 < len(switches) else len(mode)
        over = time[last] if last < len(mode) else time[-1] + interval
        recognised = [time[i] for i in range(k, last) if largest[i] == [mode[k]]]
        waited += (recognised[0] if recognised else over) - time[k]
        missed += not recognised
    return accuracy, surprise, len(switches), waited, missed


@given(histories())
@settings(max_examples=200, deadline=None)
def test_every_run_contributes_what_a_loop_over_its_steps_finds(drawn):
    mode, given, times = drawn
    found = {name: contributions(name, mode, given, times) for name in OF_MODES}
    assert ((found["brier"] >= 0) & (found["brier"] <= 2 + 1e-12)).all()
    time = evidence(mode, given, times).case.time
    for r in range(mode.shape[1]):
        accuracy, surprise, switches, waited, missed = looked_up(mode[:, r], given[:, :, r], time, CARD.interval)
        np.testing.assert_allclose(found["mode-accuracy"][:, r], accuracy, rtol=1e-14)
        np.testing.assert_allclose(found["mode-log-score"][:, r], surprise, rtol=1e-12, atol=1e-15)
        for name, total in (("recognition-time", waited), ("missed-switches", missed)):
            expected = [total, switches] if switches else [np.nan, np.nan]
            np.testing.assert_allclose(found[name][:, r], expected, rtol=1e-12, atol=1e-12)


@given(histories())
@settings(max_examples=50, deadline=None)
def test_a_filter_that_knows_the_modes_is_perfect(drawn):
    mode, given, times = drawn
    perfect = {name: contributions(name, mode, sure(mode, given.shape[1]), times) for name in OF_MODES}
    assert (perfect["mode-accuracy"] == 1).all()
    assert (perfect["mode-log-score"] == 0).all()
    assert (perfect["brier"] == 0).all()
    for name in ("recognition-time", "missed-switches"):
        assert (np.nan_to_num(perfect[name][0]) == 0).all()


@given(st.integers(0, 6), st.lists(st.integers(1, 8), min_size=1, max_size=5))
@settings(max_examples=100, deadline=None)
def test_a_filter_that_is_steps_late_takes_the_time_of_these_steps(late, lengths):
    """Every mode is in force once, the first for 8 steps: those that last no longer than the delay are missed."""
    count = len(lengths) + 1
    mode = np.repeat(np.arange(count), [8, *lengths])[:, None]
    given = sure(np.concat([np.repeat(mode[:1], late, axis=0), mode])[: len(mode)], count)
    waited = sum(min(late, length) for length in lengths) * CARD.interval
    missed = sum(length <= late for length in lengths)
    np.testing.assert_allclose(contributions("recognition-time", mode, given)[:, 0], [waited, len(lengths)])
    np.testing.assert_array_equal(contributions("missed-switches", mode, given)[:, 0], [missed, len(lengths)])


def test_the_interval_of_accuracy_is_that_of_a_share():
    rng = np.random.default_rng(0)
    mode = rng.integers(0, 3, (40, 10))
    given = rng.dirichlet(np.ones(3), (40, 10)).transpose(0, 2, 1)
    found = score("mode-accuracy", mode, given)
    assert (found.value, found.low, found.high) == share(contributions("mode-accuracy", mode, given))


def means(name, mode, given):
    """Mean over time of each run [R]."""
    return contributions(name, mode, given).mean(0)


def sigmas(values):
    """The mean of independent values in its standard errors."""
    return values.mean() / (values.std(ddof=1) / np.sqrt(len(values)))


@pytest.fixture(scope="module", params=[(TWO, 5, 120), (THREE, 4, 120)], ids=["two modes", "three modes"])
def posterior(request):
    """Modes [T, R] drawn from a model, and their exact probabilities [T, M, R]."""
    model, steps, runs = request.param
    _, y, mode = model.simulate(steps, runs, seed=7)
    return mode, enumeration(model, y).mode


# Under the exact posterior p a score at a step has the mean that p itself gives it. Bands of 5 standard errors over 120 runs:
# a false alarm has a probability of 6e-7 each.
def test_the_exact_posterior_scores_what_it_expects(posterior):
    mode, p = posterior
    expected = {
        "brier": 1 - (p**2).sum(1),
        "mode-log-score": -(p * np.log(np.maximum(p, FLOOR))).sum(1),
        "mode-accuracy": p.max(1),
    }
    for name, value in expected.items():
        assert abs(sigmas(means(name, mode, p) - value.mean(0))) < 5, name


def stale(p):
    return np.concat([p[:1] * 0 + 1 / p.shape[1], p[:-1]])


def blurred(p):
    return 0.7 * p + 0.3 / p.shape[1]


def exaggerated(p):
    return p**3 / (p**3).sum(1, keepdims=True)


@pytest.mark.parametrize("other", [stale, blurred, exaggerated])
def test_other_probabilities_score_worse_than_the_exact_ones_by_what_is_expected(posterior, other):
    """Both scores are proper: given the measurements the exact probabilities p are better on average than any others q."""
    mode, p = posterior
    q = other(p)
    expected = {
        "brier": ((p - q) ** 2).sum(1),
        "mode-log-score": (p * np.log(np.maximum(p, FLOOR) / np.maximum(q, FLOOR))).sum(1),
    }
    for name, lead in expected.items():
        assert lead.mean() > 0
        assert abs(sigmas(means(name, mode, q) - means(name, mode, p) - lead.mean(0))) < 5, name


def test_a_filter_of_several_modes_knows_more_than_how_common_they_are():
    # The lead over 800 runs was 7 to 10 standard errors on other seeds: below 3 a false alarm has probability below 1e-6.
    case = CASES["jump-linear"]
    truth = case.simulate(800, seed=4)
    estimate = ESTIMATORS["imm-ekf"].run(case.model, truth.y)
    law = np.broadcast_to(np.array([0.75, 0.25])[:, None], estimate.mode.shape)  # of the chain in the long run
    for name in ("brier", "mode-log-score"):
        lead = means(name, truth.mode, law) - means(name, truth.mode, estimate.mode)
        assert sigmas(lead) > 3
