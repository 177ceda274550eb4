"""Estimators: what turns measurements into estimates, and the one loop over time that recursive filters share."""

import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Protocol

import numpy as np

from suite import parameters
from suite.errors import BadInput, one_line
from suite.jump import JumpModel, Model
from suite.linalg import Array
from suite.model import StateSpaceModel
from suite.random import Generators, Streams

OK, LOST, FAILED = "ok", "lost", "failed"
TRACES = ("loglik", "ess", "ancestors", "acceptance", "statistic")
"""The optional parts of an estimate that are one number a step and run."""
VECTORS = ("innovation", "mode")
"""Those that are several numbers a step and run."""


@dataclass
class Estimate:
    """What an estimator returns for measurements y[T, m, R]; the optional parts are None where it has none.

    mean[T, n, R] and cov[T, n, n, R] of x_k given y_1..y_k; loglik[T, R], log p(y_k | y_1..y_{k-1}); ess[T, R],
    effective sample size; ancestors[T, R], particles of the step before with offspring; acceptance[T, R], share of
    particles moved, NaN where no move was tried; innovation[T, m, R], measurement minus its prediction, whitened by its
    covariance; mode[T, M, R], probabilities of the modes of a jump-Markov model given y_1..y_k; statistic[T, R], what a
    detector of manoeuvres compares with a threshold, larger for a manoeuvre; status[R], one of ok, lost, failed, with
    reason[R]; seconds[T, R], time of a step divided by the runs computed together; batch[R], how many runs were computed in
    the call.
    """

    mean: Array
    cov: Array
    loglik: Array | None = None
    ess: Array | None = None
    ancestors: Array | None = None
    acceptance: Array | None = None
    innovation: Array | None = None
    mode: Array | None = None
    statistic: Array | None = None
    status: Sequence[str] = ()
    reason: Sequence[str] = ()
    seconds: Array | None = None
    batch: Sequence[int] = ()

    def __post_init__(self) -> None:
        runs = np.shape(self.mean)[-1] if np.ndim(self.mean) else 0
        self.status = list(self.status) or [OK] * runs
        self.reason = list(self.reason) or [""] * runs
        self.batch = list(self.batch) or [runs] * runs

    @property
    def ok(self) -> "np.ndarray[Any, np.dtype[np.bool_]]":
        """Which runs came through [R]."""
        return np.array([s == OK for s in self.status], bool)


def join(parts: Sequence[Estimate]) -> Estimate:
    """One estimate from estimates of consecutive runs."""

    def merge(name: str) -> Any:
        pieces = [getattr(part, name) for part in parts]
        if any(p is None for p in pieces):
            return None
        if isinstance(pieces[0], np.ndarray):
            return np.concatenate(pieces, axis=-1)
        return [item for piece in pieces for item in piece]

    return parts[0] if len(parts) == 1 else Estimate(**{f.name: merge(f.name) for f in fields(Estimate)})


def alike(parts: Sequence[Estimate]) -> Sequence[Estimate]:
    """The same estimates, each given the optional parts that any of them has, as NaN, so that none is lost in `join`."""
    for name in (*TRACES, *VECTORS, "seconds"):
        known = next((getattr(part, name) for part in parts if getattr(part, name) is not None), None)
        for part in parts:
            if known is not None and getattr(part, name) is None:
                setattr(part, name, np.full((*known.shape[:-1], len(part.status)), np.nan))
    return parts


def unavailable(steps: int, n: int, runs: int, status: str, reason: str) -> Estimate:
    """An estimate that holds nothing but the reason why there is none."""
    return Estimate(
        np.full((steps, n, runs), np.nan), np.full((steps, n, n, runs), np.nan), status=[status] * runs, reason=[reason] * runs
    )


class Estimator(Protocol):
    """Anything with a name, a reference, an opinion on models, and a way to run. A dataclass's fields are parameters."""

    @property
    def name(self) -> str:
        """Name in the registry: lower case, words joined by hyphens, a peer library's name before a colon."""

    @property
    def reference(self) -> str:
        """Where the method was published."""

    def accepts(self, model: StateSpaceModel) -> str | None:
        """None when the estimator can run on the model, otherwise the reason why not, for a reader."""

    def run(self, model: StateSpaceModel, y: Array, seed: int | Streams = 0) -> Estimate:
        """Estimate the states behind measurements y[T, m, R]; the same seed gives the same numbers."""


@dataclass(frozen=True)
class Readout:
    """What a filter says after one step: mean[n, R], cov[n, n, R] and, where it has them, the rest of Estimate."""

    mean: Array
    cov: Array
    loglik: Array | None = None
    ess: Array | None = None
    ancestors: Array | None = None
    acceptance: Array | None = None
    innovation: Array | None = None
    mode: Array | None = None
    statistic: Array | None = None


