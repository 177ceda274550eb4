"""The sentences at the top of the overview."""

import dataclasses
import re

import numpy as np
import pytest

from reports.sentences import behind, bounded, headline
from reports.views import private, view
from suite import bounds
from suite.case import RECORDED
from suite.case_bounds import BlockBound
from suite.results import CaseResults
from suite.score import TIED
from tests.reports.conftest import rendered


def sentences(loaded):
    return headline([view(private(case), loaded.labels) for case in loaded.cases.values()])


def test_a_tie_and_a_winner_are_told_case_by_case(tools, tmp_path):
    estimators = [tools.scripted("near"), tools.scripted("twin"), tools.scripted("far", shift=500.0)]
    accuracy, runs, cost = sentences(tools.written(tmp_path / "r").add([tools.case()], estimators).load())
    assert accuracy.startswith("On easy, near and twin tie for the smallest RMSE of position (")
    assert accuracy.endswith(" m).")
    assert runs == (
        "Of 12 runs, none failed or was lost and none diverged. In 1 of 3 combinations that ran, scores show a fault of the "
        "estimator (optimistic in 1)."
    )
    assert cost == "On easy, near has the shortest step (102 µs)."


def test_who_stands_apart_is_named_alone(tools, tmp_path):
    estimators = [tools.scripted("far", shift=500.0), tools.scripted("near")]
    accuracy, _, _ = sentences(tools.written(tmp_path / "r").add([tools.case()], estimators).load())
    assert accuracy.startswith("On easy, near has the smallest RMSE of position (")


def test_one_run_ranks_nobody(tools, tmp_path):
    estimators = [tools.scripted("far", shift=500.0), tools.scripted("near")]
    accuracy, _, cost = sentences(tools.written(tmp_path / "r").add([tools.case()], estimators, runs=1, seconds=0).load())
    assert accuracy == "On easy, nobody can be ranked by RMSE of position, since there is one run each."
    assert cost == "No running times are stored."


def test_what_went_wrong_is_counted_and_placed(tools, tmp_path):
    estimators = [
        tools.scripted("lost", bad=(0, 1), status="lost"),
        tools.scripted("broken", error="x"),
        tools.scripted("choosy", refusal="no"),
    ]
    _, runs, _ = sentences(tools.written(tmp_path / "r").add([tools.case()], estimators).load())
    assert runs == (
        "Of 8 runs, 6 failed or were lost (broken on easy, 4 of 4; lost on easy, 2 of 4) "
        "and 2 diverged (lost on easy, 2 of 4); of 3 combinations of estimator and case, 1 was refused."
    )


def test_more_than_two_cells_in_which_runs_went_wrong_are_counted(tools, tmp_path):
    estimators = [tools.scripted(f"lost {n}", bad=range(n), status="lost") for n in (1, 3, 2)]
    _, runs, _ = sentences(tools.written(tmp_path / "r").add([tools.case()], estimators).load())
    assert runs.startswith("Of 12 runs, 6 failed or were lost (in 3 cells, among them lost 3 on easy, 3 of 4) and 6 diverged (")


def test_many_cases_are_counted(tools, tmp_path):
    estimators = [tools.scripted(name) for name in ("near", "twin", "third", "fourth")] + [tools.scripted("far", shift=500.0)]
    cases = [tools.case(f"case {i}") for i in range(5)]
    loaded = tools.written(tmp_path / "r").add(cases, estimators, runs=3).load()
    accuracy, _, cost = sentences(loaded)
    assert accuracy == (
        "By the RMSE of each case's first block, in 5 cases, most often among the best: near in 5, twin in 5 and third in 5, "
        "and 1 other in as many; in half of these cases 4 or more estimators may be the best."
    )
    assert cost == "By the time of a step, in 5 cases, most often among the best: near in 5 (alone in 5)."
    shown = [view(private(case), loaded.labels) for case in loaded.cases.values()]
    for label in ("near", "twin"):
        shown[0].cells[label].standing["latency", "step"] = TIED
    assert headline(shown)[2].endswith("most often among the best: near in 5 (alone in 4) and twin in 1.")
    recorded = loaded.cases["case 4"]
    recorded.card = dataclasses.replace(recorded.card, origin=RECORDED)
    accuracy, _, _ = sentences(loaded)
    assert accuracy.startswith(
        "By the RMSE of each case's first block, in the 4 of 5 cases where anybody can be ranked, most often"
    )


def test_what_lies_behind_the_scores_is_counted(tools, tmp_path):
    written = tools.written(tmp_path / "r").add([tools.case("one")], [tools.scripted("a"), tools.scripted("b")], runs=3)
    loaded = written.add([tools.case("two")], [tools.scripted("a")], runs=12).load()
    assert behind([]) == ""
    assert told_behind(loaded) == "3 to 12 runs a cell"
    for label, particles in (("a", 50), ("b", 1000)):
        loaded.cases["one"].cells[label].meta = {"parameters": {"particles": particles}}
    assert told_behind(loaded) == "3 to 12 runs a cell; particle filters carry 50 to 1000 particles"


