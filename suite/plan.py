"""The plan: which blocks of work a command asks for, which of them are stored already, which cells are refused."""

import dataclasses
import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from suite import parameters
from suite.case import Card, Case
from suite.effort import BRIEF, EFFORTS, FULL, Effort
from suite.errors import BadInput, one_line
from suite.estimator import Estimator, told
from suite.provenance import fingerprint
from suite.registry import Catalog, Registry, matches
from suite.store import Entry

TRUTH, BOUND, ESTIMATE, TIMING, REFUSAL = "truth", "bound", "estimate", "timing", "refusal"
ENGINE = "suite.work"


@dataclass(frozen=True)
class Profile:
    """How much to compute: runs of each cell, fewer on long cases down to `fewest`; runs in a block of work, and its seconds.

    as_published: on a case with an experiment, run that one instead, with its runs and its estimators.
    longest: patterns of estimators with the size of the longest case that they run on unless they are named; the first that
    matches counts.
    """

    name: str
    runs: int
    fewest: int
    block: int
    time_limit: float
    as_published: bool = False
    longest: tuple[tuple[str, int], ...] = ()
    effort: Effort = FULL

    def runs_of(self, case: Card) -> int:
        """Runs of each cell of a case: fewer in proportion to its size from STEPS on."""
        if self.as_published and case.experiment:
            return case.experiment.runs
        return max(self.fewest, min(self.runs, int(self.runs * STEPS / _size(case))))

    def estimators_of(self, case: Case, known: Registry[Estimator]) -> list[Estimator]:
        """Estimators to run on a case when none are named; those that refuse it are among them, to say why."""
        wanted = known.select(case.experiment.estimators if self.as_published and case.experiment else ())
        return [e for e in wanted if not self.left_out(e.name, case) or _refusal(e, case)]

    def left_out(self, estimator: str, case: Card) -> str:
        """Why the profile does not run an estimator on a case, in words; empty when it does."""
        longest = next((size for pattern, size in self.longest if matches(estimator, [pattern])), None)
        if longest is None or _size(case) <= longest:
            return ""
        return (
            f"left out of the profile {self.name} for the time it takes: {case.steps} steps, {len(case.state)} components of "
            f"the state; `filterbench run --profile whole` or naming the estimator runs it"
        )


STEPS, STATES = 50, 8


def _size(case: Card) -> float:
    """Steps of a case, more in proportion to a matrix of the state from STATES components on."""
    return case.steps * max(1.0, (len(case.state) / STATES) ** 2)


# Times of a step with three runs were measured: these are the sizes that take about a second or less, but for the last few,
# which run on every case.
QUICK = (
    ("progressive", 60),
    ("filterpy:*", 60),
    ("unscented", 60),
    ("isir", 60),
    *((name, 10_000) for name in ("kalman", "ekf", "ukf", "ckf", "bootstrap", "imm-ekf")),
    ("*", 200),
)
PROFILES = {
    p.name: p
    for p in (
        Profile("quick", 12, fewest=3, block=12, time_limit=600.0, longest=QUICK, effort=BRIEF),
        Profile("whole", 12, fewest=3, block=12, time_limit=3600.0, effort=BRIEF),
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
    effort: Effort = FULL,
) -> Plan:
    """Plan runs[case] runs of each case's estimators in blocks of `size`, leaving out what the store's entries hold.

    What is made with an effort is held, too, when it is stored as made with a greater one.
    """
    held = _Held(entries, retry_failed)
    blocks: list[WorkBlock] = []
    refused = 0
    for case, estimators in cases.items():
        truth = version(TRUTH, catalog, case, None, seed)
        blocks += _missing(TRUTH, case, None, seed, truth, truth, runs[case], size, held)
        blocks += _once(BOUND, catalog, case, None, seed, truth, held, effort)
        for estimator in estimators:
            reason = _refusal(estimator, case)
            kind = REFUSAL if reason else ESTIMATE
            refused += bool(reason)
            cell = version(kind, catalog, case, estimator, seed)
            wanted = 1 if reason else runs[case]
            blocks += _missing(kind, case, estimator, seed, cell, truth, wanted, size, held, reason or "")
            if not reason:
                blocks += _once(TIMING, catalog, case, estimator, seed, truth, held, effort)
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


def _once(
    kind: str, catalog: Catalog, case: Case, estimator: Estimator | None, seed: int, truth: str, held: _Held, effort: Effort
) -> list[WorkBlock]:  # fmt: skip
    """The block of what is made once with some effort; none when it is stored as made with this or a greater one."""
    enough = [version(kind, catalog, case, estimator, seed, e) for e in EFFORTS[EFFORTS.index(effort) :]]
    if any(held.covered(each, 1) for each in enough[1:]):
        return []
    return _missing(kind, case, estimator, seed, enough[0], truth, 1, 1, held)


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


def version(
    kind: str, catalog: Catalog, case: Case, estimator: Estimator | None, seed: int, effort: Effort = FULL
) -> str:  # fmt: skip
    """What identifies the blocks of a cell: a hash of sources, data files, parameters and seed, but not of runs.

    The effort enters where it matters.
    """
    engine = "suite.case_bounds" if kind == BOUND else "suite.case"
    parts: list[Any] = [kind, case.name, fingerprint(catalog.modules[case.name], engine, data=case.data), seed]
    if kind in (BOUND, TIMING):
        parts.append(dataclasses.astuple(effort))
    if estimator is not None:
        sources = fingerprint(type(estimator).__module__, ENGINE)
        parts += [estimator.name, {k: str(v) for k, v in parameters.values(estimator).items()}, sources]
    return _digest(parts)


def _digest(parts: Sequence[Any]) -> str:
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:24]
