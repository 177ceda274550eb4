"""A case's page: its model, its figures, all its scores."""

import dataclasses
import json
import math
from collections.abc import Mapping
from typing import Any

from reports.digest import to_json
from reports.frame import Frame
from reports.marks import Mark
from reports.pages.again import command, compare_command
from reports.pages.case_figures import case_figures
from reports.pages.differences import differences, script
from reports.pages.faults import warned
from reports.pages.problem import assumptions, in_short, published
from reports.pages.scores import absent, families, first, sortable
from reports.part import Part
from reports.plot import data_files
from reports.sentences import diverged
from reports.views import CaseView, private, view
from suite.case import RECORDED
from suite.compare import ZONE
from suite.metrics import FAMILIES, METRICS
from suite.published import Finding
from suite.published import Key as FigureKey
from suite.results import CaseResults


def digest_name(frame: Frame, name: str) -> str:
    """The file of a case's scores."""
    return f"data/{frame.stems[name]}.json"


def part(frame: Frame, results: CaseResults, findings: Mapping[FigureKey, Finding]) -> Part:
    """The page of a case, the data of its figures, and its digest."""
    name = results.card.name
    found = {" | ".join(key): dataclasses.astuple(finding) for key, finding in findings.items() if key[0] == name}
    words = json.dumps([results.card.to_dict(), list(found.values())])
    depends = {
        "blocks": results.held,
        "findings": found,
        "labels": frame.labels,
        "pages": {other: page for other, page in frame.cases.items() if other in words},
    }
    return Part(frame.cases[name], depends, files, (frame, results, findings), len(depends["blocks"]))


def files(frame: Frame, results: CaseResults, findings: Mapping[FigureKey, Finding]) -> dict[str, str]:
    """The files of a case by name."""
    case, name = view(private(results), frame.labels), results.card.name
    said = context(case, frame.marks, findings)
    stem = frame.stems[name]
    rows = {f"data/{stem}-differences.js": script(said["differences"])} if said["differences"] else {}
    return {
        frame.cases[name]: frame.page("case", **said, stem=stem, data=f"data/{stem}", digest=digest_name(frame, name)),
        **rows,
        **dict(data_files(stem, said["drawn"].all)),
        digest_name(frame, name): to_json(case),
    }


def context(case: CaseView, marks: Mapping[str, Mark], findings: Mapping[FigureKey, Finding]) -> dict[str, Any]:
    """What the template of a case's page needs."""
    figures, (stated, assumed) = published(case, findings), assumptions(case.card)
    pairs = differences(case)
    shown = [metric for metric in METRICS.values() if any(key[0] == metric.name for key in case.keys)]
    return {
        "case": case,
        "card": case.card,
        "drawn": case_figures(case, marks),
        "first": first(case),
        "tables": families(case),
        "refused": absent(case, "refused"),
        "not_run": absent(case, "not run"),
        "sortable": sortable,
        "differences": pairs,
        "zone": round(100 * ZONE),
        "warned": warned(case),
        "metrics": [(f, head, [m for m in shown if m.family == f]) for f, head in FAMILIES.items()],
        "inf": math.inf,
        "recorded": case.card.origin == RECORDED,
        "command": command(case),
        "compare_command": compare_command(case, pairs.start) if pairs else "",
        "away": {cell.label: n for cell in case.cells.values() if (n := diverged(cell))},
        "unit_of": lambda component: next((b.unit for b in case.card.blocks if component in b.components), ""),
        "limit_unit": case.card.block(case.card.divergence.block).unit,
        "stated": stated,
        "assumed": assumed,
        "published": figures,
        "in_short": in_short(figures),
    }
