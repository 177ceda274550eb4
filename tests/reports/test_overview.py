"""The overview: what its matrix says of every choice, held against the table of scores, and its files."""

import dataclasses
import itertools
import json
import math
import re
from types import SimpleNamespace

import pytest

from reports.frame import Frame
from reports.inputs import Inputs, Site
from reports.pages import overview
from reports.pages.choices import choices
from reports.pages.matrix import row
from reports.text import quantity
from reports.views import private, view
from suite import results
from suite.case import GIVEN_TRACK, RECORDED
from suite.metrics import METRICS, Score
from suite.score import table, to_json
from suite.store import Store
from tests.reports.conftest import Page, handed, matrix

ENDS = (1.1, 1.5, 3.0, 10.0)


def views(loaded):
    return [view(private(case), loaded.labels) for case in loaded.cases.values()]


def files_of(labels, cases):
    """The files of the overview of some cases."""
    frame = Frame.of(SimpleNamespace(labels=list(labels), cases={case.card.name: case for case in cases}))
    found = {}
    for part in overview.parts(Site(frame, Inputs(None, "", {}), cases, "")):
        found |= part.make(*part.arguments)
    return found


def chosen(cases, name, block=None, behind=""):
    """The choice of a metric and block."""
    return next(c for c in choices(cases) if (c.metric.name, c.block, c.behind) == (name, block, behind))


def scored(loaded):
    """What `filterbench score --format json` says, by case, estimator, metric and block."""
    said = json.loads(to_json(table(loaded, list(METRICS.values()), loaded.cases, loaded.labels)))
    return {tuple(r[name] for name in ("case", "estimator", "metric", "block")): r for r in said if r["metric"]}


def as_float(value):
    return math.nan if value is None else float(value)


@pytest.fixture(scope="session")
def files(variety):
    return files_of(variety.labels, views(variety))


@pytest.fixture(scope="session")
def score_of(variety):
    return scored(variety)


def test_the_matrix_says_what_the_table_of_scores_says(variety, files, score_of):
    data, cases = matrix(files), views(variety)
    assert [choice["id"] for choice in data["choices"]] == [choice.id for choice in choices(cases)]
    compared = 0
    for case, shown in zip(cases, data["cells"], strict=True):
        for choice, cells in zip(choices(cases), shown, strict=True):
            for label, cell in zip(variety.labels, cells, strict=True):
                if cell[0] not in ("done", "partly", "barred"):
                    assert cell[1] in ("refused", "failed", "lost", "not run", "no such block", "not timed", "none")
                    assert cell[7]
                    continue
                r = score_of[case.card.name, label, *choice.key(case)]
                numbers = [as_float(r[name]) for name in ("value", "low", "high")]
                words = quantity(Score(*numbers, r["unit"], r["runs"], r["total"]), choice.metric)
                assert cell[1:4] == [words.value, words.unit, words.interval]
                expected = {"best": "best", "tied": "tie"}.get(r["standing"], "")
                assert cell[4] == (expected if case.card.name != "lonely" else "")
                compared += 1
    assert compared > 100


def test_numbers_to_sort_by_are_those_of_the_table_of_scores(variety, files, score_of):
    cases = views(variety)
    compared = 0
    for choice in choices(cases):
        _, rows = handed(files[f"data/matrix-{choice.id}.js"])
        for case, shown in zip(cases, rows, strict=True):
            for label, cell in zip(variety.labels, shown["cells"], strict=True):
                number = cell[9] if cell and len(cell) > 9 else None
                if number is not None:
                    value = as_float(score_of[case.card.name, label, *choice.key(case)]["value"])
                    assert number == pytest.approx(value, rel=1e-5)
                    compared += 1
    assert compared > 100


def test_the_page_itself_shows_the_first_choice(variety, files):
    """Read without its scripts: values, intervals, marks, and every state in words."""
    page = Page(files["index.html"])
    first = [row(case, choices(views(variety))[0]) for case in views(variety)]
    cells = [text for text in page.cells if text.strip()]
    for shown in itertools.chain.from_iterable(each.cells for each in first):
        if shown:
            assert any(shown.value in text and shown.interval in text and shown.mark in text for text in cells)
    states = re.findall(r'<td class="cell ([a-z-]+)', files["index.html"])
    assert len(states) == len(variety.labels) * len(variety.cases)
    assert states[: len(variety.labels)] == ["done", "barred", "done", "refused", "failed", "partly"]


