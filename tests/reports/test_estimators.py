"""The list of estimators and the page of each: right about the results, and honest where there are none."""

import csv
import dataclasses
import io
import itertools
import math
import re

import numpy as np
import pytest

from cases.linear_gaussian import MODEL
from reports.digest import from_json, to_json
from reports.dots import Dot, beyond, dots
from reports.frame import Frame
from reports.inputs import Inputs, Site, digest_of
from reports.marks import marks
from reports.pages import estimators
from reports.pages.outcomes import outcomes
from reports.text import quantity
from reports.views import private, view
from suite import results
from suite.case import FROM_ANOTHER, RECORDED, draw
from suite.metrics import METRICS, Score
from suite.score import table
from suite.store import Store
from tests.reports.conftest import rendered


def site_of(loaded, findings=None):
    """What the pages about several cases are given."""
    frame = Frame.of(loaded)
    said = {name: to_json(view(private(case), frame.labels)) for name, case in loaded.cases.items()}
    cases = [from_json(text, loaded.cases[name]) for name, text in said.items()]
    return Site(frame, Inputs(loaded, "filterbench report", findings or {}), cases, digest_of(list(said.values())))


def made(loaded):
    """The files of the pages of estimators."""
    return {name: text for part in estimators.parts(site_of(loaded)) for name, text in part.make(*part.arguments).items()}


def words_of(page):
    return " ".join(re.sub(r"<[^>]*>", " ", page.replace("<wbr>", "")).split())


def rows(page, name):
    """The cells of a table by the name of its case, by the words that their heads begin with."""
    head, body = re.search(rf'id="{name}".*?<thead>(.*?)</thead>.*?<tbody>(.*?)</tbody>', page, re.S).groups()
    heads = [words_of(cell) for cell in re.findall(r"<th[^>]*>(.*?)</th>", head, re.S)]
    found = [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row, re.S) for row in re.findall(r"<tr>(.*?)</tr>", body, re.S)]
    return {words_of(cells[0]).split()[0]: dict(zip(heads, map(words_of, cells), strict=True)) for cells in found}


def numbers(files, name):
    """The data of a figure by the name of its row: numbers, NaN for what is empty."""
    header, *lines = csv.reader(io.StringIO(files[name]))
    return {row[0]: dict(zip(header[1:], (float(x) if x else math.nan for x in row[1:]), strict=True)) for row in lines}


@pytest.fixture(scope="module")
def pages(variety):
    return made(variety)


def test_the_list_counts_what_the_results_hold(variety, pages):
    listing = pages["estimators.html"]
    for label in variety.labels:
        cells = [case.cells[label] for case in variety.cases.values() if label in case.cells]
        row = re.search(rf'<tr id="{label}">(.*?)</tr>', listing, re.S)[1]
        counts = [int(n) for n in re.findall(r'<td class="number" data-sort="(\d+)">', row)]
        ran = [cell for cell in cells if cell.runs]
        assert counts[:2] == [len(ran), sum(len(cell.runs) for cell in ran)], label
        if ran:
            status = [status for cell in ran for status in cell.estimate.status]
            assert counts[2:4] == [status.count("failed"), status.count("lost")], label
        assert f'href="estimator-{label}.html"' in row


def test_the_pages_show_the_scores_of_the_table(variety, pages):
    frame = table(variety, list(METRICS.values()), variety.cases, variety.labels)
    frame = frame.set_index(["estimator", "case", "metric", "block"])
    compared = 0
    shown = (
        ("results_table", "rmse", "", "RMSE"),
        ("results_table", "crlb-ratio", "", METRICS["crlb-ratio"].title),
        ("health_table", "nees", "state", "NEES"),
        ("cost_table", "latency", "step", "Latency of a step"),
        ("cost_table", "throughput", "step", "Throughput"),
    )
    for label, (name, metric, block, head) in itertools.product(("plain", "shifted", "twin", "frail"), shown):
        for case, cells in rows(pages[f"estimator-{label}.html"], name).items():
            key = label, case, metric, block or variety.cases[case].card.blocks[0].name
            if key not in frame.index or math.isnan(frame.loc[key].value):
                assert cells[head] == "none"
                continue
            r = frame.loc[key]
            words = quantity(Score(r.value, r.low, r.high, r.unit, r.runs, r.total), METRICS[metric])
            assert cells[head].startswith(" ".join(f"{words.value} {words.unit} {words.interval}".split())), key
            compared += 1
    assert compared > 30


