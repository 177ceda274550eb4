"""The pages of estimators, and their list."""

from collections.abc import Iterator, Sequence

from reports.frame import Frame
from reports.inputs import Site
from reports.part import Part
from reports.views import CaseView


def parts(site: Site) -> Iterator[Part]:
    """The pages of estimators, and their list."""
    yield Part("estimators", site.depends(), files, (site.frame, site.cases))


def files(frame: Frame, cases: Sequence[CaseView]) -> dict[str, str]:
    """The page's file."""
    return {"estimators.html": frame.page("estimators", cases=cases)}
