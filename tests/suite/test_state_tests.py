"""The tests of the multistatic paper: against scipy, by hand, and by their rates of error."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

from suite.case import RECORDED, Card, Divergence, Region, StateBlock, Truth
from suite.estimator import FAILED, OK, Estimate
from suite.results import CaseResults, Cell
from suite.state_tests import TRUTH, of_differences, state_tests, symmetry

FIELD = Region("field", ((0.0, 0.0), (1.5, 0.0), (1.5, 1.0), (0.0, 1.0)))
CARD = Card(
    name="toy", title="", summary="", steps=40, interval=1.0, state=("x", "y", "v"), plane=(0, 1), regions=(FIELD,),
    blocks=(StateBlock("position", (0, 1), "m"),), divergence=Divergence("position", 100.0, 2), reference="",
)  # fmt: skip
RNG = np.random.default_rng(0)
TRUE = RNG.uniform(-1, 2, (40, 3, 12))
NORMAL = stats.norm.ppf((np.arange(40) + 0.5) / 40)  # as normal as 40 numbers can be
SHARP = np.sign(NORMAL) * np.abs(NORMAL) ** 4  # symmetric, but far from normal
SKEW = stats.expon.ppf((np.arange(40) + 0.5) / 40)


def a_case(card=CARD, **means):
    """A case whose cells hold these means[T, n, R]; of `status`, by label, which runs came through."""
    status = means.pop("status", {})
    case = CaseResults(card, 3, [])
    for label, mean in means.items():
        cell = case.cells[label] = Cell(case, label, {})
        cell.runs = list(range(mean.shape[2]))
        cov = np.zeros((*mean.shape[:2], *mean.shape[1:]))
        cell.estimate = Estimate(mean, cov, status=status.get(label, [OK] * mean.shape[2]))
        cell.truth = Truth(TRUE[..., : mean.shape[2]], TRUE[:, :1, : mean.shape[2]])
    return case


@pytest.mark.parametrize(
    ("differences", "test", "p"),
    [
        (NORMAL + 0.2, "t", stats.ttest_1samp(NORMAL + 0.2, 0).pvalue),
        (SHARP + 0.2, "Wilcoxon", stats.wilcoxon(SHARP + 0.2).pvalue),
        (SKEW - 0.5, "sign", stats.binomtest(int((SKEW > 0.5).sum()), 40).pvalue),
    ],
)
def test_the_strongest_test_whose_assumptions_hold(differences, test, p):
    found = of_differences(np.append(differences, np.nan))
    assert (found.test, found.count) == (test, 40)
    assert found.p == pytest.approx(p)


def test_of_more_than_5000_normality_is_judged_by_another_test():
    many = stats.norm.ppf((np.arange(6000) + 0.5) / 6000)
    assert of_differences(many).test == "t"
    assert of_differences(many**3).test == "Wilcoxon"


def test_differences_that_are_all_alike():
    assert dataclasses.astuple(of_differences(np.zeros(9))) == ("sign", 9, 1.0)
    assert dataclasses.astuple(of_differences(np.full(9, -0.3))) == ("sign", 9, 2 * 0.5**9)
    assert of_differences(np.array([1.0, 2.0, np.nan])).test == "none"
    assert np.isnan(of_differences(np.array([])).p)
    zeros = np.concatenate([np.zeros(20), SKEW])
    assert of_differences(zeros).p == pytest.approx(2 * 0.5**40)


def test_symmetry_by_hand():
    d = np.array([0.0, 1.0, 2.0, 3.0, 14.0])
    score = np.sqrt(5) * (4 - 2) / d.std(ddof=1) / np.sqrt(np.pi / 2 - 1)
    assert symmetry(d) == pytest.approx(2 * stats.norm.sf(score))
    assert symmetry(-d) == pytest.approx(symmetry(d))
    assert symmetry(np.array([-1.0, 0.0, 1.0])) == 1.0


@pytest.mark.parametrize("draw", [np.random.Generator.standard_normal, np.random.Generator.laplace], ids=["normal", "Laplace"])
def test_independent_differences_are_rejected_at_the_stated_rate(draw):
    # 300 samples of 60: 5 % have a standard deviation of 0.013; to choose the test by the data may cost 1 %; the band is 5.
    rng = np.random.default_rng(0)
    rejected = [of_differences(draw(rng, size=60)).p < 0.05 for _ in range(300)]
    assert np.mean(rejected) < 0.06 + 0.065
    shifted = [of_differences(draw(rng, size=60) + 1).p < 0.05 for _ in range(50)]
    assert np.mean(shifted) > 0.95


def test_differences_correlated_in_time_are_rejected_too_often_over_steps_and_rightly_over_runs():
    # Errors of correlation 0.8 a step: the variance of their mean is (1 + 0.8) / (1 - 0.8) = 9 times that of independent ones,
    # so |t| > 2 in about half the runs. Of 360 runs a half has a standard deviation of 0.026: the band is 5.7 of them. Of 30
    # groups 5 % have one of 0.04: the band is 5.
    rng = np.random.default_rng(0)
    error = np.empty((40, 360))
    error[0] = rng.standard_normal(360)
    for k in range(1, 40):
        error[k] = 0.8 * error[k - 1] + 0.6 * rng.standard_normal(360)
    over_steps, over_runs = [], []
    for first in range(0, 360, 12):
        estimate = TRUE + error[:, None, first : first + 12]
        case = a_case(dataclasses.replace(CARD, regions=()), a=estimate)
        over_runs.append(state_tests(case, "a", TRUTH)[0].over_runs.p < 0.05)
        over_steps += [of_differences(run).p < 0.05 for run in error[:, first : first + 12].T]
    assert 0.35 < np.mean(over_steps) < 0.65
    assert np.mean(over_runs) < 0.05 + 5 * np.sqrt(0.05 * 0.95 / 30)


def test_components_and_regions_of_a_run():
    error = RNG.standard_normal(TRUE.shape)
    found = state_tests(a_case(a=TRUE + error), "a", TRUTH, run=5)
    assert [(t.component, t.unit) for t in found[:3]] == [("x", "m"), ("y", "m"), ("v", "")]
    assert [t.region for t in found[::3]] == ["all", "inside field", "outside field"]
    assert {(t.case, t.seed, t.estimator, t.reference, t.run) for t in found} == {("toy", 3, "a", "truth", 5)}
    x, y = (TRUE + error)[:, 0], (TRUE + error)[:, 1]
    inside = (x > 0) & (x < 1.5) & (y > 0) & (y < 1)  # by the estimate, not by the truth
    for where, chosen in (("all", np.ones_like(inside)), ("inside field", inside), ("outside field", ~inside)):
        test = next(t for t in found if (t.region, t.component) == (where, "v"))
        assert test.mean == pytest.approx(error[chosen[:, 5], 2, 5].mean())
        steps = of_differences(error[chosen[:, 5], 2, 5])
        assert (test.over_steps.test, test.over_steps.count) == (steps.test, chosen[:, 5].sum())
        assert test.over_steps.p == pytest.approx(steps.p)
        means = [error[chosen[:, r], 2, r].mean() for r in range(12) if chosen[:, r].any()]
        assert test.over_runs.count == len(means)
        assert test.over_runs.p == pytest.approx(of_differences(np.array(means)).p)


def test_estimators_are_compared_on_the_runs_that_came_through_on_both_sides():
    first, second = TRUE + RNG.standard_normal(TRUE.shape), TRUE + RNG.standard_normal(TRUE.shape)
    status = {"a": [FAILED, *[OK] * 11], "b": [OK] * 11 + [FAILED]}
    case = a_case(a=first, b=second, status=status)
    found = state_tests(case, "a", "b")[0]
    assert (found.run, found.over_runs.count) == (1, 10)
    assert found.mean == pytest.approx((first - second)[:, 0, 1].mean())
    assert found.over_runs.p == pytest.approx(of_differences((first - second)[:, 0, 1:11].mean(0)).p)
    assert state_tests(case, "a", TRUTH)[0].over_runs.count == 11
    assert state_tests(case, "a", "b", run=0) == []
    for estimator, reference in (("a", "a"), ("c", "a"), ("a", "c")):
        assert state_tests(case, estimator, reference) == []


def test_a_recording_has_no_test_over_runs():
    case = a_case(dataclasses.replace(CARD, origin=RECORDED), a=TRUE + RNG.standard_normal(TRUE.shape))
    assert state_tests(case, "a", TRUTH)[0].over_runs.test == "none"
    assert state_tests(case, "a", TRUTH)[0].over_steps.test != "none"


def test_the_command_line(cli, tiny, tmp_path):
    assert tiny("-e", "last", "smoothed").code == 0
    results = tmp_path / "results"
    said = cli("compare", "truth", "--states", "--results", results)
    assert said.code == 0
    assert "minus truth" in said.out
    assert "so p over steps is too small" in said.out
    header, *lines = cli("compare", "last", "--states", "--run", 2, "--format", "csv", "--results", results).out.splitlines()
    assert header == (
        "case,seed,estimator,reference,component,region,unit,run,mean,"
        "over_steps_test,over_steps_count,over_steps_p,over_runs_test,over_runs_count,over_runs_p"
    )
    assert [line.split(",")[2:6] for line in lines] == [["smoothed", "last", name, "all"] for name in ("x", "v")]
    assert "no run to compare" in cli("compare", "truth", "--states", "--run", 99, "--results", results).errors[0]
