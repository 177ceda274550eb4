"""A case's page: its model, its figures, all its scores."""

import math
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from reports import figures, series
from reports.formula import mathml
from reports.marks import Mark
from reports.sentences import bound_name, bounded, diverged
from reports.series import Series, Tracks
from reports.text import count, listed, number, tick, within
from reports.views import PERCENT, CaseView, CellView, Key
from suite.bounds import NONE
from suite.case import RECORDED, with_unit
from suite.case_bounds import BlockBound
from suite.linalg import Array
from suite.metrics import METRICS
from suite.published import Finding
from suite.published import Key as FigureKey
from suite.results import CaseResults
from suite.verdicts import Verdict, verdicts

TABLE_ROWS = 60
HEADS = {"rmse": "RMSE", "nees": "NEES"}
"""Metrics better known by their initials."""


@dataclass(frozen=True)
class FigureView:
    """A figure with its caption, the series in its legend and its data as a table."""

    id: str
    title: str
    caption: str
    drawing: Markup | None
    labels: Sequence[str]
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str


def context(
    case: CaseView, labels: Sequence[str], marks: Mapping[str, Mark], findings: Mapping[FigureKey, Finding]
) -> dict[str, Any]:
    """What the template of a case's page needs."""
    results = case.results
    return {
        "case": case,
        "card": case.card,
        "figures": list(_figures(results, labels, marks)),
        "columns": [(key, *_column(case, key)) for key in case.keys],
        "rows": [(cell, _row(case, cell)) for cell in case.cells.values()],
        "metrics": [m for m in METRICS.values() if any(k[0] == m.name for k in case.keys)],
        "mathml": mathml,
        "inf": math.inf,
        "recorded": case.card.origin == RECORDED,
        "command": command(case),
        "away": [(cell.label, n) for cell in case.cells.values() if (n := diverged(cell))],
        "count": count,
        "number": number,
        "percent": PERCENT,
        "unit_of": lambda component: next((b.unit for b in case.card.blocks if component in b.components), ""),
        "limit_unit": case.card.block(case.card.divergence.block).unit,
        "published": [_published(verdict) for verdict in verdicts([results], findings)],
    }


def _column(case: CaseView, key: Key) -> tuple[str, str]:
    """Head of a column: the metric, and the block or how to read it."""
    metric = METRICS[key[0]]
    head = HEADS.get(metric.name, metric.title)
    if metric.unit == "block":
        return head, key[1]
    reading = metric.better if isinstance(metric.better, str) else f"{metric.better:g}"
    return head, f"{reading} is {'better' if isinstance(metric.better, str) else 'best'}"


def _row(case: CaseView, cell: CellView) -> list[dict[str, Any]]:
    """The scores of an estimator, one for each column."""
    found = []
    for key in case.keys:
        score = cell.scores.get(key)
        if score is None or score.runs == 0:
            timed = METRICS[key[0]].timed
            why = (f"failed: {cell.timing_failure}" if cell.timing_failure else "not timed") if timed else "none"
            found.append({"value": why, "absent": True})
            continue
        words = cell.quantity(key)
        runs = "" if score.runs == score.total else f"{score.runs} of {score.total} runs"
        found.append({"value": words.value, "unit": words.unit, "interval": words.interval, "runs": runs, "absent": False,
                      "mark": {"best": "best", "tied": "tie"}.get(cell.standing.get(key, ""), "")})  # fmt: skip
    return found


def _published(verdict: Verdict) -> dict[str, Any]:
    """A row of the table of published figures."""
    figure, finding = verdict.published, verdict.finding
    score = verdict.score if figure.value is not None else None
    unit = "" if figure.unit == "mixed" else figure.unit
    return {
        "figure": figure,
        "value": "a claim" if figure.value is None else f"{figure.value:g} {unit}".strip(),
        "found": within(*finding.ours, "" if figure.value is None else unit) if finding and finding.ours else "",
        "runs": finding.runs if finding else 0,
        "here": within(score.value, score.low, score.high, unit) if score else "",
        "here_runs": score.runs if score else 0,
        "verdict": verdict.recorded,
        "reason": finding.reason if finding else "",
        "broken": verdict.broken,
    }


def command(case: CaseView) -> str:
    """The command that makes the results of the page again."""
    ran = [label for label, cell in case.cells.items() if cell.status != "not run" or cell.failures]
    plugins: dict[str, None] = {}
    for cell in case.results.cells.values():
        for entry in [*cell.estimates, *cell.timings]:
            plugins |= dict.fromkeys(_plugins(str(entry.meta.get("command", ""))))
    parts = ["filterbench", "run", "-c", case.card.name, "-e", *ran]
    runs = case.runs or max((cell.total for cell in case.cells.values()), default=0) or 1
    parts += ["--runs", str(runs), "--seed", str(case.results.seed)]
    quoted = [p if p.startswith("-") or p in ("filterbench", "run") else shlex.quote(p) for p in parts]
    quoted[3] = "'" + case.card.name.replace("'", "'\"'\"'") + "'"
    return " ".join([*quoted, *(f"--plugin {shlex.quote(p)}" for p in plugins)])


def _plugins(text: str) -> Iterator[str]:
    """Plug-in files that a command names."""
    try:
        words = shlex.split(text)
    except ValueError:
        return
    for word, following in zip(words, [*words[1:], ""], strict=True):
        if word == "--plugin" and following:
            yield following
        elif word.startswith("--plugin="):
            yield word.partition("=")[2]


