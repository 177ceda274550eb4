"""Estimators beside a reference: by hand, against scipy and statsmodels, and by rates of error."""

import dataclasses
import json

import numpy as np
import pytest
from scipy import optimize, stats
from statsmodels.stats import contingency_tables, multitest

from estimators.bootstrap import Bootstrap
from suite.case import RECORDED, Card, Divergence, StateBlock, Truth, draw
from suite.compare import CONDITIONAL, NOTHING, ONE_SAMPLE, compare, gaps, nothing_to_compare, ranking
from suite.differences import effect_sizes, gap, holm, rates_apart, sign_test, win_probability, wins
from suite.errors import BadInput
from suite.estimator import FAILED, LOST, OK, Estimate
from suite.metrics import METRICS
from suite.random import Streams
from suite.results import CaseResults, Cell
from suite.score import loss
from suite.statistics import averaged, means
from tests.plugins.tiny import MODEL

CARD = Card(
    name="toy", title="", summary="", steps=10, interval=1.0, state=("x",), blocks=(StateBlock("position", (0,), "m"),),
    divergence=Divergence("position", 100.0, 2), reference="",
)  # fmt: skip
RUNS = 30
RNG = np.random.default_rng(0)
ERRORS = RNG.standard_normal((10, 1, RUNS)) * RNG.lognormal(0, 0.3, RUNS)
OTHERS = 0.9 * ERRORS + 0.4 * RNG.standard_normal((10, 1, RUNS))


def fill(case, label, errors=ERRORS, variance=1.0, status=None, runs=None, seconds=None, loglik=None):
    """A cell whose stored parts are given instead of read."""
    made = case.cells[label] = Cell(case, label, {})
    made.runs = list(range(errors.shape[2])) if runs is None else runs
    cov = np.full((10, 1, 1, errors.shape[2]), variance)
    made.estimate = Estimate(errors, cov, status=status or [OK] * errors.shape[2], loglik=loglik)
    made.truth = Truth(np.zeros_like(errors), np.zeros_like(errors))
    if seconds is not None:
        nothing = np.full((len(seconds), 1, seconds.shape[1]), np.nan)
        made.timing = Estimate(nothing, nothing[:, None], seconds=seconds, batch=[1] * seconds.shape[1])


def beside(metric="rmse", block=None, zone=0.05, card=CARD, **cells):
    """Every cell beside the one called `ref`: by label, or that of the only other one."""
    case = CaseResults(card, 0, [])
    for label, given in cells.items():
        fill(case, label, **given)
    found = compare([case], METRICS[metric], "ref", cells, zone)
    found = {c.estimator: c for c in found if block in (None, c.block)}
    assert len(found) == len(cells) - 1
    return found if len(found) > 1 else next(iter(found.values()))


def close(interval, value, low, high, rel=1e-6):
    assert (interval.value, interval.low, interval.high) == pytest.approx((value, low, high), rel=rel, abs=1e-9)


def test_the_difference_of_a_mean_is_that_of_the_paired_t_test():
    found = beside("absolute-error", "x", a={"errors": OTHERS}, ref={})
    mine, theirs = (np.abs(errors).mean((0, 1)) for errors in (OTHERS, ERRORS))
    expected = stats.ttest_rel(mine, theirs)
    close(found.difference, mine.mean() - theirs.mean(), *expected.confidence_interval(0.95))
    assert (found.value, found.reference_value, found.unit) == (pytest.approx(mine.mean()), pytest.approx(theirs.mean()), "m")
    assert (found.runs, found.left_out, found.reference_left_out) == (RUNS, 0, 0)


def test_p_of_a_mean_that_may_be_negative_is_that_of_the_paired_t_test():
    loglik = RNG.standard_normal((2, 10, RUNS)) - 3
    found = beside("loglik", a={"loglik": loglik[0] + 0.1}, ref={"loglik": loglik[1]})
    expected = stats.ttest_rel(loglik[0].mean(0) + 0.1, loglik[1].mean(0))
    assert found.p == pytest.approx(expected.pvalue)
    close(found.difference, (loglik[0].mean(0) + 0.1 - loglik[1].mean(0)).mean(), *expected.confidence_interval(0.95))
    assert np.isnan(found.ratio.value)


