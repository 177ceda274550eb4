"""What is stored of a block: its columns, and what its file says of where it came from."""

import datetime
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from suite import parameters, provenance
from suite.case import Truth
from suite.case_bounds import BlockBound
from suite.errors import BadInput
from suite.estimator import FAILED, OK, TRACES, VECTORS, told, unavailable
from suite.linalg import Array
from suite.plan import BOUND, TIMING, TRUTH, WorkBlock
from suite.registry import Catalog
from suite.store import Store, constant, texts, vectors
from suite.work import Done, Timing


@dataclass(frozen=True)
class Report:
    """What became of a block: how many of its runs failed or were lost, and the first reason."""

    block: WorkBlock
    failed: int = 0
    reason: str = ""


@dataclass(frozen=True)
class Recorder:
    """Writes blocks to a results folder, with the command that asked for them. Raises StoreError when it cannot."""

    results: str
    command: str
    catalog: Catalog

    def truth(self, block: WorkBlock, truth: Truth) -> Report:
        """Store simulated states and measurements."""
        columns = {"truth": _rows(truth.x), "y": _rows(truth.y)}
        if truth.mode is not None:
            columns["true_mode"] = np.ascontiguousarray(truth.mode.T, np.int32).ravel()
        self._write_runs(block, columns, len(truth.x), {})
        return Report(block)

    def bounds(self, block: WorkBlock, bounds: Sequence[BlockBound]) -> Report:
        """Store the bounds of a case; their number stands in the column `run`."""
        steps, n, _ = bounds[0].cov.shape
        rows, cols = np.tril_indices(n)
        columns = {
            "run": np.repeat(np.arange(len(bounds), dtype=np.int32), steps),
            "step": np.tile(np.arange(1, steps + 1, dtype=np.int32), len(bounds)),
            "cov": vectors(np.concat([each.cov[:, rows, cols] for each in bounds])),
            "bound": vectors(np.concat([each.value for each in bounds])),
            "bound_error": vectors(np.concat([each.error for each in bounds])),
        }
        said = [{"kind": each.kind, "reason": each.reason} for each in bounds]
        self._write(block, columns, steps * len(bounds), {"bounds": said})
        return Report(block)

    def estimate(self, block: WorkBlock, done: Done) -> Report:
        """Store estimates, with the status of each run."""
        estimate = done.estimate
        steps = len(estimate.mean)
        rows, cols = np.tril_indices(estimate.cov.shape[1])
        columns: dict[str, Any] = {
            "mean": _rows(estimate.mean),
            "cov": _rows(estimate.cov[:, rows, cols]),
            "batch": np.repeat(np.asarray(estimate.batch, np.int32), steps),
            "status": texts(estimate.status, steps),
            "reason": texts(estimate.reason, steps),
        }
        for name in VECTORS:
            value = getattr(estimate, name)
            columns[name] = None if value is None else _rows(value)
        for name in (*TRACES, "seconds"):
            value = getattr(estimate, name)
            columns[name] = None if value is None else np.ascontiguousarray(value.T).ravel()
        bad = [reason for status, reason in zip(estimate.status, estimate.reason, strict=True) if status != OK]
        meta = {
            "failed": sum(status == FAILED for status in estimate.status),
            "reasons": sorted(set(bad))[:20],
            "tracebacks": list(done.tracebacks),
        }
        self._write_runs(block, columns, steps, meta)
        return Report(block, len(bad), bad[0] if bad else "")

    def timing(self, block: WorkBlock, timing: Timing) -> Report:
        """Store timed calls; their number stands in the column `run`."""
        steps, calls = timing.seconds.shape
        rows = steps * calls
        columns = {
            "run": np.repeat(np.arange(calls, dtype=np.int32), steps),
            "step": np.tile(np.arange(1, steps + 1, dtype=np.int32), calls),
            "seconds": np.ascontiguousarray(timing.seconds.T).ravel(),
            "batch": np.repeat(np.asarray(timing.batch, np.int32), steps),
            "memory": None if timing.memory is None else np.repeat(timing.memory, steps),
            "logliks": None if timing.logliks is None else vectors(np.repeat(timing.logliks, steps, axis=0)),
            "status": constant(timing.status, rows),
            "reason": constant(timing.reason, rows),
        }
        failed = int(timing.status != OK)
        self._write(block, columns, rows, {"failed": failed, "reasons": [timing.reason] if failed else []})
        return Report(block, failed, timing.reason)

    def refusal(self, block: WorkBlock) -> Report:
        """Store the reason why an estimator does not accept a case's model."""
        columns = {"status": constant("refused", 1), "reason": constant(block.reason, 1)}
        self._write(block, columns, 1, {"reasons": [block.reason]})
        return Report(block)

    def failure(self, block: WorkBlock, reason: str) -> Report:
        """Store a block whose worker did not come back, as failed."""
        if block.kind in (TRUTH, BOUND):
            return Report(block, block.count, reason)  # nothing to store; of a truth each estimator will say so itself
        if block.kind == TIMING:
            return self.timing(block, Timing(np.full((1, 1), np.nan), (1,), FAILED, reason))
        case = self.catalog.cases[block.case]
        return self.estimate(block, Done(unavailable(case.steps, case.model.n, block.count, FAILED, reason)))

    def _write_runs(self, block: WorkBlock, columns: Mapping[str, Any], steps: int, meta: Mapping[str, Any]) -> None:
        runs = np.arange(block.first, block.first + block.count, dtype=np.int32)
        keys = {"run": np.repeat(runs, steps), "step": np.tile(np.arange(1, steps + 1, dtype=np.int32), block.count)}
        self._write(block, {**keys, **columns}, steps * block.count, meta)

    def _write(self, block: WorkBlock, columns: Mapping[str, Any], rows: int, meta: Mapping[str, Any]) -> None:
        if block.seed > np.iinfo(np.int64).max:
            raise BadInput(f"seed {block.seed} does not fit into the store; give one below 2^63")
        identity = {
            "kind": block.kind,
            "case": self.catalog.cases[block.case].to_dict(),
            "estimator": self._describe(block),
            "seed": block.seed,
            "first": block.first,
            "count": block.count,
            "version": block.version,
            "truth_version": block.truth_version,
            "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="microseconds"),
            "command": self.command,
            "versions": provenance.versions(),
            "host": provenance.host(),
        }
        named = {
            "case": constant(block.case, rows),
            "kind": constant(block.kind, rows),
            "seed": np.full(rows, block.seed, np.int64),
            "version": constant(block.version, rows),
        }
        if block.estimator:
            named["estimator"] = constant(block.estimator, rows)
        Store(self.results).write(block.address, {**identity, **meta}, {**named, **columns}, rows)

    def _describe(self, block: WorkBlock) -> dict[str, Any] | None:
        if block.estimator is None:
            return None
        label, estimator, case = block.estimator, self.catalog.estimators[block.estimator], self.catalog.cases[block.case]
        return {
            "label": label,
            "name": estimator.name,
            "reference": estimator.reference,
            "summary": (type(estimator).__doc__ or "").strip().partition("\n")[0],
            "parameters": parameters.values(estimator),
            "told": "" if told(estimator, case.model) is case.model else case.nominal,
        }


def _rows(values: Array) -> Any:
    """Column of vectors, one row per run and step, from an array [T, d, R]."""
    return vectors(np.moveaxis(values, 2, 0).reshape(-1, values.shape[1]))
