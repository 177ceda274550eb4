"""The plan: which blocks of work a command asks for, which of them are stored already, which cells are refused."""

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from suite import parameters
from suite.case import Case
from suite.errors import BadInput, one_line
from suite.estimator import Estimator, told
from suite.provenance import fingerprint
from suite.registry import Catalog, Registry
from suite.store import Entry

TRUTH, BOUND, ESTIMATE, TIMING, REFUSAL = "truth", "bound", "estimate", "timing", "refusal"
ENGINE = "suite.work"


@dataclass(frozen=True)
class Profile:
    """How much to compute: runs of each cell, fewer on long cases down to `fewest`; runs in a block of work, and its seconds.

    as_published: on a case with an experiment, run that one instead, with its runs and its estimators.
    """

    name: str
    runs: int
    fewest: int
    block: int
    time_limit: float
    as_published: bool = False

    def runs_of(self, case: Case) -> int:
        """Runs of each cell of a case: fewer in proportion from STEPS steps on, and from STATES components of the state on."""
        if self.as_published and case.experiment:
            return case.experiment.runs
        size = case.steps * max(1.0, case.model.n / STATES)
        return max(self.fewest, min(self.runs, int(self.runs * STEPS / size)))

    def estimators_of(self, case: Case, known: Registry[Estimator]) -> list[Estimator]:
        """Estimators to run on a case when none are named."""
        return known.select(case.experiment.estimators if self.as_published and case.experiment else ())


STEPS, STATES = 50, 10
PROFILES = {
    p.name: p
    for p in (
        Profile("quick", 12, fewest=3, block=6, time_limit=600.0),
        Profile("paper", 100, fewest=100, block=5, time_limit=3600.0, as_published=True),
    )
}


@dataclass(frozen=True)
class WorkBlock:
    """Runs first..first+count-1 of one estimator on one case (no estimator: the truth, or its bound), with its identity."""

    kind: str
    case: str
    estimator: str | None
    seed: int
    first: int
    count: int
    version: str
    """What all blocks of this cell share: sources, parameters and seed; the range of runs is not in it."""
    truth_version: str
    reason: str = ""

    @property
    def address(self) -> str:
        """Name of the block's file: a hash of everything that determines its contents."""
        return _digest([self.version, self.first, self.count])


@dataclass(frozen=True)
class Plan:
    """Blocks to compute, in order, and how many of those asked for are stored already."""

    blocks: tuple[WorkBlock, ...]
    stored: int
    stored_failures: int
    cells: int
    refused: int


def make(
    catalog: Catalog,
    cases: Mapping[Case, Sequence[Estimator]],
    runs: Mapping[Case, int],
    seed: int,
    size: int,
    entries: Iterable[Entry],
    retry_failed: bool = False,
) -> Plan:
    """Plan runs[case] runs of each case's estimators in blocks of `size`, leaving out what the store's entries hold."""
    held = _Held(entries, retry_failed)
    blocks: list[WorkBlock] = []
    refused = 0
    for case, estimators in cases.items():
        truth = version(TRUTH, catalog, case, None, seed)
        blocks += _missing(TRUTH, case, None, seed, truth, truth, runs[case], size, held)
        blocks += _missing(BOUND, case, None, seed, version(BOUND, catalog, case, None, seed), truth, 1, 1, held)
        for estimator in estimators:
            reason = _refusal(estimator, case)
            kind = REFUSAL if reason else ESTIMATE
            refused += bool(reason)
            cell = version(kind, catalog, case, estimator, seed)
            wanted = 1 if reason else runs[case]
            blocks += _missing(kind, case, estimator, seed, cell, truth, wanted, size, held, reason or "")
            if not reason:
                timing = version(TIMING, catalog, case, estimator, seed)
                blocks += _missing(TIMING, case, estimator, seed, timing, truth, 1, 1, held)
    # Truth first, since all else refers to it; timing last, when nothing else runs beside it.
    order = {TRUTH: 0, REFUSAL: 0, BOUND: 1, ESTIMATE: 1, TIMING: 2}
    blocks.sort(key=lambda b: order[b.kind])
    return Plan(tuple(blocks), held.used, held.failures, sum(map(len, cases.values())), refused)


def _refusal(estimator: Estimator, case: Case) -> str | None:
    """Why the estimator cannot run on the case, if so. Raises BadInput when its `accepts` does not say."""
    try:
        reason = estimator.accepts(told(estimator, case.model))
    except Exception as error:
        raise BadInput(f"{estimator.name}: accepts raised for the model of {case.name}: {one_line(error)}") from error
    if not isinstance(reason, str | None):
        raise BadInput(f"{estimator.name}: accepts must return None or the reason as text, got {reason!r}")
    return reason


class _Held:
    """Which runs of which version are stored."""

    def __init__(self, entries: Iterable[Entry], retry_failed: bool):
        self.retry_failed = retry_failed
        self.runs: dict[str, dict[int, Entry]] = {}
        self.used = 0
        self.failures = 0
        for entry in sorted(entries, key=lambda e: e.meta["created"]):  # of blocks that overlap the newest counts
            meta = entry.meta
            for run in range(meta["first"], meta["first"] + meta["count"]):
                self.runs.setdefault(meta["version"], {})[run] = entry

    def covered(self, version: str, runs: int) -> set[int]:
        found = {r: e for r, e in self.runs.get(version, {}).items() if r < runs}
        failed = {e.path for e in found.values() if e.meta.get("failed")}
        kept = {r: e for r, e in found.items() if not (self.retry_failed and e.path in failed)}
        self.used += len({e.path for e in kept.values()})
        self.failures += len({e.path for e in kept.values()} & failed)
        return set(kept)


def _missing(
    kind: str, case: Case, estimator: Estimator | None, seed: int, cell: str, truth: str, runs: int, size: int,
    held: _Held, reason: str = "",
) -> list[WorkBlock]:  # fmt: skip
    """Blocks for the runs not covered yet: consecutive ones together, `size` at most."""
    label = parameters.label(estimator) if estimator else None
    covered = held.covered(cell, runs)
    blocks, start = [], 0
    while start < runs:
        if start in covered:
            start += 1
            continue
        stop = start
        while stop < min(runs, (start // size + 1) * size) and stop not in covered:
            stop += 1
        blocks.append(WorkBlock(kind, case.name, label, seed, start, stop - start, cell, truth, reason))
        start = stop
    return blocks


def version(kind: str, catalog: Catalog, case: Case, estimator: Estimator | None, seed: int) -> str:
    """What identifies the blocks of a cell: a hash of sources, data files, parameters and seed, but not of runs."""
    engine = "suite.case_bounds" if kind == BOUND else "suite.case"
    parts: list[Any] = [kind, case.name, fingerprint(catalog.modules[case.name], engine, data=case.data), seed]
    if estimator is not None:
        sources = fingerprint(type(estimator).__module__, ENGINE)
        parts += [estimator.name, {k: str(v) for k, v in parameters.values(estimator).items()}, sources]
    return _digest(parts)


def _digest(parts: Sequence[Any]) -> str:
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:24]
