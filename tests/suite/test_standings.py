"""How often the marks are wrong: estimators that are equal in truth, and others that are not, over many repetitions."""

from types import SimpleNamespace

import numpy as np
import pytest

import suite.score
from suite.case import Card, Divergence, StateBlock
from suite.metrics import METRICS, counted
from suite.score import BEST, TIED, standings

CARD = Card(
    name="toy", title="", summary="", steps=4, interval=1.0, state=("x",), blocks=(StateBlock("position", (0,), "m"),),
    divergence=Divergence("position", 100.0, 2), reference="",
)  # fmt: skip
BLOCKS = {"nees": "state", "loglik": "measurement", "divergence": "runs"}


class Given:
    """A cell whose contributions [..., R] are given."""

    def __init__(self, metric, block, values, runs=None):
        values = np.asarray(values, float)
        self.counts = {"lost": 0, "failed": 0}
        self.runs = list(range(values.shape[-1])) if runs is None else runs
        self.found = {block: values}, {block: metric.score(values, "", len(self.runs))}

    def contributions(self, metric):
        return self.found[0]

    def scores(self, metric):
        return self.found[1]


@pytest.fixture(autouse=True)
def _nothing_is_barred(monkeypatch):
    monkeypatch.setattr(suite.score, "remarks", lambda cell: [])


def marked(name, contributions, runs=None):
    """Marks by the number of the estimator."""
    metric, block = METRICS[name], BLOCKS.get(name, "position")
    cells = {i: Given(metric, block, values, runs and runs[i]) for i, values in enumerate(contributions)}
    return standings(SimpleNamespace(card=CARD, cells=cells, rounding={}), [metric]).get((name, block), {})


def correlated(rng, rivals, runs, steps=4):
    """Standard normal numbers [K, T, R], of which estimators on the same data share most."""
    return np.sqrt(0.7) * rng.standard_normal((1, steps, runs)) + np.sqrt(0.3) * rng.standard_normal((rivals, steps, runs))


def equals(name, rng, rivals, runs):
    """Contributions [K, ..., R] of estimators that are equal in truth: skew, or on target."""
    z = correlated(rng, rivals, runs)
    if name == "lag":  # error along the step, and the step squared
        return np.stack([z[:, 0], 1 + z[:, 1] ** 2], axis=1)
    return z if name == "loglik" else z**2


@pytest.mark.parametrize("name", ["rmse", "nees", "lag", "loglik"])
@pytest.mark.parametrize(("rivals", "runs", "repetitions"), [(2, 12, 300), (5, 30, 60), (20, 30, 6)])
def test_whoever_is_best_is_marked_19_times_of_20(name, rivals, runs, repetitions):
    # The share of marks that equals miss has at most the variance of a single one: above 0.05 by 5 standard deviations with
    # probability below 1e-5 (of few repetitions, by Chernoff's bound, too).
    rng = np.random.default_rng(rivals * runs)
    missing = [rivals - len(marked(name, equals(name, rng, rivals, runs))) for _ in range(repetitions)]
    assert np.mean(missing) / rivals < 0.05 + 5 * np.sqrt(0.05 * 0.95 / repetitions)


def test_equal_pairs_tie_19_times_of_20():
    # A standard deviation of 0.0063, the band is 4.5 of them: probability below 1e-5.
    rng = np.random.default_rng(0)
    alone = np.mean([len(marked("rmse", equals("rmse", rng, 2, 12))) == 1 for _ in range(1200)])
    assert abs(alone - 0.05) < 0.0285


def test_a_single_best_is_wrong_once_in_20_at_most():
    """An equal pair with three that are clearly worse: a single mark is an error."""
    rng = np.random.default_rng(1)
    worse = np.array([1, 1, 2, 3, 4])[:, None, None]
    alone, strangers = 0, 0
    for _ in range(200):
        marks = marked("rmse", worse**2 * correlated(rng, 5, 30) ** 2)
        alone += len(marks) == 1
        strangers += not {*marks} <= {0, 1}
    assert alone / 200 < 0.05 + 5 * np.sqrt(0.05 * 0.95 / 200)
    assert strangers / 200 < 0.05  # RMSE twice as large, over 30 runs


