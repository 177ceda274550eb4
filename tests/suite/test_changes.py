"""What changed between two result sets: against scipy and statsmodels, by hand, and by the rate of false alarms."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from statsmodels.stats import multitest

from suite.case import RECORDED, Card, Divergence, StateBlock, Truth
from suite.changes import ABSENT, IMPROVED, of_case, settled
from suite.compare import EQUAL, ONE_SAMPLE, UNDECIDED, WORSE
from suite.differences import Interval
from suite.estimator import FAILED, OK, Estimate
from suite.metrics import METRICS
from suite.results import CaseResults, Cell

STEPS, RUNS = 10, 20
CARD = Card(
    name="toy", title="", summary="", steps=STEPS, interval=1.0, state=("x",), blocks=(StateBlock("position", (0,), "m"),),
    divergence=Divergence("position", 100.0, 2), reference="",
)  # fmt: skip
RNG = np.random.default_rng(3)
TRUTH = RNG.standard_normal((STEPS, 1, 40))
ERRORS = RNG.standard_normal((STEPS, 1, RUNS))
LOGLIK = RNG.standard_normal((STEPS, RUNS))
HERE = {"system": "Linux", "processor": "abacus", "node": "here"}


def held(cells, truth=TRUTH, seed=1, card=CARD):
    """Results of a case whose stored parts are given: by label the parts of a cell."""
    case = CaseResults(card, seed, [])
    case.truth_of = {run: Truth(truth[..., run], truth[..., run]) for run in range(truth.shape[2])}
    for label, given in cells.items():
        fill(case, label, **given)
    return case


def fill(case, label, errors=ERRORS, loglik=None, status=None, first=0, seconds=None, host=HERE, refusal=""):
    cell = case.cells[label] = Cell(case, label, {}, refusal=refusal)
    count = 0 if refusal else errors.shape[2]
    cell.runs = list(range(first, first + count))
    cell.truth = Truth(*2 * [np.stack([case.truth_of[run].x for run in cell.runs], -1)]) if count else None
    if count:
        cell.estimate = Estimate(
            cell.truth.x + errors, np.ones((STEPS, 1, 1, count)), status=status or [OK] * count, loglik=loglik
        )
    if seconds is not None:
        cell.timings = [SimpleNamespace(meta={"host": host})]
        nothing = np.full((len(seconds), 1, seconds.shape[1]), np.nan)
        cell.timing = Estimate(nothing, nothing[:, None], seconds=seconds, batch=[1] * seconds.shape[1])


def changed(before, after, *metrics, **settings):
    """What changed of a cell 'a' by some metrics, settled, by block."""
    old, new = ({name: settings[f"{name}_{side}"] for name in ("truth", "seed", "card") if f"{name}_{side}" in settings}
                for side in ("before", "after"))  # fmt: skip
    found = of_case(held({"a": before}, **old), held({"a": after}, **new), [METRICS[name] for name in metrics])
    return found, settled(found.changes)


def only(before, after, *metrics, **settings):
    found, (change,) = changed(before, after, *metrics, **settings)
    return found, change


def test_runs_of_the_same_truth_are_paired():
    shift = 0.5 + 0.2 * RNG.standard_normal(RUNS)
    found, change = only({"loglik": LOGLIK}, {"loglik": LOGLIK + shift}, "loglik")
    expected = stats.ttest_rel((LOGLIK + shift).mean(0), LOGLIK.mean(0))
    assert (found.paired, found.common, change.paired) == (True, 40, True)
    assert (change.p, change.holm) == pytest.approx([expected.pvalue] * 2)
    assert (change.difference.low, change.difference.high) == pytest.approx(tuple(expected.confidence_interval(0.95)))
    assert (change.before, change.after) == pytest.approx((LOGLIK.mean(), (LOGLIK + shift).mean()))
    assert change.verdict == IMPROVED
    assert only({"loglik": LOGLIK + shift}, {"loglik": LOGLIK}, "loglik")[1].verdict == WORSE


@pytest.mark.parametrize("seed", [1, 2])
def test_runs_of_other_truths_are_no_pairs(seed):
    other = TRUTH.copy()
    other[3, 0, 11] = np.nextafter(other[3, 0, 11], 9)
    loglik = np.random.default_rng(8).standard_normal((STEPS, 14)) + 1
    after = {"loglik": loglik, "errors": ERRORS[..., :14]}
    found, change = only({"loglik": LOGLIK}, after, "loglik", truth_after=other, seed_after=seed)
    expected = stats.ttest_ind(loglik.mean(0), LOGLIK.mean(0), equal_var=False)
    assert (found.paired, change.paired, change.runs_before, change.runs) == (False, False, RUNS, 14)
    ranks = stats.mannwhitneyu(loglik.mean(0), LOGLIK.mean(0), method="exact")
    assert change.p == pytest.approx(max(expected.pvalue, ranks.pvalue))
    assert (change.difference.low, change.difference.high) == pytest.approx(tuple(expected.confidence_interval(0.95)))
    assert any("the truth is not" in note for note in found.notes) == (seed == 1)


def test_what_is_unknown_in_both_truths_is_the_same():
    holes = TRUTH.copy()
    holes[2] = np.nan
    found, _ = changed({}, {}, "rmse", truth_before=holes, truth_after=holes.copy())
    assert found.paired


def test_numbers_that_are_the_same_to_the_bit_are_unchanged():
    found, changes = changed({}, {}, "rmse", "energy-score", "divergence")
    assert (found.unchanged, changes) == ({"a": 3}, [])
    moved = ERRORS.copy()
    moved[0, 0, 0] *= 1 + 1e-6
    found, changes = changed({}, {"errors": moved}, "rmse", "divergence")
    assert (found.unchanged, [c.metric for c in changes]) == ({"a": 1}, ["rmse"])
    assert changes[0].verdict == EQUAL


def test_more_runs_of_the_same_are_unchanged_where_both_have_them():
    longer = np.concatenate([ERRORS, ERRORS[..., ::-1]], axis=2)
    found, changes = changed({}, {"errors": longer}, "rmse")
    assert (found.unchanged, changes) == ({"a": 1}, [])
    _, change = only({"errors": longer}, {"errors": 2 * longer[..., 5:35], "first": 5}, "rmse")
    assert (change.runs_before, change.runs, change.left_out, change.left_out_before) == (30, 30, 0, 0)
    assert change.ratio.value == pytest.approx(2)


def test_failed_runs_are_left_out_and_counted_on_their_side():
    status = [FAILED] * 3 + [OK] * (RUNS - 3)
    found, (rmse, failed) = changed({}, {"errors": 0.5 * ERRORS, "status": status}, "rmse", "failed")
    assert (rmse.runs, rmse.left_out_before, rmse.left_out) == (RUNS - 3, 0, 3)
    assert (failed.before, failed.after, failed.p) == (0, 3 / RUNS, 0.25)
    assert (found.states["a"][0].status, found.states["a"][1].failed) == ("done", 3)
    other = {"truth_after": 2 * TRUTH, "seed_after": 2}
    _, (rmse, failed) = changed({}, {"errors": 0.5 * ERRORS, "status": status}, "rmse", "failed", **other)
    assert (rmse.runs_before, rmse.runs, rmse.left_out_before, rmse.left_out) == (RUNS, RUNS - 3, 0, 3)
    assert failed.p == pytest.approx(stats.fisher_exact([[3, 17], [0, 20]]).pvalue)


def test_surviving_runs_are_compared_only_as_pairs():
    wild = ERRORS.copy()
    wild[:, :, 0] = 1000.0
    verdicts = {c.block: c.verdict for c in changed({}, {"errors": wild}, "rmse")[1]}
    assert verdicts == {"position": UNDECIDED, "position, surviving runs": EQUAL}
    wild[:, :, 1:] *= 1.3
    assert {c.block for c in changed({}, {"errors": wild}, "rmse")[1]} == {"position", "position, surviving runs"}
    assert {c.block for c in changed({}, {"errors": wild}, "rmse", truth_after=2 * TRUTH)[1]} == {"position"}


def test_holm_is_over_all_that_is_told_together():
    shifts = {"a": 0.9, "b": 0.5, "c": 0.3, "d": 0.0}
    noise = np.random.default_rng(6).standard_normal((4, RUNS)) * 0.7
    before = held({label: {"loglik": LOGLIK} for label in shifts})
    after = held({label: {"loglik": LOGLIK + shift + noise[i]} for i, (label, shift) in enumerate(shifts.items())})
    changes = of_case(before, after, [METRICS["loglik"]]).changes
    together = settled(changes)
    expected = multitest.multipletests([c.p for c in changes], method="holm")[1]
    assert [c.holm for c in together] == pytest.approx(expected)
    assert [c.verdict for c in together] == [IMPROVED if p < 0.05 else UNDECIDED for p in expected]
    taken_back = [c.estimator for c in changes if c.p < 0.05 and c.verdict == "better"][-1]
    assert settled([c for c in changes if c.estimator == taken_back])[0].verdict == IMPROVED
    assert {c.estimator: c.verdict for c in settled(changes * 10)}[taken_back] == UNDECIDED


@pytest.mark.parametrize("runs", [2, 3, 4])
def test_a_few_runs_that_all_move_alike_prove_nothing(runs):
    """Shares of steps are alike in a few runs by chance: without scatter p is that of a permutation test."""
    before, after = ({"loglik": np.full((STEPS, runs), value), "errors": ERRORS[..., :runs]} for value in (-1.0, -0.9))
    _, change = only(before, after, "loglik")
    assert change.p == 0.5 ** (runs - 1)
    assert change.verdict == UNDECIDED


def test_a_mean_that_hangs_on_wild_runs_is_not_sure():
    """Two of twelve runs lose the target by far: the jackknife of the logarithm finds that sure, the single runs do not."""
    errors = ERRORS[..., :12].copy()
    errors[..., :2] *= 1e4
    for other in ({}, {"truth_after": 2 * TRUTH}):
        found, (change,) = changed({"errors": ERRORS[..., 8:]}, {"errors": errors}, "nees", **other)
        assert change.after > 1e5
        assert change.p > 0.01
        assert change.verdict == UNDECIDED
        assert found.changes[0].p == change.p


def calls(factor, noise):
    return {"seconds": 1e-3 * factor * np.exp(noise * np.random.default_rng(5).standard_normal((STEPS, 6)))}


def timed(factors, **after):
    """Latencies of cells that were a given factor slower afterwards."""
    labels = [f"e{i}" for i in range(len(factors))]
    before = held({label: calls(1.0, 0.01) for label in labels})
    after = held({label: calls(factor, 0.02) | after for label, factor in zip(labels, factors, strict=True)})
    found = of_case(before, after, [METRICS["latency"]])
    return found, settled(found.changes)


def test_running_times_are_held_against_the_spread_of_their_ratios():
    machine = np.exp(0.3 * np.random.default_rng(1).standard_normal(30))
    _, noisy = timed(machine)
    assert {c.verdict for c in noisy} == {UNDECIDED}
    assert min(c.p for c in of_case_latencies(machine)) < 1e-6, "by the calls alone they differ"
    _, quiet = timed([*machine, 1e-4])
    assert [c.verdict for c in quiet] == [UNDECIDED] * 30 + [IMPROVED]
    logs = np.abs(np.log([c.ratio.value for c in quiet]))
    size = np.median(logs) / stats.norm.ppf(0.75)
    reach = stats.t.ppf(0.975, 4) * size
    assert np.log(quiet[-1].ratio.high / quiet[-1].ratio.value) == pytest.approx(reach, rel=0.01)
    assert quiet[-1].p == pytest.approx(2 * stats.t.sf(logs[-1] / size, 4), rel=1e-3)


@pytest.mark.parametrize("cells", [2, 5, 30])
def test_the_hiccups_of_a_machine_are_rarely_called_changes(cells):
    """Of 100 pages whose log ratios have heavy tails 5 % are wrong at most, and 5 deviations of 0.022 above."""
    rng, wrong = np.random.default_rng(cells), 0
    changes = timed([1.1] * cells)[0].changes
    for _ in range(100):
        ratios = np.exp(0.2 * rng.standard_t(4, cells))
        noisy = [
            dataclasses.replace(c, ratio=Interval(r, 0.98 * r, 1.02 * r), p=0.0) for c, r in zip(changes, ratios, strict=True)
        ]
        wrong += any(c.verdict in (IMPROVED, WORSE) for c in settled(noisy))
    assert wrong / 100 <= 0.05 + 5 * 0.022


def of_case_latencies(factors):
    return timed(factors)[0].changes


def test_one_timing_alone_has_no_verdict():
    _, (change,) = timed([5.0])
    assert (change.verdict, change.ratio.value) == (UNDECIDED, pytest.approx(5, rel=0.05))
    assert np.isnan(change.p)


def test_times_that_hardly_vary_are_equal():
    assert {c.verdict for c in timed([1.001, 0.999, 1.002, 0.998, 1.0005, 1.0])[1]} == {EQUAL}


def test_running_times_of_different_machines_are_not_compared():
    found, changes = timed([5.0, 5.0], host=HERE | {"node": "there"})
    assert (changes, found.unchanged) == ([], {})
    assert found.notes == ("Running times are not compared: they were measured on different machines.",)


@pytest.mark.parametrize(
    ("part", "value"), [("steps", 11), ("blocks", (StateBlock("position", (0,), "km"),)), ("interval", 2.0), ("state", ("z",))]
)
def test_another_problem_under_the_same_name_is_not_compared(part, value):
    card = dataclasses.replace(CARD, **{part: value})
    found, changes = changed({}, {"errors": 2 * ERRORS}, "rmse", card_before=card)
    assert changes == []
    assert found.reason == f"before and after are not the same problem: they differ in {part}"


def test_other_words_about_the_same_problem_are_told():
    found, changes = changed({}, {"errors": 2 * ERRORS}, "rmse", card_after=dataclasses.replace(CARD, assumptions=("new",)))
    assert len(changes) == 1
    assert found.notes == ("The case is described in other words or figures than before: see its assumptions.",)


def test_a_recording_is_one_sample():
    card = dataclasses.replace(CARD, origin=RECORDED)
    for truth in (TRUTH, 2 * TRUTH):
        _, change = only({}, {"errors": 3 * ERRORS}, "rmse", card_before=card, card_after=card, truth_after=truth)
        assert (change.verdict, change.ratio.value) == (ONE_SAMPLE, pytest.approx(3))
        assert np.isnan([change.p, change.holm, change.ratio.low, change.difference.high]).all()


def test_what_became_of_cells_is_told_of_both_sides():
    before = held({"kept": {}, "gone": {}, "shy": {"refusal": "too hard"}})
    after = held({"kept": {}, "new": {}, "shy": {}})
    found = of_case(before, after, [METRICS["rmse"]])
    states = {label: (was.status, now.status) for label, (was, now) in found.states.items()}
    gone, none = ("done", ABSENT.status), (ABSENT.status, "done")
    assert states == {"kept": ("done", "done"), "gone": gone, "shy": ("refused", "done"), "new": none}
    assert found.states["shy"][0].reason == "too hard"
    assert (found.unchanged, found.changes) == ({"kept": 1}, ())


def test_equal_result_sets_rarely_name_a_change():
    """30 pages of 9 tests each, half of them of other truths: at most 5 % are wrong, and 5 deviations of 0.04 above."""
    rng = np.random.default_rng(12)
    metrics = [METRICS[name] for name in ("rmse", "nees", "loglik")]
    wrong = tests = 0
    for page in range(30):
        truth = rng.standard_normal((STEPS, 1, 12))
        other = truth if page % 2 else rng.standard_normal(truth.shape)
        sides = []
        for each in (truth, other):
            hard = rng.lognormal(0, 0.5, 12)
            errors, loglik = rng.standard_normal((2, 3, STEPS, 12)) * hard
            cells = {f"e{i}": {"errors": errors[i][:, None], "loglik": loglik[i]} for i in range(3)}
            sides.append(held(cells, each, seed=len(sides)))
        changes = settled(of_case(*sides, metrics).changes)
        tests += sum(not np.isnan(c.p) for c in changes)
        wrong += any(c.verdict in (IMPROVED, WORSE) for c in changes)
    assert tests == 30 * 9
    assert wrong / 30 <= 0.05 + 5 * 0.04
