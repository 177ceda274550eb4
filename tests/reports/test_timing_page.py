"""The page of running times: those of the store by machine, and benchmarks against rivals and over files."""

import csv
import dataclasses
import json
import math
import statistics

import numpy as np
import pytest

from reports.digest import from_json, to_json
from reports.frame import Frame
from reports.inputs import Inputs, Site
from reports.pages import benches, timing
from reports.text import quantity
from reports.views import view
from suite.benchmarks import read
from suite.metrics import METRICS, Score
from suite.score import table
from tests.reports.conftest import Page

MACHINE = {"machine": "x86_64", "node": "bench", "python_version": "3.12.1", "cpu": {"brand_raw": "Zen"}}


def benchmark(name, seconds, group="small", **told):
    """A benchmark as a file has it, with the times of all its rounds."""
    stats = {"median": statistics.median(seconds), "min": min(seconds), "max": max(seconds), "rounds": len(seconds)}
    return {"name": name, "group": group, "stats": stats | {"data": seconds}, "extra_info": told}


def around(seconds):
    """Nine rounds, whose median is the one given, and its exact 95 % interval the second and the eighth."""
    return [seconds * (1 + 0.01 * k) for k in range(-4, 5)]


def of_filter(label, runs, seconds):
    return benchmark(f"test_filter[{label}-{runs}]", around(seconds), "easy", estimator=label, case="easy", runs=runs, steps=20)


def against(name, seconds, ratio, **told):
    turns = {"floor": [ratio, 0.9 * ratio, 1.2 * ratio]}
    return benchmark(f"test_cost[{name}]", around(seconds), "cost", ratio_to_floor=ratio, turns=turns, filter=name, **told)


@pytest.fixture
def written(tmp_path):
    """Writes a file and gives its rows."""

    def write(name, benchmarks, date="2026-01-02T10:00:00+00:00", commit="c" * 40, dirty=False, **machine):
        said = {"machine_info": MACHINE | machine, "commit_info": {"id": commit, "dirty": dirty}, "datetime": date}
        path = tmp_path / "deep" / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(json.dumps(said | {"benchmarks": benchmarks}))
        return read(str(path))

    return write


@pytest.fixture(scope="module")
def cases(variety):
    return [from_json(to_json(view(case, variety.labels)), case) for case in variety.cases.values()]


def made(variety, cases, rows=()):
    (part,) = timing.parts(Site(Frame.of(variety), Inputs(variety, "", {}, rows), cases, ""))
    json.dumps(part.depends)
    return part.make(*part.arguments)


def words_of(files):
    return " ".join(Page(files["timing.html"]).text.split())


def rows_of(files, figure):
    return list(csv.DictReader(files[f"data/timing-{figure}.csv"].splitlines()))


def with_hosts(case, hosts):
    """A case some of whose estimators were timed on a machine that is told for each label."""
    cells = {
        label: dataclasses.replace(
            cell,
            timings=[
                dataclasses.replace(entry, meta=entry.meta | {"host": hosts.get(label, entry.meta["host"])})
                for entry in cell.timings
            ],
        )
        for label, cell in case.results.cells.items()
    }
    return dataclasses.replace(case, results=dataclasses.replace(case.results, cells=cells))


def test_figures_have_the_numbers_of_the_table_of_scores(variety, cases):
    files = made(variety, cases)
    frame = table(variety, list(METRICS.values()), list(variety.cases), variety.labels)
    compared = 0
    for figure, metric in (("latency", "latency"), ("throughput", "throughput")):
        found = {(r.case, r.estimator): r for r in frame[frame.metric == metric].itertuples() if r.runs}
        shown = rows_of(files, figure)
        assert [row["case"] for row in shown] == list(dict.fromkeys(case for case, _ in found))
        for row in shown:
            for label in variety.labels:
                score = found.get((row["case"], label))
                if score is None:
                    assert not row.get(label)
                    continue
                for head, value in ((label, score.value), (f"{label}, low", score.low), (f"{label}, high", score.high)):
                    assert row[head] == f"{value:.7g}"
                compared += 1
    assert compared == 2 * 8


def test_time_per_particle_step_is_the_inverse_of_the_throughput(cases):
    cell = dataclasses.replace(
        cases[0].cells["plain"], scores={("particle-throughput", "step"): Score(2e6, 1e6, 4e6, "particle-steps/s", 3, 3)}
    )
    score = timing._score(cell, "particle-step")
    assert (score.value, score.low, score.high, score.unit) == (500.0, 250.0, 1000.0, "ns")


