"""An estimator on trial: called on a case as often as the rules of suite/conformance.py need, and read as the engine would."""

import contextlib
import copy
import io
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import ModuleType
from typing import Any

import numpy as np

from suite.case import Case
from suite.errors import BadInput, one_line
from suite.estimator import FAILED, LOST, TRACES, VECTORS, Estimate, Estimator, told
from suite.jump import Model
from suite.linalg import Array
from suite.random import Streams
from suite.work import FAULTS, examined

STEPS, RUNS = 5, 4
STREAMS = Streams(("conformance",))
ALL = slice(None)
SPOILT = slice(1, 3)
"""The runs whose measurements are taken away or replaced; those beside them must not notice."""
PARTS = ("mean", "cov", *TRACES, *VECTORS)
Numbers = Mapping[str, tuple[Any, ...]]


class Finding(Exception):
    """An estimator breaks a rule; the message is one line that says how."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a call of `run` returned, the seconds it took, what it wrote to the terminal, and the inputs it was given."""

    returned: object
    elapsed: float
    written: str
    model: Model
    y: Array


@dataclass(frozen=True, eq=False)
class Trial:
    """An estimator on measurements y[T, m, R] of a case; whatever a call does to its inputs stays in that call.

    All that is asked of it raises Finding when the estimator raises, or returns what cannot be read.
    """

    estimator: Estimator
    case: Case
    y: Array

    @cached_property
    def refusal(self) -> str | None:
        """Why the estimator does not take the case; None when it does."""
        return opinion(self.estimator, self.case)

    @cached_property
    def outcome(self) -> Outcome:
        """What came out for the measurements as they are."""
        return self._call(self.y, STREAMS)

    @cached_property
    def plain(self) -> Estimate:
        """The estimate from the measurements as they are."""
        return self._read(self.outcome)

    def run(self, y: Array, seed: int | Streams = STREAMS) -> Estimate:
        """The estimate from other measurements."""
        return self._read(self._call(y, seed))

    def spoilt(self, steps: int | slice, components: int | slice, value: float | Array) -> Estimate:
        """The estimate with other measurements in the runs SPOILT. Raises Finding when the runs beside them change."""
        y = self.y.copy()
        y[steps, components, SPOILT] = value
        found = self.run(y)
        for beside in (slice(0, SPOILT.start), slice(SPOILT.stop, RUNS)):
            demand_same(part(found, beside), part(self.plain, beside), "a run beside those with such measurements")
        return found

    def _call(self, y: Array, seed: int | Streams) -> Outcome:
        model, y, written = copy.deepcopy(told(self.estimator, self.case.model)), y.copy(), io.StringIO()
        begin = time.perf_counter()
        try:
            with contextlib.redirect_stdout(written), contextlib.redirect_stderr(written), np.errstate(all="ignore"):
                returned = self.estimator.run(model, y, seed)
        except FAULTS as error:
            raise Finding(f"run raised {one_line(error)}") from error
        return Outcome(returned, time.perf_counter() - begin, written.getvalue(), model, y)

    def _read(self, outcome: Outcome) -> Estimate:
        steps, _, runs = outcome.y.shape
        try:
            return examined(
                outcome.returned, replace(self.case, steps=steps, times=self.case.times[:steps]), runs, outcome.elapsed
            )
        except FAULTS as error:
            raise Finding(one_line(error)) from error


def measured(case: Case) -> tuple[Case, Array]:
    """A case with the first of its measurements, y[T, m, R]. Raises BadInput when it does not simulate."""
    try:
        return case, np.asarray(case.simulate(RUNS, seed=1).y, float)[:STEPS]
    except FAULTS as error:
        raise BadInput(f"case {case.name} does not simulate: {one_line(error)}") from error


