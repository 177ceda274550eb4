"""The site as a folder of pages: whole, linked, harmless, and right about the results."""

import dataclasses
import json
import math
import os
import re
import stat
import xml.etree.ElementTree as ET
from html import escape
from urllib.parse import unquote

import pytest

from reports import folder as folder_module
from reports.folder import MANIFEST
from reports.frame import SECTIONS
from reports.text import number
from suite import results
from suite.case import StateBlock
from suite.errors import BadInput
from suite.metrics import METRICS
from suite.store import Store
from tests.reports import conftest
from tests.reports.conftest import build, rendered

HOSTILE = (
    "<script>alert(1)</script>",
    "\"><img src=x onerror='alert(1)'>",
    "</script><svg onload=alert(1)>",
    "$\\frac{1}{2}$ \x00\x1b ‮ 漢字 {{ 7 * 7 }}",
    "../../etc/passwd",
    "A b",
    "a-b",
    "x" * 200,
    "",
)

ALWAYS = {"index.html", *(f"{name}.html" for name in SECTIONS)}
"""Pages that every site has."""


def check(folder, tools):
    """What holds for every site: valid structure, unique ids, links that resolve, nothing from outside."""
    pages = {path.name: tools.read(path) for path in folder.glob("*.html")}
    for name, page in pages.items():
        assert len(page.ids) == len(set(page.ids)), f"{name}: an id comes twice"
        assert page.headings[0] == 1, name
        assert page.headings.count(1) == 1, name
        assert all(b - a <= 1 for a, b in zip(page.headings, page.headings[1:], strict=False)), f"{name}: {page.headings}"
        assert not page.handlers, f"{name}: inline handlers {page.handlers}"
        scripts = [found for tag, found in page.attributes if tag == "script"]
        assert all("src" in found or found.get("type") == "application/json" for found in scripts), name
        assert all(found.get("scope") for tag, found in page.attributes if tag == "th"), name
        for link in page.links:
            target, _, anchor = link.partition("#")
            if link == "data:,":
                continue
            assert not re.match(r"[a-z]+:|//", link), f"{name} refers to {link}"
            assert not target or (folder / unquote(target)).is_file(), f"{name} refers to {link}"
            assert not anchor or anchor in pages.get(target or name).ids, f"{name} refers to {link}"
    return pages


def matrix(folder):
    return conftest.matrix(conftest.contents(folder))


def figures_of(page):
    return [found["id"] for tag, found in page.attributes if tag == "figure"]


def test_every_page_is_there_and_every_link_resolves(site, tools):
    pages = check(site, tools)
    cases = {"case-easy-one.html", "case-other.html", "case-lonely.html"}
    assert {name for name in pages if not name.startswith("estimator-")} == {*ALWAYS, *cases}
    assert (site / "static/style.css").is_file()
    assert (site / "static/site.js").is_file()


def test_the_case_page_tells_the_case(site, tools):
    page = tools.read(site / "case-easy-one.html")
    for words in (
        "Title of easy/one",
        "the model is too hard",
        "3 of 4",
        "1 lost",
        "Assumptions Made for tests .",
        "Of 1 published figure: 1 not examined.",
        "8.25 m",
        "another site",
        "filterbench run -c 'easy/one' -e plain shifted twin choosy broken frail --runs 4 --seed 1",
        "exceeds 1000 m for 3 consecutive steps",
        "12 steps of 0.5 s",
        "The lines of plain and twin lie on top of each other.",
        "Radar",
    ):
        assert words in " ".join(page.text.split()), words
    told = [name.removeprefix("metric-") for name in page.ids if name.startswith("metric-")]
    assert {"rmse", "crlb-ratio", "nees", "divergence", "latency"} <= set(told)
    captions = re.findall(r"<figcaption>.*?</figcaption>", (site / "case-easy-one.html").read_text(), re.S)
    drawn = sum(caption.count("<math") for caption in captions)
    assert drawn >= 5  # the formula of what it shows stands under a figure
    assert page.tags.count("math") == 1 + drawn + len(told)
    assert {"rmse-0", "rmse-1", "nees", "ratio-0", "ratio-1"} <= set(figures_of(page))


def test_figures_of_errors_have_the_bound(tools, tmp_path):
    """Its line is told below the figure, and its numbers are in the table."""
    loaded = tools.written(tmp_path / "r").add([tools.case()], [tools.scripted()]).load()
    page = rendered(loaded)["case-easy.html"]
    assert page.count("The dashed line without marks is the posterior Cramér-Rao bound.") == 2
    assert page.count('<th scope="col">posterior Cramér-Rao bound</th>') == 2
    assert number(float(loaded.cases["easy"].bounds[0].value[0, 0])) in page


