"""The tables and the text of a case's page, held against what the commands print."""

import dataclasses
import math
import re
import shlex
from types import SimpleNamespace

import numpy as np
import pytest

import suite.cli
import suite.run
from reports.frame import Frame
from reports.pages import again, case, differences, faults, problem, scores
from reports.views import private, view
from suite import results
from suite.case import Truth
from suite.metrics import Score
from suite.published import Finding, Published
from suite.verdicts import Verdict
from tests.conftest import TINY, InlinePool
from tests.reports import pairs
from tests.reports.conftest import Scripted, Written, small_case
from tests.reports.pairs import agrees, noisy, printed, rows_of
from tests.reports.test_faults import plain


@pytest.fixture(scope="module", autouse=True)
def undrawn():
    with pairs.undrawn():
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return pairs.written(tmp_path_factory.mktemp("pairs"))


@pytest.fixture(scope="module")
def loaded(folder):
    return results.load(folder)


@pytest.fixture(scope="module")
def shown(loaded):
    return view(private(loaded.cases["easy"]), loaded.labels)


@pytest.fixture(scope="module")
def files(loaded):
    return case.files(Frame.of(loaded), loaded.cases["easy"], {})


@pytest.fixture(scope="module")
def page(files):
    return files["case-easy.html"]


def test_the_first_table_says_what_the_command_score_prints(page, folder, capsys):
    asked = ("rmse", "crlb-ratio", "nees", "divergence", "latency")
    said = printed(capsys, "score", "--results", folder, "-m", *asked)
    held = {(row["estimator"], row["metric"], row["block"]): row for row in said if row.get("metric")}
    shown = {"position": "rmse", "velocity": "rmse"}
    rows = rows_of(page, "scores-first")
    assert list(rows) == ["first", "same", "sharp", "blunt", "nearly", "frail"]
    for label, (came, *cells) in rows.items():
        assert came.startswith("6 of 8 2 lost" if label == "frail" else "8 of 8")
        keys = [*((metric, block) for block, metric in shown.items()), ("crlb-ratio", "position")]
        keys += [("nees", "state"), ("divergence", "runs"), ("latency", "step")]
        for (metric, block), words in zip(keys, cells, strict=True):
            row = held[label, metric, block]
            agrees(words, row["value"], row["low"], row["high"], 100.0 if metric == "divergence" else 1.0)
            mark = {"best": "best", "tied": "among the best", "": ""}[row["standing"]]
            assert (mark in words) if mark else ("best" not in words.split())
            assert ("6 of 8 runs" in words) == (row["runs"] == 6)


def far(rng):
    """A truth so far away that errors of some metres are rounding; its speed is not."""
    drawn = small_case("easy").generate(rng)
    return Truth(drawn.x + np.array([1e12, 0, 1e12, 0])[:, None], drawn.y + 1e12)


def test_errors_that_are_rounding_are_called_so_and_neither_ranked_nor_compared(tmp_path):
    estimators = [noisy("sharp", 1.0), noisy("blunt", 30.0)]
    written = Written(tmp_path / "r").add([small_case("easy", generate=far)], estimators, runs=6)
    shown = view(private(written.load().cases["easy"]), ["sharp", "blunt"])
    assert not shown.cells["sharp"].mark(("rmse", "position"))
    table = scores.first(shown)
    for cell, entries in table.rows:
        position, velocity = entries[:2]
        assert (position.words, position.mark, position.flags) == (scores.NEGLIGIBLE, "", ())
        assert velocity.words.value != "negligible"
        assert bool(velocity.mark) == (cell.label == "sharp")
    found = differences.differences(shown)
    assert found.first["blunt"].words[-1] == "both negligible"
    assert found.rows["sharp", "velocity"][0].words[-1] == "worse"


def test_the_limit_of_rounding_is_that_of_the_block(shown):
    """A part in a thousand million of the largest value of each component, together."""
    largest = np.abs(np.concatenate([truth.x for truth in shown.results.truth_of.values()])).max(0)
    for name, at in (("position", [0, 2]), ("velocity", [1, 3])):
        assert shown.rounding[name] == pytest.approx(1e-9 * math.sqrt((largest[at] ** 2).sum()))


def test_refused_ones_stand_below_the_table_by_their_reason(page):
    assert "Refused (the model is too hard): choosy , picky ." in plain(page)
    assert page.count("the model is too hard") == 1
    for label in ("choosy", "picky", "first"):
        assert page.count(f'id="{label}"') == 1
    assert '<span id="choosy"><a href="estimator-choosy.html">choosy</a></span>' in page


