"""The overview in a browser, opened from disk."""

import dataclasses
import json
import re
from importlib.resources import files as sources
from types import SimpleNamespace

import pytest

from reports.frame import SECTIONS, Frame
from reports.inputs import Inputs, Site
from reports.pages import overview
from reports.views import private, view
from suite.case import GIVEN_TRACK


@pytest.fixture(scope="module")
def site(variety, tmp_path_factory):
    """The overview of four cases, beside empty pages that its links lead to."""
    cases = [view(private(case), variety.labels) for case in variety.cases.values()]
    card = dataclasses.replace(cases[0].card, name="easy/two", title="A track", origin=GIVEN_TRACK)
    stored = cases[0].results.bound
    bound = dataclasses.replace(stored, meta=stored.meta | {"bounds": [stored.meta["bounds"][0] | {"reason": "it is a track"}]})
    cases.append(dataclasses.replace(cases[0], results=dataclasses.replace(cases[0].results, card=card, bound=bound)))
    frame = Frame.of(SimpleNamespace(labels=variety.labels, cases={case.card.name: case for case in cases}))
    found = {f"static/{file.name}": file.read_text() for file in sources("reports").joinpath("static").iterdir()}
    stubs = [*frame.cases.values(), *frame.estimators.values(), *(f"{name}.html" for name in SECTIONS)]
    found |= dict.fromkeys(stubs, "<!doctype html><title>stub</title><link rel=icon href=data:,>")
    for part in overview.parts(Site(frame, Inputs(None, "", {}), cases, "")):
        found |= part.make(*part.arguments)
    out = tmp_path_factory.mktemp("overview")
    for name, text in found.items():
        (out / name).parent.mkdir(exist_ok=True)
        (out / name).write_text(text, encoding="utf-8")
    return out


def control(page, name):
    return page.locator(f"#controls [name={name}]")


def titled(page, title):
    page.locator("[data-title]", has_text=title).wait_for()


def column(page, label):
    """The values of an estimator in the rows that are shown, as they stand."""
    return page.evaluate(
        """(label) => {
            const table = document.querySelector(".matrix");
            const place = [...table.tHead.rows[0].cells].find((th) => th.textContent.trim() === label).cellIndex;
            const values = [...table.tBodies[0].rows].filter((row) => !row.hidden).map((row) => row.cells[place]);
            return values.map((cell) => (cell.querySelector(".value") ?? cell).textContent.trim());
        }""",
        label,
    )


def shown(page):
    """Names of the cases and estimators that are shown, in their order."""
    cases = page.locator(".matrix tbody tr:visible th a").all_inner_texts()
    return cases, page.locator(".matrix thead th:visible a").all_inner_texts()


def view_of(page):
    return (
        page.locator(".matrix").inner_text(),
        page.locator(".reading").inner_text(),
        page.locator("[data-status]").inner_text(),
    )


CASES = ["easy/one", "other", "lonely", "easy/two"]
LABELS = ["plain", "shifted", "twin", "choosy", "broken", "frail"]


def test_a_chosen_metric_and_block_are_shown_and_stand_in_the_address(visit):
    page = visit()
    before = view_of(page)
    control(page, "show").select_option("latency")
    titled(page, "Latency")
    assert column(page, "plain") == ["102", "102", "not timed", "102"]
    assert page.locator("[data-under]").first.inner_text() == "step (µs)"
    assert page.url.endswith("#show=latency")
    assert control(page, "block").is_disabled()
    control(page, "show").select_option(label="RMSE")
    control(page, "block").select_option("velocity")
    page.locator("[data-block]", has_text="velocity").wait_for()
    assert column(page, "plain")[1] == "no such block"
    assert page.url.endswith("#block=velocity")
    page.go_back()
    page.go_back()
    titled(page, "Latency")
    page.go_back()
    titled(page, "RMSE")
    assert view_of(page) == before


def test_a_shared_address_gives_the_same_view(visit):
    page = visit()
    control(page, "show").select_option("nees")
    titled(page, "normalised")
    control(page, "detail").select_option("compact")
    control(page, "case").fill("EASY")
    control(page, "columns").select_option("name")
    control(page, "empty").check()
    page.get_by_role("button", name="Sort cases by shifted").click()
    page.get_by_role("button", name="Sort cases by shifted").click()
    again = visit(f"index.html#{page.url.partition('#')[2]}")
    titled(again, "normalised")
    again.locator("[aria-sort=descending]").wait_for()
    assert view_of(again) == view_of(page)
    assert shown(again) == (["easy/one", "easy/two"], ["frail", "plain", "shifted", "twin"])
    assert [control(again, name).input_value() for name in ("show", "case", "columns")] == ["nees", "EASY", "name"]
    again.evaluate("location.hash = 'show=no-such&block=x&columns=9&kind=%00'")
    titled(again, "RMSE")
    assert shown(again) == (CASES, LABELS)


