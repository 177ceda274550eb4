"""The pages of estimators, and their list."""

import dataclasses
import math
import shlex
from collections.abc import Iterator, Mapping, Sequence

from reports.dots import REACH, Dot, beyond, dots, drawable
from reports.frame import Frame
from reports.inputs import Site
from reports.pages.outcomes import COST, HEALTH, OF_FIRST, RESULTS, Outcome, Summary, grouped_by_reason, outcomes, summary
from reports.pages.overview import KINDS, kinds
from reports.pages.scores import HEADS, sortable
from reports.part import Part
from reports.plot import Column, Plot, data_files
from reports.text import listed, number, quantity
from reports.views import Key
from suite.metrics import METRICS, Score

TOLD_APART = ("failed", "lost", "diverges")
"""Remarks that the table of failures tells in numbers."""


def parts(site: Site) -> Iterator[Part]:
    """The list of estimators, and a page for each of them, which follows from what became of that one alone."""
    frame, found = site.frame, outcomes(site.cases, site.frame.labels)
    kind = {label: kinds(label, site.cases) for label in frame.labels}
    listing = [(label, kind[label], summary(found[label]), _said(found[label])) for label in frame.labels]
    yield Part("estimators.html", site.depends(), overall, (frame, listing))
    seeds = sorted({case.results.seed for case in site.cases})
    for label, of in found.items():
        name = _name(of, label)
        kin = [other for other in frame.labels if other != label and _name(found[other], other) == name]
        page = frame.estimators[label]
        depends = [label, kind[label], kin, seeds, repr(of), frame.labels, list(frame.cases)]
        yield Part(page, depends, files, (frame, label, kind[label], kin, seeds, of), len(of))


def overall(frame: Frame, listing: Sequence[tuple[str, Sequence[str], Summary, Mapping[str, str]]]) -> dict[str, str]:
    """The list of estimators: those of a kind together, in the order of the results."""
    ordered = sorted(listing, key=lambda row: [list(KINDS).index(kind) for kind in reversed(row[1])])
    said = {"rows": ordered, "kinds": KINDS, "sortable": sortable, "number": number, "latency": _latency}
    return {"estimators.html": frame.page("estimators", **said)}


def files(
    frame: Frame, label: str, kind: Sequence[str], kin: Sequence[str], seeds: Sequence[int], of: Sequence[Outcome]
) -> Mapping[str, str]:
    """The files of an estimator by name."""
    stem = f"estimator-{frame.anchors[label]}"
    plots = [errors(frame, label, of), cost(frame, label, of)]
    said = {
        "label": label,
        "kind": [KINDS[each] for each in kind],
        "kin": kin,
        "of": of,
        "summary": summary(of),
        "said": _said(of),
        "parameters": _parameters(of),
        "errors": plots[0],
        "cost": plots[1],
        "tables": {name: _table(of, wanted) for name, wanted in (("results", RESULTS), ("cost", COST), ("health", HEALTH))},
        "wrong": [one for one in of if one.wrong],
        "particles": next((values for name, values in _parameters(of) if name == "particles"), []),
        "remarks": [(one, r) for one in of for r in one.cell.remarks if r.kind not in TOLD_APART],
        "absent": {status: list(grouped_by_reason(of, status)) for status in ("refused", "not run")},
        "command": command(label, seeds),
        "latency": _latency,
        "sortable": sortable,
        "words": lambda score, metric: quantity(score, METRICS[metric]),
        "titles": {metric: HEADS.get(metric, METRICS[metric].title) for metric in (*RESULTS, *COST, *HEALTH)},
    }
    return {frame.estimators[label]: frame.page("estimator", **said, data=f"data/{stem}"), **dict(data_files(stem, plots))}


def command(label: str, seeds: Sequence[int]) -> str:
    """The command that runs an estimator on all cases."""
    seed = f" --seed {seeds[0]}" if len(seeds) == 1 else ""
    return f"filterbench run -e {shlex.quote(label)}{seed}"


def errors(frame: Frame, label: str, of: Sequence[Outcome]) -> Plot:
    """Errors of the first block of each case, over the bound where it is strict, else over the smallest in the row."""
    held = [(one, one.over_bound or one.over_best) for one in of]
    rows = [(one, score) for one, score in held if score and drawable(score.value)]
    mark = frame.marks[label]
    shown = [Dot(i, score.value, score.low, score.high, mark, not one.over_bound) for i, (one, score) in enumerate(rows)]
    axis = "RMSE over the bound, or over the smallest"
    drawing = dots([one.case for one, _ in rows], shown, "errors", f"Errors of {label}", axis, 1.0)
    return Plot(
        "errors",
        "Errors on all cases",
        _caption(of, [one for one, _ in rows], shown),
        drawing,
        [label],
        [
            Column("case", [one.case for one, _ in rows]),
            *_columns("RMSE over the bound", [one.over_bound for one, _ in rows]),
            *_columns("RMSE over the smallest", [None if one.over_bound else score for one, score in rows]),
        ],
        "case",
        axis,
        "y",
        metrics=["crlb-ratio"],
    )


