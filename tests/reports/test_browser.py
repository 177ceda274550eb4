"""The site in a browser, opened from disk."""

import shutil

import pytest

sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
ARGUMENTS = [
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
]  # fmt: skip
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed")


@pytest.fixture(scope="module")
def browser():
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield browser
        browser.close()


@pytest.fixture
def visit(browser, site):
    """Open a page of the site; at the end no page may have complained or asked for anything from outside."""
    contexts, complaints = [], []

    def open_page(name="index.html", **options):
        context = browser.new_context(**options)
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda message: complaints.append(message.text) if message.type in ("error", "warning") else None)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: request.url.startswith(("file:", "data:")) or complaints.append(request.url))
        page.goto((site / name.partition("#")[0]).as_uri() + "".join(name.partition("#")[1:]))
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert complaints == []


def values(page):
    return page.locator(".matrix [data-value]").all_inner_texts()


def test_choosing_a_metric_changes_the_matrix_and_the_address(visit):
    page = visit()
    before = values(page)
    page.get_by_label("Show", exact=True).select_option("latency-step")
    after = values(page)
    assert before != after
    assert "not timed" in after
    assert "lower is better" in page.locator(".reading").inner_text()
    assert page.url.endswith("#show=latency-step")
    again = visit("index.html#show=latency-step")
    assert values(again) == after
    assert again.get_by_label("Show", exact=True).input_value() == "latency-step"
    again.evaluate("location.hash = 'show=no-such'")
    again.wait_for_function("document.getElementById('choice').value === 'first'")
    assert values(again) == before


def test_without_scripts_the_matrix_is_there_and_no_choice(visit):
    page = visit(java_script_enabled=False)
    assert len(values(page)) == 18
    assert not page.get_by_label("Show", exact=True).is_visible()


def test_the_reason_shows_on_keyboard_focus_and_goes_on_escape(visit):
    page = visit()
    refused = page.locator(".cell.refused a").first
    tip = page.locator(".cell.refused .tip").first
    assert not tip.is_visible()
    page.locator(".cell.done a").first.focus()
    for _ in range(20):
        if refused.evaluate("element => element === document.activeElement"):
            break
        page.keyboard.press("Tab")
    assert tip.is_visible()
    assert tip.inner_text() == "the model is too hard"
    assert refused.get_attribute("aria-describedby") == tip.get_attribute("id")
    box = tip.bounding_box()
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= 1280
    assert page.evaluate("getComputedStyle(document.activeElement).outlineStyle") == "solid"
    page.keyboard.press("Escape")
    assert not tip.is_visible()


def test_the_fault_of_a_cell_shows_on_focus_whatever_the_choice(visit):
    page = visit()
    cell = page.locator(".matrix tbody tr").first.locator(".cell").nth(1)
    assert cell.locator(".tag").first.is_visible()
    assert cell.locator(".tag").first.inner_text() == "optimistic"
    for choice in ("first", "latency-step"):
        page.get_by_label("Show", exact=True).select_option(choice)
        assert not cell.locator(".tip").is_visible()
        page.keyboard.press("Tab")  # so that the focus is that of a keyboard
        cell.locator("a").focus()
        assert "optimistic: squared errors" in cell.locator(".tip").inner_text()
        assert cell.locator(".tip").is_visible()
        page.get_by_label("Show", exact=True).focus()


def test_marks_and_classes_of_shading_follow_the_choice(visit):
    page = visit()
    assert page.locator("[data-legends]").is_visible()
    page.get_by_label("Show", exact=True).select_option("lag-first")
    assert not page.locator("[data-legends]").is_visible()
    assert "0 is best" in page.locator(".reading").inner_text()
    page.get_by_label("Show", exact=True).select_option("latency-step")
    assert page.locator("[data-legends]").is_visible()
    assert page.locator(".cell.barred").count() == page.locator(".cell.barred .tag", has_text="lost").count() == 2


def test_families_are_folded_and_unfold_for_a_link(visit):
    page = visit("case-easy-one.html")
    assert page.locator("#scores-error").is_visible()
    assert page.locator("#scores-error .tag").first.is_visible()
    assert not page.locator("#scores-consistency").is_visible()
    page.locator("#family-consistency summary").click()
    assert page.locator("#scores-consistency").is_visible()
    assert not page.locator("#metric-nees").is_visible()
    page.locator("#scores-consistency thead a", has_text="NEES").click()
    page.locator("#metric-nees h4").wait_for(state="visible")
    assert page.locator("#nees .chance").is_visible()
    assert not page.locator("#ratio-0").is_visible()
    again = visit("case-easy-one.html#ratio-0")
    again.locator("#ratio-0 .drawing").wait_for(state="visible")


def test_the_skip_link_leads_to_the_content_and_keeps_the_choice(visit):
    page = visit("index.html#show=nees-state")
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    assert page.evaluate("document.activeElement.id") == "main"
    assert page.url.endswith("#show=nees-state")


def test_a_cell_leads_to_its_row(visit):
    page = visit()
    page.locator(".cell.partly a").first.click()
    page.wait_for_url("**/case-easy-one.html#frail")
    assert page.locator("tr:target .name").inner_text() == "frail"


@pytest.mark.parametrize("name", ["index.html", "case-easy-one.html", "case-lonely.html", "provenance.html"])
def test_a_narrow_page_does_not_scroll_sideways(visit, name):
    page = visit(name, viewport={"width": 390, "height": 800})
    page.evaluate("document.querySelectorAll('details').forEach(d => { d.open = true; })")
    assert page.evaluate("document.documentElement.scrollWidth") <= 390


def test_dark_and_light_are_both_readable(visit):
    look = """() => {
        const rgb = (value) => value.match(/[0-9.]+/g).slice(0, 3).map(Number);
        const shine = (c) => rgb(c).map(v => v / 255)
            .map(v => v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
            .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
        const ratio = (a, b) => (Math.max(shine(a), shine(b)) + 0.05) / (Math.min(shine(a), shine(b)) + 0.05);
        const paper = getComputedStyle(document.body).backgroundColor;
        const of = (selector, part) =>
            [...document.querySelectorAll(selector)].map(e => ratio(getComputedStyle(e)[part], paper));
        const tags = [...document.querySelectorAll('.tag')].map(e => getComputedStyle(e))
            .map(s => ratio(s.color, s.backgroundColor === 'rgba(0, 0, 0, 0)' ? paper : s.backgroundColor));
        return { paper: shine(paper), tags, text: of('h1, p, a, figcaption, .under, .flag, .inside, .drawing text', 'color'),
                 labels: of('.drawing text', 'fill'), lines: of('.swatch path[fill=none]', 'stroke') };
    }"""
    light = visit("case-easy-one.html", color_scheme="light").evaluate(look)
    dark = visit("case-easy-one.html", color_scheme="dark").evaluate(look)
    assert light["paper"] > 0.9
    assert dark["paper"] < 0.02
    for seen in (light, dark):
        assert min(seen["text"]) >= 4.5
        assert min(seen["tags"]) >= 4.5
        assert min(seen["labels"]) >= 4.5
        assert min(seen["lines"]) >= 3


def test_the_legend_of_a_figure_highlights_a_line(visit):
    page = visit("case-easy-one.html")
    figure = page.locator("#rmse-0")
    figure.locator("[data-key]").first.hover()
    assert figure.locator(".series.dim").count() == figure.locator('.series:not([data-series="0"])').count() > 0
    page.mouse.move(0, 0)
    assert figure.locator(".series.dim").count() == 0