@pytest.mark.parametrize("name", ["rmse", "nees", "loglik"])
@pytest.mark.parametrize("rivals", [2, 5, 20])
def test_one_that_is_better_by_far_is_found_alone(name, rivals):
    values = equals(name, np.random.default_rng(2), rivals, 30)
    values[1:] = values[1:] - 3 if name == "loglik" else 4 * values[1:]
    assert marked(name, values) == {0: BEST}


def test_estimators_without_error_tie_and_beat_one_that_always_errs():
    none = np.zeros((4, 12))
    errors = np.random.default_rng(3).uniform(1, 2, (4, 12))
    assert marked("rmse", [none, none]) == {0: TIED, 1: TIED}
    assert marked("rmse", [none, errors, none]) == {0: TIED, 2: TIED}
    assert marked("rmse", [errors, none]) == {1: BEST}


def test_one_error_in_twelve_runs_is_not_worse_beyond_chance_than_none():
    once = np.zeros((4, 12))
    once[2, 5] = 1.0
    assert marked("rmse", [np.zeros((4, 12)), once]) == {0: TIED, 1: TIED}
    assert marked("rmse", [once, np.roll(once, 1)]) == {0: TIED, 1: TIED}


def test_no_success_at_all_loses_to_success_in_every_run():
    """Zero is worst where more is better."""
    squared = np.random.default_rng(4).uniform(1, 2, (4, 12))
    assert marked("efficiency", [np.full((4, 12), np.inf), squared]) == {1: BEST}


def test_only_runs_that_both_have_are_compared():
    """The better half of one's runs, which the other lacks, counts for nothing."""
    rng = np.random.default_rng(5)
    many = correlated(rng, 1, 24)[0] ** 2
    many[:, 12:] *= 1e-4
    few = 1.1 * many[:, :12]
    assert marked("rmse", [few, many], [list(range(12)), list(range(24))]) == {1: BEST}
    assert marked("rmse", [few / 1.21, many], [list(range(12)), list(range(24))]) == {0: BEST}
    assert marked("rmse", [few, many[:, 12:]], [list(range(12)), list(range(12, 24))]) == {0: TIED, 1: TIED}


def test_runs_that_say_nothing_are_not_compared():
    values = correlated(np.random.default_rng(6), 1, 24)[0] ** 2
    gaps = 1.1 * values
    gaps[:, :12] = np.nan
    assert counted(gaps).sum() == 12
    assert marked("rmse", [gaps, values]) == {1: BEST}


def along_step(lag, rng, runs=30):
    """Error along the step, and the step squared [2, R], of an estimator that lags by so many steps."""
    step = rng.uniform(1, 2, runs)
    return np.stack([lag * step + 0.05 * rng.standard_normal(runs), step])


@pytest.mark.parametrize(("near", "far"), [(0.1, 0.5), (-0.1, 0.5), (0.1, -0.5), (-0.1, -0.5), (0.0, 1.0)])
def test_a_signed_target_is_missed_by_its_distance_on_either_side(near, far):
    rng = np.random.default_rng(7)
    assert marked("lag", [along_step(far, rng), along_step(near, rng)]) == {1: BEST}


def test_the_same_distance_on_either_side_ties():
    rng = np.random.default_rng(8)
    assert marked("lag", [along_step(0.3, rng), along_step(-0.3, rng)]) == {0: TIED, 1: TIED}


def test_higher_log_likelihoods_are_better_whatever_their_sign():
    z = correlated(np.random.default_rng(9), 3, 30)[:, :1]
    assert marked("loglik", z + np.array([-3, 0, 3])[:, None, None]) == {2: BEST}
    skill = [np.stack([np.full(30, part), np.ones(30)]) for part in (0.2, 1.5, 3.0)]  # 0.8, -0.5, -2
    assert marked("skill", skill) == {0: BEST}


def test_rates_are_compared_as_they_are():
    never, often, twice = np.zeros((1, 100)), np.zeros((1, 100)), np.zeros((1, 100))
    often[:, :30], twice[:, :2] = 1, 1
    assert marked("divergence", [never, often]) == {0: BEST}
    assert marked("divergence", [never, twice]) == {0: TIED, 1: TIED}
