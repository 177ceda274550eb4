"""The page of running times."""

from collections.abc import Iterator, Sequence

from reports.frame import Frame
from reports.inputs import Site
from reports.part import Part
from reports.views import CaseView


def parts(site: Site) -> Iterator[Part]:
    """The page of running times."""
    yield Part("timing", site.depends(), files, (site.frame, site.cases))


def files(frame: Frame, cases: Sequence[CaseView]) -> dict[str, str]:
    """The page's file."""
    return {"timing.html": frame.page("timing", cases=cases)}