def test_errors_are_drawn_over_the_bound_where_it_is_strict_and_else_over_the_smallest(tools, tmp_path):
    """The smallest is that of the estimators that are ranked; the intervals are scaled with the value."""
    cases = [tools.case("strict"), tools.case("loose", origin=FROM_ANOTHER)]
    estimators_ = [tools.scripted("good"), tools.scripted("off", shift=20.0), tools.scripted("frail", bad=(1,))]
    loaded = tools.written(tmp_path / "r").add(cases, estimators_, runs=4).load()
    files = made(loaded)
    rmse = {label: loaded.cases["loose"].cells[label].scores(METRICS["rmse"])["position"] for label in ("good", "off", "frail")}
    bound = loaded.cases["strict"].cells["off"].scores(METRICS["crlb-ratio"])["position"]
    found = numbers(files, "data/estimator-off-errors.csv")
    assert math.isclose(found["strict"]["RMSE over the bound"], bound.value, rel_tol=1e-6)
    assert math.isclose(found["strict"]["RMSE over the bound, high end"], bound.high, rel_tol=1e-6)
    assert math.isnan(found["strict"]["RMSE over the smallest"])
    assert math.isnan(found["loose"]["RMSE over the bound"])
    for end, name in (("value", ""), ("low", ", low end"), ("high", ", high end")):
        expected = getattr(rmse["off"], end) / rmse["good"].value
        assert math.isclose(found["loose"][f"RMSE over the smallest{name}"], expected, rel_tol=1e-6)
    assert "no strict bound" in words_of(files["estimator-off.html"])
    torn = numbers(files, "data/estimator-frail-errors.csv")
    assert math.isclose(torn["loose"]["RMSE over the smallest"], rmse["frail"].value / rmse["good"].value, rel_tol=1e-6)
    assert "which flatters: strict and loose" in words_of(files["estimator-frail.html"])
    assert "which flatters" not in files["estimator-off.html"]


def test_the_time_of_a_step_of_several_runs_is_one_over_the_throughput(variety, pages):
    found = numbers(pages, "data/estimator-shifted-cost.csv")["other"]
    score = variety.cases["other"].cells["shifted"].scores(METRICS["throughput"])["step"]
    head = "time of a step of a run, a few together (µs)"
    assert math.isclose(found[head], 1e6 / score.value, rel_tol=1e-6)
    assert math.isclose(found[f"{head}, low end"], 1e6 / score.high, rel_tol=1e-6)
    assert math.isclose(found[f"{head}, high end"], 1e6 / score.low, rel_tol=1e-6)
    assert found["n"] == len(variety.cases["other"].card.state)


def test_the_summary_is_of_the_cases_in_which_all_runs_came_through(variety):
    site = site_of(variety)
    of = outcomes(site.cases, site.frame.labels)
    plain, frail, shifted = (estimators.summary(of[label]) for label in ("plain", "frail", "shifted"))
    assert (plain.ran, plain.runs, plain.marked, plain.alone, plain.ranked) == (3, 9, 2, 0, 2)
    assert (frail.lost, frail.compared, frail.timed) == (2, 0, 2)
    ratios = []
    for name in ("easy/one", "other"):
        block = variety.cases[name].card.blocks[0].name
        values = {
            label: variety.cases[name].cells[label].scores(METRICS["rmse"])[block].value for label in ("shifted", "plain")
        }
        ratios.append(values["shifted"] / values["plain"])
    assert math.isclose(shifted.ratio, np.median(ratios))


def test_pages_tell_what_went_wrong(pages):
    broken, frail = words_of(pages["estimator-broken.html"]), words_of(pages["estimator-frail.html"])
    assert "no &lt;b&gt;luck&lt;/b&gt;" in broken
    assert "Of 8 runs, 8 failed, none was lost" in broken
    assert "step 3: gone" in frail
    assert "2 were lost" in frail
    shifted = words_of(pages["estimator-shifted.html"])
    assert "optimistic" in shifted
    assert "Not run no run of it is stored : lonely" in shifted
    assert "No run failed, was lost or diverged." in words_of(pages["estimator-plain.html"])


def test_an_estimator_that_refused_everything_says_so_and_shows_no_results(pages):
    text = words_of(pages["estimator-choosy.html"])
    assert "It ran on 0 of 3 cases, and refused 2; on 1 it was not run." in text
    assert text.count("the model is too hard") == 1
    assert "the model is too hard : easy/one , other" in text
    for heading in ("Results on all cases", "Cost", "Health"):
        assert f">{heading}</h2>" not in pages["estimator-choosy.html"]
    assert "data/estimator-choosy-errors.csv" not in pages


def test_variants_of_a_name_lead_to_each_other(tools, tmp_path):
    loaded = tools.written(tmp_path / "r").add([tools.case()], [tools.scripted(name) for name in ("a", "b", "c")]).load()
    for label in ("a", "b"):
        loaded.cases["easy"].cells[label].meta |= {"name": "same", "parameters": {"particles": 7 if label == "a" else 0.25}}
    files = made(loaded)
    assert 'href="estimator-b.html">b</a>, with other parameters' in files["estimator-a.html"]
    assert 'href="estimator-a.html">a</a>, with other parameters' in files["estimator-b.html"]
    assert "with other parameters" not in files["estimator-c.html"]
    assert "particles = 0.25" in words_of(files["estimator-b.html"])
    assert "it carries 7 particles" in words_of(files["estimator-a.html"])


