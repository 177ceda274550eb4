"""The page of detectors: its curves, its operating points and its scores are those of the command line."""

import csv
import dataclasses
import functools
import json
import math
import re

import numpy as np
import pytest

from cases import CASES
from estimators import ESTIMATORS
from reports import curves
from reports.detectors import MOST_CORNERS, NEAR_ENOUGH, _thinned
from reports.digest import from_json, to_json
from reports.frame import Frame
from reports.inputs import Inputs, Site
from reports.marks import marks
from reports.pages import detection
from reports.plot import to_csv
from reports.text import quantity
from reports.views import view
from suite import results, roc
from suite.case_bounds import bounds_of
from suite.effort import BRIEF
from suite.metrics import METRICS, Score
from tests.reports import conftest
from tests.reports.conftest import Page, Written

CASE, TWIN = "manoeuvre-detection/naval-loose", "manoeuvre-detection/naval-loose-straight"
STEM = "manoeuvre-detection-naval-loose"


class Detector:
    """An estimator that is stored under its name and neither refuses nor raises."""

    refusal = error = ""

    def __init__(self, name):
        self.name, self.reference, self.run, self.accepts = name, "", ESTIMATORS[name].run, ESTIMATORS[name].accepts


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two detectors and a filter without a statistic, all on the case, one detector on its twin."""
    found = tmp_path_factory.mktemp("detectors") / "results"
    with pytest.MonkeyPatch.context() as patch:
        few = dataclasses.replace(BRIEF, trajectories=100)  # of bounds, at which nothing here looks
        patch.setattr(conftest, "bounds_of", functools.partial(bounds_of, effort=few))
        chosen = [Detector(name) for name in ("nis-chi2", "glr", "ekf")]
        Written(found).add([CASES[CASE]], chosen, runs=10, seconds=0)
        Written(found).add([CASES[TWIN]], chosen[:1], runs=10, seconds=0)
    return found


@pytest.fixture(scope="module")
def loaded(folder):
    return results.load(folder)


@pytest.fixture(scope="module")
def digests(loaded):
    """The digest of each case."""
    return {name: to_json(view(case, loaded.labels)) for name, case in loaded.cases.items()}


@pytest.fixture(scope="module")
def case(loaded, digests):
    return from_json(digests[CASE], loaded.cases[CASE])


@pytest.fixture(scope="module")
def files(loaded, digests):
    """The files of the page."""
    return made(loaded, [from_json(digests[name], case) for name, case in loaded.cases.items()])


def made(loaded, cases):
    (part,) = detection.parts(Site(Frame.of(loaded), Inputs(loaded, "", {}), cases, ""))
    return part.make(*part.arguments)


def tables(files):
    """Rows of cells of the tables of the page, by their names."""
    found = re.findall(r'aria-label="([^"]*)" tabindex="0">\s*<table.*?<tbody>(.*?)</tbody>', files["detection.html"], re.S)
    rows = {name: re.findall(r"<tr>(.*?)</tr>", body, re.S) for name, body in found}
    return {name: [[" ".join(cell.split()) for cell in Page(row).cells] for row in held] for name, held in rows.items()}


def test_operating_points_are_those_of_the_command(files, digests, folder, cli):
    said = json.loads(cli("detect", "--results", folder, "--format", "json").out)
    rows = list(csv.DictReader(files[f"data/detection-points-{STEM}.csv"].splitlines()))
    assert [row["estimator"] for row in rows] == [row["estimator"] for row in said] == ["nis-chi2"] * 3 + ["glr"] * 3
    for row, point in zip(rows, said, strict=True):
        for name, shown in row.items():
            if name != "estimator":
                assert shown == ("" if point[name] is None else f"{point[name]:.7g}")
    held = json.loads(digests[CASE])["detectors"]
    points = [{"estimator": each["label"], **point} for each in held for point in each["points"]]
    assert points == [{name: row[name] for name in row if name not in ("case", "twin", "seed")} for row in said]


def test_the_table_shows_them_with_their_intervals_and_what_was_missed(files, folder, cli):
    said = json.loads(cli("detect", "--results", folder, "--format", "json").out)
    rows = tables(files)[f"Operating points on {CASE}"]
    assert len(rows) == len(said) == 6
    for row, point in zip(rows, said, strict=True):
        assert row[:2] == [point["estimator"], f"{point['level']:g}"]
        for place, (name, unit) in enumerate(detection.UNITS.items(), start=3):
            value, low, high = (point[name + end] for end in ("", "_low", "_high"))
            words = quantity(Score(value or 0.0, low or 0.0, high or 0.0, unit, 2, 2), METRICS["detection-delay"])
            shown = f"{words.value} {words.unit} {words.interval}"
            assert row[place] == ("none" if value is None else " ".join(shown.split()))
        assert int(row[7]) == point["runs"] - round(point["detection"] * point["runs"])
        assert row[9] == ("10 of the twin" if point["estimator"] == "nis-chi2" else "steps before manoeuvres")


def test_scores_are_those_of_the_command(files, folder, cli):
    said = json.loads(cli("score", "--results", folder, "-c", CASE, "--format", "json").out)
    held = {(row["estimator"], row["metric"], row["block"]): row for row in said}
    page = tables(files)
    compared = 0
    for row in page[f"Scores on {CASE}"]:
        for key, cell in zip(detection.SCORES, row[1:], strict=True):
            found = held.get((row[0], *key))
            if found is None or not found["runs"]:
                assert cell == "none"
                continue
            words = quantity(
                Score(found["value"], found["low"], found["high"], found["unit"] or "", found["runs"], found["total"]),
                METRICS[key[0]],
            )
            mark = {"best": "best", "tied": "tie"}.get(found["standing"], "")
            assert cell.split() == f"{words.value} {words.unit} {words.interval} {mark}".split()
            compared += 1
    assert compared == 4 + 4 + 2  # areas of both; of the one that has runs of the twin the two at the level
    assert [row[1] for row in page["Areas on all cases"]] == [row[1] for row in page[f"Scores on {CASE}"]]


def test_the_page_says_what_thresholds_are_set_on(files):
    text = " ".join(Page(files["detection.html"]).text.split())
    for words in (
        "Thresholds are set on 10 runs of the twin without manoeuvres",
        "Fewer than 36 such runs are few:",
        f"No run of the twin {TWIN} is stored of glr: thresholds are set on the steps before manoeuvres",
        f"filterbench run -c '{TWIN}'",
    ):
        assert words in text
    assert next(n for n in range(1, 100) if 0.9**n <= 0.025) == detection.ENOUGH


def test_curves_are_those_of_the_scores(files, case):
    """From the first false-alarm rates of the file to the last, the area is what the metric says."""
    scan = to_csv(curves.roc(case.detectors, "scan", marks(["nis-chi2", "glr"]), "roc"))
    for kind, text in (("manoeuvre", files[f"data/detection-roc-manoeuvre-{STEM}.csv"]), ("scan", scan)):
        rows = list(csv.DictReader(text.splitlines()))
        for label in ("nis-chi2", "glr"):
            names = (f"{label}, false-alarm rate", f"{label}, detection rate")
            curve = np.array([[row[name] for name in names] for row in rows if row[names[0]]], float)
            assert (curve[0] == 0).all()
            assert (curve[-1] == 1).all()
            area = np.trapezoid(curve[:, 1], curve[:, 0])
            assert area == pytest.approx(case.cells[label].scores["auc", kind].value, abs=1e-5 if kind == "manoeuvre" else 2e-3)


def test_a_case_without_manoeuvres_or_statistics_has_no_section(files):
    page = Page(files["detection.html"])
    assert [name for name in page.ids if name.startswith("manoeuvre-detection")] == [STEM]
    assert "ekf" not in {row[0] for rows in tables(files).values() for row in rows}


def test_of_many_detectors_the_marked_and_then_the_largest_are_shown_first(case):
    label = case.detectors[0].label
    few = case.cells[label].scores["auc", "manoeuvre"]
    names = [f"d{i}" for i in range(10)]
    case = from_json(digest_with(case, names, few), case.results)
    assert detection._first(case) == ["d0", "d9", "d8", "d7", "d6", "d5", "d4", "d3"]


def digest_with(case, names, score):
    """The digest of a case with detectors of those names, whose areas grow; the first is marked as a tie."""
    said = json.loads(to_json(case))
    cell, detector = said["estimators"][0], said["detectors"][0]
    areas = [["auc", "manoeuvre", i / 10, 0, 1, "", score.runs, score.total, "" if i else "tied"] for i in range(len(names))]
    said["estimators"] = [cell | {"label": name, "scores": [area]} for name, area in zip(names, areas, strict=True)]
    said["detectors"] = [detector | {"label": name} for name in names]
    return json.dumps(said)


def test_without_detectors_the_page_says_how_to_run_them(loaded, case):
    found = made(loaded, [dataclasses.replace(case, detectors=())])
    page = Page(found["detection.html"])
    assert list(found) == ["detection.html"]
    assert "Nothing here has both a decision statistic and manoeuvres" in " ".join(page.text.split())
    assert "filterbench run -e nis-chi2 glr" in " ".join(page.text.split())
    assert not {"figure", "table"} & set(page.tags)


def test_the_page_holds_together(files):
    page = Page(files["detection.html"])
    assert len(page.ids) == len(set(page.ids))
    assert page.headings == [1, 2, 2, *[3] * 4]
    assert {link[1:] for link in page.links if link.startswith("#")} <= set(page.ids)
    assert {link for link in page.links if link.startswith("data/")} == {name for name in files if name.startswith("data/")}
    names = [found["aria-label"] for _, found in page.attributes if found.get("role") == "region"]
    assert len(names) == len(set(names)) == 5


def distance(point, kept):
    """From a point to the nearest of the segments through points kept[K, 2]."""
    start, along = kept[:-1], np.diff(kept, axis=0)
    share = np.clip(((point - start) * along).sum(1) / (along**2).sum(1), 0, 1)
    return np.hypot(*(point - start - share[:, None] * along).T).min()


def scored(quiet, loud, seed, levels=None):
    """Scores of one run each, drawn from normal laws; rounded to so many levels a unit."""
    rng = np.random.default_rng(seed)
    found = np.full((2, 1, quiet + loud), np.nan)
    found[0, 0, :quiet], found[1, 0, quiet:] = rng.normal(size=quiet), rng.normal(1.0, size=loud)
    return np.round(found * levels) / levels if levels else found


@pytest.mark.parametrize(
    "scores",
    [scored(3000, 500, 1), scored(900, 900, 2), scored(40_000, 4000, 3, 100), scored(2500, 2500, 4, 3)],
    ids=["uneven", "even", "many ties", "few values"],
)
def test_a_thinned_curve_is_nowhere_farther_than_a_drawing_shows(scores):
    curve = roc.curve(scores)
    kept = np.transpose(_thinned(curve))
    assert len(kept) <= MOST_CORNERS
    whole = np.stack([curve.false_alarm, curve.detection], axis=1)
    assert max(distance(point, kept) for point in whole[:: max(1, len(whole) // 800)]) <= NEAR_ENOUGH < 1 / 400
    assert {tuple(point) for point in kept} <= {tuple(point) for point in whole}


def test_a_short_curve_keeps_its_corners_and_nothing_else():
    """In the order NQQNN|M, from the highest: up, then level, then up; the ends and the two corners."""
    scores = np.full((2, 1, 6), np.nan)
    scores[0, 0, :3], scores[1, 0, 3:] = [5, 4, 1], [7, 6, 3]
    np.testing.assert_allclose(_thinned(roc.curve(scores)), ([0, 0, 2 / 3, 2 / 3, 1], [0, 2 / 3, 2 / 3, 1, 1]), atol=1e-15)
    tied = np.full((2, 1, 4), np.nan)
    tied[0, 0, :2], tied[1, 0, 2:] = [1, 2], [1, 2]
    assert _thinned(roc.curve(tied)) == ([0, 1], [0, 1]), "a slanting line through a tie is straight"


def test_a_curve_of_a_hundred_runs_is_whole():
    scores = scored(100, 100, 5)
    x, y = map(np.array, _thinned(roc.curve(scores)))
    area = float(roc.area(scores).value[0])
    assert math.isclose(np.trapezoid(y, x), area, rel_tol=1e-12)
