"""Verdicts on published figures: what a result set measures of them, against what was found and recorded before."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal

import numpy as np
from scipy.special import ndtri

from suite.metrics import METRICS, Score
from suite.published import NOT_REPRODUCED, REPRODUCED, Finding, Key, Published
from suite.results import CaseResults

UNSTATED = 100
"""Runs that a paper is taken to average over when it does not say: what is usual in this field."""
WIDE = 1.5
CLEAR = 1.7
"""Distance beyond which chance puts a figure once in a thousand times."""


@dataclass(frozen=True)
class Verdict:
    """A published figure of a case, what was found of it before, and what a result set measures."""

    case: str
    published: Published
    finding: Finding | None
    score: Score | None

    @property
    def recorded(self) -> str:
        """The verdict that was recorded before."""
        return self.finding.verdict if self.finding else "not examined"

    @property
    def distance(self) -> float | None:
        """How far the measured value is from the published one, see `distance`; None when there is nothing to compare."""
        return None if self.score is None or self.published.value is None else distance(self.score, self.published)

    @property
    def agrees(self) -> bool | None:
        """Whether the published value could be the measured one's repetition; None when that cannot be told."""
        return None if self.distance is None or math.isnan(self.distance) else self.distance <= 1

    @property
    def broken(self) -> bool:
        """Whether the result set contradicts the recorded verdict: clearly, and by as many runs as the record is of."""
        if self.finding is None or self.score is None or self.distance is None or self.score.runs < self.finding.runs:
            return False
        clearly = {REPRODUCED: self.distance > CLEAR, NOT_REPRODUCED: self.distance < 1 / CLEAR}
        return clearly.get(self.recorded, False)


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


def distance(score: Score, published: Published) -> float:
    """How far a published value is from where an experiment of the paper's number of runs would put it 95 times of 100.

    It lies there up to 1. Its own scatter is taken to be ours, scaled to its runs, or to `UNSTATED` where it does not tell how
    many; both are on the scale of logarithms. Half a unit of its last printed digit is granted on top; of zeros at the end
    nothing is known. NaN where the value lies there but so would one `WIDE` times ours, or where there is no scale. A rate is
    compared by Fisher's exact test.
    """
    assert published.value is not None
    theirs = published.runs or UNSTATED
    if METRICS[published.metric].binomial:
        from scipy.stats import fisher_exact  # takes a second to import; few figures are rates

        counts = [(round(rate * runs), runs) for rate, runs in ((score.value, score.runs), (published.value, theirs))]
        return float(ndtri(1 - fisher_exact(np.array([[n, runs - n] for n, runs in counts])).pvalue / 2) / ndtri(0.975))
    if score.low <= 0 or published.value <= 0:
        return math.nan
    half = math.log(score.high / score.low) / 2
    rounding = 0.5 * 10.0 ** int(Decimal(f"{published.value:g}").as_tuple().exponent) / published.value
    allowed = math.hypot(half, half * math.sqrt(score.runs / theirs)) + rounding
    found = abs(math.log(published.value / score.value)) / allowed
    return math.nan if found <= 1 and allowed > math.log(WIDE) else found