def _caption(of: Sequence[Outcome], drawn: Sequence[Outcome], shown: Sequence[Dot]) -> str:
    """What the dots are, and which of them are to be read with care."""
    said = [
        "RMSE of the first block of each case. Filled: over the Cramér-Rao bound at each step, averaged over time, where the "
        "bound holds for every estimator: in the long run none is below 1. Hollow, where it does not: over the smallest RMSE "
        "of an estimator that is ranked on the case; below 1 for one that is not ranked. Lines are 95 % intervals; those of "
        "hollow dots are of this estimator's RMSE alone, as if the smallest were known exactly."
    ]
    far, named = beyond(shown, 1.0), {one.case for one in drawn}
    for words, cases in (
        (f"An arrow at the edge stands for a value more than {REACH:g} times off", [drawn[dot.row].case for dot in far]),
        ("Of the runs that came through alone, which flatters", [o.case for o in drawn if o.cell.came_through < o.cell.total]),
        ("Of one recording, so that intervals tell of its own random numbers only", [o.case for o in drawn if o.recorded]),
        (
            "Not drawn, since the truth is not known, nobody is ranked, or the value is zero or infinite",
            [o.case for o in of if o.cell.came_through and o.case not in named],
        ),
    ):
        said += [f"{words}: {listed(cases)}."] if cases else []
    return " ".join(said)


def cost(frame: Frame, label: str, of: Sequence[Outcome]) -> Plot:
    """Time of a step of one run alone, and in a few together, by the dimension of the state."""
    keys: tuple[Key, Key] = ("latency", "step"), ("throughput", "step")
    rows = sorted((one for one in of if any(one.score(*key) for key in keys)), key=lambda one: one.n)
    alone = [one.score(*keys[0]) for one in rows]
    together = [_reciprocal(one.score(*keys[1])) for one in rows]
    shown = [
        Dot(i, score.value, score.low, score.high, frame.marks[label], hollow)
        for hollow, scores in ((False, alone), (True, together))
        for i, score in enumerate(scores)
        if score
    ]
    axis = "time of a step of a run (µs)"
    names = [f"{one.case}, n = {one.n}" for one in rows]
    return Plot(
        "cost",
        "Time of a step on all cases",
        "Filled: latency, the time of a step with a single run. Hollow: the time of a step of each run when a few are filtered "
        "together, which is one over the throughput. Lines are 95 % intervals over timed calls. Cases in the order of n, the "
        "dimension of the state. All of the machine that the provenance names.",
        dots(names, shown, "cost", f"Time of a step of {label}", axis),
        [label],
        [
            Column("case", [one.case for one in rows]),
            Column("n", [float(one.n) for one in rows], role="other"),
            *_columns("latency (µs)", alone),
            *_columns("time of a step of a run, a few together (µs)", together),
        ],
        "case",
        axis,
        "y",
        metrics=["latency", "throughput"],
    )


def _reciprocal(score: Score | None) -> Score | None:
    """Microseconds of a step of a run, from how many there are in a second."""
    if score is None or not score.value > 0:
        return None
    value, low, high = (1e6 / end if end > 0 else math.inf for end in (score.value, score.high, score.low))
    return dataclasses.replace(score, value=value, low=low, high=high, unit="µs")


def _columns(head: str, scores: Sequence[Score | None]) -> Iterator[Column]:
    """A value and the ends of its interval as columns of a figure's data; none where there is no value at all."""
    if any(scores):
        for name, role in (("value", "value"), ("low", "low"), ("high", "high")):
            values = [getattr(score, name) if score else math.nan for score in scores]
            yield Column(head if role == "value" else f"{head}, {name} end", values, role=role)


def _table(of: Sequence[Outcome], wanted: Sequence[str]) -> list[Key]:
    """The metrics and blocks of a table, of which there is a value on any case; of the first block as ''."""
    found: dict[Key, None] = {}
    for metric in wanted:
        for one in of:
            for name, block in one.cell.scores:
                if name == metric and one.score(name, block):
                    found[name, "" if name in OF_FIRST else block] = None
    return list(found)


def _latency(found: Summary) -> str:
    """The range of latencies over the cases, in words."""
    if not found.timed:
        return ""
    score, metric = Score(0.0, math.nan, math.nan, "µs", 2, 2), METRICS["latency"]
    ends = [quantity(dataclasses.replace(score, value=value), metric) for value in (found.latency[0], found.latency[-1])]
    first, last = (f"{end.value} {end.unit}" for end in ends)
    return first if first == last else f"{first} to {last}"


def _said(of: Sequence[Outcome]) -> Mapping[str, str]:
    """What is stored of an estimator in words: its summary and its reference, those of its newest results."""
    metas = [one.cell.meta for one in of if one.cell.meta]
    return {name: next((str(meta[name]) for meta in metas if meta.get(name)), "") for name in ("summary", "reference")}


def _name(of: Sequence[Outcome], label: str) -> str:
    return next((str(one.cell.meta["name"]) for one in of if one.cell.meta), label)


def _parameters(of: Sequence[Outcome]) -> list[tuple[str, list[str]]]:
    """Parameters with their values, several where results of versions with other defaults are stored."""
    found: dict[str, dict[str, None]] = {}
    for one in of:
        for name, value in one.cell.meta.get("parameters", {}).items():
            found.setdefault(name, {})[f"{value:.6g}" if isinstance(value, float) else str(value)] = None
    return [(name, list(values)) for name, values in found.items()]