def test_the_ratio_is_by_pseudo_values_of_its_logarithm():
    found = beside("rmse", a={"errors": OTHERS}, ref={})

    def log_ratio(kept):
        rmse = [np.sqrt((errors[..., kept] ** 2).mean(2)).mean() for errors in (OTHERS, ERRORS)]
        return np.log(rmse[0] / rmse[1])

    everyone = np.arange(RUNS)
    whole = log_ratio(everyone)
    pseudo = [RUNS * whole - (RUNS - 1) * log_ratio(np.delete(everyone, r)) for r in everyone]
    expected = stats.ttest_1samp(pseudo, 0)
    close(found.ratio, np.exp(whole), *np.exp(expected.confidence_interval(0.95)))
    assert found.p == pytest.approx(expected.pvalue)


def test_wins_and_effect_are_of_the_values_of_single_runs():
    errors = OTHERS.copy()
    errors[..., :4] = ERRORS[..., :4]
    found = beside("rmse", a={"errors": errors}, ref={})
    mine, theirs = (np.abs(each).mean((0, 1)) for each in (errors, ERRORS))  # of one run the root mean square is |e|
    more, fewer = (mine < theirs).sum(), (mine > theirs).sum()
    assert more + fewer == RUNS - 4
    assert (more - fewer) % 2 == 0
    half = more + 2
    expected = stats.binomtest(int(half), RUNS).proportion_ci(0.95, "exact")
    close(found.wins, half / RUNS, *expected)
    gained = np.log(theirs) - np.log(mine)
    t = np.sqrt(RUNS) * gained.mean() / gained.std(ddof=1)
    ends = [optimize.brentq(lambda d, tail=tail: stats.nct.cdf(t, RUNS - 1, d) - tail, t - 9, t + 9) for tail in (0.975, 0.025)]
    close(found.effect, *np.array([t, *ends]) / np.sqrt(RUNS), rel=1e-5)


def test_half_a_win_is_rounded_outwards():
    found = win_probability(3, 2, 8)  # three ties
    expected = stats.binomtest(4, 8).proportion_ci(method="exact").low, stats.binomtest(5, 8).proportion_ci(method="exact").high
    close(found, 4.5 / 8, *expected)
    assert wins(np.array([1.0, 2.0, np.inf, 1.0, 3.0]), np.array([2.0, 1.0, np.inf, 1 + 1e-9, np.inf])) == (2, 1)


def test_what_has_no_value_of_a_single_run_has_no_wins():
    found = beside("run-rmse-sd", a={"errors": OTHERS}, ref={})
    assert np.isnan([found.wins.value, found.effect.value]).all()
    assert 0 < found.p < 1


def flags(*counts):
    """Errors of runs that diverge: (both, first alone, second alone, neither)."""
    both, first, second, neither = counts
    diverged = np.repeat([[1, 1], [1, 0], [0, 1], [0, 0]], counts, axis=0).T
    return [np.where(each, 1000.0, 1.0) * np.ones((10, 1, both + first + second + neither)) for each in diverged]


def test_rates_are_compared_by_mcnemar():
    mine, theirs = flags(3, 1, 9, 40)
    found = beside("divergence", a={"errors": mine}, ref={"errors": theirs})
    assert (found.value, found.reference_value) == (4 / 53, 12 / 53)
    assert found.p == pytest.approx(contingency_tables.mcnemar([[3, 1], [9, 40]], exact=True).pvalue)
    assert found.p == pytest.approx(stats.binomtest(1, 10).pvalue)
    # Bonett and Price: one run added to either side that differs, two to all.
    p, q, n = 2 / 55, 10 / 55, 55
    reach = stats.norm.ppf(0.975) * np.sqrt((p + q - (p - q) ** 2) / n)
    close(found.difference, -8 / 53, p - q - reach, p - q + reach)
    assert found.wins.value == pytest.approx((9 + 43 / 2) / 53)
    assert np.isnan([found.ratio.value, found.effect.value]).all()
    assert found.verdict == "better"


def test_rates_without_an_event_are_equal_only_when_many_runs_say_so():
    for runs, verdict in ((12, "undecided"), (100, "equal")):
        mine, theirs = flags(0, 0, 0, runs)
        found = beside("divergence", a={"errors": mine}, ref={"errors": theirs})
        assert (found.p, found.verdict, found.wins.value) == (1.0, verdict, 0.5)


