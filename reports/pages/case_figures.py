"""The figures of a case's page in their order: those that a reader sees at once, and those that are folded away."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from reports import curves, series
from reports.marks import Mark
from reports.plot import Plot
from reports.plots import calibration, cost, divergence, modes, over_time, plane, runs
from reports.plots.runs import Runs
from reports.views import CaseView

MOST_BLOCKS = 3
"""State blocks whose errors a reader sees at once; those of the others are folded away."""


@dataclass(frozen=True)
class CaseFigures:
    """Figures of the main part, those of single runs on the plane, and the rest; and the table of runs."""

    main: Sequence[Plot]
    planes: Sequence[Plot]
    more: Sequence[Plot]
    runs: Runs | None

    @property
    def all(self) -> list[Plot]:
        """All figures."""
        return [*self.main, *self.planes, *self.more]


def case_figures(case: CaseView, marks: Mapping[str, Mark]) -> CaseFigures:
    """All figures of a case."""
    labels = series.ranked(case)
    card = case.card
    components = card.plane or (card.blocks[0].components if card.blocks else ())
    picked = runs.chosen(case.results, labels, components)
    errors = list(over_time.errors(case, labels, marks))
    return CaseFigures(
        [*errors[:MOST_BLOCKS], *_main(case, labels, marks, picked)],
        plane.figures(case, labels, marks, picked),
        [*errors[MOST_BLOCKS:], *_more(case, labels, marks)],
        runs.table(case, labels, picked),
    )


def _main(case: CaseView, labels: Sequence[str], marks: Mapping[str, Mark], picked: Mapping[str, int]) -> Iterator[Plot]:
    if case.card.blocks:
        yield from cost.latency(case, 0, labels, marks)
    yield from over_time.squares(case, "nees", labels, marks)
    yield from divergence.figures(case, labels, marks)
    yield from modes.figures(case, labels, marks, picked)
    yield from over_time.brier(case, labels, marks)
    yield from _detection(case, labels, marks)


def _detection(case: CaseView, labels: Sequence[str], marks: Mapping[str, Mark]) -> Iterator[Plot]:
    known = {each.label: each for each in case.detectors}
    found = [known[label] for label in labels if label in known]
    for kind in curves.PER:
        drawn = [each.label for each in found if kind in each.curves]
        if drawn:
            yield curves.roc(found, kind, marks, f"roc-{kind}", series.first(drawn))
    if delay := curves.delay(found, marks, "delay", series.first([each.label for each in found])):
        yield delay


def _more(case: CaseView, labels: Sequence[str], marks: Mapping[str, Mark]) -> Iterator[Plot]:
    yield from over_time.ratios(case, labels, marks)
    yield from over_time.squares(case, "nis", labels, marks)
    yield from calibration.coverage(case, labels, marks)
    yield from calibration.histograms(case, labels, marks)
    for place in range(1, len(case.card.blocks)):
        yield from cost.latency(case, place, labels, marks)
    yield from cost.throughput(case, labels, marks)
