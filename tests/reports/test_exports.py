"""Figures and tables to take along: what the files hold that a reader saves from a page."""

import csv
import io
import re
import shutil
import subprocess
import tempfile
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from PIL import Image

from reports.plot import Column, Plot, tex, to_csv, to_latex

PAGE = "case-easy-one.html"
TABLE = """<!doctype html><meta charset="utf-8"><title>t</title><link rel="icon" href="data:,">
<link rel="stylesheet" href="static/style.css">
<script src="static/site.js" defer></script>
<script src="static/tables.js" defer></script>
<script src="static/exports.js" defer></script>
<a class="skip" href="#page_main">s</a>
<main id="page_main"><div class="scroll" aria-label="Scores, 5 %">
<table class="sortable" id="scores">
<thead><tr><th>Name</th><th>RMSE<span class="under">position</span></th><th hidden>Left out</th></tr></thead><tbody>
<tr><th>b,"quoted"</th>
<td data-sort="2"><span class="value">2 <span class="unit">m</span></span>
<span class="interval">1 to 3</span></td><td hidden>x</td></tr>
<tr><th>a_[n=1]</th><td data-sort="1">1 m<span hidden>hidden words</span></td><td hidden>x</td></tr>
<tr hidden><th>filtered</th><td data-sort="0">0 m</td><td hidden>x</td></tr>
<tr><th>c</th><td data-export="9 m; 8 to 10" data-sort="9">9</td><td hidden>x</td></tr>
<tr><th>d</th><td colspan="2">refused</td></tr>
</tbody></table></div></main>"""
SVG = "{http://www.w3.org/2000/svg}"


def saved(page, place, words):
    """The content of what a button saves, and its name."""
    with page.expect_download() as caught:
        page.locator(place).get_by_role("button", name=words).click()
    return caught.value.path().read_bytes(), caught.value.suggested_filename


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_figure_is_saved_as_it_is_shown_with_title_and_legend_in_light_colours(visit, scheme):
    page = visit(PAGE, color_scheme=scheme)
    page.locator('#rmse-0 [data-name="shifted"] button').click()
    content, name = saved(page, "#rmse-0", "SVG")
    assert name == "easy-one-rmse-0.svg"
    tree = ET.fromstring(content)
    texts = [element.text for element in tree.iter(f"{SVG}text")]
    assert "RMSE of position over time" in texts
    assert {"plain", "twin"} <= set(texts)
    assert "shifted" not in texts
    assert {"time (s)", "RMSE (m)"} <= set(texts)
    assert tree.find(f"{SVG}desc").text == page.locator("#rmse-0 figcaption").text_content()
    drawn = {element.get("data-series") for element in tree.iter() if element.get("data-series")}
    key = {label: page.locator(f'#rmse-0 [data-name="{label}"]').get_attribute("data-key") for label in ("plain", "shifted")}
    assert key["plain"] in drawn
    assert key["shifted"] not in drawn
    assert b"var(" not in content
    assert b"#1a5eca" in content
    assert tree.find(f"{SVG}rect").get("style") == "fill: #ffffff"
    assert not [element for element in tree.iter() if any("http" in value for value in element.attrib.values())]


def test_a_figure_is_saved_as_an_image_twice_as_large(visit):
    page = visit(PAGE, color_scheme="dark")
    drawing = ET.fromstring(saved(page, "#rmse-0", "SVG")[0])
    content, name = saved(page, "#rmse-0", "PNG")
    assert name == "easy-one-rmse-0.png"
    image = Image.open(io.BytesIO(content)).convert("RGB")
    assert image.size == tuple(2 * int(drawing.get(side)) for side in ("width", "height"))
    assert image.getpixel((0, 0)) == image.getpixel((image.width - 1, image.height - 1)) == (255, 255, 255)
    colours = {colour for _, colour in image.getcolors(1 << 20)}
    assert (0x1A, 0x5E, 0xCA) in colours


@pytest.fixture
def table(visit, site, tmp_path):
    shutil.copytree(site / "static", tmp_path / "static")
    (tmp_path / "t.html").write_text(TABLE)
    return visit("t.html", tmp_path)


def test_a_table_is_saved_as_it_is_sorted_and_filtered(table):
    content, name = saved(table, "main", "CSV")
    assert name == "t-scores.csv"
    rows = list(csv.reader(io.StringIO(content.decode())))
    assert rows[0] == ["Name", "RMSE position"]
    assert rows[1:] == [['b,"quoted"', "2 m; 1 to 3"], ["a_[n=1]", "1 m"], ["c", "9 m; 8 to 10"], ["d", "refused", ""]]
    table.get_by_role("button", name="Sort by RMSE").click()
    rows = list(csv.reader(io.StringIO(saved(table, "main", "CSV")[0].decode())))
    assert [row[0] for row in rows[1:]] == ["a_[n=1]", 'b,"quoted"', "c", "d"]


