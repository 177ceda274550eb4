"""The page of published figures: what each paper prints or claims, beside what was found of it here."""

import dataclasses
import itertools
import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from reports.dots import REACH, Dot, beyond, dots, drawable
from reports.frame import Frame
from reports.inputs import Site
from reports.part import Part
from reports.plot import Column, Plot, data_files
from reports.text import listed, within
from reports.views import CaseView
from suite.metrics import METRICS, Score
from suite.published import VERDICTS, Finding, Key, Published
from suite.verdicts import Verdict, distance

NOT_EXAMINED = "not examined"
FAR = 1e6
"""So many times a published value is beyond any scatter."""
AGREEMENT = {
    True: "within chance of what is printed",
    False: "beyond chance of what is printed",
    None: "too uncertain to tell",
}


@dataclass(frozen=True)
class Row:
    """A published figure as the page shows it.

    number: of its row in the paper's table and drawing, 0 for a claim. here: what these results measure, in words, or why they
    measure nothing. same: number of the row whose reason is the same, 0 where it is the first.
    """

    verdict: Verdict
    number: int
    here: str
    runs: int
    same: int = 0

    @property
    def figure(self) -> Published:
        """What is printed, and where."""
        return self.verdict.published

    @property
    def unit(self) -> str:
        """The unit, none for what mixes several."""
        return "" if self.figure.unit == "mixed" else self.figure.unit

    @property
    def reason(self) -> str:
        """Why the verdict is what it is."""
        return self.verdict.finding.reason if self.verdict.finding else ""

    @property
    def recorded(self) -> str:
        """Our value with its interval as it was recorded, in words."""
        found = self.verdict.finding
        return within(*found.ours, self.unit) if found and found.ours else ""

    @property
    def agreement(self) -> str:
        """How what these results measure agrees with what is printed; nothing where they do not measure it."""
        return "" if self.verdict.distance is None else AGREEMENT[self.verdict.agrees]


@dataclass(frozen=True)
class Paper:
    """What was published in one place: the cases that are of it, its printed numbers and its claims."""

    anchor: str
    title: str
    reference: str
    cases: Sequence[str]
    rows: Sequence[Row]
    claims: Sequence[Row]
    plot: Plot | None

    @property
    def counts(self) -> list[int]:
        """How many of its figures and claims have each verdict, then how many are not examined."""
        found = Counter(row.verdict.recorded for row in (*self.rows, *self.claims))
        return [found[verdict] for verdict in (*VERDICTS, NOT_EXAMINED)]

    @property
    def broken(self) -> int:
        """How many of the records these results contradict."""
        return sum(row.verdict.broken for row in self.rows)


def parts(site: Site) -> Iterator[Part]:
    """The page of published figures."""
    found = {" | ".join(key): dataclasses.astuple(finding) for key, finding in site.inputs.findings.items()}
    verdicts = {case.card.name: list(_here(case, site.inputs.findings)) for case in site.cases}
    references = {case.card.name: case.card.reference for case in site.cases}
    arguments = (site.frame, verdicts, references, site.inputs.findings)
    yield Part("reproduction.html", site.depends(found), files, arguments)


def files(
    frame: Frame, verdicts: Mapping[str, Sequence[Row]], references: Mapping[str, str], findings: Mapping[Key, Finding]
) -> Mapping[str, str]:
    """The page's files."""
    found = papers(frame, verdicts, references)
    told = {case for paper in found for case in paper.cases}
    known = {_key(row.verdict) for rows in verdicts.values() for row in rows}
    said = {
        "papers": found,
        "heads": (*VERDICTS, NOT_EXAMINED),
        "totals": [sum(column) for column in zip(*(paper.counts for paper in found), strict=True)],
        "without": [name for name in references if name not in told],
        "elsewhere": _elsewhere({key: finding for key, finding in findings.items() if key not in known}),
        "stems": frame.stems,
        "within": within,
    }
    plots = [paper.plot for paper in found if paper.plot]
    return {
        "reproduction.html": frame.page("reproduction", **said, data="data/reproduction"),
        **dict(data_files("reproduction", plots)),
    }


def _here(case: CaseView, findings: Mapping[Key, Finding]) -> Iterator[Row]:
    """The published figures of a case, with what these results measure of each; without their numbers."""
    for verdict in case.verdicts(findings):
        figure, score = verdict.published, verdict.score
        row = Row(verdict, 0, "", 0)
        if score:
            yield dataclasses.replace(row, here=within(score.value, score.low, score.high, row.unit), runs=score.runs)
        else:
            yield dataclasses.replace(row, here=_unmeasured(case, figure))


def _unmeasured(case: CaseView, figure: Published) -> str:
    """Why these results measure nothing of a published figure."""
    if figure.metric not in METRICS:
        return "no metric here measures it"
    cell = case.cells.get(figure.estimator)
    if cell is None:
        return "no such estimator was run"
    if not cell.ran or not cell.came_through:
        return cell.status
    return "too few runs for an interval" if cell.total == 1 else "no value with an interval"


def papers(frame: Frame, verdicts: Mapping[str, Sequence[Row]], references: Mapping[str, str]) -> list[Paper]:
    """The papers of which anything printed is recorded, in the order of their first cases."""
    groups: dict[str, list[str]] = {}
    for name, reference in references.items():
        groups.setdefault(reference, []).append(name)
    found: list[Paper] = []
    for reference, cases in groups.items():
        if not any(verdicts[name] for name in cases):
            continue
        mine = [row for name in cases for row in verdicts[name]]
        rows = _numbered([row for row in mine if row.figure.value is not None])
        claims = [row for row in mine if row.figure.value is None]
        title, number = _title(reference, cases), len(found) + 1
        plot = _plot(frame, f"found-over-printed-{number}", title, rows)
        found.append(Paper(f"paper_{number}", title, reference, cases, rows, claims, plot))
    return found