def test_those_not_run_are_named_below_the_table(loaded, folder, tmp_path):
    Written(folder.parent / "more").add([small_case("easy")], [Scripted("first")], runs=2)
    other = results.load(folder.parent / "more")
    made = case.files(Frame.of(loaded), other.cases["easy"], {})["case-easy.html"]
    assert "Not run (no run of it is stored): same , sharp , blunt , nearly , frail , choosy , picky ." in plain(made)
    assert made.count('id="sharp"') == 1


def test_surviving_runs_stand_behind_all_runs_and_only_where_some_diverged(shown, tmp_path):
    limit = small_case("easy", divergence=dataclasses.replace(small_case("easy").divergence, limit=50.0))
    loaded = Written(tmp_path / "r").add([limit], [noisy("sharp", 1.0), noisy("blunt", 40.0, 1)], runs=6).load()
    some = view(private(loaded.cases["easy"]), loaded.labels)
    assert 0 < some.cells["blunt"].scores["rmse", "position, surviving runs"].runs < 6
    heads = [column.under for column in scores.families(some)[0].columns if column.head == "RMSE"]
    assert heads == ["position", "position, surviving runs", "velocity", "velocity, surviving runs"]
    assert not any("surviving" in column.key[1] for table in scores.families(shown) for column in table.columns)
    assert not any("surviving" in column.key[1] for column in scores.first(some).columns)


def test_what_stands_in_place_of_intervals_is_said_once(tmp_path):
    loaded = Written(tmp_path / "r").add([small_case("easy")], [noisy("a", 1.0), noisy("b", 2.0)], runs=1).load()
    table = scores.first(view(private(loaded.cases["easy"]), loaded.labels))
    assert table.columns[0].under == "position; one run"
    assert {entries[0].words.interval for _, entries in table.rows} == {""}


def test_reasons_are_counted_and_the_same_words_are_said_once(loaded):
    shown = view(private(loaded.cases["easy"]), loaded.labels)
    (found,) = [w for w in faults.warned(shown) if "frail" in w.labels]
    assert found.reasons == ("gone (2 runs, step 3)",)
    assert found.labels == ["frail"]
    alike = dataclasses.replace(shown.cells["frail"], label="twin")
    shown.results.cells["twin"] = shown.results.cells["frail"]
    (found,) = [w for w in faults.warned(dataclasses.replace(shown, cells=shown.cells | {"twin": alike})) if w.reasons]
    assert found.labels == ["frail", "twin"]


@pytest.mark.parametrize(
    ("reasons", "told"),
    [
        (["step 9: gone", "step 7: torn", "step 3: torn"], ["torn (2 runs, steps 3 to 7)", "gone (1 run, step 9)"]),
        (["gone", "step 3: gone"], ["gone (2 runs)"]),
        (["a: b"] * 3, ["a: b (3 runs)"]),
    ],
)
def test_steps_of_reasons_are_told_where_all_are_known(shown, reasons, told):
    estimate = SimpleNamespace(status=["failed"] * len(reasons) + ["ok"], reason=[*reasons, ""])
    held = SimpleNamespace(runs=list(range(len(reasons) + 1)), estimate=estimate)
    cell = dataclasses.replace(shown.cells["first"], failures=(("estimate", reasons[0], ()), ("timing", "slow", ())))
    case = SimpleNamespace(results=SimpleNamespace(cells={"first": held}), cells={"first": cell})
    (found,) = faults.warned(case)
    assert list(found.reasons) == [*told, "while timed: slow"]


def test_what_is_stated_is_told_apart_from_what_is_assumed(loaded):
    card = loaded.cases["easy"].card
    words = ("Stated in the paper: all.", "Not stated: the rest.", "Corrected: a sign that is Stated wrong.")
    assert problem.assumptions(dataclasses.replace(card, assumptions=words)) == ([words[0]], [*words[1:]])
    assert problem.assumptions(dataclasses.replace(card, assumptions=words[1:])) == ([], [*words[1:]])
    results_ = dataclasses.replace(loaded.cases["easy"], card=dataclasses.replace(card, assumptions=words))
    results_.cells = {}
    text = plain(case.files(Frame.of(loaded), results_, {})["case-easy.html"])
    assert re.search(
        r"Stated by the reference Stated in the paper: all\. Assumed or corrected here.* Not stated: the rest\.", text
    )