def test_a_table_for_latex_has_rules_a_caption_and_no_bare_sign(table):
    content, name = saved(table, "main", "LaTeX")
    assert name == "t-scores.tex"
    lines = content.decode().splitlines()
    assert r"\caption{Scores, 5 \%}" in lines
    assert r"a\_{[}n=1{]} & 1 m \\" in lines
    assert [line for line in lines if line.endswith("rule")] == [r"\toprule", r"\midrule", r"\bottomrule"]
    assert lines[lines.index(r"\midrule") - 1] == r"Name & RMSE position \\"
    assert compiled(content.decode())


def test_both_ways_to_escape_words_for_latex_agree(table):
    text = "x".join(chr(code) for code in range(0x21, 0x2718))
    assert table.evaluate("text => exporting.latex(text)", text) == tex(text)
    assert tex("5 %\u202fof a_b\u00a0c") == r"5 \%\,of a\_b~c"


def compiled(text):
    """Whether LaTeX takes a text; true where it is not installed."""
    needed = ["kpsewhich", "pgfplots.sty", "booktabs.sty"]
    if shutil.which("pdflatex") is None or subprocess.run(needed, capture_output=True).returncode:
        return True
    preamble = r"\documentclass{article}\usepackage{pgfplots,booktabs}\pgfplotsset{compat=1.18}\begin{document}"
    whole = preamble + text + r"\end{document}"
    with tempfile.TemporaryDirectory() as folder:
        command = ["pdflatex", "-draftmode", "-halt-on-error"]
        return subprocess.run(command, input=whole.encode(), capture_output=True, cwd=folder).returncode == 0


LINES = Plot(
    "a", "A", "5 % of η × 10⁻² & more", None, ["u[n=1,m]"],
    [
        Column("time (s)", np.arange(4.0)),
        Column("u[n=1,m]", np.array([1, np.nan, 3, 4.0]), "u[n=1,m]"),
        Column("u[n=1,m], low", np.array([0.5, 1, 2, 3]), "u[n=1,m]", "low"),
        Column("u[n=1,m], high", np.array([2, 3, 4, np.inf]), "u[n=1,m]", "high"),
        Column("bound", np.ones(4)),
    ],
    y="RMSE (m)", log="y",
)  # fmt: skip
POINTS = Plot(
    "b", "B", "words", None, [],
    [
        Column("estimator", ["u[n=1,m]", "v_2", "u[n=1,m]"]),
        Column("cost (µs)", [1.0, 2.0, 3.0]), Column("cost, low", [0.5, 1.0, 2.0], role="low"),
        Column("cost, high", [2.0, 3.0, np.nan], role="high"), Column("RMSE (m)", [4.0, 5.0, 6.0], over="cost (µs)"),
    ],
    x="cost (µs)", y="RMSE (m)", log="x",
)  # fmt: skip
NAMED = Plot(
    "c", "C", "words", None, [], [Column("case", ["one, two", "b_c"]), Column("ratio", [1.0, 2.0], "s")], x="case", y="r"
)


def test_lines_for_latex_are_read_from_the_file_and_have_thin_ends_of_their_intervals():
    text = to_latex(LINES, "a.csv")
    plots = re.findall(r"\\addplot\+\[(.*?)\] table\[(.*?)\]\{a\.csv\}", text)
    assert [re.search(r"y index=(\d)", read)[1] for _, read in plots] == ["2", "3", "1", "4"]
    assert ["forget plot" in style for style, _ in plots] == [True, True, False, False]
    assert all("header=false, skip first n=1" in read for _, read in plots)
    assert re.findall(r"\\addlegendentry\{(.*)\}", text) == ["u{[}n=1,m{]}", "bound"]


def test_points_for_latex_carry_their_numbers_and_intervals():
    text = to_latex(POINTS, "b.csv")
    assert "b.csv" not in text
    assert re.findall(r"\\addlegendentry\{(.*)\}", text) == ["u{[}n=1,m{]}", r"v\_2"]
    assert "x xl xh y yl yh\n1 0.5 1 4 0 0\n3 1 0 6 0 0\n};" in text
    assert "x xl xh y yl yh\n2 1 1 5 0 0\n};" in text


def test_rows_with_names_have_them_at_the_ticks():
    text = to_latex(NAMED, "c.csv")
    assert r"xtick={1,...,2}, xticklabels={{one, two}, {b\_c}}" in text
    assert "x xl xh y yl yh\n1 0 0 1 0 0\n2 0 0 2 0 0\n};" in text


def test_latex_takes_the_figures(tmp_path):
    place = tmp_path / "a.csv"
    place.write_text(to_csv(LINES))
    assert compiled(to_latex(LINES, str(place)) + to_latex(POINTS, "b.csv") + to_latex(NAMED, "c.csv"))
