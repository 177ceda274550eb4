"""A case's page: its model, its figures, all its scores."""

import dataclasses
import json
import math
import shlex
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from reports.digest import to_json
from reports.frame import Frame
from reports.marks import Mark
from reports.pages.case_figures import main_figures, more_figures
from reports.pages.scores import tables, warned
from reports.part import Part
from reports.plot import data_files
from reports.sentences import diverged
from reports.text import within
from reports.views import CaseView, private, view
from suite.case import RECORDED
from suite.metrics import FAMILIES, METRICS
from suite.published import Finding
from suite.published import Key as FigureKey
from suite.results import CaseResults
from suite.store import Entry
from suite.verdicts import Verdict


def digest_name(frame: Frame, name: str) -> str:
    """The file of a case's scores."""
    return f"data/{frame.stems[name]}.json"


def part(frame: Frame, results: CaseResults, findings: Mapping[FigureKey, Finding]) -> Part:
    """The page of a case, the data of its figures, and its digest."""
    name = results.card.name
    found = {" | ".join(key): dataclasses.astuple(finding) for key, finding in findings.items() if key[0] == name}
    words = json.dumps([results.card.to_dict(), list(found.values())])
    entries = [*_entries(results), *(_entries(results.calm) if results.calm else [])]
    depends = {
        "blocks": [(entry.meta["address"], entry.meta["created"]) for entry in entries],
        "findings": found,
        "labels": frame.labels,
        "pages": {other: page for other, page in frame.cases.items() if other in words},
    }
    return Part(frame.stems[name], depends, files, (frame, results, findings), len(entries))


def _entries(results: CaseResults) -> list[Entry]:
    cells = [entry for cell in results.cells.values() for entry in [*cell.estimates, *cell.timings]]
    return [*results.truths, *filter(None, [results.bound]), *cells]


def files(frame: Frame, results: CaseResults, findings: Mapping[FigureKey, Finding]) -> dict[str, str]:
    """The files of a case by name."""
    case, name = view(private(results), frame.labels), results.card.name
    said = context(case, frame.labels, frame.marks, findings)
    stem = frame.stems[name]
    return {
        frame.cases[name]: frame.page("case", **said, data=f"data/{stem}", digest=digest_name(frame, name)),
        **dict(data_files(stem, [*said["figures"], *said["more"]])),
        digest_name(frame, name): to_json(case),
    }


def context(
    case: CaseView, labels: Sequence[str], marks: Mapping[str, Mark], findings: Mapping[FigureKey, Finding]
) -> dict[str, Any]:
    """What the template of a case's page needs."""
    results = case.results
    shown = [metric for metric in METRICS.values() if any(key[0] == metric.name for key in case.keys)]
    return {
        "case": case,
        "card": case.card,
        "figures": list(main_figures(results, labels, marks)),
        "more": list(more_figures(results, labels, marks)),
        "tables": tables(case),
        "warned": warned(case),
        "families": [(f, head, [m for m in shown if m.family == f]) for f, head in FAMILIES.items()],
        "inf": math.inf,
        "recorded": case.card.origin == RECORDED,
        "command": command(case),
        "away": [(cell.label, n) for cell in case.cells.values() if (n := diverged(cell))],
        "unit_of": lambda component: next((b.unit for b in case.card.blocks if component in b.components), ""),
        "limit_unit": case.card.block(case.card.divergence.block).unit,
        "published": [_published(verdict) for verdict in case.verdicts(findings)],
    }


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
        elif word.endswith(".toml"):  # a recording that was named among the cases is a plug-in too
            yield word