def test_a_published_figure_begins_with_its_verdict():
    figure = Published("sir", "RMSE", 8.25, "m", "Table 2", "read off", "rmse", "position", 50)
    finding = Finding("reproduced", "it fits", (8.1, 7.9, 8.4), 50)
    row = problem._figure(Verdict("easy", figure, finding, Score(20.0, 19.0, 21.0, "m", 60, 60)))
    assert dataclasses.astuple(row) == (
        "reproduced", True, "it fits", "sir", "RMSE", "Table 2; read off", "8.25 m", "50 runs", "8.1 (7.9 to 8.4) m, 50 runs",
        "20 (19 to 21) m, 60 runs",
    )  # fmt: skip
    claim = problem._figure(Verdict("easy", dataclasses.replace(figure, value=None, runs=0), None, None))
    assert (claim.verdict, claim.value, claim.found, claim.here, claim.printed_runs) == ("not examined", "a claim", "", "", "")
    assert problem.in_short([row, claim]) == (
        "Of 2 published figures: 1 reproduced and 1 not examined. These results contradict 1 verdict."
    )
    assert problem.in_short([claim]) == "Of 1 published figure: 1 not examined."


def stored(command, case="easy"):
    return SimpleNamespace(meta={"command": command})


def test_the_command_tells_plug_ins_profile_and_each_number_of_runs(shown):
    cells = {
        "a b": stored("filterbench run --plugin 'my file.py' --profile=paper"),
        "c": stored("filterbench run --profile paper"),
    }
    held = SimpleNamespace(
        cells={label: SimpleNamespace(estimates=[entry], timings=[]) for label, entry in cells.items()},
        seed=7,
        calm=SimpleNamespace(card=SimpleNamespace(name="easy/calm")),
    )
    views = {
        label: dataclasses.replace(shown.cells["first"], label=label, status=status, total=total, failures=())
        for label, status, total in (("a b", "done", 8), ("c", "done", 2), ("d", "refused", 0), ("e", "not run", 0))
    }
    case = SimpleNamespace(results=held, cells=views, runs=8, card=SimpleNamespace(name="easy"))
    said = again.command(case)
    rest = "--seed 7 --profile paper --plugin 'my file.py'"
    assert said.splitlines() == [
        f"filterbench run -c 'easy' 'easy/calm' -e 'a b' d --runs 8 {rest}",
        f"filterbench run -c 'easy' 'easy/calm' -e c --runs 2 {rest}",
    ]
    cells["c"].meta["command"] = "filterbench run"
    assert "--profile" not in again.command(
        SimpleNamespace(results=held, cells=views, runs=8, card=SimpleNamespace(name="easy"))
    )


def test_the_command_of_the_page_gives_the_same_numbers_in_a_fresh_folder(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(suite.run, "ProcessPool", InlinePool)
    first, fresh = tmp_path / "first", tmp_path / "fresh"
    asked = ["-c", "tiny", "-e", "smoothed[jitter=0.3]", "bootstrap[particles=30]", "--runs", "3", "--seed", "5"]
    assert suite.cli.main(["run", *asked, "--plugin", TINY, "--results", str(first)]) == 0
    loaded = results.load(first)
    page = case.files(Frame.of(loaded), loaded.cases["tiny"], {})["case-tiny.html"]
    told = shlex.split(plain(re.search(r"Run it again</h2>.*?<code>(.*?)</code></pre>", page, re.S)[1]))
    assert told[:2] == ["filterbench", "run"]
    assert suite.cli.main([*told[1:], "--results", str(fresh)]) == 0
    capsys.readouterr()
    metrics = ["-m", "rmse", "nees", "crlb-ratio", "divergence"]
    numbers = [printed(capsys, "score", "--results", folder, *metrics) for folder in (first, fresh)]
    assert numbers[0] == numbers[1]
    assert len(numbers[0]) > 8


def test_names_lead_to_the_pages_of_estimators(page):
    for label in ("first", "frail"):
        assert page.count(f'<a class="name" href="estimator-{label}.html">{label}</a>') >= 2


def test_numbers_to_sort_by_are_those_of_the_cells(page, shown):
    sorts = re.findall(r'<tr id="sharp".*?</tr>', page, re.S)[0]
    found = re.findall(r'data-sort="([^"]*)"', sorts)
    assert float(found[0]) == 1.0
    assert float(found[1]) == pytest.approx(shown.cells["sharp"].scores["rmse", "position"].value, rel=1e-5)
    assert scores.sortable(math.nan) == ""
    assert scores.sortable(math.inf) == "inf"
