"""The page of published figures."""

from collections.abc import Iterator, Sequence

from reports.frame import Frame
from reports.inputs import Site
from reports.part import Part
from reports.views import CaseView


def parts(site: Site) -> Iterator[Part]:
    """The page of published figures."""
    yield Part("reproduction", site.depends(), files, (site.frame, site.cases))


def files(frame: Frame, cases: Sequence[CaseView]) -> dict[str, str]:
    """The page's file."""
    return {"reproduction.html": frame.page("reproduction", cases=cases)}
