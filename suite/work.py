"""One block of work: some runs of one estimator on one case. It never raises for an estimator's faults."""

import functools
import math
import time
import traceback
import tracemalloc
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from suite import parameters
from suite.case import Case, Truth
from suite.effort import FULL, Effort
from suite.errors import one_line
from suite.estimator import FAILED, LOST, OK, TRACES, Estimate, Estimator, StepError, alike, join, told, unavailable
from suite.linalg import Array
from suite.random import Streams

FAULTS = (Exception, SystemExit, GeneratorExit)
"""What an estimator may raise and be charged with: all but an interrupt, which is the user's."""
SHORT = 3
"""Steps of a call that warms up; fewest of a timed one."""
TRACED = 2
"""Steps of a call whose memory is measured, at several times its usual pace."""
TAIL_STEPS = 368
"""Steps from which on the 99th percentile has an upper limit, see `suite.metrics.cost`."""


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
    """The estimate, if its parts have the shapes they must have; runs whose numbers cannot be are marked as failed.

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
    seconds = np.asarray(estimate.seconds)[:, estimate.ok]
    if not np.isfinite(seconds).all() or (seconds < 0).any():
        raise ValueError("seconds are negative or not finite")
    mean, cov = estimate.mean, estimate.cov
    with np.errstate(all="ignore"):  # of numbers that are not finite
        skew = np.abs(cov - np.swapaxes(cov, 1, 2)).max((1, 2))
        variance = np.einsum("taar->tar", cov)
        rounding = n * np.finfo(float).eps * np.abs(variance).max(1)
    faults: dict[str, Any] = {
        "mean is not finite": ~np.isfinite(mean).all(1),
        "cov is not finite": ~np.isfinite(cov).all((1, 2)),
        "cov is not symmetric": skew > 1e-6 * np.abs(cov).max((1, 2)),
        "cov has a negative variance": variance.min(1) < -rounding,
    }
    for what, faulty in faults.items():
        for r in np.flatnonzero(estimate.ok & faulty.any(0)):
            step = int(np.argmax(faulty[:, r])) + 1
            estimate.status[r] = FAILED  # type: ignore[index]
            estimate.reason[r] = f"step {step}: {what}"
    return estimate


@dataclass(frozen=True)
class Timing:
    """Seconds per run-step [K, B] of B timed calls, and how many runs each call carried; with what else such calls show.

    memory[B]: peak bytes of a short call with as many runs, made apart from the timed ones. logliks[B, R]:
    log-likelihood of each run of a call, summed over its steps; NaN for runs that did not come through, or that the call did
    not carry. Calls of several runs are all of the same data, each with its own seed.
    """

    seconds: Array
    batch: tuple[int, ...]
    status: str = "ok"
    reason: str = ""
    memory: Array | None = None
    logliks: Array | None = None


def measure_time(case: Case, estimator: Estimator, seed: int, effort: Effort = FULL) -> Timing:
    """Time an estimator on the first steps of a case: single runs for latency, several together for throughput.

    Each call is warm: short ones go before. Run it alone on the machine, in one thread.
    """
    runs, repeats = effort.runs, effort.repeats
    try:
        y = simulated(case, seed, 0, runs).y[: effort.steps]
        warm = float(np.median(np.asarray(_call(case, estimator, y[:SHORT], seed).seconds)))
        peak = {carried: _peak(case, estimator, y[:TRACED, :, :carried], seed) for carried in (1, runs)}
        y = y[: max(SHORT, int(effort.seconds / (runs * warm + 1e-9)))]
        calls = [_call(case, estimator, y[:, :, :1], seed)]
        tail = math.ceil(TAIL_STEPS / len(y))
        once = float(np.sum(np.asarray(calls[0].seconds)))
        single = max(repeats, tail) if tail * once < effort.tail_seconds else repeats
        calls += [_call(case, estimator, y[:, :, [r % runs]], seed + r) for r in range(1, single)]
        calls += [_call(case, estimator, y, seed + r) for r in range(repeats)]
    except FAULTS as error:
        return Timing(np.full((1, 1), np.nan), (1,), FAILED, _reason(error))
    batch = (1,) * single + (runs,) * repeats
    seconds = np.stack([np.asarray(call.seconds).mean(-1) for call in calls], axis=1)
    return Timing(seconds, batch, memory=np.array([peak[carried] for carried in batch]), logliks=_logliks(calls, runs))


def _call(case: Case, estimator: Estimator, y: Array, seed: int) -> Estimate:
    """The estimate from the first steps of a case, with the seconds that they took."""
    begin = time.perf_counter()
    estimate = estimator.run(told(estimator, case.model), y.copy(), seed)
    elapsed = time.perf_counter() - begin
    return examined(estimate, replace(case, steps=len(y), times=case.times[: len(y)]), y.shape[2], elapsed)


def _peak(case: Case, estimator: Estimator, y: Array, seed: int) -> float:
    """Most bytes that a call has in use at any time, of those that Python and NumPy allot in it."""
    model, y = told(estimator, case.model), y.copy()
    tracemalloc.start()
    try:
        estimator.run(model, y, seed)
        return float(tracemalloc.get_traced_memory()[1])
    finally:
        tracemalloc.stop()


def _logliks(calls: list[Estimate], runs: int) -> Array | None:
    """Log-likelihood of the runs of each call [B, R], summed over its steps; None when the estimator gives none."""
    found = np.full((len(calls), runs), np.nan)
    for row, call in zip(found, calls, strict=True):
        if call.loglik is None:
            return None
        with np.errstate(invalid="ignore"):  # of runs that are lost
            row[: len(call.status)] = np.where(call.ok, call.loglik.sum(0), np.nan)
    return found
