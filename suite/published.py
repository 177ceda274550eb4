"""Published figures: what a paper prints or claims, how it came by it, and what became of it here."""

import dataclasses
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

REPRODUCED, NOT_REPRODUCED, NOT_COMPARABLE = "reproduced", "not reproduced", "not comparable"
VERDICTS = (REPRODUCED, NOT_REPRODUCED, NOT_COMPARABLE)


@dataclass(frozen=True)
class Published:
    """A figure printed in a paper, or a claim without one, with the place where it stands and what is known of its conditions.

    estimator: label of the estimator here that stands for the paper's, its parameters included. quantity: what was measured,
    in words. metric and block: how it is measured here, "" where nothing here measures it. runs: those the paper averages
    over, 0 where it does not say.
    """

    estimator: str
    quantity: str
    value: float | None
    unit: str
    where: str
    note: str = ""
    metric: str = ""
    block: str = ""
    runs: int = 0

    def __post_init__(self) -> None:
        if self.value is not None and not math.isfinite(self.value):
            raise ValueError(f"the published {self.quantity!r} of {self.estimator} must be a number or None, got {self.value}")


@dataclass(frozen=True)
class Experiment:
    """What a paper ran on a case: so many runs of the estimators with these labels."""

    runs: int
    estimators: tuple[str, ...]


@dataclass(frozen=True)
class Finding:
    """What became of a published figure here, for a reader who has the paper in hand.

    verdict: one of `VERDICTS`. ours: our value and the ends of its 95 % interval, over so many runs; none where there is
    nothing to measure.
    """

    verdict: str
    reason: str
    ours: tuple[float, float, float] | None = None
    runs: int = 0


Key = tuple[str, str, str]
"""Names a published figure: its case, the estimator and the quantity."""


def findings(path: Path) -> Mapping[Key, Finding]:
    """The findings of a TOML file, a table [[finding]] each. Raises ValueError that names the table which is not sound."""
    found: dict[Key, Finding] = {}
    for table in tomllib.loads(path.read_text(encoding="utf-8"))["finding"]:
        given = dict(table)
        key = given.pop("case", ""), given.pop("estimator", ""), given.pop("quantity", "")
        unknown = given.keys() - {f.name for f in dataclasses.fields(Finding)}
        if not all(key) or key in found or unknown or given.get("verdict") not in VERDICTS or not given.get("reason"):
            raise ValueError(f"{path}: the finding on {key} is not sound: {given}")
        if "ours" in given:
            given["ours"] = tuple(given["ours"])
        found[key] = Finding(**given)
    return found
