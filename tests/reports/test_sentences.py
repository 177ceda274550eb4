"""The sentences at the top of the overview."""

from reports.sentences import headline
from reports.views import private, view


def sentences(loaded):
    return headline([view(private(case), loaded.labels) for case in loaded.cases.values()])


def test_a_tie_and_a_winner_are_told_case_by_case(tools, tmp_path):
    estimators = [tools.scripted("near"), tools.scripted("twin"), tools.scripted("far", shift=500.0)]
    accuracy, runs, cost = sentences(tools.written(tmp_path / "r").add([tools.case()], estimators).load())
    assert accuracy.startswith("On easy, near and twin tie for the smallest RMSE of position (")
    assert accuracy.endswith(" m).")
    assert runs == "Of 12 runs, none failed or was lost and none diverged."
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
        "and 2 diverged (lost on easy, 2 of 4); 1 combination of estimator and case is refused."
    )


def test_many_cases_are_counted(tools, tmp_path):
    estimators = [tools.scripted("near"), tools.scripted("twin"), tools.scripted("far", shift=500.0)]
    cases = [tools.case(f"case {i}") for i in range(5)]
    accuracy, _, cost = sentences(tools.written(tmp_path / "r").add(cases, estimators, runs=3).load())
    assert accuracy == (
        "By RMSE of each case's first block, near leads or ties for the lead in 5 of 5 cases (alone in none); "
        "twin in 5 of 5 cases (alone in none)."
    )
    assert cost == "By time of a step, near leads or ties for the lead in 5 of 5 cases (alone in 5)."


def test_nothing_stored(tools):
    assert headline([]) == ["No run is stored in this results folder, so there is nothing to compare yet."]
