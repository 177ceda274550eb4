"""The site in a browser, opened from disk."""


def test_families_are_folded_and_unfold_for_a_link(visit):
    page = visit("case-easy-one.html")
    folded = page.locator("details.family:has(table)").first.locator("table").first
    assert not folded.is_visible()
    page.locator("details.family:has(table) > summary").first.click()
    assert folded.is_visible()
    assert not page.locator("#metric-nees").is_visible()
    page.evaluate("location.hash = 'metric-nees'")
    page.locator("#metric-nees h4").wait_for(state="visible")
    assert page.locator("#nees .chance").is_visible()
    assert not page.locator("#ratio-0").is_visible()
    again = visit("case-easy-one.html#ratio-0&hide=twin")
    again.locator("#ratio-0 .drawing").wait_for(state="visible")


def test_the_skip_link_leads_to_the_content_and_keeps_the_choice(visit):
    page = visit("index.html#show=nees-state")
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    assert page.evaluate("document.activeElement.id") == "page_main"
    assert page.url.endswith("#show=nees-state")


def test_a_cell_leads_to_its_row(visit):
    page = visit()
    page.locator(".cell.partly a").first.click()
    page.wait_for_url("**/case-easy-one.html#frail")
    assert page.locator("tr:target .name").inner_text() == "frail"


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