def told_behind(loaded):
    return behind([view(private(case), loaded.labels) for case in loaded.cases.values()])


def test_nothing_stored(tools):
    assert headline([]) == ["No run is stored in this results folder, so there is nothing to compare yet."]


def bound(kind, reason="", value=(2.0, 3.0), error=(0.0, 0.0)):
    """A bound on one block, with its value and error there."""
    return (
        BlockBound(kind, reason, np.array([value]).T, np.array([error]).T, np.ones((2, 1, 1))),
        np.array(value),
        np.array(error),
    )


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ([], ""),
        ([bound(bounds.POSTERIOR)], " The dashed line without marks is the posterior Cramér-Rao bound."),
        (
            [bound(bounds.POSTERIOR, error=(0.01, 0.06))],
            " The dashed line without marks is the posterior Cramér-Rao bound, its standard error by Monte Carlo up to 2 %.",
        ),
        (
            [bound(bounds.POSTERIOR, error=(0.25, 0.0))],
            " The dashed line without marks is the posterior Cramér-Rao bound, its standard error by Monte Carlo up to 12 %.",
        ),
        ([bound(bounds.POSTERIOR, value=(0.0, 0.0))], " The posterior Cramér-Rao bound is zero."),
        ([bound(bounds.NONE, "no slopes", value=(np.nan, np.nan))], " There is no bound: no slopes."),
        (
            [bound(bounds.KNOWN_MODES, "a track"), bound(bounds.BEST_FIT, "a track")],
            " The dashed line without marks is the Cramér-Rao bound of filters that are told the modes (no strict bound here). "
            "The dotted line without marks is the error predicted by the Gaussian motion that fits the modes best (no bound). "
            "A track.",
        ),
        (
            [bound(bounds.CONDITIONAL, "no noise there")],
            " The dashed line without marks is the covariance linearised along each truth (no bound). No noise there.",
        ),
    ],
)
def test_bounds_are_named_as_what_they_are(given, words):
    assert bounded(given) == words


@pytest.mark.parametrize(
    ("kind", "reason", "head"),
    [
        (bounds.CONDITIONAL, "no noise there", "covariance linearised along each truth (no bound)"),
        (bounds.POSTERIOR, "a given track", "posterior Cramér-Rao bound (no strict bound here)"),
        (bounds.KNOWN_MODES, "", "Cramér-Rao bound of filters that are told the modes"),
        (bounds.BEST_FIT, "", "error predicted by the Gaussian motion that fits the modes best (no bound)"),
    ],
)
def test_a_column_of_numbers_is_headed_as_its_line_is_called(tools, tmp_path, monkeypatch, kind, reason, head):
    loaded = tools.written(tmp_path / "r").add([tools.case()], [tools.scripted()], seconds=0).load()
    stored = loaded.cases["easy"].bounds[0]
    monkeypatch.setattr(CaseResults, "bounds", [dataclasses.replace(stored, kind=kind, reason=reason)])
    page = rendered(loaded)["case-easy.html"]
    assert page.count(f'<th scope="col">{head}</th>') == page.count(f"line without marks is the {head}.") == 2
    assert len(re.findall("<th[^>]*>[^<]*bound", page)) == 2


def test_where_there_is_no_bound_no_column_has_its_name(tools, tmp_path, monkeypatch):
    loaded = tools.written(tmp_path / "r").add([tools.case()], [tools.scripted()], seconds=0).load()
    none = dataclasses.replace(loaded.cases["easy"].bounds[0], kind=bounds.NONE, reason="no noise")
    monkeypatch.setattr(CaseResults, "bounds", [none])
    page = rendered(loaded)["case-easy.html"]
    assert page.count("There is no bound: no noise.") == 4  # below two figures, above the first table and that of the family
    assert not re.search("<th[^>]*>[^<]*bound", page)


def test_what_the_quick_profile_leaves_out_is_said_to_be_so_and_nothing_else_is(variety):
    long = dataclasses.replace(variety.cases["lonely"].card, steps=201)
    short = dataclasses.replace(long, steps=200)
    labels = ["ukf", "sis", "sis[particles=9]", "plain"]
    told = {}
    for card in (long, short):
        case = dataclasses.replace(variety.cases["lonely"], card=card)
        told[card.steps] = [cell.reason for label, cell in view(case, labels).cells.items() if label != "plain"]
    left = "the quick profile leaves it out for the time it takes; the profile whole runs it"
    assert told == {201: ["no run of it is stored", left, "no run of it is stored"], 200: ["no run of it is stored"] * 3}
