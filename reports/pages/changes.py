"""The page of what changed since other results."""

import itertools
import json
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass, fields, replace
from typing import Any

from reports.frame import Frame
from reports.inputs import Inputs
from reports.pages.sides import came_and_went, shared, sides, versions
from reports.part import Part
from reports.text import count, grouped, listed, number, quantity, within
from reports.views import SHOWN, private
from suite.case import RECORDED
from suite.changes import IMPROVED, CaseChanges, Change, State, of_case, settled
from suite.compare import EQUAL, NOTHING, ONE_SAMPLE, UNDECIDED, WORSE, ZONE
from suite.differences import Interval
from suite.metrics import METRICS, Score
from suite.results import CaseResults
from suite.score import to_json
from suite.statistics import LEVEL
from suite.tables import frame_of

ALTOGETHER = ("inclination",)
"""Metrics of all runs together: a single run has no value, so that no test tells chance from change where runs are few."""
COMPARED = [
    metric
    for metric in SHOWN
    if (metric.ranked or metric.binomial) and metric.family != "bound" and metric.name not in ALTOGETHER
]
"""Metrics by which a value can be better than another, and the rates of what went wrong; not those against the bound, which
change with it where the errors do not."""
ORDER = (WORSE, IMPROVED, UNDECIDED, EQUAL, ONE_SAMPLE, NOTHING)
MOST, FEW = 12, 3
"""Changes of each verdict on a case that the page shows, of improved and worse and of the others; its file has all."""
LEAST_P = 1e-4


@dataclass(frozen=True)
class Row:
    """A change in words."""

    change: Change
    metric: str
    before: str
    after: str
    runs_before: str
    runs: str
    apart: str
    p: str


@dataclass(frozen=True)
class CaseRows:
    """What is shown of a case: its changes, how many of each verdict there are, and how many of them are left out."""

    found: CaseChanges
    rows: Sequence[Row]
    counts: Sequence[tuple[str, int]]
    left_out: int
    unchanged: int
    pairing: str


def digest_name(frame: Frame, name: str) -> str:
    """The file of a case's changes; no case's own file has two hyphens on end."""
    return f"data/changes--{frame.stems[name]}.json"


def case_parts(frame: Frame, inputs: Inputs) -> list[Part]:
    """The changes of each case that both result sets hold."""
    found = []
    for name in shared(inputs):
        assert inputs.against
        pair = inputs.against.cases[name], inputs.loaded.cases[name]
        blocks = [side.held for side in pair]
        file = digest_name(frame, name)
        found.append(Part(f"changes of {name}", blocks, _case_files, (file, *pair), sum(map(len, blocks))))
    return found


def _case_files(file: str, before: CaseResults, after: CaseResults) -> dict[str, str]:
    return {file: encoded(of_case(private(before), private(after), COMPARED))}


def encoded(found: CaseChanges) -> str:
    """Changes of a case as JSON; numbers that do not exist are null, infinite ones 'inf' or '-inf'."""
    frame = frame_of(found.changes)
    rows = [list(record.values()) for record in json.loads(to_json(frame))] if found.changes else []
    said = {**asdict(replace(found, changes=())), "columns": list(frame.columns), "changes": rows}
    return json.dumps(said, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def decoded(text: str) -> CaseChanges:
    """The changes of a case that `encoded` wrote."""
    said = json.loads(text)
    columns = said.pop("columns")
    said["changes"] = tuple(_change(dict(zip(columns, row, strict=True))) for row in said["changes"])
    said["states"] = {label: (State(**was), State(**now)) for label, (was, now) in said["states"].items()}
    said |= {name: tuple(said[name]) for name in ("seeds", "runs", "notes")}
    return CaseChanges(**said)


def _change(row: dict[str, Any]) -> Change:
    found = {}
    for field in fields(Change):
        if field.type is Interval:
            found[field.name] = Interval(*(_number(row[field.name + end]) for end in ("", "_low", "_high")))
        else:
            found[field.name] = _number(row[field.name]) if field.type is float else row[field.name]
    return Change(**found)


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)


def page(frame: Frame, inputs: Inputs, texts: Sequence[str]) -> Part:
    """The page, from the changes of all cases."""
    held = [
        [(name, list(case.cells)) for name, case in each.cases.items()]
        for each in filter(None, (inputs.against, inputs.loaded))
    ]
    folders = [str(each.folder) for each in filter(None, (inputs.against, inputs.loaded))]
    depends = [texts, held, folders, sides(inputs)]
    return Part("changes", depends, files, (frame, inputs, texts))


def files(frame: Frame, inputs: Inputs, texts: Sequence[str]) -> dict[str, str]:
    """The page, and all its changes as a table."""
    if inputs.against is None:
        return {"changes.html": frame.page("changes", against=None)}
    cases = list(map(decoded, texts))
    changes = settled([change for case in cases for change in case.changes])
    told = iter(changes)
    cases = [replace(case, changes=tuple(itertools.islice(told, len(case.changes)))) for case in cases]
    made = {"changes.html": frame.page("changes", **context(inputs, cases))}
    return made | ({"data/changes.csv": frame_of(changes).to_csv(index=False)} if changes else {})