def test_the_table_gives_the_median_over_cases_and_the_extremes(variety, cases):
    times = {"easy/one": 300.0, "other": 100.0}
    found = []
    for case in cases[:2]:
        cell, time = case.cells["shifted"], times[case.card.name]
        cell = dataclasses.replace(cell, scores={("latency", "step"): Score(time, time - 1, time + 1, "µs", 4, 4)})
        found.append(dataclasses.replace(case, cells=case.cells | {"shifted": cell}))
    rows = [" ".join(cell.split()) for cell in Page(made(variety, found)["timing.html"]).cells]
    at = rows.index("shifted")
    words = quantity(Score(200.0, 100.0, 300.0, "µs", 2, 2), METRICS["latency"])
    assert rows[at + 1 : at + 4] == ["2", f"{words.value} {words.unit} {words.interval}", "none"]


def test_machines_are_never_mixed(variety, cases):
    other = {"processor": "Other", "system": "Plan 9", "node": "elsewhere"}
    found = [with_hosts(cases[0], {"shifted": other}), *cases[1:]]
    assert [{cell.label for _, cell in timed} for timed in timing.by_machine(found).values()][1:] == [{"shifted"}]
    files = made(variety, found)
    assert "The running times are of 2 machines." in words_of(files)
    assert "Other, Plan 9, node elsewhere" in words_of(files)
    assert [list(row) for row in rows_of(files, "latency-1")] == [["case", "shifted", "shifted, low", "shifted, high"]]
    assert next(iter(rows_of(files, "latency")))["shifted"] == ""
    assert "The running times are of" not in words_of(made(variety, cases))


def test_a_machine_that_is_not_recorded_is_said_so(variety, cases):
    unknown = with_hosts(cases[0], {label: {} for label in variety.labels})
    assert "a machine that is not recorded" in words_of(made(variety, [unknown]))


def test_nothing_to_show_says_how_to_get_it(variety, cases):
    lonely = [case for case in cases if case.card.name == "lonely"]
    files = made(variety, lonely)
    assert list(files) == ["timing.html"]
    assert "No running times are stored." in words_of(files)
    assert "nox -s bench" in words_of(files)
    assert "filterbench report --benchmarks bench/*/*.json" in words_of(files)
    assert not {"figure", "table"} & set(Page(files["timing.html"]).tags)


def test_what_failed_while_timed_and_what_was_not_timed_is_told(variety, cases):
    cell = cases[0].cells["plain"]
    failed = dataclasses.replace(cell, scores={}, failures=(("timing", "no <luck>", ()),))
    case = dataclasses.replace(cases[0], cells=cases[0].cells | {"plain": failed})
    words = words_of(made(variety, [case]))
    assert "plain on easy/one : no <luck>" in words
    assert "Of the combinations of estimator and case that ran, 2 have no running time." in words


def test_ratios_to_rivals_have_the_intervals_of_the_rounds(variety, cases, written):
    rows = written("a.json", [against("sis", 0.5, 4.0), against("isir", 0.9, 2.0, filterpy_to_one=3.0)])
    files = made(variety, cases, rows)
    (first, second) = rows_of(files, "bench-0-0")
    assert first == {
        "benchmark": "sis", "ratio to floor": "4", "ratio to floor, low": "3.6", "ratio to floor, high": "4.8",
    }  # fmt: skip
    assert (second["benchmark"], second["ratio to floor"]) == ("isir", "2")
    cells = [" ".join(cell.split()) for cell in Page(files["timing.html"]).cells]
    at = cells.index("sis")
    assert cells[at + 1 : at + 5] == ["500 ms 480 to 520", "9", "4.0 (3.6 to 4.8)", "filter sis"]
    assert "a.json" in cells
    assert "deep" not in files["timing.html"]


def test_a_ratio_without_turns_has_no_interval_and_says_so(variety, cases, written):
    rows = written("a.json", [benchmark("test_x[a]", around(0.1), ratio_to_floor=2.5)])
    files = made(variety, cases, rows)
    assert "2.50 (no interval)" in words_of(files)
    assert "1 of 1 ratios have none" in words_of(files)


def test_a_group_is_that_of_the_newest_file_of_its_machine(variety, cases, written):
    old = written("old.json", [of_filter("plain", 1, 0.004), of_filter("twin", 1, 0.006)], "2026-01-01T10:00:00+00:00")
    new = written("new.json", [of_filter("plain", 1, 0.002)])
    (machine,) = benches.machines(Frame.of(variety), [*new, *old])
    (group,) = machine.groups
    assert (machine.name, machine.files) == ("Zen, node bench", 2)
    assert [(line.label, line.value.value, line.value.unit) for line in group.lines] == [("plain", "100", "µs")]
    assert group.when == "2026-01-02 10:00 UTC, commit cccccccccc, Python 3.12.1"


