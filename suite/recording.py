"""Recordings: one's own measurements as a case, from a CSV or Parquet file and a TOML file that describes it.

The measurements have the columns time, sensor, and z1, z2, ... or the components by their names, such as range and bearing;
where rows have covariances of their own, also cov11, cov12, cov22, ..., in the order and the units of the components (for a
geodetic position m²). Times do not decrease; a step of the case is a distinct time. The truth has the columns time, the
position, and what else of the state is known, in m, m/s, m/s², rad/s, and in degrees for latitude and longitude.
"""

import functools
import itertools
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from scipy.linalg import block_diag

from suite.angles import wrap
from suite.case import RECORDED, Case, Divergence, Equation, StateBlock, Truth
from suite.columns import instant
from suite.description import FIRST_FIX, MOTIONS, TIME, Description, describe
from suite.errors import BadInput
from suite.kinematics import Station, coordinated_turn, polynomial, stacked
from suite.linalg import Array
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian
from suite.random import Generators
from suite.readings import Frame, Reading, known, recorded

LETTERS = {"position": "", "velocity": "v", "acceleration": "a"}
"""What stands before the axis in the names of the state."""
UNITS = {"position": "m", "velocity": "m/s", "acceleration": "m/s²", "turn_rate": "rad/s"}
ANGLES = ("bearing", "elevation")
FORMULAS = {
    "constant-velocity": ("Nearly constant velocity", r"\ddot r = w"),
    "constant-acceleration": ("Nearly constant acceleration", r"\dddot r = w"),
    "coordinated-turn": ("Nearly coordinated turn", r"\ddot x = -\omega \dot y + w_x, \quad \ddot y = \omega \dot x + w_y"),
}
LONGEST = 1e15
"""Seconds that a recording may take: far beyond, powers of times overflow."""
Stations = Sequence[Station | None]


def load(path: Path | str) -> Case:
    """The case of a recording, described in a TOML file. Raises BadInput with file, line and column of what is wrong."""
    told = describe(Path(path))
    readings, frame = recorded(told)
    stations = [None if i.place is None else frame.station(i.place) for i in told.instruments]
    start, prior = _prior(told, readings, frame, stations)
    used = [r for r in readings if r.instant > start]
    if not used:
        raise BadInput(f"{told.measurements}: nothing is measured after the first fix")
    instants = sorted({r.instant for r in used})
    intervals = [(b - a) * TIME[told.time] for a, b in itertools.pairwise([start, *instants])]
    times = [(at - start) * TIME[told.time] for at in instants]
    if times[-1] > LONGEST or (np.diff([0.0, *times]) <= 0).any():
        raise BadInput(f"{told.measurements}: its times lie too far apart or too close together for floating point")
    even = max(intervals) - min(intervals) < 1e-6 * max(intervals)
    y, noise = _measured(told, used, instants)
    names = {part: _names(part, frame) for part in ("position", *MOTIONS[told.motion.kind])}
    state, n = tuple(itertools.chain(*names.values())), len(prior.mean)
    model = StateSpaceModel(
        prior,
        _dynamics(told, intervals),
        _sensor(told, stations, n, noise),
        linear=tuple(range(frame.dimensions, n - len(names.get("turn_rate", ())))),
    )
    return Case(
        name=told.name,
        title=told.title,
        summary=f"A recording: {len(used)} measurements by {len(stations)} sensors at {len(instants)} times, the same in every "
        f"run. Its truth is {'known' if told.truth else 'not known'}.",
        steps=len(instants),
        interval=float(np.median(intervals)),
        state=state,
        blocks=tuple(
            StateBlock(part.replace("_", " "), tuple(state.index(name) for name in own), UNITS[part])
            for part, own in names.items()
        ),
        divergence=Divergence("position", told.limit, told.steps),
        reference=f"a recording of one's own, {told.measurements.name}",
        equations=(Equation(*FORMULAS[told.motion.kind]),),
        assumptions=_assumptions(told, len(readings) - len(used)),
        plane=(0, 1),
        landmarks=tuple(
            (i.name, float(s.place[0]), float(s.place[1])) for i, s in zip(told.instruments, stations, strict=True) if s
        ),
        model=model,
        origin=RECORDED,
        times=() if even else tuple(times),
        generate=functools.partial(_replayed, known(told, frame, state, instants), y),
        data=tuple(p for p in (told.path, told.measurements, told.truth) if p),
    )


def name_of(path: Path | str) -> str:
    """The name of the case of a recording. Raises BadInput as `load` does."""
    return describe(Path(path)).name