@pytest.mark.parametrize(("p", "q"), [(0.02, 0.02), (0.05, 0.15), (0.5, 0.3)])
def test_coverage_of_the_difference_of_rates(p, q):
    # 3000 samples of 40 runs: the published coverage is 0.94 or more; a band of 5 standard deviations is 0.02.
    drawn = np.random.default_rng(1).multinomial(40, [p, q, 1 - p - q], 3000)
    inside = 0
    for more, fewer, _ in drawn:
        one = np.repeat([1.0, 0.0, 0.0], [more, fewer, 40 - more - fewer])[None]
        other = np.repeat([0.0, 1.0, 0.0], [more, fewer, 40 - more - fewer])[None]
        found = rates_apart(one, other)
        inside += found.low <= p - q <= found.high
    assert inside / 3000 > 0.94 - 0.02


def test_running_times_are_no_pairs():
    seconds = [1e-3 * np.random.default_rng(s).uniform(1, 2 + s, (10, 6 + s)) for s in (0, 2)]
    found = beside("latency", a={"seconds": seconds[0]}, ref={"seconds": seconds[1]})
    calls = [1e6 * np.median(each, axis=0) for each in seconds]
    expected = stats.ttest_ind(*calls, equal_var=False).confidence_interval(0.95)
    close(found.difference, calls[0].mean() - calls[1].mean(), *expected)
    assert found.runs == 6
    # A jackknife of the logarithm of a mean of such calls is close to the mean of logarithms.
    assert found.p == pytest.approx(stats.ttest_ind(*map(np.log, calls), equal_var=False).pvalue, rel=0.5)
    assert np.isnan([found.wins.value, found.effect.value]).all()


def test_a_recording_is_one_sample():
    card = dataclasses.replace(CARD, origin=RECORDED)
    found = beside("rmse", card=card, a={"errors": OTHERS}, ref={})
    assert (found.verdict, found.runs) == (ONE_SAMPLE, RUNS)
    assert found.ratio.value == pytest.approx(found.value / found.reference_value)
    assert np.isnan([found.p, found.holm, found.ratio.low, found.difference.high, found.wins.value]).all()
    calls = {"seconds": 1e-3 * RNG.uniform(1, 2, (10, 6))}
    assert 0 < beside("latency", card=card, a=calls, ref=calls).p <= 1


def test_holm_is_over_all_comparisons_that_were_made_together():
    factors = {"a": 1.3, "b": 1.1, "c": 1.02}
    noise = RNG.standard_normal((3, *ERRORS.shape))
    cells = {label: {"errors": f * OTHERS + 0.3 * n} for (label, f), n in zip(factors.items(), noise, strict=True)}
    found = beside(ref={}, **cells)
    first, second, third = sorted(found.values(), key=lambda c: c.p)
    two = max(3 * first.p, 2 * second.p)
    assert [first.holm, second.holm] == pytest.approx([min(3 * first.p, 1), min(two, 1)])
    assert third.holm == pytest.approx(min(max(two, third.p), 1))
    assert holm([0.01, np.nan, 0.04]) == pytest.approx([0.02, np.nan, 0.04], nan_ok=True)
    assert holm([]) == []
    p = np.random.default_rng(0).random(40) ** 4
    assert holm(p) == pytest.approx(multitest.multipletests(p, method="holm")[1])


def test_what_holm_takes_back_is_undecided():
    gained = RNG.standard_normal(RUNS)
    gained = (gained - gained.mean()) / gained.std(ddof=1) + 2.5 / np.sqrt(RUNS)  # t is 2.5
    reference = {"loglik": np.zeros((10, RUNS))}
    cells = {"a": {"loglik": reference["loglik"] + gained}, "ref": reference}
    alone = beside("loglik", **cells)
    assert (alone.p, alone.holm) == pytest.approx([2 * stats.t.sf(2.5, RUNS - 1)] * 2)
    assert alone.verdict == "better"
    among = beside("loglik", **cells, b=reference, c=reference)["a"]
    assert (among.p, among.holm) == pytest.approx((alone.p, 3 * alone.p))
    assert among.holm > 0.05
    assert among.verdict == "undecided"


