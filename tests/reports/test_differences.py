"""The table of paired differences: what `filterbench compare` prints, against any reference, in any browser."""

import json
import re

import pytest

from reports.frame import Frame
from reports.pages import case, differences
from reports.site import _static
from reports.views import view
from suite import results
from tests.reports import pairs
from tests.reports.conftest import Scripted, Written, read, small_case
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
def files(folder):
    loaded = results.load(folder)
    return case.files(Frame.of(loaded), loaded.cases["easy"], {})


@pytest.fixture(scope="module")
def page(files):
    return files["case-easy.html"]


def test_differences_are_what_the_command_compare_prints_for_every_reference(files, folder, capsys):
    script = files["data/easy-differences.js"]
    data = json.loads(
        re.fullmatch(r'window.dispatchEvent\(new CustomEvent\("differences", \{ detail: (.*) \}\)\);\n', script)[1]
    )
    labels, blocks = data["labels"], data["blocks"]
    assert (labels, blocks) == (["first", "same", "sharp", "blunt", "nearly", "frail"], ["position", "velocity"])
    verdicts = set()
    for reference, of_blocks in zip(labels, data["rows"], strict=True):
        said = printed(capsys, "compare", reference, "--results", folder)
        for block, rows in zip(blocks, of_blocks, strict=True):
            held = {row["estimator"]: row for row in said if row["block"] == block}
            assert [labels[place] for place, *_ in rows] == [label for label in labels if label != reference]
            for place, (difference, ratio, wins, p, runs, verdict), sorts, kind in rows:
                row = held[labels[place]]
                if difference == "rounding":
                    assert max(abs(row[f"difference{end}"]) for end in ("", "_low", "_high")) <= 1e-6 * row["reference_value"]
                    assert {reference, labels[place]} <= {"first", "same", "frail"}
                else:
                    agrees(difference, row["difference"], row["difference_low"], row["difference_high"])
                    agrees(ratio, row["ratio"], row["ratio_low"], row["ratio_high"])
                agrees(wins, row["wins"], row["wins_low"], row["wins_high"], 100.0)
                assert row["holm"] < 0.001 if p == "< 0.001" else float(p) == pytest.approx(row["holm"], rel=0.05)
                assert verdict.replace("equal within 5 %", "equal") == row["verdict"]
                assert kind == (row["verdict"].split()[0] if row["verdict"] != "undecided" else "")
                left = f", left out {row['left_out']} and {row['reference_left_out']}"
                assert runs == f"{row['runs']}{left if row['runs'] < 8 else ''}"
                assert float(sorts[0]) == pytest.approx(row["difference"], rel=1e-4)
                verdicts.add(verdict.partition(" where")[0])
    assert verdicts == {"better", "worse", "equal within 5 %", "undecided"}


def test_without_scripts_the_differences_are_against_the_first_that_competes(files, page):
    script = json.loads(re.search(r"detail: (.*) \}\)\);", files["data/easy-differences.js"])[1])
    rows = rows_of(page, "differences-table")
    assert rows.pop("first") == ["", "", "", "", "", "the reference"]
    expected = {script["labels"][place]: words for place, words, *_ in script["rows"][0][0]}
    assert rows == {label: [plain(word) for word in words] for label, words in expected.items()}
    assert re.search(r"RMSE of <span data-of>position</span>.*?<strong data-reference>first</strong>", page, re.S)
    assert "filterbench compare first -c &#39;easy&#39; -m rmse" in page


def test_a_reference_with_a_fault_is_not_shown_first(tmp_path):
    estimators = [Scripted("frail", bad=(1,), status="lost"), noisy("sound", 1.0), noisy("sharp", 0.1)]
    loaded = Written(tmp_path / "r").add([small_case("easy")], estimators, runs=4).load()
    assert differences.differences(view(loaded.cases["easy"], loaded.labels)).start == "sound"


