"""What a worker process does: compute a block and store it."""

import contextlib
import functools
import multiprocessing
import os
import threading
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import wait

from threadpoolctl import threadpool_limits

from suite.case_bounds import bounds_of
from suite.effort import FULL, Effort
from suite.errors import BadInput
from suite.plan import BOUND, TIMING, TRUTH, WorkBlock, version
from suite.record import Recorder, Report
from suite.registry import Catalog
from suite.work import compute, measure_time, simulated

Load = Callable[[tuple[str, ...]], Catalog]


@dataclass(frozen=True)
class Context:
    """What every block of a command shares: where to store, how to load the registries, the command itself, the effort."""

    results: str
    load: Load
    plugins: tuple[str, ...]
    command: str
    effort: Effort = FULL


def start(context: Context) -> None:
    """Prepare a worker process: one BLAS thread, registries loaded, and an end when the parent process ends."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()
    with contextlib.suppress(BadInput):  # the first block raises it again, where the parent process can see it
        recorder(context)
    threadpool_limits(1)  # after the registries: they bring in the libraries to be limited


def perform(context: Context, block: WorkBlock) -> Report:
    """Compute a block and store it. Raises StoreError when it cannot be stored."""
    write = recorder(context)
    case = write.catalog.cases[block.case]
    if block.kind == TRUTH:
        return write.truth(block, simulated(case, block.seed, block.first, block.count))
    if block.kind == BOUND:
        return write.bounds(block, bounds_of(case, block.seed, context.effort))
    estimator = write.catalog.estimators[str(block.estimator)]
    if version(block.kind, write.catalog, case, estimator, block.seed, context.effort) != block.version:
        raise BadInput(f"the sources of {block.estimator} on {block.case} changed while it ran; repeat the command")
    if block.kind == TIMING:
        return write.timing(block, measure_time(case, estimator, block.seed, context.effort))
    return write.estimate(block, compute(case, estimator, block.seed, block.first, block.count))


@functools.lru_cache(maxsize=1)
def recorder(context: Context) -> Recorder:
    """The recorder of a command, its registries loaded once a process."""
    return Recorder(context.results, context.command, context.load(context.plugins))


def _end_with(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)
