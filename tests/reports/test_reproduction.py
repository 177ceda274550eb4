"""The page of published figures: never stronger than the record, and right about these results."""

import csv
import io
import math
import re

import pytest

from reports.pages import reproduction
from reports.text import within
from suite import results
from suite.metrics import METRICS, Score
from suite.published import NOT_REPRODUCED, REPRODUCED, Finding, Published
from suite.store import Store
from suite.verdicts import Verdict, distance
from tests.reports.conftest import Scripted, Written, rendered, small_case
from tests.reports.test_estimators import site_of, words_of

ALIKE = "Both are `made up` <b>here</b>."


def published(estimator="plain", quantity="error", value=15.0, where="Table 1", note="", metric="rmse", runs=100, unit="m"):
    """A published figure of the position."""
    return Published(
        estimator, quantity, value, unit, where, note, metric, "runs" if metric == "divergence" else "position", runs
    )


def page_of(loaded, findings):
    """The files of the page of some results and what was found before."""
    (part,) = reproduction.parts(site_of(loaded, findings))
    return part.make(*part.arguments)


def rows(page):
    """The cells of the tables of printed numbers, row by row, as texts."""
    bodies = re.findall(r'<table class="printed">.*?</table>', page, re.S)
    found = [row for body in bodies for row in re.findall(r"<tr>\s*<td.*?</tr>", body, re.S)]
    return [[words_of(cell) for cell in re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row, re.S)] for row in found]


@pytest.fixture(scope="module")
def paper(tmp_path_factory):
    """Two scenarios of a paper, and a case of another one with nothing printed."""
    first = (
        published(quantity="near"),
        published(quantity="far", value=1e5),
        published("absent[particles=3]", "of nobody"),
        published(quantity="unmeasured", metric="", value=3.5, unit="mixed", runs=0),
        published(quantity="share that is lost", metric="divergence", value=0.0, unit=""),
        published(quantity="a claim", value=None, note="said to be *good*"),
        published("choosy", "of one that refuses"),
    )
    cases = [
        small_case("scene/1", published=first, reference="A. B. First, C. von Second, A title, 1999"),
        small_case("scene/2", published=(published(value=None),), reference="A. B. First, C. von Second, A title, 1999"),
        small_case("alone", published=(), reference="Another"),
    ]
    chosen = [Scripted("plain"), Scripted("choosy", refusal="too hard")]
    return Written(tmp_path_factory.mktemp("paper") / "r").add(cases, chosen, runs=6, seconds=0).load()


FINDINGS = {
    ("scene/1", "plain", "near"): Finding(REPRODUCED, ALIKE, (13.5, 12.0, 15.3), 50),
    ("scene/1", "plain", "far"): Finding(REPRODUCED, ALIKE, (9.9e4, 9.5e4, 1.1e5), 4),
    ("scene/1", "absent[particles=3]", "of nobody"): Finding(NOT_REPRODUCED, "It is gone.", (1.0, 0.9, 1.1), 20),
    ("elsewhere", "plain", "error"): Finding(NOT_REPRODUCED, "Not run here.", (2.0, 1.9, 2.2), 30),
}


@pytest.fixture(scope="module")
def files(paper):
    return page_of(paper, FINDINGS)


def test_each_figure_stands_beside_the_record_and_these_results(paper, files):
    cell = paper.cases["scene/1"].cells["plain"]
    score = cell.scores(METRICS["rmse"])["position"]
    here = within(score.value, score.low, score.high, "m")
    found = {row[2].removesuffix(" Table 1"): row for row in rows(files["reproduction.html"])}
    assert list(found) == [
        "near", "far", "of nobody", "unmeasured", "share that is lost", "of one that refuses",
    ]  # fmt: skip
    assert found["near"][3:5] == ["15 m 100 runs", "14 (12 to 15) m 50 runs"]
    assert found["near"][5] == f"{here} 6 runs; within chance of what is printed"
    assert found["near"][6].startswith("reproduced ")
    assert found["far"][4] == " ".join(within(9.9e4, 9.5e4, 1.1e5, "m").split()) + " 4 runs"
    assert found["far"][5].endswith("6 runs; beyond chance of what is printed")
    assert found["far"][6].startswith("reproduced these results contradict the record")
    assert found["of nobody"][5] == "no such estimator was run"
    assert found["of one that refuses"][4:6] == ["no value", "refused"]
    assert found["of one that refuses"][6] == "not examined"
    assert found["unmeasured"][3:6] == ["3.5 runs not stated", "no value", "no metric here measures it"]
    assert found["share that is lost"][5].startswith("0 (0 to 0.")


def test_the_summary_counts_verdicts_and_contradictions(files):
    line = re.search(r'<tr><th scope="row"><a href="#paper_1">(.*?)</tr>', files["reproduction.html"], re.S)[1]
    assert words_of(line) == "First and von Second: scene 6 2 2 1 0 5 1"
    assert 'id="paper_2"' not in files["reproduction.html"]


def test_a_reason_that_comes_again_is_named_by_its_first_row(files):
    page = files["reproduction.html"]
    assert page.count("Both are <code>made up</code> &lt;b&gt;here&lt;/b&gt;.") == 1
    assert rows(page)[1][6].endswith("as for row 1")


def test_every_case_with_something_printed_can_be_led_to(files):
    page = files["reproduction.html"]
    assert [page.count(f'id="{stem}"') for stem in ("scene-1", "scene-2", "alone")] == [1, 1, 0]
    assert "no number or claim is recorded" in page
    assert '<a href="case-alone.html">alone</a>' in page.partition("no number or claim is recorded")[2]


