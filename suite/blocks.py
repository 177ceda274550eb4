"""Blocks of the store as what they hold: estimates, bounds, timed calls."""

from typing import Any

import numpy as np

from suite.case import Card
from suite.case_bounds import BlockBound
from suite.estimator import TRACES, VECTORS, Estimate
from suite.linalg import Array
from suite.metrics.cost import Calls
from suite.store import Entry, read


def steps(rows: Array, runs: int) -> Array:
    """Array [T, d, R] from rows [R · T, d], run after run."""
    return np.moveaxis(rows.reshape(runs, -1, rows.shape[1]), 0, -1)


def read_estimate(entry: Entry, card: Card) -> Estimate:
    """The estimate of a block. Raises StoreError when its file is damaged; so do the others."""
    names = ["mean", "cov", *TRACES, *VECTORS, "seconds", "batch", "status", "reason"]
    columns = read(entry.path, names)
    runs, n = entry.meta["count"], len(card.state)
    lower = steps(columns["cov"], runs)
    cov = np.empty((len(lower), n, n, runs))
    rows, cols = np.tril_indices(n)
    cov[:, rows, cols] = lower
    cov[:, cols, rows] = lower
    parts: dict[str, Any] = {name: list(columns[name][:: card.steps]) for name in ("batch", "status", "reason")}
    for name in (*TRACES, "seconds"):
        parts[name] = None if columns[name] is None else columns[name].reshape(runs, -1).T
    for name in VECTORS:
        parts[name] = None if columns[name] is None else steps(columns[name], runs)
    return Estimate(steps(columns["mean"], runs), cov, **parts)


def read_bounds(entry: Entry, card: Card) -> list[BlockBound]:
    """The bounds of a case."""
    columns = read(entry.path, ["cov", "bound", "bound_error"])
    said, n = entry.meta["bounds"], len(card.state)
    value, error, lower = (columns[name].reshape(len(said), card.steps, -1) for name in ("bound", "bound_error", "cov"))
    cov = np.empty((len(said), card.steps, n, n))
    rows, cols = np.tril_indices(n)
    cov[:, :, rows, cols] = cov[:, :, cols, rows] = lower
    return [BlockBound(s["kind"], s["reason"], *parts) for s, *parts in zip(said, value, error, cov, strict=True)]


def read_timing(entry: Entry) -> Calls:
    """Timed calls, as an estimate that holds no states."""
    columns = read(entry.path, ["run", "seconds", "batch", "memory", "logliks", "status", "reason"])
    calls = int(columns["run"].max()) + 1
    steps = len(columns["run"]) // calls
    nothing = np.full((steps, 1, calls), np.nan)
    more = {name: columns[name] if columns[name] is None else columns[name][::steps] for name in ("memory", "logliks")}
    return Calls(
        nothing,
        nothing[:, None],
        seconds=columns["seconds"].reshape(calls, steps).T,
        batch=list(columns["batch"][::steps]),
        status=columns["status"][::steps],
        reason=columns["reason"][::steps],
        **more,
    )
