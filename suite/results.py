"""Results: what a store holds, as cases and cells, ready for metrics."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from suite.blocks import read_bounds, read_estimate, read_timing, steps
from suite.case import Card, Truth
from suite.case_bounds import BlockBound
from suite.errors import BadInput
from suite.estimator import TRACES, VECTORS, Estimate, alike, join
from suite.metrics import Evidence, Metric, Score
from suite.metrics.evidence import rounding_of
from suite.metrics.metric import Contributions
from suite.plan import BOUND, ESTIMATE, REFUSAL, TIMING, TRUTH
from suite.store import Damage, Entry, Store, read

_NO_TRUTH = Truth(np.empty((0, 0, 0)), np.empty((0, 0, 0)))
"""What a metric of running times is given for a truth: it does not look at it."""


@dataclass(eq=False)
class Cell:
    """One estimator on one case: its stored blocks, read when a metric needs them."""

    case: "CaseResults"
    label: str
    meta: dict[str, Any]
    estimates: list[Entry] = field(default_factory=list)
    timings: list[Entry] = field(default_factory=list)
    refusal: str = ""

    @functools.cached_property
    def runs(self) -> list[int]:
        """Numbers of the runs held whose truth is held as well, ascending."""
        held = {r for e in self.estimates for r in _runs(e)}
        return sorted(held & self.case.truth_of.keys())

    @functools.cached_property
    def estimate(self) -> Estimate:
        """The estimates of all runs, in the order of `runs`."""
        blocks = [read_estimate(e, self.case.card) for e in self.estimates]
        return _pick(blocks, [list(_runs(e)) for e in self.estimates], self.runs)

    @functools.cached_property
    def truth(self) -> Truth:
        """The truth of the same runs."""
        picked = [self.case.truth_of[r] for r in self.runs]
        x, y = (np.stack([getattr(truth, name) for truth in picked], axis=-1) for name in ("x", "y"))
        modes = [truth.mode for truth in picked if truth.mode is not None]
        return Truth(x, y, np.stack(modes, axis=-1) if modes else None)

    @functools.cached_property
    def timing(self) -> Estimate | None:
        """The timed calls, as an estimate that holds no states; None when there are none."""
        return read_timing(self.timings[-1]) if self.timings else None

    @property
    def failures(self) -> list[tuple[str, str, list[str]]]:
        """What went wrong: (kind of block, reason, tracebacks)."""
        found = []
        for entry in [*self.estimates, *self.timings]:
            found += [
                (entry.meta["kind"], reason, entry.meta.get("tracebacks", [])) for reason in entry.meta.get("reasons", [])
            ]
        return found

    @functools.cached_property
    def counts(self) -> dict[str, int]:
        """How many runs there are of each status."""
        return {s: self.estimate.status.count(s) for s in ("ok", "lost", "failed")} if self.runs else {}

    @functools.cached_property
    def evidence(self) -> Evidence | None:
        """What metrics of accuracy look at; None without runs."""
        if not self.runs:
            return None
        twin = self.case.calm.cells.get(self.label) if self.case.calm else None
        calm = twin.estimate if twin and twin.runs else None
        return Evidence(self.case.card, self.truth, self.estimate, self.case.bounds, calm, self.particles)

    @property
    def particles(self) -> int | None:
        """How many particles the estimator carries; None where its parameters do not say."""
        found = self.meta.get("parameters", {}).get("particles")
        return found if isinstance(found, int) else None

    def contributions(self, metric: Metric) -> Contributions:
        """Contributions of the runs, by block, computed once; empty when there is nothing to look at."""
        if metric.name not in self._contributions:
            looked_at = self.evidence
            if metric.timed:
                looked_at = Evidence(self.case.card, _NO_TRUTH, self.timing, particles=self.particles) if self.timing else None
            self._contributions[metric.name] = metric.contributions(looked_at) if looked_at else {}
        return self._contributions[metric.name]

    def scores(self, metric: Metric) -> dict[str, Score]:
        """The metric's scores by block, computed once; empty when there is nothing to look at."""
        if metric.name not in self._scores:
            self._scores[metric.name] = {
                block: metric.score(values, metric.unit_of(self.case.card, block), len(self.runs))
                for block, values in self.contributions(metric).items()
            }
        return self._scores[metric.name]

    @functools.cached_property
    def _contributions(self) -> dict[str, Contributions]:
        return {}

    @functools.cached_property
    def _scores(self) -> dict[str, dict[str, Score]]:
        return {}


@dataclass(eq=False)
class CaseResults:
    """All that a store holds of a case, for one version of its truth."""

    card: Card
    seed: int
    truths: list[Entry]
    cells: dict[str, Cell] = field(default_factory=dict)
    bound: Entry | None = None
    calm: "CaseResults | None" = None
    """The twin of the case in which no manoeuvre happens."""

    @property
    def held(self) -> list[tuple[str, str]]:
        """What stands for all that is held, the twin included: address and time of each block, and refusals by label."""
        found = []
        for case in (self, self.calm) if self.calm else (self,):
            cells = [entry for cell in case.cells.values() for entry in (*cell.estimates, *cell.timings)]
            entries = [*case.truths, *filter(None, [case.bound]), *cells]
            found += [(entry.meta["address"], entry.meta["created"]) for entry in entries]
            found += [(label, cell.refusal) for label, cell in case.cells.items() if cell.refusal]
        return found

    @functools.cached_property
    def bounds(self) -> list[BlockBound]:
        """The bounds on the error of each state block, of every kind there is."""
        return read_bounds(self.bound, self.card) if self.bound else []

    @functools.cached_property
    def truth_of(self) -> dict[int, Truth]:
        """States x[T, n], measurements y[T, m] and modes [T] of each run."""
        found: dict[int, Truth] = {}
        for entry in self.truths:
            columns = read(entry.path, ["truth", "y", "true_mode"])
            runs = list(_runs(entry))
            x, y = (steps(columns[name], len(runs)) for name in ("truth", "y"))
            mode = None if columns["true_mode"] is None else columns["true_mode"].reshape(len(runs), -1)
            found |= {run: Truth(x[:, :, i], y[:, :, i], None if mode is None else mode[i]) for i, run in enumerate(runs)}
        return found

    @functools.cached_property
    def rounding(self) -> dict[str, float]:
        """By state block, the size of an error up to which it is rounding."""
        if not self.truth_of:
            return {}
        size = rounding_of(np.stack([truth.x for truth in self.truth_of.values()], axis=-1))
        return {block.name: float(np.linalg.norm(size[list(block.components)])) for block in self.card.blocks}


