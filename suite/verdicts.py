"""Verdicts on published figures: what a result set measures of them, against what was found and recorded before."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal

from suite.metrics import METRICS, Score
from suite.published import NOT_REPRODUCED, REPRODUCED, Finding, Key, Published
from suite.results import CaseResults

UNSTATED = 100
"""Runs that a paper is taken to average over when it does not say: what is usual in this field."""
WIDE = 1.5


@dataclass(frozen=True)
class Verdict:
    """A published figure of a case, what was found of it before, and what a result set measures."""

    case: str
    published: Published
    finding: Finding | None
    score: Score | None

    @property
    def agrees(self) -> bool | None:
        """Whether the measured value could be the published one's repetition; None when there is nothing to compare."""
        return None if self.score is None or self.published.value is None else agrees(self.score, self.published)

    @property
    def broken(self) -> bool:
        """Whether the result set contradicts the recorded verdict."""
        expected = {REPRODUCED: True, NOT_REPRODUCED: False}.get(self.finding.verdict if self.finding else "")
        return self.agrees is not None and expected is not None and self.agrees != expected


def verdicts(cases: Iterable[CaseResults], findings: Mapping[Key, Finding]) -> Iterator[Verdict]:
    """The published figures of the cases, in their order, with what the results measure of each."""
    for case in cases:
        for published in case.card.published:
            finding = findings.get((case.card.name, published.estimator, published.quantity))
            yield Verdict(case.card.name, published, finding, measured(case, published))


def measured(case: CaseResults, published: Published) -> Score | None:
    """The score that measures a published figure; None without one, or without an interval."""
    cell = case.cells.get(published.estimator)
    if cell is None or published.metric not in METRICS:
        return None
    score = cell.scores(METRICS[published.metric]).get(published.block)
    return score if score is not None and math.isfinite(score.low) and math.isfinite(score.high) else None


def agrees(score: Score, published: Published) -> bool | None:
    """Whether a published value lies where an experiment of the paper's number of runs would put it, 95 times of 100.

    Its own scatter is taken to be ours, scaled to its runs, or to `UNSTATED` where it does not tell how many; both are on the
    scale of logarithms. Half a unit of its last printed digit is granted on top. None where it lies there,
    but so would one `WIDE` times ours: then nothing is decided.
    """
    assert published.value is not None
    if score.low <= 0 or published.value <= 0:
        return score.low <= published.value <= score.high
    ours = math.log(score.high / score.low) / 2
    theirs = ours * math.sqrt(score.runs / (published.runs or UNSTATED))
    last = Decimal(str(published.value)).as_tuple().exponent
    rounding = 0.5 * 10.0 ** int(last) / published.value
    allowed = math.hypot(ours, theirs) + rounding
    if abs(math.log(published.value / score.value)) > allowed:
        return False
    return None if allowed > math.log(WIDE) else True
