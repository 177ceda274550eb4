"""The page of what changed: as the comparison says, filtered on the page, harmless, and saying so when there is nothing."""

import csv
import dataclasses
import functools
import io
import json
import math
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

import reports
from reports.frame import Frame
from reports.inputs import Inputs
from reports.pages import changes
from suite.changes import IMPROVED, of_case, settled
from suite.compare import UNDECIDED, WORSE
from suite.metrics import METRICS
from tests.reports.conftest import Page, Scripted, Written, small_case

HOSTILE = "<script>alert(1)</script>"


def made(loaded, against):
    """The files of the page and of the changes of cases, without the rest of the site."""
    frame, inputs = Frame.of(loaded), Inputs(loaded, "filterbench report", {}, (), against)
    files = {}
    for part in changes.case_parts(frame, inputs):
        files |= part.make(*part.arguments)
    texts = [files[changes.digest_name(frame, name)] for name in changes.shared(inputs)]
    part = changes.page(frame, inputs, texts)
    assert json.dumps(part.depends)
    return files | part.make(*part.arguments)


def text_of(files):
    return " ".join(Page(files["changes.html"]).text.split())


def written(folder, before, after, cases=None, runs=8):
    """The files of two result sets of the same truth, with the estimators of each, and these result sets."""
    sides = [
        Written(folder / side).add(cases or [small_case()], estimators, runs=runs).load()
        for side, estimators in (("before", before), ("after", after))
    ]
    return made(sides[1], sides[0]), sides


@pytest.fixture
def two(tmp_path):
    """A writer of two result sets: `two(before, after)`."""
    return functools.partial(written, tmp_path)


@pytest.fixture(scope="module")
def changed(tmp_path_factory):
    """One estimator got worse, one better, one came, one went, one no longer refuses, one fails now, one is as it was."""
    e = Scripted
    before = [e("same"), e("shifts"), e("gone"), e("shy", refusal="too hard"), e("frail"), e("mends", shift=60.0)]
    after = [e("same"), e("shifts", shift=80.0), e("new"), e("shy"), e("frail", bad=(1,)), e("mends")]
    return written(tmp_path_factory.mktemp("changed"), before, after)


def test_without_other_results_the_page_says_how_to_get_it(tools, tmp_path):
    files = made(tools.written(tmp_path / "r").add([tools.case()], [tools.scripted()]).load(), None)
    assert list(files) == ["changes.html"]
    assert "filterbench report --against OTHER_RESULTS" in text_of(files)
    assert Page(files["changes.html"]).tags.count("input") == 0


def test_the_csv_file_says_what_the_comparison_says(changed):
    files, (before, after) = changed
    found = of_case(before.cases["easy"], after.cases["easy"], changes.COMPARED)
    told = settled(found.changes)
    rows = list(csv.DictReader(io.StringIO(files["data/changes.csv"])))
    assert len(rows) == len(told) > 20
    for row, change in zip(rows, told, strict=True):
        names = (change.estimator, change.metric, change.block, change.verdict)
        assert (row["estimator"], row["metric"], row["block"], row["verdict"]) == names
        for name, value in (("before", change.before), ("after", change.after), ("holm", change.holm)):
            assert (float(row[name] or "nan") == value) or math.isnan(value)
        scores = [side.cases["easy"].cells[change.estimator].scores(METRICS[change.metric]) for side in (before, after)]
        if change.estimator != "frail":
            values = [score[change.block].value for score in scores]
            assert [change.before, change.after] == pytest.approx(values, rel=1e-12, nan_ok=True)
    verdicts = {(c.estimator, c.metric): c.verdict for c in told if c.block in ("position", "state")}
    assert verdicts["shifts", "rmse"] == WORSE
    assert verdicts["mends", "rmse"] == IMPROVED
    assert not [c for c in told if c.estimator == "same" and not METRICS[c.metric].timed]


def test_errors_are_compared_by_themselves_and_not_by_a_bound_that_may_have_changed(changed):
    files, _ = changed
    compared = {row["metric"] for row in csv.DictReader(io.StringIO(files["data/changes.csv"]))}
    assert "rmse" in compared
    assert not compared & {name for name, metric in METRICS.items() if metric.family == "bound"}