def test_provenance_tells_what_went_wrong(site, tools):
    text = " ".join(tools.read(site / "provenance.html").text.split())
    for words in (
        "filterbench run",
        "RuntimeError: no <b>luck</b>",
        "Traceback",
        "the model is too hard",
        "step 3: gone",
        "numpy",
    ):
        assert words in text, words


def test_the_same_results_give_the_same_bytes(variety):
    assert rendered(variety) == rendered(variety)


@pytest.fixture
def hostile(tools, tmp_path):
    """Results in which every text tries to be markup."""
    cases = []
    for name in HOSTILE:
        words = {"title": name, "summary": name, "reference": name, "assumptions": (name,), "landmarks": ((name, 1.0, 2.0),)}
        blocks, state = (name or "b", "b " + name), (name, "b", "c", "d")
        cases.append(tools.case(name.replace("=", "-"), blocks=blocks, state=state, **words))
    estimators = [
        *(tools.scripted(name.replace("=", "-")) for name in HOSTILE[:4]),
        tools.scripted(HOSTILE[5], error=HOSTILE[0]),
        tools.scripted(HOSTILE[6], refusal=HOSTILE[1]),
    ]
    written = tools.written(tmp_path / "hostile", command=HOSTILE[0])
    return written.add(cases, estimators, runs=2).load()


def test_no_text_becomes_markup(hostile, tools, tmp_path):
    out = build(hostile, tmp_path / "site", HOSTILE[2])
    pages = check(out, tools)
    assert len([name for name in pages if name.startswith("case-")]) == len(HOSTILE)
    for page in pages.values():
        assert "img" not in page.tags
        assert not any("onload" in found or "onerror" in found for _, found in page.attributes)
    assert HOSTILE[0] in pages["index.html"].text
    assert matrix(out)["cells"][0][0][5][7] == HOSTILE[1]


def test_drawings_are_well_formed(site):
    text = (site / "case-easy-one.html").read_text(encoding="utf-8")
    drawings = re.findall(r"<svg xmlns.*?</svg>", text, re.S)
    assert len(drawings) == text.count('<div class="drawing">') > 6
    for drawing in drawings:
        tree = ET.fromstring(drawing)
        assert tree.get("role") == "img"
        assert {"title", "desc"} <= {element.tag.rpartition("}")[2] for element in tree}
        assert "#0a0" not in drawing
        assert "var(--ink)" in drawing


def test_without_results_the_pages_say_so(tools, tmp_path):
    Store(tmp_path / "empty", create=True)
    out = build(results.load(tmp_path / "empty"), tmp_path / "site")
    pages = check(out, tools)
    assert "there is nothing to compare yet" in pages["index.html"].text
    assert "nothing is stored" in pages["provenance.html"].text


@pytest.mark.parametrize(
    ("estimator", "words"),
    [
        ({}, "so there is nothing to compare it with"),
        ({"error": "broken"}, "no estimator has an RMSE of position"),
        ({"refusal": "too hard"}, "No run"),
        ({"value": math.nan}, "no estimator has an RMSE of position"),
        ({"shift": 1e150}, "RMSE"),
        ({"variance": 0.0}, "RMSE"),
    ],
)
@pytest.mark.parametrize("runs", [1, 3])
def test_a_single_cell(tools, tmp_path, estimator, words, runs):
    loaded = tools.written(tmp_path / "r").add([tools.case()], [tools.scripted("only", **estimator)], runs=runs).load()
    out = build(loaded, tmp_path / "site")
    pages = check(out, tools)
    text = " ".join(pages["index.html"].text.split())
    assert words in text
    assert {cell[4] for choices in matrix(out)["cells"][0] for cell in choices} == {""}


def test_a_case_without_truth_blames_its_estimators(tools, tmp_path):
    def fail(rng):
        raise ValueError("no truth today")

    written = tools.written(tmp_path / "r").add([tools.case()], [tools.scripted("only")])
    loaded = written.load()
    for path in (tmp_path / "r").rglob("truth/*.parquet"):
        path.unlink()
    loaded = written.load()
    out = build(loaded, tmp_path / "site")
    check(out, tools)
    assert matrix(out)["cells"][0][0][0][0] == "not run"


def test_many_estimators_and_long_series(tools, tmp_path):
    long = tools.case(steps=250, generate=lambda rng: _long(tools, rng))
    estimators = [tools.scripted(f"e{i}", shift=float(i)) for i in range(11)]
    loaded = tools.written(tmp_path / "r").add([long], estimators, runs=3).load()
    pages = rendered(loaded)
    assert len(pages["case-easy.html"]) < 3_000_000
    assert "30 of 250 rows" in pages["case-easy.html"]


def _long(tools, rng):
    from cases.linear_gaussian import MODEL
    from suite.case import draw

    return draw(MODEL, 250, rng)


