"""The overview: what the results show in three sentences, all cases against all estimators, and the list of the cases."""

import itertools
import json
import math
from collections.abc import Iterator, Sequence
from typing import Any

from reports.frame import Frame
from reports.inputs import Site
from reports.pages.choices import Choice, choices
from reports.pages.matrix import payload, row, said
from reports.part import Part
from reports.sentences import behind, headline
from reports.views import CaseView
from suite.case import ORIGINS
from suite.metrics import FAMILIES, METRICS

MANY = 8
"""With more estimators than so many the matrix is compact at first."""
KINDS = {
    "plain": "without particles (Gaussian)",
    "particles": "with particles",
    "modes": "of several modes",
    "detects": "that detect manoeuvres",
    "library": "of other libraries",
}
"""Kinds of estimators to filter by, with the words behind 'estimators'; one may be of several."""


def parts(site: Site) -> Iterator[Part]:
    """The overview, and what can be chosen on it, a part for each family of metrics."""
    frame, cases = site.frame, site.cases
    yield Part("overview", site.depends(), files, (frame, cases), len(cases))
    for family, offered in _by_family(choices(cases) if cases and frame.labels else []):
        yield Part(f"overview {family}", site.depends(), data_files, (cases, family), len(offered) * len(cases))


def files(frame: Frame, cases: Sequence[CaseView]) -> dict[str, str]:
    """The page."""
    return {"index.html": frame.page("overview", **context(frame, cases))}


def data_files(cases: Sequence[CaseView], family: str) -> dict[str, str]:
    """Scripts that hand the page what the choices of a family of metrics show.

    The page adds them as they are chosen, since pages on a disk cannot fetch.
    """
    return {data_file(choice): _script(choice, cases) for choice in choices(cases) if choice.metric.family == family}


def data_file(choice: Choice) -> str:
    """The script of a choice."""
    return f"data/matrix-{choice.id}.js"


def _script(choice: Choice, cases: Sequence[CaseView]) -> str:
    found = json.dumps(payload([row(case, choice) for case in cases]), separators=(",", ":"))
    return f'overview.receive("{choice.id}", {found});\n'


def context(frame: Frame, cases: Sequence[CaseView]) -> dict[str, Any]:
    """What the overview's template needs."""
    if not cases or not frame.labels:
        return {"rows": [], "headline": headline(cases), "behind": behind(cases)}
    offered = choices(cases)
    texts: dict[str, int] = {}
    words = [[[texts.setdefault(text, len(texts)) for text in said(cell)] for cell in case.cells.values()] for case in cases]
    return {
        "headline": headline(cases),
        "behind": behind(cases),
        "rows": list(zip(cases, [row(case, offered[0]) for case in cases], strict=True)),
        "choices": offered,
        "metrics": [(FAMILIES[name], list(dict.fromkeys(c.metric for c in group))) for name, group in _by_family(offered)],
        "titles": {choice.metric.name: choice.title for choice in offered},
        "kinds": {label: kinds(label, cases) for label in frame.labels},
        "kind_words": KINDS,
        "scenarios": _scenarios(cases),
        "scenario": scenario,
        "origins": [origin for origin in ORIGINS if any(case.card.origin == origin for case in cases)],
        "many": len(frame.labels) > MANY,
        "told": any(cell.told for case in cases for cell in case.cells.values()),
        "data": {"choices": [_told(choice) for choice in offered], "texts": list(texts), "said": words},
    }


def _told(choice: Choice) -> dict[str, Any]:
    """What the page's script knows of a choice."""
    return {
        "id": choice.id,
        "metric": choice.metric.name,
        "title": choice.title,
        "block": choice.named,
        "better": choice.better,
        "legend": choice.legend,
        "bound": choice.bound,
        "factor": choice.factor,
    }


def _by_family(offered: Sequence[Choice]) -> list[tuple[str, list[Choice]]]:
    return [(name, list(group)) for name, group in itertools.groupby(offered, lambda choice: choice.metric.family)]


def kinds(label: str, cases: Sequence[CaseView]) -> list[str]:
    """Which of `KINDS` an estimator is of, from its name, its parameters and what it has scores of, as far as these tell."""
    cells = [case.cells[label] for case in cases]
    known = [cell.meta for cell in cells if cell.meta]
    scored = {METRICS[name].family for cell in cells for (name, _), score in cell.scores.items() if math.isfinite(score.value)}
    particles = any("particles" in meta.get("parameters", {}) for meta in known)
    found = {
        "plain": bool(known) and not particles,
        "particles": particles,
        "modes": "modes" in scored,
        "detects": "detection" in scored,
        "library": ":" in label.partition("[")[0],
    }
    return [kind for kind, holds in found.items() if holds]


def scenario(case: CaseView) -> str:
    """The family of a case: its name before the slash."""
    return str(case.card.name).partition("/")[0]


def _scenarios(cases: Sequence[CaseView]) -> dict[str, list[CaseView]]:
    """The cases of each family."""
    found: dict[str, list[CaseView]] = {}
    for case in cases:
        found.setdefault(scenario(case), []).append(case)
    return found
