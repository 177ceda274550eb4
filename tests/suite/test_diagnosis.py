"""What is said to be wrong with an estimator: each remark where it must be, and hardly ever elsewhere."""

import dataclasses
import re

import numpy as np
import pytest

from cases import CASES
from estimators.kalman import Kalman
from suite.bounds import CONDITIONAL, KNOWN_MODES, NONE, POSTERIOR
from suite.case import FROM_ANOTHER, FROM_MODEL, GIVEN_TRACK, RECORDED, Truth
from suite.case_bounds import bounds_of
from suite.diagnosis import SURE, gap, remarks
from suite.estimator import FAILED, LOST, OK, Estimate
from suite.metrics import METRICS
from suite.results import CaseResults, Cell
from suite.statistics import below_zero, means

CASE = CASES["linear-gaussian"]
BOUND = bounds_of(CASE, seed=1)[0]
TRUTH = CASE.simulate(12, seed=1)
EXACT = Kalman().run(CASE.model, TRUTH.y)


def cell(mean=EXACT.mean, cov=EXACT.cov, truth=TRUTH, bound=BOUND, status=None, **card):
    """A cell of these estimates, on the case with what differs from it."""
    case = CaseResults(dataclasses.replace(CASE, **card), 0, [])
    case.bounds = [bound] if bound else []
    made, runs = Cell(case, "a", {}), mean.shape[2]
    made.runs, made.truth = list(range(runs)), Truth(truth.x[..., :runs], truth.y[..., :runs])
    made.estimate = Estimate(mean, cov[..., :runs], status=status or [OK] * runs)
    return made


def kinds(*given, **more):
    return [remark.kind for remark in remarks(cell(*given, **more))]


def nearer(share):
    """Estimates whose errors are a share of those of the exact filter."""
    return TRUTH.x + share * (EXACT.mean - TRUTH.x)


def late(steps):
    return np.concat([EXACT.mean[:1]] * steps + [EXACT.mean[:-steps]])


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, []),
        ({"mean": nearer(0.7), "cov": 0.49 * EXACT.cov}, ["too good"]),
        ({"mean": nearer(0.5)}, ["too good", "pessimistic"]),
        ({"mean": TRUTH.x}, ["too good", "pessimistic"]),
        ({"mean": nearer(1.1)}, []),
        ({"mean": nearer(1.4)}, ["optimistic"]),
        ({"mean": -EXACT.mean}, ["diverges", "misled", "optimistic"]),
        ({"cov": EXACT.cov / 1.3}, []),
        ({"cov": EXACT.cov / 2}, ["optimistic"]),
        ({"cov": EXACT.cov * 1.3}, []),
        ({"cov": EXACT.cov * 2}, ["pessimistic"]),
        ({"cov": 0 * EXACT.cov}, ["optimistic"]),
        ({"mean": late(2), "cov": 9 * EXACT.cov}, ["late"]),
    ],
)
def test_each_fault_is_named_and_nothing_else(given, expected):
    assert kinds(**given) == expected


@pytest.mark.parametrize("runs", [6, 12])
def test_plain_faults_are_named_from_six_runs(runs):
    assert kinds(EXACT.mean[..., :runs]) == []
    assert kinds(EXACT.mean[..., :runs], EXACT.cov / 4) == ["optimistic"]
    assert kinds(EXACT.mean[..., :runs], EXACT.cov * 4) == ["pessimistic"]
    assert kinds(nearer(0.5)[..., :runs], EXACT.cov / 4) == ["too good"]


@pytest.mark.parametrize("given", [{"cov": EXACT.cov / 4}, {"mean": nearer(0.5)}, {"mean": late(2)}, {"mean": TRUTH.x}])
def test_a_single_run_and_a_recording_prove_nothing(given):
    mean = given.get("mean", EXACT.mean)
    assert kinds(mean[..., :1], given.get("cov", EXACT.cov)) == []
    assert kinds(**given, origin=RECORDED) == []


def test_without_runs_there_is_nothing_to_say():
    empty = Cell(CaseResults(CASE, 0, []), "a", {})
    empty.runs = []
    assert remarks(empty) == []


def test_runs_that_did_not_come_through_are_counted_and_the_others_judged():
    status = [FAILED, *[OK] * 9, LOST, LOST]
    found = remarks(cell(status=status, cov=EXACT.cov / 4))
    assert [(r.kind, r.bars) for r in found] == [("failed", True), ("lost", True), ("optimistic", True)]
    assert [r.words for r in found[:2]] == ["failed in 1 of 12 runs", "lost in 2 of 12 runs"]
    assert kinds(status=[FAILED] * 12) == ["failed"]


