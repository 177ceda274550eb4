"""Cases: a problem, what filters are told of it, and what really happens."""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from suite.errors import BadInput
from suite.jump import JumpModel, Model, Modes, simulated
from suite.linalg import Array
from suite.model import Sensor
from suite.published import Experiment, Published
from suite.random import Generators, Streams


def with_unit(words: str, unit: str) -> str:
    """Words, with the unit in brackets where there is one."""
    return f"{words} ({unit})" if unit else words


@dataclass(frozen=True)
class StateBlock:
    """A named group of state components that share a unit, such as position in metres; "" where there is none."""

    name: str
    components: tuple[int, ...]
    unit: str

    @property
    def title(self) -> str:
        """Name, with the unit in brackets where there is one."""
        return with_unit(self.name, self.unit)


@dataclass(frozen=True)
class Divergence:
    """A run has diverged when the Euclidean error of `block` exceeds `limit` for `steps` consecutive steps."""

    block: str
    limit: float
    steps: int


@dataclass(frozen=True)
class Region:
    """Part of the ground plane: the inside of the polygon with these corners, in the unit of the plane."""

    name: str
    corners: tuple[tuple[float, float], ...]

    def holds(self, x: Array, y: Array) -> NDArray[np.bool_]:
        """Whether points x[...], y[...] lie inside: a ray from there crosses the sides an odd number of times."""
        inside = np.zeros(np.shape(x), bool)
        for (ax, ay), (bx, by) in zip(self.corners, self.corners[1:] + self.corners[:1], strict=True):
            if ay != by:
                inside ^= ((ay > y) != (by > y)) & (x < ax + (bx - ax) * (y - ay) / (by - ay))
        return inside


@dataclass(frozen=True)
class Equation:
    """A formula of the model in LaTeX, with the words that say what it is."""

    words: str
    latex: str


FROM_MODEL = "drawn from the model"
FROM_ANOTHER = "drawn from another model than the filters are told"
GIVEN_TRACK = "a given track, its measurements drawn"
RECORDED = "recorded, measurements included"
ORIGINS = (FROM_MODEL, FROM_ANOTHER, GIVEN_TRACK, RECORDED)
"""Where a truth comes from: of the first alone a bound is one; runs of the last are all of the same data."""


@dataclass(frozen=True)
class Truth:
    """What really happened: states x[T, n, R] and measurements y[T, m, R], NaN where unknown or not observed.

    mode[T, R]: which mode of a jump-Markov model was in force, where the case has one.
    """

    x: Array
    y: Array
    mode: Modes | None = None


@dataclass(frozen=True)
class Card:
    """What a reader and a metric need to know of a case: plain data, stored beside the results."""

    name: str
    title: str
    summary: str
    steps: int
    interval: float
    state: tuple[str, ...]
    blocks: tuple[StateBlock, ...]
    divergence: Divergence
    reference: str
    equations: tuple[Equation, ...] = ()
    assumptions: tuple[str, ...] = ()
    published: tuple[Published, ...] = ()
    plane: tuple[int, int] | None = None
    landmarks: tuple[tuple[str, float, float], ...] = ()
    modes: tuple[str, ...] = ()
    nominal: str = ""
    origin: str = FROM_MODEL
    times: tuple[float, ...] = ()
    regions: tuple[Region, ...] = ()
    experiment: Experiment | None = None
    calm: str = ""

    @property
    def time(self) -> Array:
        """Times [T] of the steps in seconds."""
        return np.asarray(self.times or [self.interval * k for k in range(1, self.steps + 1)], float)

    def block(self, name: str) -> StateBlock:
        """The state block of that name."""
        return next(b for b in self.blocks if b.name == name)

    def to_dict(self) -> dict[str, Any]:
        """Plain data, ready for JSON."""
        return {f.name: _plain(getattr(self, f.name)) for f in dataclasses.fields(Card)}

    @staticmethod
    def from_dict(data: dict[str, Any]) -> "Card":
        """The card that `to_dict` wrote."""
        made = dict(data)
        made["state"] = tuple(data["state"])
        made["assumptions"] = tuple(data["assumptions"])
        made["modes"] = tuple(data.get("modes", ()))  # results of before there were modes lack them
        made["blocks"] = tuple(StateBlock(b["name"], tuple(b["components"]), b["unit"]) for b in data["blocks"])
        made["divergence"] = Divergence(**data["divergence"])
        made["equations"] = tuple(Equation(**e) for e in data["equations"])
        made["published"] = tuple(Published(**p) for p in data["published"])
        made["plane"] = tuple(data["plane"]) if data["plane"] else None
        made["landmarks"] = tuple((n, x, y) for n, x, y in data["landmarks"])
        made["times"] = tuple(data.get("times", ()))
        made["regions"] = tuple(Region(r["name"], tuple((x, y) for x, y in r["corners"])) for r in data.get("regions", ()))
        ran = data.get("experiment")
        made["experiment"] = Experiment(ran["runs"], tuple(ran["estimators"])) if ran else None
        return Card(**made)