def test_states_differ_and_give_their_reason(variety, files):
    data = matrix(files)
    cells = dict(zip(variety.labels, data["cells"][0][0], strict=True))
    assert {label: cell[0] for label, cell in cells.items()} == {
        "plain": "done", "shifted": "barred", "twin": "done", "choosy": "refused", "broken": "failed", "frail": "partly",
    }  # fmt: skip
    assert cells["choosy"][7] == "the model is too hard"
    assert "no <b>luck</b>" in cells["broken"][7]
    assert cells["frail"][5] == "3 of 4 runs"
    assert cells["frail"][4] == cells["frail"][6] == ""
    assert (cells["plain"][4], cells["twin"][4], cells["shifted"][4]) == ("tie", "tie", "")
    lonely = dict(zip(variety.labels, data["cells"][2][0], strict=True))
    assert lonely["plain"][3] == "one run"
    assert lonely["plain"][4] == lonely["plain"][6] == ""
    assert lonely["twin"][0] == "not run"


def test_colours_are_ratios_to_the_best_that_competes_and_to_the_bound(tools, tmp_path):
    estimators = [tools.scripted(f"e{shift}", shift=shift, variance=100 + shift**2 / 2) for shift in (3.0, 9.0, 30.0, 200.0)]
    estimators.append(tools.scripted("sure", variance=1.0))
    strict, track = tools.case("strict"), tools.case("track", origin=GIVEN_TRACK)
    loaded = tools.written(tmp_path / "r").add([strict, track], estimators, seconds=0).load()
    cases, score_of = views(loaded), scored(loaded)
    choice = chosen(cases, "rmse", "position")
    for case in cases:
        name = case.card.name
        values = {label: score_of[name, label, "rmse", "position"]["value"] for label in loaded.labels}
        shown = dict(zip(loaded.labels, row(case, choice).cells, strict=True))
        competing = [label for label in loaded.labels if shown[label].state == "done"]
        assert len(competing) > 2
        assert ("sure" in competing) == (name == "track")
        assert (shown["sure"].ratio < 1) == (name == "strict")
        best = min(values[label] for label in competing)
        for place, label in enumerate(sorted(competing, key=values.get), 1):
            cell = shown[label]
            assert cell.ratio == pytest.approx(values[label] / best)
            assert cell.shade == sum(values[label] / best > end for end in ENDS)
            assert cell.place == place
            over = score_of[name, label, "crlb-ratio", "position"]["value"]
            assert cell.bound == (sum(over > end for end in ENDS) if name == "strict" else -1)
        for label in set(loaded.labels) - set(competing):
            assert (shown[label].shade, shown[label].bound, shown[label].place) == (-1, -1, 0)
    assert len({cell.shade for case in cases for cell in row(case, choice).cells}) > 2


def test_only_errors_offer_the_bound_and_only_where_a_case_has_one(tools, tmp_path):
    loaded = tools.written(tmp_path / "r").add([tools.case()], [tools.scripted()], seconds=0).load()
    assert {choice.metric.name for choice in choices(views(loaded)) if choice.bound} == {"rmse", "crlb-ratio"}
    loaded.cases["easy"].bound = None
    assert not any(choice.bound for choice in choices(views(loaded)))


def scaled(case, key, factor):
    """A case whose scores of one kind are so many times as large."""

    def smaller(score):
        return dataclasses.replace(score, value=factor * score.value, low=factor * score.low, high=factor * score.high)

    cells = {
        label: dataclasses.replace(cell, scores={k: smaller(s) if k == key else s for k, s in cell.scores.items()})
        for label, cell in case.cells.items()
    }
    return dataclasses.replace(case, cells=cells)


def test_errors_that_are_rounding_are_called_negligible_and_rank_nobody(variety):
    first, key = views(variety)[0], ("rmse", "position")
    choice = chosen([first], *key)
    assert any(cell.mark for cell in row(first, choice).cells if cell)
    tiny = row(scaled(first, key, 1e-13), choice).cells
    assert {cell.state for cell in tiny if cell and cell.number < 1e-9} == {"negligible"}
    for cell in filter(None, tiny):
        assert (cell.mark, cell.shade, cell.bound, cell.place) == ("", -1, -1, 0)
        assert math.isnan(cell.ratio)
    assert re.fullmatch(r"an error of .* × 10⁻¹. m is rounding; nobody is ranked by it", tiny[0].note)
    assert row(scaled(first, key, 1e-5), choice).cells[0].mark == "tie"


def test_a_block_that_a_case_lacks_is_named_with_those_it_has(variety):
    cases = views(variety)
    cells = row(cases[1], chosen(cases, "rmse", "velocity")).cells
    assert cells[0].value == "no such block"
    assert cells[0].note == "this case has no velocity; its state blocks are horizontal position and speed"
    assert cells[3] is None