def test_the_page_shows_the_verdicts_of_the_largest_changes(changed):
    files, _ = changed
    page = Page(files["changes.html"])
    rows = list(csv.DictReader(io.StringIO(files["data/changes.csv"])))
    shown = [found["data-verdict"] for tag, found in page.attributes if tag == "tr" and "data-verdict" in found]
    for verdict in {row["verdict"] for row in rows}:
        held = sum(row["verdict"] == verdict for row in rows)
        assert shown.count(verdict) == min(held, changes.MOST if verdict in (IMPROVED, WORSE) else changes.FEW)
    assert shown == sorted(shown, key=changes.ORDER.index)
    counts = {verdict: sum(row["verdict"] == verdict for row in rows) for verdict in (IMPROVED, WORSE, UNDECIDED)}
    words = f"{counts[IMPROVED]} improved, {counts[WORSE]} got worse, {counts[UNDECIDED]} are undecided"
    assert words in text_of(files)
    tests = sum(row["p"] != "" for row in rows)
    assert f"Over {tests} tests on this page" in text_of(files)
    worst = max((row for row in rows if row["verdict"] == WORSE), key=lambda row: float(row["size"] or 0))
    first = next(i for i, cell in enumerate(page.cells) if cell.strip() == "p, adjusted") + 1
    assert page.cells[first].split() == [worst["estimator"]]


def test_what_came_and_went_is_named(changed):
    text = text_of(changed[0])
    for words in (
        "new : new on easy",
        "gone : gone on easy",
        "no longer refused : shy on easy: refused (too hard) before, done after",
        "failures came : frail on easy: done before, 1 failed of 8 runs (step 3: gone) after",
        "8 runs of the same truth and measurements before and after, compared run by run",
    ):
        assert words in text, words


def test_numbers_survive_their_file(two, tools):
    e = tools.scripted
    _, (before, after) = two([e("a"), e("b", variance=0.0)], [e("a", shift=1e150), e("b", value=math.nan)])
    found = of_case(before.cases["easy"], after.cases["easy"], changes.COMPARED)
    text = changes.encoded(found)
    assert "NaN" not in text
    assert "Infinity" not in text
    np.testing.assert_equal(dataclasses.asdict(changes.decoded(text)), dataclasses.asdict(found))
    assert changes.encoded(changes.decoded(text)) == text


def test_the_same_results_are_unchanged(two, tools):
    files, _ = two([tools.scripted()], [tools.scripted()])
    text = text_of(files)
    assert re.search(
        r"Of (\d+) scores that both result sets hold, 0 improved, 0 got worse, 0 are undecided and \1 are the same", text
    )
    assert "data/changes.csv" not in files
    assert "Both hold the same cases and estimators" in text


def test_nothing_in_common_is_said(tools, tmp_path):
    one, other = (tools.written(tmp_path / n).add([tools.case(n)], [tools.scripted()]).load() for n in ("one", "other"))
    files = made(one, other)
    assert list(files) == ["changes.html"]
    assert "have no case in common" in text_of(files)
    assert "new cases : one" in text_of(files)
    assert "cases gone : other" in text_of(files)


def test_another_problem_of_the_same_name_is_not_compared(tools, tmp_path):
    one, other = (
        tools.written(tmp_path / name).add([tools.case(blocks=(name, "speed"))], [tools.scripted()]).load()
        for name in ("p", "q")
    )
    assert "Nothing is compared: before and after are not the same problem: they differ in blocks, divergence." in text_of(
        made(one, other)
    )


def test_no_name_becomes_markup(two, tools):
    e = tools.scripted
    files, _ = two([e(HOSTILE), e("x", refusal=HOSTILE)], [e(HOSTILE, shift=50.0), e("x")], [tools.case(HOSTILE)], 3)
    page = Page(files["changes.html"])
    assert [found.get("src", "")[:7] for tag, found in page.attributes if tag == "script"] == ["static/"] * page.tags.count(
        "script"
    )
    assert HOSTILE in page.text
    assert len(page.ids) == len(set(page.ids))


