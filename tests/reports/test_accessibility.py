"""Whether pages can be used by all: assistive technology, colour blindness, narrow screens, paper."""

import importlib.util
import itertools
import re
from pathlib import Path

import numpy as np
import pytest

from reports.marks import COLOURS, marks

KINDS = (
    "index.html", "case-easy-one.html", "estimators.html", "estimator-frail.html", "reproduction.html",
    "detection.html", "timing.html", "changes.html", "provenance.html",
)  # fmt: skip
SERIOUS = ("serious", "critical")
UNFOLDED = "document.querySelectorAll('details').forEach(each => { each.open = true; })"
SHORTER = """() => {
    for (const body of document.querySelectorAll('tbody')) [...body.rows].slice(4).forEach(row => row.remove());
    [...document.querySelectorAll('.metric')].slice(4).forEach(metric => metric.remove());
    for (const shape of document.querySelectorAll('.drawing :is(path, use)')) shape.remove();
    [...document.querySelectorAll('figure')].slice(2).forEach(figure => figure.remove());
}"""
"""Rows, metrics, figures and shapes are alike, and looking at all of them would take a minute."""
PAPER = 718
"""Width of the text on A4 in CSS pixels, with margins of 1 cm."""
STYLE = (Path(__file__).parents[2] / "reports/static/style.css").read_text(encoding="utf-8")
BLINDNESS = {
    "none": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
"""What is seen of linear RGB: Machado, Oliveira and Fernandes, IEEE Trans. Visualization and Computer Graphics 15, 2009."""
APART = 16.0
"""Least distance of two series colours in CIELAB, where about 2 can just be noticed side by side."""


@pytest.fixture(scope="module")
def axe():
    """The source of axe-core, which looks for faults of accessibility."""
    found = importlib.util.find_spec("axe_playwright_python")
    if found is None or found.origin is None:
        pytest.skip("axe-playwright-python is not installed")
    return (Path(found.origin).parent / "axe.min.js").read_text(encoding="utf-8")


def faults(page, axe, options):
    page.evaluate(UNFOLDED)
    page.evaluate(SHORTER)
    page.evaluate(axe)
    quiet = {"resultTypes": ["violations"], "preload": False, "selectors": False, **options}
    found = page.evaluate("options => axe.run(document, options)", quiet)["violations"]
    return [(each["id"], each["nodes"][0]["html"]) for each in found if each["impact"] in SERIOUS]


@pytest.mark.parametrize("name", KINDS)
def test_no_page_has_a_serious_fault(visit, axe, name):
    page = visit(name)
    assert faults(page, axe, {}) == []
    page.emulate_media(color_scheme="dark")
    assert faults(page, axe, {"runOnly": ["color-contrast"]}) == []


def test_a_fault_would_be_found(visit, axe):
    page = visit("provenance.html")
    page.evaluate("document.querySelector('h1').style.color = 'var(--edge)'; document.querySelector('.brand').textContent = ''")
    assert {"color-contrast", "link-name"} <= {rule for rule, _ in faults(page, axe, {})}


def test_no_page_scrolls_sideways_on_a_narrow_screen_or_on_paper(visit, site):
    wide = {}
    page = visit("provenance.html")
    for each in sorted(site.glob("*.html")):
        page.goto(each.as_uri())
        page.evaluate(UNFOLDED)
        for medium, width in (("screen", 390), ("print", PAPER)):
            page.emulate_media(media=medium)
            page.set_viewport_size({"width": width, "height": 800})
            reach = page.evaluate("document.documentElement.scrollWidth")
            if reach > width:
                wide[f"{each.name} on {medium}"] = reach
    assert wide == {}


def test_paper_is_light_and_shows_what_the_screen_shows(visit):
    page = visit("case-easy-one.html", color_scheme="dark")
    page.locator('#rmse-0 [data-name="twin"] button').click()
    page.emulate_media(media="print", color_scheme="dark")
    look = page.evaluate("[getComputedStyle(document.body).backgroundColor, getComputedStyle(document.body).color]")
    assert look == ["rgb(255, 255, 255)", "rgb(0, 0, 0)"]
    assert page.evaluate("getComputedStyle(document.documentElement).getPropertyValue('--s1').trim()") == "#1a5eca"
    assert page.locator('#rmse-0 [data-name="plain"]').is_visible()
    for gone in ('#rmse-0 [data-name="twin"]', "#rmse-0 .take", "#rmse-0 .tools", ".top", ".sort"):
        assert not page.locator(gone).first.is_visible(), gone


def test_every_button_and_region_that_scrolls_can_be_reached_and_is_large_enough(visit):
    page = visit("case-easy-one.html")
    small = page.evaluate(
        """() => [...document.querySelectorAll('button, select, input, summary')].filter(each => each.getClientRects().length)
        .filter(each => (each.closest('label') ?? each).getBoundingClientRect().height < 24)
        .map(each => each.outerHTML.slice(0, 80))"""
    )
    assert small == []
    page.evaluate(UNFOLDED)
    wide = "each => each.scrollWidth > each.clientWidth && each.tabIndex !== 0"
    stuck = f"[...document.querySelectorAll('.scroll, pre')].filter({wide})"
    assert page.evaluate(f"{stuck}.length") == 0
    page.locator("#rmse-0 [data-key] button").first.focus()
    page.keyboard.press("Tab")
    assert page.evaluate("getComputedStyle(document.activeElement).outlineStyle") == "solid"


def palette(theme):
    """Colours of the series in a theme, as RGB between 0 and 1."""
    found = re.findall(r"--s(\d+): #([0-9a-f]{6})", STYLE)
    assert [int(number) for number, _ in found] == 2 * list(range(1, COLOURS + 1))
    chosen = found[:COLOURS] if theme == "light" else found[COLOURS:]
    return np.array([[int(code[i : i + 2], 16) / 255 for i in (0, 2, 4)] for _, code in chosen])


def linear(rgb):
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def lab(light):
    """CIELAB of linear sRGB, white D65."""
    to_xyz = [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
    xyz = light @ np.transpose(to_xyz) / [0.95047, 1.0, 1.08883]
    f = np.where(xyz > 216 / 24389, np.cbrt(xyz), (24389 / 27 * xyz + 16) / 116)
    return np.stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])], axis=1)


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("kind", BLINDNESS)
def test_the_first_ten_colours_differ_for_all_who_look(theme, kind):
    seen = lab(np.clip(linear(palette(theme)) @ np.transpose(BLINDNESS[kind]), 0, 1))
    apart = [float(np.linalg.norm(a - b)) for a, b in itertools.combinations(seen, 2)]
    assert min(apart) >= APART


def test_no_two_of_forty_estimators_look_alike_and_neighbours_differ_twice():
    found = list(marks([f"e{i}" for i in range(40)]).values())
    assert len({(mark.colour, mark.marker, mark.dash) for mark in found}) == 40
    for a, b in itertools.pairwise(found):
        assert (a.colour != b.colour) + (a.marker != b.marker) + (a.dash != b.dash) >= 2
    for a, b in zip(found, found[COLOURS:], strict=False):
        assert a.colour == b.colour
        assert a.marker != b.marker
        assert a.dash != b.dash
