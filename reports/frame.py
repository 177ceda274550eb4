"""What all pages of a site share: marks and pages of estimators, pages of cases, and the templates."""

import functools
from dataclasses import dataclass
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from reports.formula import mathml, prose
from reports.marks import Mark, marks
from reports.text import breakable, count, grouped, listed, slugs
from reports.views import PERCENT
from suite.metrics import METRICS
from suite.results import Results

SECTIONS = {
    "estimators": "Estimators",
    "reproduction": "Reproduction",
    "detection": "Detection",
    "timing": "Timing",
    "changes": "Changes",
    "provenance": "Provenance",
}
"""Pages beside the overview and those of cases and estimators, by the names of their files."""


@dataclass(frozen=True)
class Frame:
    """Labels of all estimators in their order; by label the mark, the anchor and the page; by name the page of each case."""

    labels: tuple[str, ...]
    marks: dict[str, Mark]
    anchors: dict[str, str]
    estimators: dict[str, str]
    stems: dict[str, str]
    cases: dict[str, str]

    @classmethod
    def of(cls, loaded: Results) -> "Frame":
        """The frame of a result set."""
        labels, names = loaded.labels, list(loaded.cases)
        anchors, stems = slugs(labels), slugs(names)
        estimators = {label: f"estimator-{anchors[label]}.html" for label in labels}
        cases = {name: f"case-{stems[name]}.html" for name in names}
        return cls(tuple(labels), marks(labels), anchors, estimators, stems, cases)

    def page(self, template: str, **context: Any) -> str:
        """A page from its template."""
        shared = {
            "labels": self.labels,
            "marks": self.marks,
            "anchors": self.anchors,
            "estimators": self.estimators,
            "pages": self.cases,
            "percent": PERCENT,
            "breakable": breakable,
            "count": count,
            "listed": listed,
            "grouped": grouped,
            "prose": prose,
            "mathml": mathml,
            "metrics_of": METRICS,
            "sections": SECTIONS,
        }
        return _environment().get_template(f"{template}.html.j2").render(shared | context)


@functools.lru_cache
def _environment() -> Environment:
    return Environment(
        loader=PackageLoader("reports", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
