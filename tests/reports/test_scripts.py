"""The scripts that all pages share: states in the address, legends of figures, sorting of tables."""

import shutil

import pytest

PAGE = "case-easy-one.html"
SORTABLE = """<!doctype html><meta charset="utf-8"><title>t</title><link rel="icon" href="data:,">
<script src="static/site.js" defer></script>
<script src="static/tables.js" defer></script><a class="skip" href="#page_main">s</a>
<main id="page_main"><table class="sortable">
<thead><tr><th>Name</th><th>Size</th><th></th></tr></thead><tbody>
<tr><th>b10</th><td data-sort="2">two</td><td></td></tr>
<tr><th>a</th><td data-sort="">none</td><td></td></tr>
<tr><th>b9</th><td data-sort="inf">infinite</td><td></td></tr>
<tr><th>d</th><td data-sort="-1e1">minus ten</td><td></td></tr>
<tr><th>e</th><td colspan="2">refused</td></tr>
<tr><th>c</th><td data-sort="2">two</td><td></td></tr>
</tbody></table></main>"""


def shown(page, figure):
    """Names of the series of a figure that are drawn."""
    return page.evaluate(
        """figure => { const items = [...document.querySelectorAll(`${figure} [data-key]`)];
        const drawn = (key) => [...document.querySelectorAll(`${figure} .drawing [data-series="${key}"]`)]
            .some(each => getComputedStyle(each).display !== 'none');
        return items.filter(item => drawn(item.dataset.key)).map(item => item.dataset.name); }""",
        figure,
    )


def entry(page, figure, name):
    return page.locator(f'{figure} [data-name="{name}"] button')


def test_a_series_that_is_hidden_is_hidden_in_all_figures_and_in_the_address(visit):
    page = visit(PAGE)
    every = shown(page, "#rmse-0")
    assert {"plain", "shifted", "twin"} <= set(every)
    entry(page, "#rmse-0", "shifted").click()
    rest = [name for name in every if name != "shifted"]
    assert shown(page, "#rmse-0") == rest
    assert "shifted" not in shown(page, "#rmse-1")
    assert entry(page, "#rmse-1", "shifted").get_attribute("aria-pressed") == "false"
    assert entry(page, "#rmse-1", "plain").get_attribute("aria-pressed") == "true"
    assert page.url.endswith("#hide=shifted")
    again = visit(f"{PAGE}#hide=shifted,twin")
    assert shown(again, "#rmse-0") == [name for name in rest if name != "twin"]
    again.locator("#rmse-0 [data-all]").click()
    assert shown(again, "#rmse-0") == every
    assert again.url.endswith(PAGE)


def test_the_legend_works_by_keyboard_and_highlights_what_has_the_focus(visit):
    page = visit(PAGE)
    entry(page, "#rmse-0", "plain").focus()
    dim = page.locator("#rmse-0 .series.dim")
    key = page.locator('#rmse-0 [data-name="plain"]').get_attribute("data-key")
    assert dim.count() == page.locator(f'#rmse-0 .series:not([data-series="{key}"])').count() > 0
    page.keyboard.press("Space")
    assert "plain" not in shown(page, "#rmse-0")
    page.keyboard.press("Enter")
    assert "plain" in shown(page, "#rmse-0")
    page.keyboard.press("Tab")
    assert page.locator(f'#rmse-0 .series.dim[data-series="{key}"]').count() > 0
    page.locator("h1").hover()
    page.evaluate("document.activeElement.blur()")
    assert dim.count() == 0


