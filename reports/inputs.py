"""What a site is made from, and what its pages about several cases know of them."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from reports.frame import Frame
from reports.views import CaseView
from suite.benchmarks import Row
from suite.published import Finding, Key
from suite.results import Results


@dataclass(frozen=True)
class Inputs:
    """Results, what was found of published figures before, the command that asked for the site, rows of benchmarks, and
    results to hold these against."""

    loaded: Results
    command: str
    findings: Mapping[Key, Finding]
    benchmarks: Sequence[Row] = ()
    against: Results | None = None


@dataclass(frozen=True)
class Site:
    """The frame of all pages, the inputs, the cases in their order, and a hash that stands for all that is known of them."""

    frame: Frame
    inputs: Inputs
    cases: Sequence[CaseView]
    digest: str

    def depends(self, *more: Any) -> list[Any]:
        """What a page about all cases follows from, and more."""
        return [self.digest, self.frame.labels, list(self.frame.cases), *more]


def digest_of(texts: Sequence[str]) -> str:
    """A hash that stands for texts."""
    return hashlib.sha256(json.dumps(list(texts)).encode()).hexdigest()
