"""A case's page: its model, its figures, all its scores."""

import math
import shlex
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from reports.formula import mathml
from reports.marks import Mark
from reports.pages.case_figures import main_figures, more_figures
from reports.pages.scores import tables, warned
from reports.sentences import diverged
from reports.text import count, within
from reports.views import PERCENT, CaseView
from suite.case import RECORDED
from suite.metrics import FAMILIES, METRICS
from suite.published import Finding
from suite.published import Key as FigureKey
from suite.verdicts import Verdict, verdicts


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
        "mathml": mathml,
        "inf": math.inf,
        "recorded": case.card.origin == RECORDED,
        "command": command(case),
        "away": [(cell.label, n) for cell in case.cells.values() if (n := diverged(cell))],
        "count": count,
        "percent": PERCENT,
        "unit_of": lambda component: next((b.unit for b in case.card.blocks if component in b.components), ""),
        "limit_unit": case.card.block(case.card.divergence.block).unit,
        "published": [_published(verdict) for verdict in verdicts([results], findings)],
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