def _numbered(rows: Sequence[Row]) -> list[Row]:
    """Rows with their numbers; a reason that comes again refers to the row that has it first."""
    first: dict[str, int] = {}
    made = []
    for number, row in enumerate(rows, 1):
        same = first.setdefault(row.reason, number)
        made.append(dataclasses.replace(row, number=number, same=same if row.reason and same != number else 0))
    return made


def _title(reference: str, cases: Sequence[str]) -> str:
    """The authors' names, as far as a reference begins with them, and what the names of the cases have in common."""
    initials = r"(?:\w\.[ -]?)+"
    words = [part.strip() for part in reference.split(",")]
    count = next((i for i, word in enumerate(words) if not re.match(initials + r"\S", word)), len(words))
    authors = [re.sub(rf"^{initials}", "", word) for word in words[:count]]
    words_of = zip(*(re.split(r"(?=[/-])", name) for name in cases), strict=False)
    alike = itertools.takewhile(lambda found: len(set(found)) == 1, words_of)
    common = "".join(found[0] for found in alike) or listed(cases, 3)
    return f"{listed(authors, 4)}: {common}" if authors else common


def _plot(frame: Frame, name: str, title: str, rows: Sequence[Row]) -> Plot | None:
    """What was found here over what is printed, with the band in which a repetition would fall; None without any such value."""
    held = [row for row in rows if _comparable(row) and (_recorded(row) or row.verdict.score)]
    if not held:
        return None
    recorded, here = [_over(row, _recorded(row)) for row in held], [_over(row, row.verdict.score) for row in held]
    bands = [_band(row) for row in held]
    marks = [frame.marks.get(row.figure.estimator) for row in held]
    shown = [
        Dot(i, score.value, score.low, score.high, marks[i], hollow)
        for hollow, scores in ((False, recorded), (True, here))
        for i, score in enumerate(scores)
        if score
    ]
    drawn_bands = [(i, *band) for i, band in enumerate(bands) if band]
    names = [f"{row.number} {row.figure.estimator}" for row in held]
    axis = "found here over printed"
    heading = f"Found here over printed, {title}"
    far = [names[dot.row] for dot in beyond(shown, 1.0)]
    columns = [Column("row", names)]
    for head, scores in (("recorded", recorded), ("these results", here)):
        for end in ("value", "low", "high"):
            values = [getattr(score, end) if score else math.nan for score in scores]
            columns.append(Column(f"{head} over printed" if end == "value" else f"{head}, {end} end", values, head, end))
    for place, end in enumerate(("low", "high")):
        columns.append(Column(f"band, {end} end", [band[place] if band else math.nan for band in bands], "band", end))
    return Plot(
        name,
        heading,
        "Rows as in the table below. Filled: as recorded. Hollow: these results. Lines are 95 % intervals. Grey: where the "
        "ratio lies 95 times of 100 if the paper, with its number of runs (100 where it does not say), and the record measure "
        "the same; without a record, if the paper and these results do. What no metric here measures has no band; rates and "
        "zeros are not drawn. A verdict may rest on more than this: its reason says on what."
        + (f" An arrow at the edge stands for a value more than {REACH:g} times off: {listed(far)}." if far else ""),
        dots(names, shown, name, heading, axis, 1.0, drawn_bands),
        list(dict.fromkeys(row.figure.estimator for row in held if row.figure.estimator in frame.marks)),
        columns,
        "row",
        axis,
        "y",
    )


def _comparable(row: Row) -> bool:
    """Whether ratios to what is printed say anything."""
    metric = METRICS.get(row.figure.metric)
    return row.figure.value is not None and drawable(row.figure.value) and not (metric and metric.binomial)


def _recorded(row: Row) -> Score | None:
    """What was found before, as a score."""
    found = row.verdict.finding
    return Score(*found.ours, row.unit, found.runs, found.runs) if found and found.ours else None


def _over(row: Row, score: Score | None) -> Score | None:
    """A score over what is printed."""
    if score is None:
        return None
    assert row.figure.value is not None
    ends = {end: getattr(score, end) / row.figure.value for end in ("value", "low", "high")}
    return dataclasses.replace(score, unit="", **ends)


def _band(row: Row) -> tuple[float, float] | None:
    """Where ratios are taken for a repetition's, by the rule of the verdicts; None where it does not apply.

    The rule says how many times what it allows two values are apart, so what it allows follows from values far apart.
    """
    score = _recorded(row) or row.verdict.score
    if score is None or row.figure.metric not in METRICS or not score.low > 0 or not score.runs:
        return None
    assert row.figure.value is not None
    factor = FAR * row.figure.value / score.value
    apart = dataclasses.replace(score, value=score.value * factor, low=score.low * factor, high=score.high * factor)
    found = distance(apart, row.figure)
    if not found > 1:
        return None
    allowed = math.exp(math.log(FAR) / found)
    return 1 / allowed, allowed


def _elsewhere(findings: Mapping[Key, Finding]) -> dict[str, list[tuple[Key, Finding]]]:
    """Findings by case."""
    found: dict[str, list[tuple[Key, Finding]]] = {}
    for key, finding in findings.items():
        found.setdefault(key[0], []).append((key, finding))
    return found


def _key(verdict: Verdict) -> Key:
    return verdict.case, verdict.published.estimator, verdict.published.quantity
