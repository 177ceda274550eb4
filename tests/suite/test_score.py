"""Who is best, who ties: on cells made by hand."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from suite.case import FROM_MODEL, RECORDED, Card, Divergence, StateBlock, Truth
from suite.estimator import FAILED, LOST, OK, Estimate
from suite.metrics import METRICS
from suite.results import CaseResults, Cell
from suite.score import BEST, TIED, scores, standings, table
from suite.tables import print_scores

CARD = Card(
    name="toy", title="", summary="", steps=10, interval=1.0, state=("x",), blocks=(StateBlock("position", (0,), "m"),),
    divergence=Divergence("position", 100.0, 2), reference="",
)  # fmt: skip
RUNS = 30
ERRORS = np.random.default_rng(0).standard_normal((10, 1, RUNS))


def cell(case, label, errors=ERRORS, variance=1.0, status=None, runs=None, seconds=None):
    """A cell whose stored parts are given instead of read."""
    made = Cell(case, label, {})
    made.runs = list(range(errors.shape[2])) if runs is None else runs
    cov = np.full((10, 1, 1, errors.shape[2]), variance)
    made.estimate = Estimate(errors, cov, status=status or [OK] * errors.shape[2])
    made.truth = Truth(np.zeros_like(errors), np.zeros_like(errors))
    if seconds is not None:
        nothing = np.full((len(seconds), 1, seconds.shape[1]), np.nan)
        made.timing = Estimate(nothing, nothing[:, None], seconds=seconds, batch=[1] * seconds.shape[1])
    return made


def ranked(metric="rmse", block="position", **cells):
    case = CaseResults(CARD, 0, [])
    case.cells = {label: cell(case, label, **given) for label, given in cells.items()}
    return standings(case, [METRICS[metric]])[metric, block]


def test_identical_estimators_tie():
    assert ranked(a={}, b={}) == {"a": TIED, "b": TIED}


def test_a_clearly_worse_one_does_not():
    assert ranked(a={}, b={"errors": 1.5 * ERRORS}) == {"a": BEST}
    assert ranked(a={"errors": 1.5 * ERRORS}, b={}) == {"b": BEST}
    assert ranked(a={}, b={"errors": 1.5 * ERRORS}, c={}) == {"a": TIED, "c": TIED}


def test_comparison_is_paired():
    """Two per cent worse in every run is worse, though the two intervals overlap almost wholly."""
    assert ranked(a={}, b={"errors": 1.02 * ERRORS}) == {"a": BEST}
    other = np.random.default_rng(1).standard_normal(ERRORS.shape) * 1.02
    assert set(ranked(a={}, b={"errors": other}).values()) == {TIED}


@pytest.mark.parametrize("factor", [1 + 1e-12, 1 - 1e-12, 1 + 1e-8])
def test_rounding_ties(factor):
    assert ranked(a={}, b={"errors": factor * ERRORS}) == {"a": TIED, "b": TIED}


@pytest.mark.parametrize("bad", [FAILED, LOST])
def test_one_bad_run_forbids_to_be_best(bad):
    status = [bad] + [OK] * (RUNS - 1)
    assert ranked(a={}, b={"errors": 0.1 * ERRORS, "status": status}) == {"a": BEST}
    assert ranked(a={"errors": 0.1 * ERRORS, "status": status}, b={}, c={}) == {"b": TIED, "c": TIED}


def test_nobody_is_best_when_all_have_bad_runs():
    status = [FAILED] + [OK] * (RUNS - 1)
    case = CaseResults(CARD, 0, [])
    case.cells = {"a": cell(case, "a", status=status)}
    assert not standings(case, [METRICS["rmse"]]).get(("rmse", "position"))


def test_a_target_is_missed_by_its_ratio():
    """NEES of 1 is the target: 1.4 and 1 / 1.4 miss it alike, and any nearer one is best."""
    exact = ERRORS / np.sqrt((ERRORS**2).mean((0, 1)))  # every run has NEES 1 with variance 1
    half, double = {"errors": exact, "variance": 1.4}, {"errors": exact, "variance": 1 / 1.4}
    assert ranked("nees", "state", a=half, b={"errors": exact, "variance": 1.1}) == {"b": BEST}
    assert ranked("nees", "state", a={"errors": exact, "variance": 0.9}, b=double) == {"a": BEST}
    assert ranked("nees", "state", a=half, b=double) == {"a": TIED, "b": TIED}


def test_an_infinite_score_is_never_best():
    assert ranked("nees", "state", a={"variance": 0.0}, b={"variance": 9.0}, c={"variance": 0.5}) == {"c": BEST}


def test_runs_are_compared_where_both_have_them():
    assert ranked(a={}, b={"errors": 1.5 * ERRORS[..., 5:], "runs": list(range(5, RUNS))}) == {"a": BEST}
    apart = {"errors": 1.5 * ERRORS, "variance": 2.25, "runs": list(range(100, 100 + RUNS))}
    assert set(ranked(a={}, b=apart).values()) == {TIED}


def test_throughput_is_better_high_and_latency_low():
    calls = 1e-3 * (1 + 0.01 * np.random.default_rng(0).random((10, 8)))
    fast, slow = {"seconds": calls}, {"seconds": 2 * calls}
    assert ranked("latency", "step", a=slow, b=fast) == {"b": BEST}


def test_one_cell_alone_is_best_of_nothing():
    assert ranked(a={}) == {}


def test_a_rate_has_no_interval_where_all_runs_are_of_the_same_data():
    for origin, high in ((FROM_MODEL, 1 - 0.025 ** (1 / RUNS)), (RECORDED, np.nan)):
        made = cell(CaseResults(dataclasses.replace(CARD, origin=origin), 0, []), "a")
        rate = scores(made, METRICS["divergence"])["runs"]
        assert (rate.value, rate.runs, rate.total) == (0.0, RUNS, RUNS)
        assert rate.high == pytest.approx(high, nan_ok=True)
        assert np.isnan(rate.low) == (origin == RECORDED)
        error = scores(made, METRICS["rmse"])["position"]
        assert 0 < error.low < error.value < error.high


def printed(capsys, metrics, **cells):
    """Metrics that the printed table shows, by estimator."""
    case = CaseResults(CARD, 0, [])
    case.cells = {label: cell(case, label, **given) for label, given in cells.items()}
    print_scores(table(SimpleNamespace(cases={"toy": case}), [METRICS[m] for m in metrics], ["toy"], cells))
    rows = [[part.strip() for part in line.split("│")] for line in capsys.readouterr().out.splitlines() if "│" in line]
    return {label: [(row[2], row[3]) for row in rows if row[1] == label] for label in cells}


def test_what_no_estimator_of_a_case_has_is_not_printed(capsys):
    unknown = {"errors": np.full_like(ERRORS, np.nan)}
    rmse, nees = np.sqrt((ERRORS**2).mean(2)).mean(), (ERRORS**2).mean()
    assert printed(capsys, ["rmse", "nees"], a={}, b=unknown) == {
        "a": [("rmse:position", f"{rmse:.4g} m"), ("nees:state", f"{nees:.4g}")],
        "b": [("rmse:position", "none"), ("nees:state", "none")],
    }
    assert printed(capsys, ["rmse", "nees"], a={"variance": 0.0}, b=unknown)["a"][1] == ("nees:state", "inf")
    timed = {"seconds": 1e-3 * np.ones((10, 8))}
    assert printed(capsys, ["rmse", "latency"], a=unknown | timed) == {"a": [("latency:step", "1000 µs")]}
    assert printed(capsys, ["rmse"], a=unknown) == {"a": [("rmse:position", "none")]}