def test_a_page_follows_from_its_own_estimator_alone(tools, tmp_path):
    """Another one that is far off anyway may become worse: pages of the rest are kept."""

    def keys(shift):
        chosen = [tools.scripted("good"), tools.scripted("off", shift=shift)]
        loaded = tools.written(tmp_path / f"r{shift}").add([tools.case()], chosen).load()
        return {part.name: part.key for part in estimators.parts(site_of(loaded))}

    one, other = keys(30.0), keys(40.0)
    assert one["estimator-good.html"] == other["estimator-good.html"]
    assert one["estimator-off.html"] != other["estimator-off.html"]
    assert one["estimators.html"] != other["estimators.html"]


def test_a_truth_that_is_not_known_is_said(tools, tmp_path):
    def generate(rng):
        truth = draw(MODEL, tools.steps, rng)
        return dataclasses.replace(truth, x=np.full_like(truth.x, math.nan))

    loaded = tools.written(tmp_path / "r").add([tools.case(generate=generate)], [tools.scripted("only")]).load()
    files = made(loaded)
    assert "whether any diverged is not known, since the truth is not." in words_of(files["estimator-only.html"])
    assert "Not drawn, since the truth is not known" in files["estimator-only.html"]
    row = re.search(r'<tr id="only">(.*?)</tr>', files["estimators.html"], re.S)[1]
    assert "not known" in row
    assert "nobody is ranked" in row


def test_errors_that_are_rounding_rank_nobody(tools, tmp_path):
    """What one filter rounds better than another is no merit of it, and a ratio to it no error."""

    class Exact(tools.scripted):
        def run(self, model, y, seed):
            estimate = super().run(model, y, seed)
            estimate.mean[:] = 1.0 + self.shift
            return estimate

    def generate(rng):
        truth = draw(MODEL, tools.steps, rng)
        return dataclasses.replace(truth, x=np.ones_like(truth.x))

    case = tools.case(generate=generate, origin=FROM_ANOTHER)
    chosen = [Exact("a", shift=1e-15), Exact("b", shift=1e-14), Exact("c", shift=5.0)]
    loaded = tools.written(tmp_path / "r").add([case], chosen).load()
    files = made(loaded)
    for label in ("a", "b", "c"):
        assert "On no case that it ran on can estimators be ranked" in words_of(files[f"estimator-{label}.html"])
        assert f"data/estimator-{label}-errors.csv" not in files


def test_runs_of_a_recording_are_named(tools, tmp_path):
    cases = [tools.case("taped", origin=RECORDED)]
    loaded = tools.written(tmp_path / "r").add(cases, [tools.scripted("a"), tools.scripted("b", shift=5.0)]).load()
    page = made(loaded)["estimator-b.html"]
    assert "Of one recording, so that intervals tell of its own random numbers only: taped." in words_of(page)


def test_without_results_the_list_says_so(tmp_path):
    Store(tmp_path / "empty", create=True)
    files = rendered(results.load(tmp_path / "empty"))
    assert "No estimator is in this results folder" in files["estimators.html"]


def places(drawing, name):
    """Centres of the dots of a series, from the left and from the top."""
    groups = re.findall(rf'<g class="series" data-series="{name}">\s*<defs>(.*?)</g>', drawing, re.S)
    return [(float(x), float(y)) for group in groups for x, y in re.findall(r'<use[^>]* x="([\d.]+)" y="([\d.]+)"', group)]


def test_dots_stand_on_a_logarithmic_axis_in_their_rows():
    mark = marks(["a"])["a"]
    shown = [Dot(i, value, math.nan, math.nan, mark) for i, value in enumerate((10.0, 1.0, 100.0))]
    (first, second, third) = places(dots(["x", "y", "z"], shown, "d", "t", "axis"), mark.series)
    assert math.isclose(first[0] - second[0], third[0] - first[0], rel_tol=0.02)
    assert first[0] - second[0] > 50
    assert first[1] < second[1] < third[1]


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_what_has_no_place_on_a_logarithmic_axis_is_not_drawn(value):
    mark = marks(["a"])["a"]
    assert dots(["x"], [Dot(0, value, math.nan, math.nan, mark)], "d", "t", "axis") is None
    drawing = dots(["x", "y"], [Dot(0, value, 0.5, 2.0, mark), Dot(1, 1.0, 0.5, 2.0, mark)], "d", "t", "axis")
    assert len(places(drawing, mark.series)) == 1


def test_a_value_far_from_the_reference_is_an_arrow_that_leaves_the_others_apart():
    mark = marks(["a"])["a"]
    near = [Dot(0, 1.0, 0.5, 2.0, mark), Dot(1, 10.0, 5.0, 20.0, mark)]
    far = Dot(2, 1e9, 1e8, 1e10, mark)
    assert beyond([*near, far], 1.0) == [far]
    assert beyond([dataclasses.replace(far, value=1e-4)], 1.0)
    assert beyond(near, 1.0) == []
    drawing = dots(["x", "y", "z"], [*near, far], "d", "t", "axis", 1.0)
    left, right, edge = sorted(x for x, _ in places(drawing, mark.series))
    assert right - left > 30
    assert edge > right