def test_cases_are_sorted_by_an_estimator_and_back(visit, site):
    page = visit()
    button = page.get_by_role("button", name="Sort cases by twin")
    button.click()
    page.locator("[aria-sort=ascending]").wait_for()
    data = (site / "data/matrix-rmse-first.js").read_text()
    rows = json.loads(re.fullmatch(r"[^{]*(\{.*\})\);\s*", data)[1])["rows"]
    ratio = {name: row["cells"][2][10] if row["cells"][2] else None for name, row in zip(CASES, rows, strict=True)}
    known = [name for name in CASES if ratio[name] is not None]
    ascending = [*sorted(known, key=lambda name: (ratio[name], CASES.index(name))), "lonely"]
    assert shown(page)[0] == ascending
    control(page, "order").select_option("value")
    control(page, "by").select_option("shifted")
    control(page, "down").select_option("down")
    values = [float(text) for text in column(page, "shifted")[:3]]
    assert values == sorted(values, reverse=True)
    assert shown(page)[0][-1] == "lonely"
    control(page, "order").select_option("name")
    control(page, "down").select_option("")
    assert shown(page)[0] == sorted(CASES)
    page.get_by_role("button", name="Reset").click()
    assert shown(page)[0] == CASES


def test_estimators_are_sorted_by_marks(visit):
    page = visit()
    page.wait_for_function("overview && document.querySelector('[id^=data-]')")
    control(page, "columns").select_option("marks")
    page.wait_for_function("document.querySelector('.matrix thead th:nth-child(3)').textContent.includes('twin')")
    assert shown(page)[1][:2] == ["plain", "twin"]


FILTERS = [
    ("scenario", "easy", ["easy/one", "easy/two"], LABELS, "2 of 4 cases, 6 of 6 estimators."),
    ("truth", GIVEN_TRACK, ["easy/two"], LABELS, "1 of 4 cases, 6 of 6 estimators."),
    ("case", " a track ", ["easy/two"], LABELS, "1 of 4 cases, 6 of 6 estimators."),
    ("estimator", "RO", CASES, ["broken"], "4 of 4 cases, 1 of 6 estimators."),
    ("kind", "particles", [], [], "4 of 4 cases, 0 of 6 estimators."),
    ("empty", "hide", CASES, ["plain", "shifted", "twin", "frail"], "4 of 4 cases, 4 of 6 estimators."),
]


def test_filters_leave_what_they_say_and_reset_brings_all_back(visit):
    page = visit()
    for name, value, cases, labels, words in FILTERS:
        chosen = control(page, name)
        if name == "empty":
            chosen.check()
        elif name in ("case", "estimator"):
            chosen.fill(value)
        else:
            chosen.select_option(value)
        page.locator("[role=status]", has_text=words).wait_for()
        assert shown(page) == (cases, labels)
        assert page.locator("[data-none]").is_visible() == (not labels)
        assert f"{name}=" in page.url
        page.get_by_role("button", name="Reset").click()
        assert shown(page) == (CASES, LABELS)
        assert "#" not in page.url


def test_a_cell_says_its_reason_on_focus_and_on_hover_and_escape_hides_it(visit):
    page = visit()
    tip = page.get_by_role("tooltip")
    cell = page.locator(".cell.refused a").first
    cell.focus()
    assert tip.inner_text().split("\n") == ["choosy on easy/one: refused", "the model is too hard"]
    assert cell.get_attribute("aria-describedby") == tip.get_attribute("id")
    page.keyboard.press("Escape")
    assert not tip.is_visible()
    assert cell.get_attribute("aria-describedby") is None
    page.wait_for_function("document.querySelector('[id^=data-]')")
    page.locator(".cell.barred a").first.hover()
    lines = tip.inner_text().split("\n")
    assert lines[0] == "shifted on easy/one"
    assert re.fullmatch(r"RMSE, position: 4\d m \(95 % interval \d\d to \d\d\)", lines[1])
    assert re.fullmatch(r"about \d\.\d times the row's smallest; about \d\.\d times the bound", lines[2])
    assert any(line.startswith("optimistic: squared errors") for line in lines)
    box = tip.bounding_box()
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= 1280
    page.mouse.move(0, 0)
    assert not tip.is_visible()