def test_verdicts():
    assert beside(a={"errors": 1.5 * ERRORS}, ref={}).verdict == "worse"
    assert beside(a={"errors": 0.5 * ERRORS}, ref={}).verdict == "better"
    assert beside(a={}, ref={}).verdict == "equal"
    other = {"errors": np.random.default_rng(5).standard_normal(ERRORS.shape)}
    assert beside(a=other, ref={}).verdict == "undecided"
    loglik = np.zeros((10, RUNS)) + RNG.standard_normal(RUNS)
    higher = beside("loglik", a={"loglik": loglik + 1}, ref={"loglik": loglik})
    assert (higher.verdict, higher.p) == ("better", 0.0)


@pytest.mark.parametrize(
    ("factor", "zone", "verdict"), [(1.04, 0.05, "equal"), (1.04, 0.03, "worse"), (1.06, 0.05, "worse"), (1.9, 0.5, "worse")]
)
def test_a_sure_difference_within_the_zone_is_none_that_matters(factor, zone, verdict):
    """And to change places changes better for worse, but no equal."""
    mirror = {"equal": "equal", "worse": "better"}[verdict]
    assert beside(a={"errors": factor * ERRORS}, ref={}, zone=zone).verdict == verdict
    assert beside(a={}, ref={"errors": factor * ERRORS}, zone=zone).verdict == mirror


@pytest.mark.parametrize(("shift", "verdict"), [(0.04, "equal"), (0.06, "better"), (-0.06, "worse")])
def test_the_zone_of_a_logarithm_does_not_hang_on_units(shift, verdict):
    loglik = np.zeros((10, RUNS)) + RNG.standard_normal(RUNS)
    for unit in (0.0, 1e4):
        found = beside("loglik", a={"loglik": loglik + unit + shift}, ref={"loglik": loglik + unit})
        assert found.verdict == verdict


def test_better_is_nearer_to_a_target():
    exact = ERRORS / np.sqrt((ERRORS**2).mean(0))  # every run has NEES 1 with variance 1
    exact = exact * (1 + 0.01 * np.random.default_rng(2).standard_normal(RUNS))

    def verdict(mine, theirs, zone=0.05):
        return beside(
            "nees", a={"errors": exact, "variance": mine}, ref={"errors": exact, "variance": theirs}, zone=zone
        ).verdict

    assert verdict(1.1, 1.4) == "better"
    assert verdict(1 / 1.4, 1.1) == "worse"
    assert verdict(1.4, 1 / 1.4) == "undecided"  # as far, on either side
    assert verdict(1.4, 1.42) == "equal"


def test_two_that_hit_a_target_are_rarely_told_apart():
    # 1000 pairs of 20 runs, both of mean 1: at most 5 % wrong, and 5 standard deviations of 0.007.
    rng, metric = np.random.default_rng(0), METRICS["nees"]
    wrong = 0
    for _ in range(1000):
        common = rng.standard_exponential((1, 20))
        one, other = (means((common + rng.standard_exponential((1, 20))) / 2) for _ in range(2))
        wrong += max(g.p[0] for g in gaps(metric, one, other)) < 0.05
    assert wrong / 1000 < 0.05 + 0.035


def test_runs_that_did_not_come_through_are_counted_and_told():
    mine, theirs = [FAILED] * 2 + [OK] * (RUNS - 2), [OK] * (RUNS - 1) + [LOST]
    found = beside(a={"errors": 0.5 * ERRORS, "status": mine}, ref={"status": theirs})
    assert (found.runs, found.left_out, found.reference_left_out) == (RUNS - 3, 2, 1)
    assert found.verdict == "better" + CONDITIONAL
    assert "failed in 2 of 30 runs" in found.remarks
    assert beside(a={"errors": ERRORS, "variance": (ERRORS**2).mean()}, ref={}).remarks == ""
    assert beside(a={"status": [FAILED] * RUNS}, ref={}).verdict == NOTHING


def test_runs_that_only_one_side_was_given_are_not_left_out():
    later = {"errors": 2 * np.roll(ERRORS, -5, axis=2), "runs": list(range(5, RUNS + 5)), "status": [OK] * 29 + [FAILED]}
    found = beside(a=later, ref={"status": [FAILED] + [OK] * 29})
    assert (found.runs, found.left_out, found.reference_left_out) == (RUNS - 5, 0, 0)
    assert found.ratio.value == pytest.approx(2)
    assert found.verdict == "worse"