@pytest.mark.parametrize(("runs", "verdict", "interval"), [(1, "undecided", False), (2, "undecided", True)])
def test_few_runs_decide_nothing(tmp_path, runs, verdict, interval):
    estimators = [noisy("sharp", 0.1), noisy("blunt", 9.0)]
    loaded = Written(tmp_path / "r").add([small_case("easy")], estimators, runs=runs).load()
    (row,) = differences.differences(view(loaded.cases["easy"], loaded.labels)).first.values()
    assert (row.words[-1], row.kind) == (verdict, "")
    assert (" to " in row.words[0]) == interval


def test_one_estimator_has_nothing_to_differ_from(tmp_path):
    loaded = Written(tmp_path / "r").add([small_case("easy")], [Scripted("only")], runs=2).load()
    assert differences.differences(view(loaded.cases["easy"], loaded.labels)) is None
    made = case.files(Frame.of(loaded), loaded.cases["easy"], {})
    assert "data/easy-differences.js" not in made
    assert "Paired differences" not in made["case-easy.html"]


def test_hostile_labels_stay_text_in_the_script_of_differences(tmp_path):
    names = ["</script><script>alert(1)</script>", "\u2028\"'"]
    loaded = Written(tmp_path / "r").add([small_case("easy")], [noisy(name, 1.0) for name in names], runs=3).load()
    made = case.files(Frame.of(loaded), loaded.cases["easy"], {})
    detail = re.search(r"detail: (.*) \}\)\);", made["data/easy-differences.js"], re.S)[1]
    assert json.loads(detail)["labels"] == names
    (tmp_path / "page.html").write_text(made["case-easy.html"], encoding="utf-8")
    assert "alert(1)" in read(tmp_path / "page.html").text


@pytest.fixture
def opened(browser, files, tmp_path):
    """Opens the page from disk in a browser; nothing may complain."""
    for name, text in {**files, **_static()}.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    complaints, contexts = [], []

    def visit(state="", **options):
        contexts.append(browser.new_context(**options))
        made = contexts[-1].new_page()
        made.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
        made.on("pageerror", lambda error: complaints.append(str(error)))
        made.goto((tmp_path / "case-easy.html").as_uri() + state)
        return made

    yield visit
    for context in contexts:
        context.close()
    assert complaints == []


def read_off(shown):
    """Rows of the table in the browser, by estimator."""
    rows = shown.locator("#differences-table tbody tr")
    found = [[cell.strip() for cell in row.inner_text().split("\t")] for row in rows.all()]
    return {label: words for label, *words in found}


def test_the_reader_chooses_reference_and_block_and_may_share_the_view(opened, files, page):
    data = json.loads(re.search(r"detail: (.*) \}\)\);", files["data/easy-differences.js"])[1])
    shown = opened()
    assert read_off(shown) == rows_of(page, "differences-table")
    shown.get_by_label("Against", exact=True).select_option(label="sharp")
    shown.get_by_label("by the RMSE of", exact=True).select_option(label="velocity")
    shown.wait_for_function("document.querySelector('[data-reference]').textContent === 'sharp'")
    wanted = {data["labels"][place]: words for place, words, *_ in data["rows"][2][1]}
    found = read_off(shown)
    assert found.pop("sharp")[-1] == "the reference"
    assert found == wanted
    assert shown.url.endswith("#against=sharp&of=velocity")
    again = opened("#against=sharp&of=velocity")
    again.wait_for_function("document.querySelector('[data-reference]').textContent === 'sharp'")
    assert read_off(again) == read_off(shown)
    again.get_by_label("Against", exact=True).select_option(label="first")
    again.get_by_label("by the RMSE of", exact=True).select_option(label="position")
    assert read_off(again) == rows_of(page, "differences-table")
    assert not again.url.partition("#")[2]


def test_without_scripts_there_is_no_choice(opened):
    shown = opened(java_script_enabled=False)
    assert not shown.get_by_label("Against", exact=True).is_visible()
    assert shown.locator("#differences-table tbody tr").count() == 6