def opinion(estimator: Estimator, case: Case) -> str | None:
    """What `accepts` says of a case's model. Raises Finding when it is neither None nor text, or the model changed."""
    before = told(estimator, case.model)
    model, written = copy.deepcopy(before), io.StringIO()
    try:
        with contextlib.redirect_stdout(written), contextlib.redirect_stderr(written), np.errstate(all="ignore"):
            reason = estimator.accepts(model)
    except FAULTS as error:
        raise Finding(f"accepts raised {one_line(error)} for the model of {case.name}") from error
    if written.getvalue():
        raise Finding(f"accepts wrote {' '.join(written.getvalue().split())[:200]!r}")
    if reason is not None and not (isinstance(reason, str) and reason.strip()):
        raise Finding(f"accepts returned {reason!r} for the model of {case.name}")
    if changed := difference(numbers(before), numbers(model)):
        raise Finding(f"accepts changed {changed} of {case.name}")
    return reason


def numbers(thing: Any, path: str = "model", depth: int = 8) -> Numbers:
    """All numbers in an object, by the path that leads there."""
    if isinstance(thing, np.ndarray | float | int):
        array = np.asarray(thing)
        return {path: (array.shape, array.dtype, array.tobytes())}
    if isinstance(thing, type | ModuleType) or not depth:
        return {}
    if isinstance(thing, list | tuple):
        inside = {f"{path}[{i}]": item for i, item in enumerate(thing)}
    elif isinstance(thing, dict):
        inside = {f"{path}[{key!r}]": item for key, item in thing.items()}
    else:
        inside = {f"{path}.{key}": item for key, item in getattr(thing, "__dict__", {}).items()}
    return {key: value for place, item in inside.items() for key, value in numbers(item, place, depth - 1).items()}


def difference(before: Numbers, after: Numbers) -> str | None:
    """The first of the numbers before that are others after; what was only added, such as a cache, does not count."""
    return next((path for path, value in before.items() if after.get(path) != value), None)


def part(estimate: Estimate, runs: slice) -> Estimate:
    """The numbers of some of the runs."""
    found: dict[str, Any] = {name: getattr(estimate, name) for name in PARTS}
    kept: dict[str, Any] = {name: None if value is None else value[..., runs] for name, value in found.items()}
    return Estimate(**kept, status=estimate.status[runs])


def demand_same(found: Estimate, expected: Estimate, what: str) -> None:
    """Raise Finding when two estimates of the same runs differ in a bit."""
    if list(found.status) != list(expected.status):
        raise Finding(f"{what}: the status is {list(found.status)}, not {list(expected.status)}")
    for name in PARTS:
        a, b = getattr(found, name), getattr(expected, name)
        if (a is None) != (b is None) or (a is not None and not np.array_equal(a, b, equal_nan=True)):
            raise Finding(f"{what}: {name} is another")


def demand_no_failure(found: Estimate) -> None:
    """Raise Finding when a run failed, or is not finite without being marked lost."""
    for r, status in enumerate(found.status):
        if status == FAILED:
            raise Finding(f"run {r}, {found.reason[r]}")


def demand_sound(found: Estimate, before: Estimate) -> None:
    """Raise Finding when a run failed, or was lost that was not lost before."""
    demand_no_failure(found)
    for r, status in enumerate(found.status):
        if status == LOST and before.ok[r]:
            raise Finding(f"run {r} was lost, {found.reason[r]}")


def demand_blocks(trial: Trial, ranges: Sequence[slice]) -> None:
    """Raise Finding when runs computed by themselves differ in a bit from the same runs among all others."""
    for runs in ranges:
        found = trial.run(trial.y[:, :, runs], Streams(STREAMS.key, runs.start))
        demand_same(found, part(trial.plain, runs), f"runs {runs.start} to {runs.stop - 1} computed by themselves")


def demand_within(trial: Trial, trace: str, low: float, high: float, or_nan: bool = False) -> None:
    """Raise Finding when an optional part of the estimate leaves its range in a run that is not lost."""
    values = getattr(trial.plain, trace)
    if values is None:
        return
    values = values[:, trial.plain.ok]
    slack = 1e-9 * max(1.0, min(high, 1e9))  # rounding
    good = ((values >= low - slack) & (values <= high + slack)) | (np.isnan(values) & or_nan)
    if not good.all():
        raise Finding(f"{trace} is {values[~good][0]:.6g}")