def test_the_keyboard_alone_chooses_and_walks_the_matrix(visit):
    page = visit()
    control(page, "show").focus()
    page.keyboard.type("Latency of a step")
    page.keyboard.press("Enter")
    titled(page, "Latency")
    page.get_by_role("button", name="Reset").focus()
    page.keyboard.press("Tab")  # the box that scrolls
    page.keyboard.press("Tab")
    here = "document.activeElement.textContent + document.activeElement.ariaLabel"
    assert page.evaluate(here).startswith("plain")
    page.keyboard.press("ArrowDown")
    assert page.evaluate("document.activeElement.closest('tr').dataset.scenario") == "easy"
    assert page.evaluate("getComputedStyle(document.activeElement).outlineStyle") == "solid"
    page.keyboard.press("End")
    assert "frail on easy/one" in page.get_by_role("tooltip").inner_text()
    page.keyboard.press("ArrowDown")
    assert "frail on other" in page.get_by_role("tooltip").inner_text()
    page.keyboard.press("ArrowLeft")
    assert "broken on other" in page.get_by_role("tooltip").inner_text()
    page.keyboard.press("Control+End")
    assert "frail on easy/two" in page.get_by_role("tooltip").inner_text()
    assert page.evaluate("document.querySelectorAll('.matrix [tabindex=\"0\"]').length") == 1
    page.keyboard.press("Enter")
    page.wait_for_url("**/case-easy-two.html#frail")


def test_colours_by_the_bound_leave_cases_without_one_plain(visit):
    page = visit("index.html#colour=bound")
    page.locator("[data-legend=bound]").wait_for()
    assert "up to 1.1 times the bound" in page.locator(".legend").inner_text()
    assert not page.locator("[data-legend=legend]").is_visible()
    rows = page.locator(".matrix tbody tr")
    assert rows.nth(0).locator("[class*=shade-]").count() == 2
    assert rows.nth(3).locator("[class*=shade-]").count() == 0
    control(page, "show").select_option("lag")
    titled(page, "Lag")
    assert not page.locator("[data-legends]").is_visible()
    assert page.locator("[class*=shade-]:visible").count() == 0
    assert control(page, "colour").locator("option[value=bound]").is_disabled()


def test_a_compact_cell_shows_the_value_alone_and_a_full_one_all(visit):
    page = visit()
    cell = page.locator(".cell.barred").first
    assert cell.locator(".interval").is_visible()
    control(page, "detail").select_option("compact")
    assert not cell.locator(".interval").is_visible()
    assert cell.locator(".value").is_visible()
    assert cell.locator(".tag").first.bounding_box()["width"] < 25
    assert page.locator(".short").is_visible()


def test_without_scripts_the_first_choice_is_there_and_no_control(visit):
    page = visit(java_script_enabled=False)
    assert page.locator(".matrix td").count() == len(CASES) * len(LABELS)
    assert page.locator(".cell.done .interval").first.is_visible()
    assert not page.locator("#controls").is_visible()


def test_numbers_that_are_not_beside_the_page_are_missed_in_words(browser, site, tmp_path):
    (tmp_path / "static").mkdir()
    for name in ("index.html", *(f"static/{path.name}" for path in (site / "static").iterdir())):
        (tmp_path / name).write_bytes((site / name).read_bytes())
    page = browser.new_page()
    page.goto((tmp_path / "index.html").as_uri())
    words = "The numbers of this choice are missing: data/matrix-rmse-first.js is not beside this page."
    page.locator("[data-status]", has_text=words).wait_for()
    assert page.locator(".cell.done .value").first.is_visible()
    page.close()


def test_on_paper_the_whole_matrix_stands_without_controls(visit):
    page = visit()
    page.emulate_media(media="print")
    assert not page.locator("#controls").is_visible()
    box, table = page.locator(".matrix-box").bounding_box(), page.locator(".matrix").bounding_box()
    assert table["height"] <= box["height"] + 2


def test_a_narrow_overview_scrolls_the_matrix_and_not_the_page(visit):
    page = visit(viewport={"width": 390, "height": 800})
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert page.evaluate("(box => box.scrollWidth > box.clientWidth)(document.querySelector('.matrix-box'))")