def test_a_case_is_compared_anew_only_when_a_block_of_either_side_is_new(tools, tmp_path):
    one, other = (tools.written(tmp_path / n).add([tools.case()], [tools.scripted()]).load() for n in ("one", "other"))

    def key(loaded, against):
        (part,) = changes.case_parts(Frame.of(loaded), Inputs(loaded, "", {}, (), against))
        return part.key

    assert key(one, other) == key(one, other)
    again = tools.written(tmp_path / "other").add([tools.case()], [tools.scripted("more")]).load()
    assert key(one, again) != key(one, other)
    assert key(again, one) != key(one, again)


@pytest.fixture
def folder(changed, tmp_path):
    """The page and what it needs, on disk."""
    out = tmp_path / "page"
    shutil.copytree(Path(reports.__file__).parent / "static", out / "static")
    for name, text in changed[0].items():
        (out / name).parent.mkdir(exist_ok=True)
        (out / name).write_text(text, encoding="utf-8")
    return out


def test_a_choice_shows_one_verdict_and_stays_in_the_address(visit, folder):
    page = visit("changes.html", folder)
    rows, counts = page.locator("tr[data-verdict]"), {}
    every = rows.count()
    for words, verdict in (("only worse", WORSE), ("only improved", IMPROVED), ("undecided", UNDECIDED)):
        page.get_by_label(words, exact=True).check()
        seen = [row.get_attribute("data-verdict") for row in rows.all() if row.is_visible()]
        assert set(seen) == {verdict}
        assert page.url.endswith(f"#verdict={verdict}")
        counts[verdict] = len(seen)
    assert 0 < counts[WORSE] < every
    page.go_back()
    assert page.get_by_label("only improved", exact=True).is_checked()
    again = visit(f"changes.html#verdict={WORSE}", folder)
    assert again.get_by_label("only worse", exact=True).is_checked()
    assert sum(row.is_visible() for row in again.locator("tr[data-verdict]").all()) == counts[WORSE]
    again.locator("input:checked").focus()
    again.keyboard.press("ArrowLeft")
    assert again.get_by_label("only improved", exact=True).is_checked()
    strange = visit("changes.html#verdict=nonsense", folder)
    assert sum(row.is_visible() for row in strange.locator("tr[data-verdict]").all()) == every


def test_a_narrow_page_of_changes_does_not_scroll_sideways(visit, folder):
    page = visit("changes.html", folder, viewport={"width": 390, "height": 800})
    assert page.evaluate("document.documentElement.scrollWidth") <= 390


def test_where_no_change_has_the_verdict_the_page_says_so(visit, tools, two, tmp_path):
    files, _ = two([tools.scripted()], [tools.scripted(shift=80.0)])
    shutil.copytree(Path(reports.__file__).parent / "static", tmp_path / "page" / "static")
    (tmp_path / "page" / "changes.html").write_text(files["changes.html"], encoding="utf-8")
    page = visit(f"changes.html#verdict={IMPROVED}", tmp_path / "page")
    assert page.locator("[data-nothing]").is_visible()
    page.get_by_label("all", exact=True).check()
    assert not page.locator("[data-nothing]").is_visible()


def test_other_results_that_cannot_be_compared_with_are_named(cli, tools, tmp_path):
    refusing = tools.scripted(refusal="too hard")
    for name in ("r", "other"):
        tools.written(tmp_path / name).add([tools.case()], [refusing])
    (tmp_path / "empty").mkdir()
    (tmp_path / "pictures").mkdir()
    (tmp_path / "pictures" / "cat.png").write_text("a cat")

    def asked(against, out="site"):
        return cli("report", "--results", tmp_path / "r", "--against", tmp_path / against, "--out", tmp_path / out, "--jobs", 1)

    for against, out, words in (
        ("r", "site", "is the folder of the results themselves"),
        ("../" + tmp_path.name + "/r", "site", "is the folder of the results themselves"),
        ("nowhere", "site", "no results in"),
        ("empty", "site", "no results in"),
        ("pictures", "site", "holds other files and no results"),
        ("other", "other/site", "lies in the results folder"),
    ):
        said = asked(against, out)
        assert (said.code, len(said.errors), said.out) == (2, 1, "")
        assert words in said.errors[0]
        assert not (tmp_path / out).exists()
