"""Running a plan: blocks spread over worker processes, failures recorded, the rest going on."""

import contextlib
import multiprocessing
import signal
import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import dataclass, field
from multiprocessing import resource_tracker

from pebble import ProcessExpired, ProcessPool

from suite.errors import BadInput, one_line
from suite.plan import REFUSAL, TIMING, Plan, WorkBlock
from suite.record import Report
from suite.work import FAULTS
from suite.worker import Context, perform, recorder, start


@dataclass
class Outcome:
    """What a command did: the reports of all blocks, as they were finished."""

    reports: list[Report] = field(default_factory=list)


def execute(
    plan: Plan, context: Context, jobs: int, time_limit: float, progress: Callable[[Report], None] = lambda report: None
) -> Outcome:
    """Compute a plan's blocks in `jobs` worker processes of one thread each; a block may take `time_limit` seconds.

    A block whose worker raises, hangs or dies is stored as failed with its reason. Raises StoreError when results
    cannot be written; what was finished before is kept.
    """
    outcome = Outcome()

    def account(report: Report) -> None:
        outcome.reports.append(report)
        progress(report)

    for block in plan.blocks:
        if block.kind == REFUSAL:
            account(recorder(context).refusal(block))
    together = [b for b in plan.blocks if b.kind not in (REFUSAL, TIMING)]
    alone = [b for b in plan.blocks if b.kind == TIMING]
    for blocks, workers in ((together, jobs), (alone, 1)):
        for report in _spread(blocks, context, workers, time_limit):
            account(report)
    return outcome


def _spread(blocks: Iterable[WorkBlock], context: Context, workers: int, time_limit: float) -> Iterator[Report]:
    """Reports of blocks computed by a pool of processes, as they come in."""
    blocks = list(blocks)
    if not blocks:
        return
    pool = ProcessPool(
        max_workers=min(workers, len(blocks)),
        initializer=start,
        initargs=(context,),
        context=multiprocessing.get_context("spawn"),
    )
    try:
        with _deaf_to_interrupts():
            waiting: dict[Future[Report], WorkBlock] = {
                pool.schedule(perform, args=(context, block), timeout=time_limit): block for block in blocks
            }
        while waiting:
            done, _ = wait(waiting, return_when=FIRST_COMPLETED)
            for future in done:
                yield _report(future, waiting.pop(future), context, time_limit)
    except BaseException:
        pool.stop()  # type: ignore[no-untyped-call]
        raise
    finally:
        pool.close()  # type: ignore[no-untyped-call]
        pool.join()


@contextlib.contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """Threads and processes started inside inherit a mask: Ctrl-C reaches the main thread alone, which stops them.

    Windows has no such masks; there the workers' own complaints about Ctrl-C may be seen.
    """
    if sys.platform == "win32":
        yield
        return
    resource_tracker.ensure_running()  # when it starts, it lifts the mask
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def _report(future: "Future[Report]", block: WorkBlock, context: Context, time_limit: float) -> Report:
    try:
        return future.result()
    except (BadInput, CancelledError):
        raise
    except TimeoutError:
        reason = f"ran past the time limit of {time_limit:g} s for a block"
    except ProcessExpired as error:
        hint = "; perhaps it ran out of memory" if error.exitcode == -signal.SIGKILL else ""
        reason = f"the worker process died (exit code {error.exitcode}){hint}"
    except FAULTS as error:
        reason = one_line(error)
    return recorder(context).failure(block, reason)