class StepError(Exception):
    """A filter's step raised; carries the time index at which it did."""


class Filter(ABC):
    """Base of recursive estimators: give `init`, one `step` and `read`; the loop over time is here, once.

    It is one `step`, not predict and update: some filters need y_k before they propose.
    """

    name: str
    reference: str
    takes_modes: ClassVar[bool] = False
    """Whether it is told the modes of a jump-Markov model; otherwise it is told the nominal mode alone."""

    def __post_init__(self) -> None:
        parameters.check(self)

    @abstractmethod
    def init(self, model: StateSpaceModel, rng: Generators) -> Any:
        """Belief about x_0 for each run of `rng`."""

    @abstractmethod
    def step(self, model: StateSpaceModel, belief: Any, y: Array, k: int, rng: Generators) -> Any:
        """Belief about x_k given the belief about x_{k-1} and y_k = y[m, R], where NaN means not observed."""

    @abstractmethod
    def read(self, belief: Any) -> Readout:
        """Moments of the belief."""

    def accepts(self, model: StateSpaceModel) -> str | None:
        """None when the filter can run on the model, otherwise the reason why not."""
        return None

    def runs_at_once(self, model: StateSpaceModel) -> int | None:
        """How many runs to carry together, so that their arrays stay in the processor's cache; None for all."""
        return None

    def run(self, model: Any, y: Array, seed: int | Streams = 0) -> Estimate:
        """Filter measurements y[T, m, R]. Raises BadInput when their shape does not fit, StepError when a step does."""
        model, y = told(self, model), measurements(model, y)
        streams, runs = Streams.of(seed), y.shape[2]
        size = self.runs_at_once(model) or runs
        starts = range(0, runs, size)
        groups = [(y[:, :, s : s + size], streams.batch(s, min(size, runs - s))) for s in starts]
        with np.errstate(all="ignore"):  # a run that goes wrong is seen by its numbers, see `_loop`
            estimate = join([self._loop(model, part, rng) for part, rng in groups])
        estimate.batch = [runs] * runs
        return estimate

    def _loop(self, model: StateSpaceModel, y: Array, rng: Generators) -> Estimate:
        steps, runs = y.shape[0], y.shape[2]
        out = unavailable(steps, model.n, runs, OK, "")
        out.seconds = np.zeros((steps, runs))
        alive = np.ones(runs, bool)
        belief = self.init(model, rng)
        for k in range(1, steps + 1):
            begin = time.perf_counter()
            try:
                belief = self.step(model, belief, np.ascontiguousarray(y[k - 1]), k, rng)
                now = self.read(belief)
            except Exception as error:
                raise StepError(f"step {k}: {one_line(error)}") from error
            out.seconds[k - 1] = (time.perf_counter() - begin) / runs
            alive = _bury(out, alive, now, k)
            _write(out, now, k - 1, alive)
        return out


def _bury(out: Estimate, alive: Any, now: Readout, k: int) -> Any:
    """Mark the runs whose numbers stopped being finite at step k; they stay lost."""
    if np.isfinite(now.mean).all() and np.isfinite(now.cov).all():
        return alive
    sound = np.isfinite(now.mean).all(0) & np.isfinite(now.cov).all((0, 1))
    collapsed = np.zeros_like(sound) if now.loglik is None else now.loglik == -np.inf
    for r in np.flatnonzero(alive & ~sound):
        why = "the measurement has zero likelihood" if collapsed[r] else "the state estimate is not finite"
        out.status[r], out.reason[r] = LOST, f"step {k}: {why}"  # type: ignore[index]
    return alive & sound


def _write(out: Estimate, now: Readout, row: int, alive: Any) -> None:
    """Store one step's readout; a lost run keeps NaN from its last step on."""
    steps, whole = len(out.mean), alive.all()
    for name in ("mean", "cov", *TRACES, *VECTORS):
        value = getattr(now, name)
        if value is None:
            continue
        if getattr(out, name) is None:
            setattr(out, name, np.full((steps, *value.shape), np.nan))
        getattr(out, name)[row] = value if whole else np.where(alive, value, np.nan)


def told(estimator: Estimator, model: Model) -> Any:
    """What an estimator is told of a model: jump-Markov models whole if it takes modes, otherwise their nominal mode."""
    whole = isinstance(estimator, Filter) and estimator.takes_modes
    return model.nominal_mode if isinstance(model, JumpModel) and not whole else model


def measurements(model: Model, y: Array) -> Array:
    """Measurements as floats y[T, m, R]. Raises BadInput when the shape does not fit the model."""
    y = np.asarray(y, float)
    if y.ndim != 3 or y.shape[1] != model.m or 0 in y.shape:
        raise BadInput(f"measurements must have shape (steps, {model.m}, runs), all at least 1, got {y.shape}")
    return y