@dataclass(frozen=True, kw_only=True, eq=False)
class Case(Card):
    """A problem of the bench: its card, the `model` that filters are told, and `generate`, what really happens.

    generate takes the generators of a batch of runs and returns their Truth; it may differ from the model. `data`
    names the files it reads. interval is the time between steps in seconds, the usual one where `times` gives that of each
    step; plane, the two state components to draw on the ground; landmarks and regions, named points and parts of that plane.
    origin, one of `ORIGINS`, says where truths come from; experiment, what the paper of the case ran; calm, the name of the
    case that is alike but has no manoeuvres: false alarms are counted there. modes and nominal follow from a model that has
    several modes.
    """

    model: Model
    generate: Callable[[Generators], Truth]
    data: tuple[Path, ...] = ()

    def __post_init__(self) -> None:
        n = self.model.n
        if len(self.state) != n:
            raise ValueError(f"case {self.name}: {len(self.state)} state names for {n} components")
        for block in self.blocks:
            if not block.components or not set(block.components) <= set(range(n)):
                raise ValueError(f"case {self.name}: block {block.name!r} names components outside 0..{n - 1}")
        if self.divergence.block not in [b.name for b in self.blocks]:
            raise ValueError(f"case {self.name}: divergence names an unknown block {self.divergence.block!r}")
        if isinstance(self.model, JumpModel):
            object.__setattr__(self, "modes", self.model.names)
            object.__setattr__(self, "nominal", self.model.names[self.model.nominal])
        if self.origin not in ORIGINS:
            raise ValueError(f"case {self.name}: origin {self.origin!r} is none of {', '.join(map(repr, ORIGINS))}")
        if self.times and (len(self.times) != self.steps or np.any(np.diff(self.times) <= 0)):
            raise ValueError(f"case {self.name}: times must be {self.steps} numbers that increase")
        if self.regions and self.plane is None:
            raise ValueError(f"case {self.name}: regions need the plane on which they lie")
        if self.steps < 1:
            raise ValueError(f"case {self.name}: steps must be at least 1, got {self.steps}")

    def simulate(self, runs: int, seed: int = 0, first: int = 0) -> Truth:
        """Truth and measurements of `runs` runs, numbered from `first`; a run's numbers depend on its number alone.

        Raises BadInput when runs is below 1, ValueError when `generate` returns arrays of the wrong shape, or modes that the
        model does not have.
        """
        if runs < 1:
            raise BadInput(f"runs must be at least 1, got {runs}")
        truth = self.generate(Streams((seed, self.name, "truth"), first).batch(0, runs))
        for name, array, rows in (("x", truth.x, self.model.n), ("y", truth.y, self.model.m)):
            if np.shape(array) != (self.steps, rows, runs):
                raise ValueError(f"case {self.name}: {name} has shape {np.shape(array)}, not {(self.steps, rows, runs)}")
        if truth.mode is not None:
            if np.shape(truth.mode) != (self.steps, runs):
                raise ValueError(f"case {self.name}: mode has shape {np.shape(truth.mode)}, not {(self.steps, runs)}")
            if not np.isin(truth.mode, range(len(self.modes))).all():
                raise ValueError(f"case {self.name}: mode holds other numbers than indices of its {len(self.modes)} modes")
        return truth


def draw(model: Model, steps: int, rng: Generators) -> Truth:
    """Truth and measurements drawn from the model itself."""
    if isinstance(model, JumpModel):
        return Truth(*simulated(model, steps, rng))
    x = model.prior.sample(rng, (rng.runs,))
    states = []
    for k in range(1, steps + 1):
        x = model.dynamics.sample(rng, x, k)
        states.append(x)
    trajectory = np.stack(states)
    return Truth(trajectory, measure(model.sensor, trajectory, rng))


def measure(sensor: Sensor, x: Array, rng: Generators) -> Array:
    """Measurements y[T, m, R] of the states x[T, n, R]."""
    return np.stack([sensor.sample(rng, np.ascontiguousarray(at), k) for k, at in enumerate(x, start=1)])


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return dataclasses.asdict(value)
    if isinstance(value, tuple):
        return [_plain(v) for v in value]
    return value
