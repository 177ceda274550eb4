"""What a case's page tells of the problem: what its reference states, what is assumed here, and the figures it prints."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from reports.text import count, listed, within
from reports.views import CaseView
from suite.case import Card
from suite.published import VERDICTS, Finding
from suite.published import Key as FigureKey
from suite.verdicts import Verdict

STATED = "Stated"
"""How an assumption begins that tells what the reference states; of the others it depends."""


@dataclass(frozen=True)
class Figure:
    """A published figure: verdict and its reason first, then what was printed and what was found, in words.

    broken: whether these results say otherwise than the verdict.
    """

    verdict: str
    broken: bool
    reason: str
    estimator: str
    quantity: str
    where: str
    value: str
    printed_runs: str
    found: str
    here: str


def assumptions(card: Card) -> tuple[list[str], list[str]]:
    """What the card says that the reference states, and all else; the first is empty where it does not tell them apart."""
    stated = [words for words in card.assumptions if words.startswith(STATED)]
    return stated, [words for words in card.assumptions if words not in stated]


def published(case: CaseView, findings: Mapping[FigureKey, Finding]) -> list[Figure]:
    """The published figures of a case."""
    return [_figure(verdict) for verdict in case.verdicts(findings)]


def in_short(figures: Sequence[Figure]) -> str:
    """How many of the published figures have which verdict."""
    found = Counter(figure.verdict for figure in figures)
    order = [*VERDICTS, *(verdict for verdict in found if verdict not in VERDICTS)]
    counted = listed(f"{found[verdict]} {verdict}" for verdict in order if found[verdict])
    said = f"Of {count(len(figures), 'published figure')}: {counted}."
    against = sum(figure.broken for figure in figures)
    return f"{said} These results contradict {count(against, 'verdict')}." if against else said


def _figure(verdict: Verdict) -> Figure:
    figure, finding, score = verdict.published, verdict.finding, verdict.score
    unit = "" if figure.unit == "mixed" or figure.value is None else figure.unit
    found = here = ""
    if finding and finding.ours and math.isfinite(finding.ours[0]):
        found = f"{within(*finding.ours, unit)}, {count(finding.runs, 'run')}"
    if score and figure.value is not None:
        here = f"{within(score.value, score.low, score.high, unit)}, {count(score.runs, 'run')}"
    return Figure(
        verdict.recorded,
        verdict.broken,
        finding.reason if finding else "",
        figure.estimator,
        figure.quantity,
        f"{figure.where}; {figure.note}" if figure.note else figure.where,
        "a claim" if figure.value is None else f"{figure.value:g} {unit}".strip(),
        count(figure.runs, "run") if figure.runs else "",
        found,
        here,
    )