def context(inputs: Inputs, cases: Sequence[CaseChanges]) -> dict[str, Any]:
    """What the template of the page needs."""
    assert inputs.against
    facts, changes = sides(inputs), [change for case in cases for change in case.changes]
    rows = [_case_rows(case, inputs.loaded.cases[case.case]) for case in cases]
    return {
        "against": str(inputs.against.folder),
        "folder": str(inputs.loaded.folder),
        "differing": [(name, was, now) for name, was, now in facts if was != now],
        "alike": [f"{name} {now}" for name, was, now in facts if was == now],
        "versions": versions(inputs),
        "summary": _summary(cases, changes),
        "cases": rows,
        "came_and_went": came_and_went(inputs, cases),
        "changes": changes,
        "zone": f"{100 * ZONE:g} %",
        "titles": {metric.name: metric.title for metric in COMPARED},
    }


def _summary(cases: Sequence[CaseChanges], changes: Sequence[Change]) -> list[str]:
    """What changed in a few sentences, no stronger than the tests."""
    if not cases:
        return ["The two result sets have no case in common, so that nothing can be compared."]
    counts, same = Counter(change.verdict for change in changes), sum(sum(case.unchanged.values()) for case in cases)
    if not changes and not same:
        return ["No estimator has runs on both sides that can be compared."]
    words = [
        f"{grouped(counts[verdict])} {what}"
        for verdict, what in (
            (IMPROVED, "improved"),
            (WORSE, "got worse"),
            (UNDECIDED, "are undecided"),
            (EQUAL, f"are equal within {100 * ZONE:g} %"),
            (ONE_SAMPLE, "are of recordings and not tested"),
            (NOTHING, "have no run in common"),
        )
        if counts[verdict] or verdict in (IMPROVED, WORSE, UNDECIDED)
    ]
    said = [f"Of {count(len(changes) + same, 'score')} that both result sets hold, {listed([*words, _same(same)])}."]
    tests = sum(not math.isnan(change.p) for change in changes)
    if tests:
        said.append(
            f"Over {count(tests, 'test')} on this page p is adjusted by Holm's method: where nothing changed but the random "
            f"numbers, at most {100 * (1 - LEVEL):g} % of such pages name any improvement or loss. The surest change needs a p "
            f"below {number((1 - LEVEL) / tests)} by itself."
        )
    return said


def _same(n: int) -> str:
    return f"{grouped(n)} {'is' if n == 1 else 'are'} the same to the bit"


def _case_rows(case: CaseChanges, results: CaseResults) -> CaseRows:
    counts = Counter(change.verdict for change in case.changes)
    ordered = sorted(case.changes, key=lambda c: (ORDER.index(c.verdict), -c.size if c.size == c.size else 1.0))
    groups = [list(group) for _, group in itertools.groupby(ordered, lambda c: c.verdict)]
    shown = [change for group in groups for change in group[: MOST if group[0].verdict in (WORSE, IMPROVED) else FEW]]
    seeds, runs = case.seeds, case.runs
    if case.paired:
        pairing = f"{count(case.common, 'run')} of the same truth and measurements before and after, compared run by run"
    else:
        held = [f"{count(n, 'run')} with seed {seed}" for n, seed in zip(runs, seeds, strict=True)]
        pairing = f"{held[0]} before, {held[1]} after, of other truths, so that runs are no pairs"
    pairing += "; all are of the same recording, so that nothing is tested" if results.card.origin == RECORDED else ""
    rows = [_row(change, (case.common, case.common) if case.paired else runs) for change in shown]
    unchanged = sum(case.unchanged.values())
    told = [(verdict, counts[verdict]) for verdict in ORDER if counts[verdict]]
    return CaseRows(case, rows, told, len(ordered) - len(shown), unchanged, pairing)


def _row(c: Change, usual: tuple[int, int]) -> Row:
    """In words; how many runs there are only where it is not as usual on the case."""
    metric, sides = METRICS[c.metric], ((c.before, c.runs_before, c.left_out_before), (c.after, c.runs, c.left_out))
    values = [quantity(Score(value, math.nan, math.nan, c.unit, n, n), metric) for value, n, _ in sides]
    what = "call" if metric.timed else "run"
    runs = [
        "" if n == expected and not metric.timed else f"{count(n, what)}{f', {left} left out' if left else ''}"
        for (_, n, left), expected in zip(sides, usual, strict=True)
    ]
    block = f": {c.block}" if c.block not in ("state", "runs", "step") else ""
    words = [f"{each.value} {each.unit}".strip() for each in values]
    p = "" if math.isnan(c.holm) else f"< {LEAST_P:g}" if c.holm < LEAST_P else number(c.holm)
    return Row(c, f"{metric.title}{block}", *words, *runs, _apart(c), p)


def _apart(c: Change) -> str:
    """The ratio where there is one, else the difference, with its interval."""
    if math.isfinite(c.ratio.value) and c.ratio.value > 0:
        return f"× {_interval(c.ratio, '')}"
    scale, unit = (100.0, "percentage points") if METRICS[c.metric].binomial else (1.0, c.unit)
    apart = Interval(*(scale * end for end in astuple(c.difference)))
    if math.isnan(apart.value):
        return "none"
    return f"{'+' if apart.value > 0 else ''}{_interval(apart, unit)}"


def _interval(apart: Interval, unit: str) -> str:
    if math.isnan(apart.low) or math.isnan(apart.high):
        return f"{number(apart.value)} {unit}".strip()
    return within(apart.value, apart.low, apart.high, unit)