def test_surviving_runs_are_compared_where_they_say_something_new():
    wild = OTHERS.copy()
    wild[:, :, 0] = 1000.0
    case = CaseResults(CARD, 0, [])
    fill(case, "ref")
    fill(case, "a", errors=OTHERS)
    fill(case, "b", errors=wild)
    found = compare([case], METRICS["rmse"], "ref", case.cells)
    assert [(c.estimator, c.block, c.runs) for c in found] == [
        ("a", "position", RUNS),
        ("b", "position", RUNS),
        ("b", "position, surviving runs", RUNS - 1),
    ]
    assert found[2].left_out == 1


def test_values_of_zero_and_infinity_are_compared_by_wins():
    nothing = {"errors": np.zeros_like(ERRORS)}
    both = beside(a=nothing, ref=nothing)
    assert (both.verdict, both.p, both.difference.value) == ("equal", 1.0, 0.0)
    exact = beside(a=nothing, ref={})
    assert exact.p == pytest.approx(2 * 0.5**RUNS)
    assert exact.verdict == "better"
    singular = beside("nees", a={"variance": 0.0}, ref={})
    assert (singular.p, singular.verdict) == (pytest.approx(2 * 0.5**RUNS), "worse")
    assert sign_test(0, 0) == 1.0


def test_one_run_has_values_and_no_verdict():
    found = beside(a={"errors": OTHERS[..., :1]}, ref={"errors": ERRORS[..., :1]})
    assert found.ratio.value == pytest.approx(found.value / found.reference_value)
    assert np.isnan([found.p, found.ratio.low, found.effect.value]).all()
    assert found.verdict == "undecided"


@pytest.mark.parametrize("zone", [0.0, 1.0, -0.05, np.nan])
def test_a_zone_is_a_share(zone):
    with pytest.raises(BadInput, match="between 0 and 1"):
        beside(a={}, ref={}, zone=zone)


def skew_pair(rng, runs, spread):
    """Squared errors [10, R] of two estimators of the same runs, some of which are hard for both; in truth alike."""
    shared, hard = rng.standard_normal((10, runs)), rng.lognormal(0, spread, runs)
    return [(0.8 * shared + 0.6 * rng.standard_normal((10, runs))) ** 2 * hard for _ in range(2)]


@pytest.mark.parametrize(("runs", "least"), [(12, 0.93), (30, 0.935), (100, 0.94)])
def test_coverage_on_correlated_skew_errors(runs, least):
    """Measured on 3000 other samples: 0.93, 0.94, 0.945 for difference and ratio, more for wins and effect."""
    # 500 samples: a coverage of 0.93 has a standard deviation of 0.0114; the band is 5 of them.
    rng = np.random.default_rng(runs)
    inside = np.zeros(4)
    for _ in range(500):
        mine, theirs = skew_pair(rng, runs, 0.5)
        one, other = averaged(1.44 * mine, np.sqrt), averaged(theirs, np.sqrt)
        own = [np.log(np.sqrt(each).mean(0)) for each in (mine, theirs)]
        found = (
            (gap(one, other).intervals()[0], 0.2 * np.exp(0.5**2 / 4)),
            (gap(one.map(np.log), other.map(np.log)).intervals()[0], np.log(1.2)),
            (win_probability(*map(int, wins(*own)), runs), 0.5),
            (effect_sizes((own[1] - own[0])[None])[0], 0.0),
        )
        inside += [i.low <= value <= i.high for i, value in found]
    assert (inside / 500 > least - 0.057).all(), inside / 500
    assert (inside[:2] / 500 < 0.95 + 0.049).all(), "no interval is so wide that it cannot miss"


def test_holm_holds_the_rate_of_any_error_among_twenty_equal_estimators():
    # 150 tables: 5 % have a standard deviation of 0.018; jackknife t at 30 runs has 1 % more (see above); the band is 5.
    rng = np.random.default_rng(0)
    wrong = 0
    for _ in range(150):
        shared, hard = rng.standard_normal((10, 30)), rng.lognormal(0, 0.5, 30)
        squares = (0.8 * shared + 0.6 * rng.standard_normal((21, 10, 30))) ** 2 * hard
        reference, *others = (averaged(each, np.sqrt).map(np.log) for each in squares)
        wrong += min(holm([gap(other, reference).p[0] for other in others])) < 0.05
    assert wrong / 150 < 0.06 + 5 * 0.018


