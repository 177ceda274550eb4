"""One block of work: some runs of one estimator on one case. It never raises for an estimator's faults."""

import functools
import time
import traceback
from dataclasses import dataclass
from typing import Any

import numpy as np

from suite import parameters
from suite.case import Case, Truth
from suite.errors import one_line
from suite.estimator import FAILED, LOST, OK, TRACES, Estimate, Estimator, StepError, alike, join, told, unavailable
from suite.linalg import Array
from suite.random import Streams

FAULTS = (Exception, SystemExit, GeneratorExit)
"""What an estimator may raise and be charged with: all but an interrupt, which is the user's."""
TIMED_STEPS, TIMED_RUNS, REPEATS = 50, 20, 5
TIMED_SECONDS = 0.1
"""About how long a timed call may take: slow estimators are timed over fewer steps."""


@dataclass(frozen=True)
class Done:
    """An estimate together with the distinct tracebacks of what went wrong in it."""

    estimate: Estimate
    tracebacks: tuple[str, ...] = ()


@functools.lru_cache(maxsize=2)
def simulated(case: Case, seed: int, first: int, count: int) -> Truth:
    """The truth of some runs; the estimators of a case come one after the other and share it."""
    return case.simulate(count, seed, first)


def compute(case: Case, estimator: Estimator, seed: int, first: int, count: int) -> Done:
    """Run an estimator on the runs first..first+count-1 of a case; what fails is marked with its reason."""
    try:
        truth = simulated(case, seed, first, count)
    except Exception as error:
        return Done(_failed(case, count, f"the case does not simulate: {one_line(error)}"), (traceback.format_exc(),))
    streams = Streams((seed, case.name, parameters.label(estimator), "filter"), first)
    return _attempt(case, estimator, truth.y, streams)


def _attempt(case: Case, estimator: Estimator, y: Array, streams: Streams) -> Done:
    """Run a batch; when it raises, each of its runs alone, so that a fault is charged to the runs that have it."""
    runs = y.shape[2]
    try:
        begin = time.perf_counter()
        estimate = estimator.run(told(estimator, case.model), y.copy(), streams)
        return Done(examined(estimate, case, runs, time.perf_counter() - begin))
    except FAULTS as error:
        if runs == 1:
            return Done(_failed(case, 1, _reason(error)), (traceback.format_exc(),))
    alone = [_attempt(case, estimator, y[:, :, r : r + 1], Streams(streams.key, streams.first + r)) for r in range(runs)]
    tracebacks = dict.fromkeys(text for done in alone for text in done.tracebacks)
    return Done(join(alike([done.estimate for done in alone])), tuple(tracebacks)[:5])


def _reason(error: BaseException) -> str:
    """The reason in the words of the estimator's error; a step's failure already names its cause."""
    return str(error) if isinstance(error, StepError) else one_line(error)


def _failed(case: Case, runs: int, reason: str) -> Estimate:
    estimate = unavailable(case.steps, case.model.n, runs, FAILED, reason)
    estimate.seconds = np.full((case.steps, runs), np.nan)
    return estimate


def examined(estimate: object, case: Case, runs: int, elapsed: float) -> Estimate:
    """The estimate, if its parts have the shapes they must have; runs that are not finite are marked as failed.

    Raises TypeError or ValueError that names the part otherwise.
    """
    if not isinstance(estimate, Estimate):
        raise TypeError(f"run returned {type(estimate).__name__}, not an Estimate")
    steps, n, m = case.steps, case.model.n, case.model.m
    shapes = {
        "mean": (steps, n, runs),
        "cov": (steps, n, n, runs),
        **dict.fromkeys(TRACES, (steps, runs)),
        "innovation": (steps, m, runs),
        "mode": (steps, max(1, len(case.modes)), runs),
        "seconds": (steps, runs),
        "status": (runs,),
        "reason": (runs,),
        "batch": (runs,),
    }
    if estimate.seconds is None:
        estimate.seconds = np.full((steps, runs), elapsed / (steps * runs))
    for name, shape in shapes.items():
        part = getattr(estimate, name)
        if part is not None and np.shape(part) != shape:
            raise ValueError(f"{name} has shape {np.shape(part)}, expected {shape}")
        if np.iscomplexobj(part):
            raise TypeError(f"{name} is complex, expected real numbers")
        if part is not None and len(shape) > 1:
            setattr(estimate, name, np.asarray(part, float))
    unknown = set(estimate.status) - {OK, LOST, FAILED}
    if unknown:
        raise ValueError(f"status must be one of {OK}, {LOST}, {FAILED}, got {sorted(map(str, unknown))}")
    estimate.reason = [str(reason) for reason in estimate.reason]
    mean, cov = estimate.mean, estimate.cov
    with np.errstate(all="ignore"):  # of numbers that are not finite
        skew = np.abs(cov - np.swapaxes(cov, 1, 2)).max((1, 2))
    faults: dict[str, Any] = {
        "mean is not finite": ~np.isfinite(mean).all(1),
        "cov is not finite": ~np.isfinite(cov).all((1, 2)),
        "cov is not symmetric": skew > 1e-6 * np.abs(cov).max((1, 2)),
    }
    for what, faulty in faults.items():
        for r in np.flatnonzero(estimate.ok & faulty.any(0)):
            step = int(np.argmax(faulty[:, r])) + 1
            estimate.status[r] = FAILED  # type: ignore[index]
            estimate.reason[r] = f"step {step}: {what}"
    return estimate


@dataclass(frozen=True)
class Timing:
    """Seconds per run-step [K, B] of B timed calls, and how many runs each call carried."""

    seconds: Array
    batch: tuple[int, ...]
    status: str = "ok"
    reason: str = ""


def measure_time(case: Case, estimator: Estimator, seed: int) -> Timing:
    """Time an estimator on the first steps of a case: single runs for latency, batches for throughput.

    Each call is warm: two short ones go before. Run it alone on the machine, in one thread.
    """
    try:
        y = simulated(case, seed, 0, TIMED_RUNS).y[:TIMED_STEPS]
        first = [_timed_call(case, estimator, y[:3, :, :1], seed) for _ in range(2)][1]
        y = y[: max(3, int(TIMED_SECONDS / (TIMED_RUNS * np.median(first) + 1e-9)))]
        columns = [_timed_call(case, estimator, y[:, :, r : r + 1], seed + r) for r in range(REPEATS)]
        columns += [_timed_call(case, estimator, y, seed + r) for r in range(REPEATS)]
    except FAULTS as error:
        return Timing(np.full((1, 1), np.nan), (1,), FAILED, _reason(error))
    return Timing(np.stack(columns, axis=1), (1,) * REPEATS + (TIMED_RUNS,) * REPEATS)


def _timed_call(case: Case, estimator: Estimator, y: Array, seed: int) -> Array:
    begin = time.perf_counter()
    estimate = estimator.run(told(estimator, case.model), y.copy(), seed)
    elapsed = time.perf_counter() - begin
    if estimate.seconds is None:
        return np.full(len(y), elapsed / (len(y) * y.shape[2]))
    return np.asarray(np.mean(estimate.seconds, axis=-1))
