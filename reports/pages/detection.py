"""The page of detectors: their curves, operating points and scores on every case that has manoeuvres to detect."""

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from reports import curves
from reports.detectors import Detector
from reports.frame import Frame
from reports.inputs import Site
from reports.marks import Mark
from reports.part import Part
from reports.plot import Column, Plot, data_files, table_csv
from reports.text import grouped, number, quantity
from reports.views import CaseView, Key
from suite.case import RECORDED
from suite.metrics import METRICS, Score
from suite.metrics.detection import ALARMED
from suite.operating import POINT

STEM = "detection"
AREA: Key = ("auc", "manoeuvre")
SCORES: Sequence[Key] = (AREA, ("pauc", "manoeuvre"), ("auc", "scan"), ("pauc", "scan"),
                         ("detection-rate", "manoeuvre"), ("detection-delay", "manoeuvre"))  # fmt: skip
FIRST = 8
"""Detectors whose curves are shown at first."""
ENOUGH = math.ceil(math.log(0.025) / math.log(1 - ALARMED))
"""Runs without manoeuvres below which the threshold of that level may well be above all that they show."""
UNITS = {"false_alarm": "", "run_length": "s", "detection": "", "delay": "s"}


def parts(site: Site) -> Iterator[Part]:
    """The page of detectors."""
    yield Part(STEM, site.depends(), files, (site.frame, site.cases))


def files(frame: Frame, cases: Sequence[CaseView]) -> dict[str, str]:
    """The page's files."""
    chosen = [case for case in cases if case.detectors]
    sections = [_section(frame, case) for case in chosen]
    labels = [label for label in frame.labels if any(d.label == label for case in chosen for d in case.detectors)]
    said = {"found": sections, "labels_here": labels, "cases": chosen, "area": AREA, "enough": ENOUGH, "level": ALARMED}
    tables = {f"data/{STEM}-points-{each['stem']}.csv": table_csv(each["points"]) for each in sections}
    plots = [plot for each in sections for plot in each["plots"]]
    return {"detection.html": frame.page("detection", **said), **dict(data_files(STEM, plots)), **tables}


def _section(frame: Frame, case: CaseView) -> dict[str, Any]:
    """What the page shows of a case."""
    stem = frame.stems[case.card.name]
    shown = [key for key in SCORES if any(key in case.cells[d.label].scores for d in case.detectors)]
    calm = sorted({int(row["calm_runs"]) for d in case.detectors for row in d.points})
    return {
        "case": case,
        "stem": stem,
        "plots": list(_plots(case, frame.marks, stem)),
        "keys": [(key, METRICS[key[0]]) for key in shown],
        "rows": [(case.cells[d.label], d.points) for d in case.detectors],
        "points": points(case.detectors),
        "table": [(d.label, [_words(row) for row in d.points]) for d in case.detectors],
        "calm": [n for n in calm if n],
        "uncalibrated": [d.label for d in case.detectors if any(not row["calm_runs"] for row in d.points)],
        "all": len(case.detectors),
        "pointless": [d.label for d in case.detectors if not d.points],
        "recorded": case.card.origin == RECORDED,
    }


def _plots(case: CaseView, marks: Mapping[str, Mark], stem: str) -> Iterator[Plot]:
    """The curves per manoeuvre, per scan where there are none, and delay against false alarms; the page of a case has all."""
    first = _first(case)
    kind = "manoeuvre" if any("manoeuvre" in each.curves for each in case.detectors) else "scan"
    roc = curves.roc(case.detectors, kind, marks, f"roc-{kind}-{stem}", first)
    for plot in (roc, curves.delay(case.detectors, marks, f"delay-{stem}", first)):
        if plot and plot.labels:
            yield dataclasses.replace(plot, title=f"{plot.title}, {case.card.name}")


def _first(case: CaseView) -> Sequence[str]:
    """Of many detectors those with the largest areas, the ones marked before others."""
    if len(case.detectors) <= FIRST:
        return ()

    def place(detector: Detector) -> tuple[bool, float]:
        cell = case.cells[detector.label]
        score = cell.scores.get(AREA)
        return not cell.mark(AREA), -score.value if score and not math.isnan(score.value) else math.inf

    return [detector.label for detector in sorted(case.detectors, key=place)[:FIRST]]


def points(detectors: Sequence[Detector]) -> list[Column]:
    """All operating points as columns, which are those of `filterbench detect`."""
    rows = [(detector.label, row) for detector in detectors for row in detector.points]
    columns = [Column("estimator", [label for label, _ in rows])]
    return columns + [Column(name, [row[name] for _, row in rows]) for name in POINT]


def _words(row: Mapping[str, Any]) -> dict[str, Any]:
    """An operating point in words; a quantity with its interval, None where it is not known."""
    found: dict[str, Any] = {"level": f"{row['level']:g}", "threshold": number(row["threshold"]), "runs": grouped(row["runs"])}
    for name, unit in UNITS.items():
        value, low, high = (row[name + end] for end in ("", "_low", "_high"))
        score = Score(value, low, high, unit, row["runs"], row["runs"])
        found[name] = None if math.isnan(value) else quantity(score, METRICS["detection-delay"])
    missed = row["runs"] * (1 - row["detection"])
    found["missed"] = "none" if math.isnan(missed) else grouped(round(missed))
    found["set_on"] = f"{grouped(row['calm_runs'])} of the twin" if row["calm_runs"] else "steps before manoeuvres"
    return found
