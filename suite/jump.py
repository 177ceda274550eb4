"""Jump-Markov models: several modes, one of which is in force at each step."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from suite.checks import is_integer, numbers, several, shown
from suite.linalg import Array
from suite.model import StateSpaceModel
from suite.random import Generators

ROUNDING = 1e-9
Modes = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class JumpModel:
    """A Markov chain of modes r_k, each with a transition and a sensor for the one state that all of them share.

    transition: P[i, j] = P(r_k = j | r_{k-1} = i). initial: law of r_0 [M]; x_0 given r_0 follows that mode's prior, x_k given
    x_{k-1} and y_k given x_k follow the dynamics and the sensor of mode r_k. nominal: the mode without a manoeuvre, which
    filters of a single model are told alone. names: words for the modes. Raises ValueError that names the field.
    """

    modes: tuple[StateSpaceModel, ...]
    transition: Array
    initial: Array
    nominal: int = 0
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        modes = several("JumpModel.modes", self.modes, StateSpaceModel)
        count = len(modes)
        for i, mode in enumerate(modes):
            if (mode.n, mode.m) != (self.n, self.m):
                raise ValueError(
                    f"JumpModel.modes[{i}] has {mode.n} state and {mode.m} measurement components, modes[0] has {self.n} and "
                    f"{self.m}; all modes share one state and one measurement"
                )
        object.__setattr__(self, "modes", modes)
        for field, shape in (("transition", (count, count)), ("initial", (count,))):
            object.__setattr__(self, field, _probabilities(field, getattr(self, field), shape))
        if not is_integer(self.nominal) or not 0 <= self.nominal < count:
            raise ValueError(
                f"JumpModel.nominal is {shown(self.nominal)}, not the index of one of {count} modes: 0 to {count - 1}"
            )
        names: Any = self.names.tolist() if isinstance(self.names, np.ndarray) else self.names
        names = [f"mode {i + 1}" for i in range(count)] if names in ((), []) else names
        words = isinstance(names, tuple | list) and all(isinstance(name, str) for name in names)
        if not words or not len(names) == len(set(names)) == count:
            raise ValueError(f"JumpModel.names must be {count} different names, one a mode, got {shown(self.names)}")
        object.__setattr__(self, "names", tuple(names))

    @property
    def n(self) -> int:
        """Number of state components."""
        return self.modes[0].n

    @property
    def m(self) -> int:
        """Number of measurement components."""
        return self.modes[0].m

    @cached_property
    def log_transition(self) -> Array:
        """Log-probabilities of r_k = j given r_{k-1} = i [M, M] at [i, j]."""
        with np.errstate(divide="ignore"):
            return np.asarray(np.log(self.transition))

    @property
    def nominal_mode(self) -> StateSpaceModel:
        """The model of the mode without a manoeuvre."""
        return self.modes[self.nominal]


def _probabilities(field: str, given: Any, shape: tuple[int, ...]) -> Array:
    """The rows of `given` as probabilities. Raises ValueError that names the field and the row."""
    array = numbers(f"JumpModel.{field}", given)
    if array.shape != shape:
        raise ValueError(f"JumpModel.{field} has shape {array.shape}, {shape[0]} modes need {shape}")
    for i, row in enumerate(array.reshape(-1, shape[-1])):
        where = f"JumpModel.{field}" + (f" row {i}" if len(shape) > 1 else "")
        if not np.isfinite(row).all() or (row < 0).any():
            raise ValueError(f"{where} is {row.tolist()}: probabilities are finite and not negative")
        if abs(row.sum() - 1) > ROUNDING:
            raise ValueError(f"{where} sums to {row.sum():.9g}, not to 1")
    return np.asarray(array / array.sum(-1, keepdims=True))


def started(model: JumpModel, rng: Generators, shape: tuple[int, ...]) -> Modes:
    """Modes r_0 [R, ...] drawn from their initial law; shape[0] is the number of runs."""
    return drawn(np.broadcast_to(model.initial, (*shape, len(model.initial))), rng)


def evolved(model: JumpModel, modes: Modes, rng: Generators) -> Modes:
    """Modes r_k [R, ...] drawn given the modes r_{k-1} [R, ...]."""
    ends, uniform = _ends(model.transition), rng.random((1, *modes.shape))[0]
    return np.asarray(sum(uniform >= np.take(end, modes) for end in ends.T), np.intp)


def drawn(probabilities: Array, rng: Generators) -> Modes:
    """Modes [R, ...] drawn by inversion, given the probabilities [R, ..., M] of each."""
    uniform = rng.random((1, *probabilities.shape[:-1]))[0]
    return np.asarray((uniform[..., None] >= _ends(probabilities)).sum(-1), np.intp)


def _ends(probabilities: Array) -> Array:
    """Running sums [..., M] of probabilities, infinite from the last mode that has any on: sums may end just below 1."""
    ends = np.cumsum(probabilities, axis=-1)
    return np.asarray(np.where(ends >= ends[..., -1:], np.inf, ends))


def simulated(model: JumpModel, steps: int, rng: Generators) -> tuple[Array, Array, Modes]:
    """States x[T, n, R], measurements y[T, m, R] and modes [T, R] drawn from the model."""
    mode = started(model, rng, (rng.runs,))
    x = chosen(mode, [each.prior.sample(rng, (rng.runs,)) for each in model.modes])
    states, measurements, modes = [], [], []
    for k in range(1, steps + 1):
        mode = evolved(model, mode, rng)
        x = chosen(mode, [each.dynamics.sample(rng, x, k) for each in model.modes])
        states.append(x)
        measurements.append(chosen(mode, [each.sensor.sample(rng, x, k) for each in model.modes]))
        modes.append(mode)
    return np.stack(states), np.stack(measurements), np.stack(modes)


def chosen(mode: Modes, options: Sequence[Array]) -> Array:
    """Of arrays [d, R, ...], one for each mode, the columns that belong to the modes [R, ...]."""
    out = options[0]
    for i, option in enumerate(options[1:], start=1):
        out = np.where(mode == i, option, out)
    return out


Model = StateSpaceModel | JumpModel
"""What a case may be about."""
