"""What pages about several cases need of a case, as JSON: also what a reader who computes may take from the site."""

import dataclasses
import json
import math
from typing import Any

from reports.detectors import Detector
from reports.views import CaseView, CellView, Key
from suite.diagnosis import Remark
from suite.metrics import Score
from suite.results import CaseResults

COLUMNS = ("metric", "block", *(field.name for field in dataclasses.fields(Score)), "standing")
"""Of a score in the list of an estimator's scores."""


def to_json(case: CaseView) -> str:
    """A case with all its scores; numbers that do not exist are null, infinite ones 'inf' or '-inf'."""
    said = {
        "case": case.card.name,
        "seed": case.results.seed,
        "runs": case.runs,
        "known": case.known,
        "rounding": dict(case.rounding),
        "keys": case.keys,
        "columns": COLUMNS,
        "estimators": [_of_cell(cell) for cell in case.cells.values()],
        "measured": [score and dataclasses.astuple(score) for score in case.measured],
        "detectors": [dataclasses.asdict(detector) for detector in case.detectors],
    }
    return json.dumps(_encoded(said), separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def from_json(text: str, results: CaseResults) -> CaseView:
    """The case that `to_json` wrote, beside the results that it came from."""
    said = json.loads(text)
    cells = [_cell(each, results) for each in said["estimators"]]
    return CaseView(
        results,
        {cell.label: cell for cell in cells},
        tuple(_pair(key) for key in said["keys"]),
        said["runs"],
        said["known"],
        said["rounding"],
        tuple(_score(each) if each else None for each in said["measured"]),
        tuple(_detector(each) for each in said["detectors"]),
    )


def _of_cell(cell: CellView) -> dict[str, Any]:
    said = {field.name: getattr(cell, field.name) for field in dataclasses.fields(cell)}
    said |= {"remarks": [dataclasses.astuple(remark) for remark in cell.remarks]}
    said |= {"scores": [(*key, *dataclasses.astuple(score), cell.standing.get(key, "")) for key, score in cell.scores.items()]}
    return {name: value for name, value in said.items() if name not in ("meta", "standing")}


def _cell(said: dict[str, Any], results: CaseResults) -> CellView:
    rows = said.pop("scores")
    label = said["label"]
    said["failures"] = tuple((kind, reason, tuple(tracebacks)) for kind, reason, tracebacks in said["failures"])
    said["remarks"] = tuple(Remark(*each) for each in said["remarks"])
    scores: dict[Key, Score] = {(metric, block): _score(rest[:-1]) for metric, block, *rest in rows}
    standing: dict[Key, str] = {(metric, block): rest[-1] for metric, block, *rest in rows if rest[-1]}
    held = results.cells.get(label)
    return CellView(**said, scores=scores, standing=standing, meta=held.meta if held else {})


def _score(row: list[Any]) -> Score:
    value, low, high, unit, runs, total = row
    return Score(_number(value), _number(low), _number(high), unit, runs, total)


def _detector(said: dict[str, Any]) -> Detector:
    points = [{name: _number(value) for name, value in row.items()} for row in said["points"]]
    return Detector(said["label"], {name: (x, y) for name, (x, y) in said["curves"].items()}, points)


def _pair(key: list[str]) -> Key:
    metric, block = key
    return metric, block


def _number(value: Any) -> Any:
    return math.nan if value is None else float(value) if isinstance(value, str) else value


def _encoded(value: Any) -> Any:
    """Plain data that JSON can hold."""
    if isinstance(value, dict):
        return {key: _encoded(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_encoded(each) for each in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else str(value)
    return value.item() if hasattr(value, "item") else value