def test_only_the_first_of_many_series_are_shown_until_all_are_asked_for(visit, site, tmp_path):
    folder = shutil.copytree(site, tmp_path / "site")
    text = (folder / PAGE).read_text()
    (folder / PAGE).write_text(text.replace('data-name="twin"', 'data-name="twin" data-later'))
    page = visit(PAGE, folder)
    first = shown(page, "#rmse-0")
    assert "twin" not in first
    assert "plain" in first
    assert not entry(page, "#rmse-0", "twin").is_visible()
    page.locator("#rmse-0").get_by_role("button", name="Choose from 1 more").click()
    entry(page, "#rmse-0", "twin").click()
    assert page.url.endswith("#with=twin")
    assert "twin" in shown(page, "#rmse-0")
    entry(page, "#rmse-0", "twin").click()
    assert "twin" not in shown(page, "#rmse-0")
    entry(page, "#rmse-0", "plain").click()
    page.locator("#rmse-0 [data-all]").click()
    assert page.url.endswith("#with=all")
    assert {"plain", "twin"} <= set(shown(page, "#rmse-0"))
    page.locator("#rmse-0").get_by_role("button", name="Only the first ones").click()
    assert shown(page, "#rmse-0") == first
    assert "twin" in shown(visit(PAGE, folder, java_script_enabled=False), "#rmse-0")


def test_an_anchor_and_states_live_in_one_address(visit):
    page = visit(f"{PAGE}#rmse-1&hide=twin")
    page.wait_for_function("document.querySelector(':target')?.id === 'rmse-1'")
    assert "twin" not in shown(page, "#rmse-0")
    assert page.url.endswith("#rmse-1&hide=twin")
    entry(page, "#rmse-0", "twin").click()
    assert page.url.endswith("#rmse-1")
    entry(page, "#rmse-0", "plain").click()
    page.evaluate("location.hash = 'rmse-0'")
    page.wait_for_function("location.hash === '#rmse-0&hide=plain'")
    assert page.evaluate("document.querySelector(':target').id") == "rmse-0"
    assert "plain" not in shown(page, "#rmse-0")


def test_states_of_scripts_keep_each_other_and_follow_the_history(visit):
    page = visit("provenance.html#hide=twin&other=a%26b%3Dc")
    page.evaluate("window.calls = []; address.follow(() => window.calls.push(address.get('key')))")
    assert page.evaluate("address.get('other')") == "a&b=c"
    page.evaluate("address.push({ key: 'x y,z:1' })")
    assert page.url.endswith("#hide=twin&other=a%26b%3Dc&key=x%20y,z:1")
    page.evaluate("address.set({ other: null, key: 'v' })")
    assert page.url.endswith("#hide=twin&key=v")
    page.go_back()
    page.wait_for_function("window.calls.length === 2")
    assert page.evaluate("[window.calls, address.get('other')]") == [[None, None], "a&b=c"]
    page.evaluate("location.hash = '%E0%A4%A'")
    assert page.evaluate("address.get('hide')") == "twin"


def test_back_from_a_state_leads_to_an_anchor_without_it(visit):
    page = visit(f"{PAGE}#rmse-0")
    page.evaluate("address.push({ key: 'x' })")
    page.go_back()
    page.wait_for_function("address.get('key') === null")
    assert page.url.endswith("#rmse-0")


@pytest.fixture
def table(visit, site, tmp_path):
    shutil.copytree(site / "static", tmp_path / "static")
    (tmp_path / "t.html").write_text(SORTABLE)
    return visit("t.html", tmp_path)


def names(page):
    return page.locator("tbody th").all_inner_texts()


def test_tables_are_sorted_by_numbers_with_what_is_missing_last_and_ties_as_they_were(table):
    before = ["b10", "a", "b9", "d", "e", "c"]
    size = table.get_by_role("button", name="Sort by Size")
    size.click()
    assert names(table) == ["d", "b10", "c", "b9", "a", "e"]
    assert table.locator("th", has_text="Size").get_attribute("aria-sort") == "ascending"
    size.focus()
    table.keyboard.press("Enter")
    assert names(table) == ["b9", "b10", "c", "d", "a", "e"]
    assert table.locator("th", has_text="Size").get_attribute("aria-sort") == "descending"
    size.click()
    assert names(table) == before
    assert table.locator("[aria-sort]").count() == 0


def test_tables_are_sorted_by_words_as_people_count_and_only_one_head_says_so(table):
    table.get_by_role("button", name="Sort by Size").click()
    table.get_by_role("button", name="Sort by Name").click()
    assert names(table) == ["a", "b9", "b10", "c", "d", "e"]
    assert table.locator("[aria-sort]").count() == 1
    assert table.locator(".sort").count() == 2