def test_two_bootstrap_filters_that_differ_in_their_seed_are_equal():
    truth = draw(MODEL, 20, Streams.of(0).batch(0, 800))
    errors = [(Bootstrap(particles=200).run(MODEL, truth.y, seed=seed).mean - truth.x)[-10:, :1] for seed in (1, 2)]
    # 40 groups of 20 runs: of 5 % there are 2, with a standard deviation of 1.4; 9 are 5 of these.
    one, other = ([averaged(part[:, 0] ** 2, np.sqrt).map(np.log) for part in np.split(e, 40, axis=2)] for e in errors)
    assert sum(gap(a, b).p[0] < 0.05 for a, b in zip(one, other, strict=True)) <= 9
    assert beside(a={"errors": errors[0]}, ref={"errors": errors[1]}).verdict == "equal"


def test_the_command_line(cli, tiny, tmp_path):
    assert tiny("-e", "last", "smoothed", "smoothed[jitter=5.0]").code == 0
    results = tmp_path / "results"

    def asked(*arguments):
        return cli("compare", *arguments, "--results", results)

    table = asked("last")
    assert table.code == 0
    assert "p is adjusted over all comparisons by a metric: 2 by rmse" in table.out
    rows = json.loads(asked("smoothed", "-e", "last", "smoothed*", "-m", "rmse", "eta", "--format", "json").out)
    assert [(row["metric"], row["estimator"], row["runs"]) for row in rows if row["block"] in ("level", "state")]
    assert all(row["reference"] == "smoothed" for row in rows)
    header, *lines = asked("last", "--format", "csv").out.splitlines()
    assert header.startswith("case,seed,metric,block,estimator,reference,unit,value,reference_value,difference,difference_low")
    assert header.endswith("runs,left_out,reference_left_out,verdict,remarks")
    assert len(lines) == 2
    for arguments, words in (
        (["lst"], "no stored estimator is 'lst'; did you mean 'last'?"),
        (["last", "-e", "last"], "last has no run to compare with any other"),
        (["last", "--zone", "5"], "must be a percentage between 0% and 100%, such as 5%, got '5'"),
        (["last", "--zone", "100%"], "must be a percentage between 0% and 100%"),
        (["last", "--zone", "x%"], "must be a percentage between 0% and 100%"),
        (["last", "--run", "1"], "add --states"),
        (["truth"], "only states are held against the truth; add --states"),
        (["last", "--states", "-m", "rmse"], "drop one of --states and --metric"),
    ):
        said = asked(*arguments)
        assert (said.code, len(said.errors), said.out) == (2, 1, "")
        assert words in said.errors[0]


@pytest.mark.parametrize(
    ("cells", "cases", "words"),
    [
        ({"a": {}}, 2, "it was not run on toy and 1 other; run it there with `filterbench run -e ref`"),
        ({"ref": {}}, 1, "it is the only estimator chosen on toy; run or choose another one beside it"),
        (
            {"ref": {"refusal": "not linear"}, "a": {}},
            3,
            "it refused toy and 2 others (not linear); name a reference that accepts it",
        ),
        ({"ref": {}, "a": {}}, 1, "on toy; run both on the same case, or name another metric"),
    ],
)
def test_why_there_is_nothing_to_compare(cells, cases, words):
    case = CaseResults(CARD, 0, [])
    case.cells = {label: Cell(case, label, {}, **given) for label, given in cells.items()}
    said = str(nothing_to_compare([case] * cases, "ref", ["a", "ref"]))
    assert said.startswith("ref has no run to compare with any other")
    assert said.endswith(words)


def test_a_pattern_leaves_out_metrics_that_rank_nobody_and_a_name_does_not():
    assert {metric.name for metric in ranking(["*"])} == {name for name, metric in METRICS.items() if metric.ranked}
    assert [metric.name for metric in ranking(["n*"])] == ["nees", "nis"]
    assert [metric.name for metric in ranking(["nci", "nis"])] == ["nis", "nci"]
    with pytest.raises(BadInput, match=r"by no metric that matches 'ess\*' is an estimator better"):
        ranking(["ess*"])
    with pytest.raises(BadInput, match="by nci no estimator is better than another"):
        compare([], METRICS["nci"], "ref", [])


def test_a_run_loses_as_much_on_either_side_of_a_target():
    below, above = loss(METRICS["nees"], np.array([0.5, 2.0]))
    assert below == pytest.approx(above)
    assert above == pytest.approx(np.log(2))
    np.testing.assert_allclose(loss(METRICS["rmse"], np.array([0.5, 2.0])), np.log([0.5, 2.0]))
