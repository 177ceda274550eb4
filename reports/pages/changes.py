"""The page of what changed."""

from collections.abc import Iterator, Sequence

from reports.frame import Frame
from reports.inputs import Site
from reports.part import Part
from reports.views import CaseView


def parts(site: Site) -> Iterator[Part]:
    """The page of what changed."""
    yield Part("changes", site.depends(), files, (site.frame, site.cases))


def files(frame: Frame, cases: Sequence[CaseView]) -> dict[str, str]:
    """The page's file."""
    return {"changes.html": frame.page("changes", cases=cases)}