@dataclass(eq=False)
class Results:
    """What a results folder holds: the newest version of every case and cell.

    superseded counts blocks of older versions (changed sources, parameters or seeds), damages names files that are
    not blocks.
    """

    folder: Path
    cases: dict[str, CaseResults]
    entries: list[Entry]
    superseded: int
    damages: list[Damage]
    order: tuple[str, ...] = ()

    @property
    def labels(self) -> list[str]:
        """Labels of all estimators in the order asked for; others behind, as they first appear in any case."""
        return _ordered(list(dict.fromkeys(label for case in self.cases.values() for label in case.cells)), self.order)


def load(
    folder: str | Path, case_order: Sequence[str] = (), estimator_order: Sequence[str] = (), seed: int | None = None
) -> Results:
    """Read what a results folder holds. Raises StoreError when it is none.

    Of several versions of a case the newest counts, and of each estimator the newest that ran on that truth; with a seed
    given, only what was run with it.
    """
    entries, damages = Store(folder).scan()
    entries = sorted((e for e in entries if seed in (None, e.meta["seed"])), key=lambda e: e.meta["created"])
    told = {e.meta["version"] for e in entries if e.meta["kind"] == TRUTH}
    # What ran last counts. Versions whose truth is stored come first: a case may hold nothing but refusals, or have failed
    # before its truth was stored.
    by_truth = sorted(entries, key=lambda e: e.meta["truth_version"] in told)
    newest = {e.meta["case"]["name"]: e.meta["truth_version"] for e in by_truth}
    current = [e for e in entries if e.meta["truth_version"] == newest[e.meta["case"]["name"]]]
    cases: dict[str, CaseResults] = {}
    for name in _ordered(list(newest), case_order):
        mine = [e for e in current if e.meta["case"]["name"] == name]
        truth = [e for e in mine if e.meta["kind"] == TRUTH]
        case = CaseResults(Card.from_dict(mine[-1].meta["case"]), mine[-1].meta["seed"], truth)
        case.bound = next((e for e in reversed(mine) if e.meta["kind"] == BOUND), None)
        _fill(case, mine, estimator_order)
        cases[name] = case
    for case in cases.values():
        case.calm = cases.get(case.card.calm) if case.card.calm else None
    used = sum(len(c.truths) + (c.bound is not None) + sum(_size(cell) for cell in c.cells.values()) for c in cases.values())
    return Results(Path(folder), cases, entries, len(entries) - used, damages, tuple(estimator_order))


def _fill(case: CaseResults, entries: list[Entry], order: Sequence[str]) -> None:
    by_label: dict[str, list[Entry]] = {}
    for entry in entries:
        if entry.meta["estimator"]:
            by_label.setdefault(entry.meta["estimator"]["label"], []).append(entry)
    for label in _ordered(list(by_label), order):
        held = by_label[label]
        last = (
            next(e for e in reversed(held) if e.meta["kind"] != TIMING)
            if any(e.meta["kind"] != TIMING for e in held)
            else held[-1]
        )
        cell = Cell(case, label, dict(last.meta["estimator"]))
        if last.meta["kind"] == REFUSAL:
            cell.refusal = last.meta["reasons"][0]
        else:
            cell.estimates = [e for e in held if e.meta["kind"] == ESTIMATE and e.meta["version"] == last.meta["version"]]
            timed = [e for e in held if e.meta["kind"] == TIMING]
            cell.timings = timed[-1:]
        case.cells[label] = cell


def _size(cell: Cell) -> int:
    return 1 if cell.refusal else len(cell.estimates) + len(cell.timings)


def _ordered(names: list[str], order: Sequence[str]) -> list[str]:
    """Names by the place of their stem in `order`; those not in it last, as they came."""
    place = {name: i for i, name in enumerate(order)}
    return sorted(names, key=lambda n: place.get(n.partition("[")[0], len(place)))


def _runs(entry: Entry) -> range:
    return range(entry.meta["first"], entry.meta["first"] + entry.meta["count"])


def _pick(blocks: list[Estimate], runs: list[list[int]], wanted: list[int]) -> Estimate:
    """The estimates of the wanted runs, in that order, from blocks that may overlap (their numbers are the same)."""
    if not blocks:
        raise BadInput("no run of this cell is stored")
    whole = join(alike(blocks))  # a failed block lacks what its neighbours have
    place = {run: i for i, run in enumerate([r for block in runs for r in block])}
    index = [place[r] for r in wanted]
    parts: dict[str, Any] = {}
    for name in ("mean", "cov", *TRACES, *VECTORS, "seconds"):
        value = getattr(whole, name)
        parts[name] = None if value is None else value[..., index]
    for name in ("status", "reason", "batch"):
        parts[name] = [getattr(whole, name)[i] for i in index]
    return Estimate(**parts)