def _figures(results: CaseResults, labels: Sequence[str], marks: Mapping[str, Mark]) -> Iterator[FigureView]:
    track = series.tracks(results, labels)
    if track:
        yield _ground(results, track, marks)
    errors = series.errors(results, labels)
    for i, block in enumerate(results.card.blocks):
        lines = errors.get(block.name, [])
        title = f"RMSE of {block.name} over time"
        bounds = [(bound, bound.value[:, i], bound.error[:, i]) for bound in results.bounds]
        if not _unknown(lines):
            yield _over_time(lines, marks, f"rmse-{i}", title, with_unit("RMSE", block.unit), bounds=bounds)
    lines = series.consistency(results, labels)
    title = "Normalised estimation error squared over time"
    if not _unknown(lines):
        yield _over_time(lines, marks, "nees", title, "NEES", METRICS["nees"].better)
    if results.card.modes:
        lines = series.modes(results, labels)
        yield _over_time(lines, marks, "brier", "Brier score of the mode probabilities over time", "Brier score")


def _unknown(lines: Sequence[Series]) -> bool:
    """Whether runs came through, and yet nothing is known of them at any step, as where the truth is not."""
    return bool(lines) and all(np.isnan(line.value).all() for line in lines)


def _over_time(
    lines: Sequence[Series],
    marks: Mapping[str, Mark],
    name: str,
    title: str,
    axis: str,
    target: Any = None,
    bounds: Sequence[tuple[BlockBound, Array, Array]] = (),
) -> FigureView:
    drawing = figures.over_time(lines, marks, f"fig-{name}", axis, title, target, [value for _, value, _ in bounds])
    runs = {s.runs for s in lines}
    band = f" The shaded bands are {PERCENT} intervals over runs." if any(s.runs > 1 for s in lines) else ""
    unit = axis.partition(" (")
    caption = f"{title[: -len(' over time')]}{''.join(unit[1:])} against time (s), " + (
        f"over {count(runs.pop(), 'run')} of each estimator." if len(runs) == 1 else "over the runs of each that came through."
    )
    caption += band + (" The dotted line is 1, where errors are as large as the filter says." if target else "")
    if lines:
        caption += _same(lines) + bounded(bounds)
    for line in lines:
        if line.hidden:
            caption += f" {line.label}: {count(line.hidden, 'step')} of {len(line.value)} without a finite value, not drawn."
    header = ["time (s)", *(f"{s.label}{what}" for s in lines for what in ("", ", low", ", high"))]
    named = [(bound_name(each), value) for each, value, _ in bounds if each.kind != NONE]
    header += [name for name, _ in named]
    rows, note = _table(lines, [value for _, value in named])
    return FigureView(name, title, caption, drawing, [s.label for s in lines], header, rows, note)


def _same(lines: Sequence[Series]) -> str:
    """Says which lines cannot be told apart, since one then hides the other."""
    groups: list[list[Series]] = []
    for line in lines:
        home = next((g for g in groups if _close(g[0], line)), None)
        if home is None:
            groups.append([line])
        else:
            home.append(line)
    alike = [listed([s.label for s in g]) for g in groups if len(g) > 1]
    return "".join(f" The lines of {names} lie on top of each other." for names in alike)


def _close(a: Series, b: Series) -> bool:
    return len(a.value) == len(b.value) and all(
        x == y or math.isclose(x, y, rel_tol=1e-3) for x, y in zip(a.value.tolist(), b.value.tolist(), strict=True)
    )


def _table(lines: Sequence[Series], bounds: Sequence[Array]) -> tuple[list[list[str]], str]:
    """The data of a figure over time, at most `TABLE_ROWS` steps of it, and a note on those left out."""
    if not lines:
        return [], ""
    at = lines[0].at[series.sampled(len(lines[0].at), TABLE_ROWS)]
    place = {int(step): i for i, step in enumerate(lines[0].at)}
    rows = [
        [tick(float(lines[0].time[k])), *(
            number(float(x)) for s in lines for x in (s.value[k], s.low[place[int(k)]], s.high[place[int(k)]])
        ), *(number(float(value[k])) for value in bounds)]
        for k in at
    ]  # fmt: skip
    steps = len(lines[0].time)
    return rows, "" if len(rows) == steps else f"{len(rows)} of {steps} steps, spread evenly."


def _ground(results: CaseResults, track: Tracks, marks: Mapping[str, Mark]) -> FigureView:
    card = results.card
    assert card.plane is not None
    x, y = (card.state[i] for i in card.plane)
    title = "Truth and estimates on the ground plane" if track.known else "Estimates on the ground plane"
    drawing = figures.ground(track, card, marks, "fig-ground", title)
    caption = (
        f"Run {track.run}, the one whose error on this plane is the median of the runs of {track.chosen_by}. "
        "The circle marks the start, the thin line without marks the truth."
        if track.known
        else f"Run {track.run}, the first of {track.chosen_by} that came through. The truth is not known; "
        f"the circle marks the first estimate of {track.chosen_by}."
    )
    if card.landmarks:
        caption += f" Triangles: {listed([name for name, *_ in card.landmarks], 8)}."
    if track.missing:
        caption += f" Not drawn: {listed(track.missing)}, which did not come through this run."
    places = [*([("truth", track.truth)] if track.known else []), *track.estimates.items()]
    header = ["time (s)", *(f"{name} {c}" for name, _ in places for c in (x, y))]
    steps = track.truth.shape[1]
    rows = [
        [tick(float(card.time[k])), *(f"{float(e):.6g}".replace("-", "−") for _, place in places for e in place[:, k])]
        for k in series.sampled(steps, TABLE_ROWS)
    ]
    note = "" if len(rows) == steps else f"{len(rows)} of {steps} steps, spread evenly."
    return FigureView("ground", title, caption, drawing, list(track.estimates), header, rows, note)