@pytest.mark.parametrize(
    ("kind", "reason", "expected"),
    [
        (POSTERIOR, "", ["too good"]),
        (KNOWN_MODES, "", ["too good"]),
        (POSTERIOR, "the truth is given", []),
        (CONDITIONAL, "", []),
        (NONE, "", []),
    ],
)
def test_only_bounds_that_hold_for_all_show_who_is_too_good(kind, reason, expected):
    assert kinds(nearer(0.5), EXACT.cov / 4, bound=dataclasses.replace(BOUND, kind=kind, reason=reason)) == expected


def test_without_a_bound_nobody_is_too_good():
    assert kinds(nearer(0.5), EXACT.cov / 4, bound=None) == []


def test_the_error_of_a_bound_is_allowed_for():
    """Four standard errors: a bound that may be half of what it says shows nothing of an estimator at 0.6 of it."""
    given = {"mean": nearer(0.6), "cov": 0.36 * EXACT.cov}
    assert kinds(**given) == ["too good"]
    assert kinds(**given, bound=dataclasses.replace(BOUND, error=0.15 * BOUND.value)) == []


@pytest.mark.parametrize(("origin", "bars"), [(FROM_MODEL, True), (FROM_ANOTHER, False), (GIVEN_TRACK, False)])
def test_where_the_model_is_not_the_truth_it_is_not_the_estimators_fault(origin, bars):
    for given in ({"cov": EXACT.cov / 4}, {"cov": 4 * EXACT.cov}, {"mean": late(2), "cov": 9 * EXACT.cov}):
        found = remarks(cell(**given, origin=origin))
        assert [remark.bars for remark in found] == [bars]


def test_words_say_by_how_much():
    words = {r.kind: r.words for r in remarks(cell(nearer(0.5), EXACT.cov))}
    score = METRICS["crlb-ratio"](CASE, TRUTH, Estimate(nearer(0.5), EXACT.cov), bounds=[BOUND])["position"]
    pattern = r"RMSE of position only (\S+) \((\S+) to (\S+)\) of a bound that no estimator can beat"
    said = re.fullmatch(pattern, words["too good"])
    np.testing.assert_allclose([float(x) for x in said.groups()], [score.value, score.low, score.high], rtol=0.05)
    assert remarks(cell(cov=0 * EXACT.cov))[0].words.startswith("squared errors endlessly larger")


def test_exact_filters_are_hardly_ever_accused():
    # 5 kinds with a probability of 1e-3 each at most, on 80 groups of runs: 0.4 are expected at most, 6 or more have
    # probability below 1e-5 even then.
    runs, groups = 12, 80
    truth = CASE.simulate(groups * runs, seed=2)
    estimate = Kalman().run(CASE.model, truth.y)
    accused = []
    for start in range(0, groups * runs, runs):
        part = slice(start, start + runs)
        drawn = Truth(truth.x[..., part], truth.y[..., part])
        accused += kinds(estimate.mean[..., part], estimate.cov[..., part], truth=drawn)
    assert len(accused) < 6, accused


@pytest.mark.parametrize("runs", [2, 3, 5, 12, 30])
@pytest.mark.parametrize("freedom", [1, 4, 20])
def test_skew_contributions_of_few_runs_are_not_taken_for_proof(runs, freedom):
    """Of estimators at the very limit one in a thousand may be named; of squared errors of one number, twice as many."""
    # 40000 groups: a rate of 0.001 has a standard deviation of 0.00016, twice that 0.00022: probability below 1e-5.
    drawn = means(np.random.default_rng(runs).chisquare(freedom, (40_000, runs)) / freedom)
    below = below_zero(gap(drawn.map(np.sqrt), 1.0, 1, np.log)) < SURE  # as the ratio to a bound
    above = below_zero(gap(drawn, 1.0, -1, np.log)) < SURE  # as NEES
    assert below.mean() < 0.002 + 5 * 0.00022
    assert above.mean() < 0.001 + 5 * 0.00016
    if freedom == 20:
        assert below.mean() < 0.001 + 5 * 0.00016
        assert below.mean() + above.mean() > 0.0002  # and it is a test at its level, not one that never speaks