def test_claims_are_a_list_and_no_rows(files):
    page = files["reproduction.html"]
    claims = re.findall(r'<ul class="claims".*?</ul>', page, re.S)
    assert len(claims) == 3  # of two cases, and what was recorded elsewhere
    assert "plain , a claim (Table 1). Said to be *good*." in words_of(claims[0])
    assert not any("claim" in cell for row in rows(page) for cell in row)


def test_what_was_recorded_of_other_cases_is_told_apart(files):
    told = words_of(files["reproduction.html"].partition('id="not_here"')[2])
    assert "elsewhere: 1 figure, 1 not reproduced" in told
    assert "found 2.0 (1.9 to 2.2), 30 runs . Not run here." in told.replace("runs.", "runs .")
    assert "near" not in told


def test_the_figure_has_the_ratios_to_what_is_printed(paper, files):
    header, *lines = csv.reader(io.StringIO(files["data/reproduction-found-over-printed-1.csv"]))
    found = {line[0]: dict(zip(header[1:], line[1:], strict=True)) for line in lines}
    score = paper.cases["scene/1"].cells["plain"].scores(METRICS["rmse"])["position"]
    assert list(found) == ["1 plain", "2 plain", "3 absent[particles=3]"]
    assert float(found["1 plain"]["recorded over printed"]) == pytest.approx(0.9)
    assert float(found["1 plain"]["recorded, high end"]) == pytest.approx(1.02)
    assert float(found["1 plain"]["these results over printed"]) == pytest.approx(score.value / 15, rel=1e-5)
    assert float(found["2 plain"]["these results, low end"]) == pytest.approx(score.low / 1e5, rel=1e-5)
    assert found["3 absent[particles=3]"]["these results over printed"] == ""


@pytest.mark.parametrize(
    ("figure", "ours", "runs"),
    [
        (published(value=10.0), (9.0, 8.0, 10.2), 50),
        (published(value=0.0089), (0.02, 0.0199, 0.0201), 1000),
        (published(value=37.4, runs=0), (30.0, 12.0, 90.0), 3),
        (published(value=162.05, runs=1), (110.0, 97.0, 120.0), 20),
    ],
)
def test_the_band_ends_where_the_rule_of_the_verdicts_does(figure, ours, runs):
    """A value with the same relative interval just inside counts as a repetition's by that rule, just outside it does not."""
    verdict = Verdict("case", figure, Finding(REPRODUCED, "so", ours, runs), None)
    low, high = reproduction._band(reproduction.Row(verdict, 1, "", 0))
    assert low == pytest.approx(1 / high)
    for ratio, inside in ((high * 0.999, True), (high * 1.001, False), (low * 1.001, True), (low * 0.999, False)):
        factor = ratio * figure.value / ours[0]
        found = distance(Score(*(factor * end for end in ours), "m", runs, runs), figure)
        # Where what is allowed is wide, the rule says of a value inside that it cannot tell.
        assert (found <= 1 or math.isnan(found)) is inside


def test_without_a_record_the_band_is_that_of_these_results():
    score = Score(9.0, 8.0, 10.2, "m", 50, 50)
    of_record = Verdict("case", published(), Finding(REPRODUCED, "so", (9.0, 8.0, 10.2), 50), None)
    of_results = Verdict("case", published(), None, score)
    bands = [reproduction._band(reproduction.Row(verdict, 1, "", 0)) for verdict in (of_record, of_results)]
    assert bands[0] == pytest.approx(bands[1])
    unmeasured = Verdict("case", published(metric=""), Finding(REPRODUCED, "so", (9.0, 8.0, 10.2), 50), None)
    assert reproduction._band(reproduction.Row(unmeasured, 1, "", 0)) is None


@pytest.mark.parametrize(
    ("reference", "cases", "title"),
    [
        ("A. Pavlov, M. G. S. Bruno, Filtro de partículas", ["ballistic/1", "ballistic/2"], "Pavlov and Bruno: ballistic"),
        ("E. N. Lorenz, Predictability", ["lorenz96/10"], "Lorenz: lorenz96/10"),
        ("P.-J. Nord, A title", ["target/one", "target/one-model"], "Nord: target/one"),
        ("A book", ["easy", "early"], "easy and early"),
        ("", ["x"], "x"),
    ],
)
def test_a_paper_is_named_by_its_authors_and_its_cases(reference, cases, title):
    assert reproduction._title(reference, cases) == title


def test_only_what_may_change_makes_the_page_again(paper):
    def key(findings):
        (part,) = reproduction.parts(site_of(paper, findings))
        return part.key

    changed = FINDINGS | {("elsewhere", "plain", "error"): Finding(REPRODUCED, "Run again.", (2.0, 1.9, 2.2), 30)}
    assert key(FINDINGS) == key(dict(FINDINGS))
    assert key(FINDINGS) != key(changed)


def test_without_published_figures_the_page_says_so(tmp_path):
    Store(tmp_path / "empty", create=True)
    files = rendered(results.load(tmp_path / "empty"))
    assert "No case of these results has a published figure." in files["reproduction.html"]
    assert "At a glance" not in files["reproduction.html"]


def test_records_alone_are_told(tmp_path):
    Store(tmp_path / "empty", create=True)
    page = rendered(results.load(tmp_path / "empty"), findings=FINDINGS)["reproduction.html"]
    assert words_of(page).count("not reproduced") == 4  # two in the heads of their cases, two of the figures
    assert "At a glance" not in page