def test_history_goes_over_the_files_of_one_machine_by_date(variety, cases, written):
    """The first estimator got twice as fast, beyond its intervals, the other 1 % slower, within them."""
    times = {"old.json": ("2026-01-01", 0.004, 0.006, "bench"), "new.json": ("2026-01-02", 0.002, 0.00606, "bench"),
             "else.json": ("2026-01-03", 0.001, 0.001, "laptop")}  # fmt: skip
    rows = [
        row
        for name, (day, a, b, node) in times.items()
        for row in written(name, [of_filter("plain", 1, a), of_filter("twin", 1, b)], f"{day}T10:00:00+00:00", node=node)
    ]
    files = made(variety, cases, rows[::-1])
    shown = rows_of(files, "bench-0-0-history")
    assert [row["date"] for row in shown] == ["2026-01-01 10:00 UTC", "2026-01-02 10:00 UTC"]
    np.testing.assert_allclose([[float(row[label]) for label in ("plain", "twin")] for row in shown], [[200, 300], [100, 303]])
    assert [float(shown[0][f"plain, {end}"]) for end in ("low", "high")] == pytest.approx([200 * 0.97, 200 * 1.03])
    words = words_of(files)
    assert "the intervals lie apart of plain (the last is 0.500 times the first)." in words
    assert "One file is of this machine, so there is no history." in words
    assert not [name for name in files if "bench-1" in name and "history" in name]


@pytest.fixture
def history(variety, written):
    """The history of a benchmark that is given day by day."""

    def of(*benchmarks):
        days = enumerate(benchmarks, start=1)
        rows = [row for day, one in days for row in written(f"{day}.json", [one], f"2026-01-0{day}T10:00:00+00:00")]
        ((group,),) = [machine.groups for machine in benches.machines(Frame.of(variety), rows)]
        return group.history

    return of


def test_a_change_within_intervals_is_none(history):
    assert "all intervals overlap" in history(of_filter("plain", 1, 0.002), of_filter("plain", 1, 0.00204)).caption


def test_without_intervals_nothing_is_said_of_a_change(history):
    found = history(benchmark("test_a", [0.1] * 5), benchmark("test_a", [0.2] * 5))
    assert "Without intervals nothing can be said of a change." in found.caption


def test_timings_of_other_work_are_left_out_of_a_history(history):
    found = history(*(benchmark("test_a[x]", around(0.1), steps=steps) for steps in (10, 20, 20)))
    assert np.isnan(found.columns[2].values).tolist() == [True, False, False]
    assert "1 older timing of other numbers of runs or steps left out" in found.caption


def test_the_same_file_twice_is_one(variety, written):
    rows = written("a.json", [of_filter("plain", 1, 0.002), of_filter("plain", 20, 0.002)])
    found = benches.machines(Frame.of(variety), [*rows, *rows])
    assert [(len(group.lines), group.history) for group in found[0].groups] == [(1, None), (1, None)]


def test_strange_benchmarks_make_a_page(variety, cases, written):
    rows = written(
        "a.json",
        [
            benchmark("<b>bold</b>[<i>x</i>]", [0.0] * 6, None, note="</script><b>", ratio_to_floor=math.nan),
            benchmark("a" * 300, [1e-9] * 9, "<u>g</u>", turns={}),
            benchmark("b[" + "c" * 300 + "]", [1e5], "<u>g</u>", table="A <b>table</b>"),
            of_filter("plain", 20, 1e-12),
        ],
        node="<node>",
    )
    files = made(variety, cases, rows)
    page = Page(files["timing.html"])
    assert not {"b", "i", "u"} & set(page.tags)
    assert len(page.ids) == len(set(page.ids))
    assert all(b - a <= 1 for a, b in zip(page.headings, page.headings[1:], strict=False))


def test_colours_of_estimators_stay_and_others_get_their_own(variety, written):
    frame = Frame.of(variety)
    rows = written("a.json", [of_filter("twin", 1, 0.1), against("sis", 0.5, 4.0)])
    looks, anchors = benches.all_marks(frame, rows), benches.all_anchors(frame, rows)
    assert {label: looks[label] for label in frame.labels} == frame.marks
    assert len({mark.series for mark in looks.values()}) == len(looks)
    assert set(looks) == set(anchors) >= {"sis", "ratio to floor"}
    assert len(set(anchors.values())) == len(anchors)


def test_of_many_benchmarks_a_history_draws_those_that_changed_most(variety, written):
    """Each is as much faster as its number says; the ends of the intervals of those below three overlap."""
    rows = [
        row
        for day in (1, 2)
        for row in written(
            f"{day}.json",
            [benchmark(f"test_a[{k}]", around(0.1 * (1 - 0.02 * k * (day - 1)))) for k in range(10)],
            f"2026-01-0{day}T10:00:00+00:00",
        )
    ]
    ((group,),) = [machine.groups for machine in benches.machines(Frame.of(variety), rows)]
    assert group.history.labels == ["9", "8", "7", "6", "5", "4", "3", "2"]
    assert [column.series for column in group.history.columns if column.role == "value"][2:] == group.history.labels
    assert "Of 10 benchmarks the 8 are drawn that changed most." in group.history.caption
    assert "lie apart of 3 (the last is 0.940 times the first), 4 (the last" in group.history.caption