@pytest.fixture
def quick(tools, tmp_path):
    """Results that are rendered at once: two cases that the only estimator refuses."""
    written = tools.written(tmp_path / "quick results")
    return written.add([tools.case("one"), tools.case("other")], [tools.scripted("only", refusal="too hard")]).load()


def test_stale_pages_go_and_other_files_stay(quick, tmp_path):
    out = build(quick, tmp_path / "site")
    (out / "CNAME").write_text("mine")
    (out / "case-mine.html").write_text("mine")
    (out / f".index.html.{2**22 + 1}.tmp").write_text("half")
    Store(tmp_path / "empty", create=True)
    build(results.load(tmp_path / "empty"), out)
    assert {p.name for p in out.iterdir()} == {"CNAME", "case-mine.html", "static", MANIFEST, *ALWAYS}
    assert (out / "CNAME").read_text() == "mine"


@pytest.mark.parametrize(
    "manifest",
    [
        "",
        "[]",
        '{"parts": 3}',
        '{"parts": {"a": {"key": "", "files": {"../../x": "", "/etc/passwd": "", "CNAME": ""}}}}',
        '{"parts": {"a": {"key": "", "files": ["CNAME"]}}}',
    ],
)
def test_a_damaged_list_of_files_removes_nothing(quick, tmp_path, manifest):
    out = build(quick, tmp_path / "site")
    (out / "CNAME").write_text("mine")
    (tmp_path / "x").write_text("mine")
    (out / MANIFEST).write_text(manifest)
    build(quick, out)
    assert (out / "CNAME").exists()
    assert (tmp_path / "x").exists()
    assert "case-other.html" in json.loads((out / MANIFEST).read_text())["parts"]["case-other.html"]["files"]


def test_an_interrupted_build_leaves_whole_pages_that_the_next_one_replaces(quick, tmp_path, monkeypatch):
    out = tmp_path / "site"
    write, written = folder_module.write_whole, []

    def interrupted(path, content):
        if len(written) == 8:
            raise KeyboardInterrupt
        written.append(path.name)
        write(path, content)

    monkeypatch.setattr(folder_module, "write_whole", interrupted)
    with pytest.raises(KeyboardInterrupt):
        build(quick, out)
    assert all(path.read_text().rstrip().endswith("</html>") for path in out.glob("*.html"))
    monkeypatch.undo()
    build(quick, out)
    assert not list(out.glob(".*"))


def test_a_failed_write_leaves_no_half_page(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "fsync", lambda _: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    Store(tmp_path / "empty", create=True)
    with pytest.raises(BadInput, match=r"cannot write the site to .*No space left"):
        build(results.load(tmp_path / "empty"), tmp_path / "site")
    assert [p for p in (tmp_path / "site").rglob("*") if p.is_file()] == []


def test_a_place_that_is_none_for_a_site(quick, tmp_path):
    file = tmp_path / "file"
    file.write_text("x")
    with pytest.raises(BadInput, match="is a file"):
        build(quick, file)
    with pytest.raises(BadInput, match="holds other files and no filterbench site"):
        build(quick, tmp_path)
    with pytest.raises(BadInput, match="cannot write the site"):
        build(quick, file / "below")


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write anywhere")
def test_a_folder_that_cannot_be_written(quick, tmp_path):
    folder = tmp_path / "locked"
    folder.mkdir()
    folder.chmod(stat.S_IRUSR | stat.S_IXUSR)
    with pytest.raises(BadInput, match="cannot write the site"):
        build(quick, folder / "site")


def test_a_case_without_blocks_of_its_divergence_is_still_shown(tools, tmp_path):
    loaded = tools.written(tmp_path / "r").add([tools.case()], [tools.scripted("a"), tools.scripted("b")]).load()
    case = loaded.cases["easy"]
    case.card = dataclasses.replace(case.card, plane=None, landmarks=(), equations=(), published=(), assumptions=(),
                                    blocks=(*case.card.blocks, StateBlock("unused", (0,), "")))  # fmt: skip
    case.bound = None
    page = rendered(loaded)["case-easy.html"]
    assert "ground plane" not in page
    assert "Published" not in page


def test_formulas_of_metrics_stand_below_their_figures(site):
    text = (site / "case-easy-one.html").read_text(encoding="utf-8")
    figures = dict(re.findall(r'<figure id="([^"]+)"(.*?)</figure>', text, re.S))
    for name, metric in (("rmse-0", "rmse"), ("nees", "nees"), ("cost-0", "latency")):
        assert escape(METRICS[metric].formula) in figures[name], name
    assert "before the mean over time" in figures["rmse-0"]
    assert "before the mean over time" not in figures["cost-0"]