def _names(part: str, frame: Frame) -> tuple[str, ...]:
    """Names of the components of a part of the state."""
    return tuple(LETTERS[part] + axis for axis in "xyz"[: frame.dimensions]) if part in LETTERS else (part,)


def _prior(told: Description, readings: Sequence[Reading], frame: Frame, stations: Stations) -> tuple[float, Gaussian]:
    """When the prior begins, and the prior: as stated, or about the first measurement that gives a position."""
    where = f"{told.path}, [prior]"
    mean = [np.array(told.prior.mean[part]) for part in MOTIONS[told.motion.kind]]
    cov = [np.diag(told.prior.std[part]) ** 2 for part in MOTIONS[told.motion.kind]]
    if told.prior.start != FIRST_FIX:
        start = instant(told.prior.start, told.time, f"{where}, start")
        if start >= readings[0].instant:
            raise BadInput(f"{where}: start must be before the first measurement, got {told.prior.start!s}")
        at, spread = frame.position(told.prior.mean["position"]), np.diag(told.prior.std["position"]) ** 2
        return start, Gaussian(np.concat([at, *mean]), block_diag(spread, *cov))
    for reading in readings:
        instrument, station = told.instruments[reading.sensor], stations[reading.sensor]
        noise = np.diag(instrument.std) ** 2 if reading.cov is None else reading.cov
        fix = (reading.y, noise) if station is None else station.fix(instrument.components, reading.y, noise)
        if fix is not None:
            return reading.instant, Gaussian(np.concat([fix[0], *mean]), block_diag(fix[1], *cov))
    raise BadInput(f"{where}: no sensor measures a position by itself; state a start with its time and position")


def _measured(
    told: Description, used: Sequence[Reading], instants: Sequence[float]
) -> tuple[Array, Gaussian | Callable[[int], Gaussian]]:
    """Measurements y[T, m], NaN where not reported, and their noise: a law a step where rows have covariances of their own."""
    ends = list(itertools.accumulate((len(i.components) for i in told.instruments), initial=0))
    angles = [name in ANGLES for i in told.instruments for name in i.components]
    step = {at: k for k, at in enumerate(instants)}
    y = np.full((len(instants), ends[-1]), np.nan)
    nominal = np.diag(np.concat([i.std for i in told.instruments])) ** 2
    noises = [nominal.copy() for _ in instants]
    for r in used:
        rows = slice(ends[r.sensor], ends[r.sensor + 1])
        y[step[r.instant], rows] = r.y
        if r.cov is not None:
            noises[step[r.instant]][rows, rows] = r.cov
    y[:, angles] = wrap(y[:, angles])
    if all(r.cov is None for r in used):
        return y, Gaussian.noise(nominal)
    laws = [Gaussian.noise(cov) for cov in noises]
    return y, lambda k: laws[k - 1]


def _dynamics(told: Description, intervals: Sequence[float]) -> AdditiveTransition:
    """The motion over the intervals before the steps."""
    motion = told.motion
    if motion.kind == "coordinated-turn":
        return coordinated_turn(intervals, motion.density, motion.turn_density)
    return polynomial(intervals, motion.density, order=len(MOTIONS[motion.kind]))


def _sensor(told: Description, stations: Stations, n: int, noise: Gaussian | Callable[[int], Gaussian]) -> AdditiveSensor:
    """All sensors, one below the other."""
    angles = tuple(j for j, name in enumerate(c for i in told.instruments for c in i.components) if name in ANGLES)
    pairs = list(zip(told.instruments, stations, strict=True))
    d = told.coordinates.dimensions
    mean = stacked([s.look(i.components) if s else lambda x: [x[j] for j in range(d)] for i, s in pairs])
    linear = Affine(np.tile(np.eye(d, n), (len(pairs), 1)))
    return AdditiveSensor(mean if any(stations) else linear, noise, angles)


def _assumptions(told: Description, dropped: int) -> tuple[str, ...]:
    """What was done to the recording."""
    found = []
    if told.prior.start == FIRST_FIX:
        found.append(
            f"The prior is the first measured position; all else that was measured until then ({dropped - 1} rows) is dropped."
        )
    if told.coordinates.geodetic:
        found.append("Places are in local east, north and up of WGS84; bearings and elevations are those at each sensor.")
        if told.coordinates.dimensions == 2:
            found.append("All is at the height of the origin above WGS84, over the curve of the earth.")
    if told.truth:
        found.append("The truth is linear between its rows.")
    return tuple(found)


def _replayed(x: Array, y: Array, rng: Generators) -> Truth:
    """The recorded x[T, n] and y[T, m] in every run."""
    return Truth(np.repeat(x[:, :, None], rng.runs, axis=2), np.repeat(y[:, :, None], rng.runs, axis=2))