def test_each_choice_comes_once_and_the_first_block_leads(variety):
    first, *others = views(variety)
    cases = [dataclasses.replace(first, keys=(*first.keys, ("rmse", "position, surviving runs"))), *others]
    offered = choices(cases)
    assert len({choice.id for choice in offered}) == len({(c.metric.name, c.block, c.behind) for c in offered}) == len(offered)
    for _, group in itertools.groupby(offered, lambda choice: choice.metric.name):
        led = list(group)
        assert led[0].block is None or all(choice.block is not None for choice in led)
    blocks = [c.named for c in offered if c.metric.name == "rmse"]
    assert blocks[:2] == ["first block of each case", "first block of each case, surviving runs"]
    assert {"position", "velocity", "horizontal position", "speed", "position, surviving runs"} <= set(blocks)
    assert choices(cases)[0].key(cases[1]) == ("rmse", "horizontal position")


def test_a_recording_has_no_places(variety):
    case = views(variety)[0]
    case.results.card = dataclasses.replace(case.card, origin=RECORDED)
    unmarked = dataclasses.replace(
        case, cells={label: dataclasses.replace(cell, standing={}) for label, cell in case.cells.items()}
    )
    assert {cell.place for cell in row(unmarked, choices([case])[0]).cells if cell} == {0}


def test_kinds_of_estimators_follow_from_what_they_have(variety):
    case = views(variety)[0]
    plain = case.cells["plain"]

    def kinds(label="x", meta=None, metrics=()):
        scores = {(name, "b"): Score(1.0, 1.0, 1.0, "", 2, 2) for name in metrics}
        cell = dataclasses.replace(plain, meta={"name": label} if meta is None else meta, scores=scores)
        return overview.kinds(label, [dataclasses.replace(case, cells={label: cell})])

    assert kinds() == ["plain"]
    assert kinds(meta={"parameters": {"particles": 10}}) == ["particles"]
    assert kinds(metrics=["brier"]) == ["plain", "modes"]
    assert kinds(metrics=["auc"]) == ["plain", "detects"]
    assert kinds("lib:ukf[alpha=1]") == ["plain", "library"]
    assert kinds("ukf[file=a:b]") == ["plain"]
    assert kinds(meta={}) == []


def test_the_list_of_cases_is_grouped_and_counts_who_ran(variety):
    cases = views(variety)
    twin = dataclasses.replace(cases[0].results, card=dataclasses.replace(cases[0].card, name="easy/two"))
    page = Page(files_of(variety.labels, [*cases, dataclasses.replace(cases[0], results=twin)])["index.html"])
    text = " ".join(page.text.split())
    listing = text[text.rindex("Cases easy") :]
    assert listing.index("easy/one") < listing.index("easy/two") < listing.index("Others") < listing.index("lonely")
    assert "Truth drawn from the model. 5 of 6 estimators ran, up to 4 runs each." in listing
    assert "cases" in page.ids


def test_a_page_of_thirty_by_thirty_is_light(variety):
    first = views(variety)[0]
    ran = [cell for cell in first.cells.values() if cell.ran]
    labels = [f"estimator-number-{i}" for i in range(30)]
    cells = {label: dataclasses.replace(cell, label=label) for label, cell in zip(labels, itertools.cycle(ran), strict=False)}
    cases = []
    for i in range(30):
        held = dataclasses.replace(first.results, card=dataclasses.replace(first.card, name=f"family-{i % 5}/case-number-{i}"))
        cases.append(dataclasses.replace(first, results=held, cells=cells))
    frame = Frame.of(SimpleNamespace(labels=labels, cases={case.card.name: case for case in cases}))
    assert len(overview.files(frame, cases)["index.html"]) < 500_000
    scripts = overview.data_files(cases, choices(cases)[0].metric.family).values()
    assert scripts
    assert max(map(len, scripts)) < 200_000


def test_data_cannot_break_out_of_their_script(tools, tmp_path):
    bad = '</script>"); alert(1); //\u2028'
    loaded = tools.written(tmp_path / "r").add([tools.case(blocks=(bad, "b"))], [tools.scripted(bad)], seconds=0).load()
    files = files_of(loaded.labels, views(loaded))
    for name, text in files.items():
        if name.startswith("data/"):
            assert text.isascii()
            assert handed(text)[1][0]["cells"]
    assert "alert" in matrix(files)["cells"][0][0][0][0] + files["index.html"]
    assert "</script>&#34;" not in files["index.html"]
    assert Page(files["index.html"]).tags.count("script") == files["index.html"].count("</script>")


def test_without_results_the_overview_says_so(tmp_path):
    Store(tmp_path / "empty", create=True)
    loaded = results.load(tmp_path / "empty")
    files = files_of(loaded.labels, views(loaded))
    assert list(files) == ["index.html"]
    page = Page(files["index.html"])
    assert "There is no result to show." in page.text
    assert "0 cases, 0 estimators." in " ".join(page.text.split())
    assert "table" not in page.tags
