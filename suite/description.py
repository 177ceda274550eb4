"""Descriptions of recordings: TOML files that say what was measured, by which sensors, and how the target is held to move.

Every number that has a unit is written with it, as in "15 m" or "0.5 deg"; once read, all are in m, s and rad.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from suite.errors import BadInput
from suite.section import ACCELERATION, ANGLE, LENGTH, SPEED, TURN_RATE, Section, Units, Vector, parse

TIME: Units = {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0, "ISO 8601": 1e-6}
"""Seconds in a unit of recorded time; instants in ISO 8601 are counted in microseconds."""
UNITS: dict[str, Units] = {
    **dict.fromkeys(("x", "y", "z", "height", "range", "position"), LENGTH),
    **dict.fromkeys(("latitude", "longitude", "bearing", "elevation"), ANGLE),
    **dict.fromkeys(("range-rate", "velocity"), SPEED),
    "acceleration": ACCELERATION,
    "turn_rate": TURN_RATE,
}
KINDS: dict[str, tuple[str, ...]] = {
    "position": (),
    "range": ("range",),
    "bearing": ("bearing",),
    "range-rate": ("range-rate",),
    "range-bearing": ("range", "bearing"),
    "range-bearing-rate": ("range", "bearing", "range-rate"),
    "bearing-elevation": ("bearing", "elevation"),
    "range-bearing-elevation": ("range", "bearing", "elevation"),
    "range-bearing-elevation-rate": ("range", "bearing", "elevation", "range-rate"),
}
"""What a sensor of each kind measures; a position has the coordinates' own names."""
MOTIONS = {
    "constant-velocity": ("velocity",),
    "constant-acceleration": ("velocity", "acceleration"),
    "coordinated-turn": ("velocity", "turn_rate"),
}
"""What the state holds besides the position."""
DENSITY: dict[str, Units] = {
    "constant-velocity": {"m^2/s^3": 1.0},
    "constant-acceleration": {"m^2/s^5": 1.0},
    "coordinated-turn": {"m^2/s^3": 1.0},
}
TURN_DENSITY: Units = {"rad^2/s^3": 1.0, "deg^2/s^3": (math.pi / 180) ** 2}
FIRST_FIX = "first fix"
T = TypeVar("T")


@dataclass(frozen=True)
class Coordinates:
    """Local metres, or geodetic latitude, longitude and height about an origin (rad, rad, m); in 2 or 3 dimensions."""

    geodetic: bool
    dimensions: int
    origin: Vector | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of a place's coordinates, in their order."""
        return (("latitude", "longitude", "height") if self.geodetic else ("x", "y", "z"))[: self.dimensions]

    @property
    def units(self) -> list[Units]:
        """Units of a place's coordinates."""
        return [UNITS[name] for name in self.names]

    def on_axes(self, values: Sequence[T]) -> tuple[T, ...]:
        """What is told in the order of a place's coordinates, in that of the axes of the state: east before north."""
        return (values[1], values[0], *values[2:]) if self.geodetic else tuple(values)


@dataclass(frozen=True)
class Instrument:
    """A sensor: the components it measures, the units they are recorded in, its place, its standard deviations.

    std: those of a position along the axes of the state.
    """

    name: str
    components: tuple[str, ...]
    scale: Vector
    place: Vector | None
    std: Vector


@dataclass(frozen=True)
class Motion:
    """A kind of motion, its noise density on each axis (m²/s³, or m²/s⁵ with acceleration), and that of the turn rate."""

    kind: str
    density: Vector
    turn_density: float = 0.0


@dataclass(frozen=True)
class Prior:
    """Means and standard deviations of the parts of the state that are stated.

    The mean of the position is a place, its standard deviations are along the axes of the state.
    start: its time as it stands in the file; FIRST_FIX when the position is to be taken from the recording.
    """

    start: object
    mean: Mapping[str, Vector]
    std: Mapping[str, Vector]


@dataclass(frozen=True)
class Description:
    """What a TOML file says of a recording; a run has diverged beyond `limit` metres for `steps` steps.

    name: of the case; where none is stated that of the file, with a dash for what a name must not hold.
    """

    path: Path
    name: str
    title: str
    measurements: Path
    truth: Path | None
    time: str
    coordinates: Coordinates
    instruments: tuple[Instrument, ...]
    motion: Motion
    prior: Prior
    limit: float
    steps: int


def describe(path: Path) -> Description:
    """The description in a TOML file; the files it names are looked for beside it. Raises BadInput."""
    top = parse(path)
    required = ("title", "measurements", "time", "coordinates", "sensors", "motion", "prior")
    top.only(*required, "name", "truth", "divergence")
    title, measurements, time = top.text("title"), top.text("measurements"), top.choice("time", tuple(TIME))
    coordinates = _coordinates(top.section("coordinates"))
    sensors = top.section("sensors")
    if not sensors.data:
        raise BadInput(f"{sensors.where}: names no sensor; describe each in a table such as [sensors.radar]")
    motion = _motion(top.section("motion"), coordinates)
    limit, steps = math.inf, 1
    if "divergence" in top.data:
        rule = top.section("divergence")
        rule.only("limit", "steps")
        limit, steps = rule.quantities("limit", [LENGTH], above=0.0)[0], rule.count("steps", 1)
    return Description(
        path=path,
        name=top.text("name") if "name" in top.data else re.sub(r"[^\w.:+-]", "-", path.stem),
        title=title,
        measurements=path.parent / measurements,
        truth=path.parent / top.text("truth") if "truth" in top.data else None,
        time=time,
        coordinates=coordinates,
        instruments=tuple(_instrument(name, sensors.section(name), coordinates) for name in sensors.data),
        motion=motion,
        prior=_prior(top.section("prior"), motion, coordinates),
        limit=limit,
        steps=steps,
    )


def _coordinates(table: Section) -> Coordinates:
    geodetic = table.choice("kind", ("local", "geodetic")) == "geodetic"
    table.only("kind", "dimensions", *(("origin",) if geodetic else ()))
    found = Coordinates(geodetic, table.count("dimensions", 2, 3))
    # Even in the plane, an origin may have a height: that of the plane.
    origin = _place(table, "origin", [ANGLE, ANGLE, LENGTH]) if "origin" in table.data else None
    return Coordinates(geodetic, found.dimensions, origin)


def _place(table: Section, key: str, units: Sequence[Units]) -> Vector:
    """A place's coordinates."""
    found = table.quantities(key, units)
    if units[0] is ANGLE and abs(found[0]) > math.pi / 2:
        raise BadInput(f"{table.where}: a latitude in {key} must be from -90 to 90 degrees")
    return found


def _instrument(name: str, table: Section, coordinates: Coordinates) -> Instrument:
    kind = table.choice("kind", tuple(KINDS))
    placed = kind != "position"
    table.only("kind", "units", "std", *(("place",) if placed else ()))
    components = KINDS[kind] or coordinates.names
    if "elevation" in components and coordinates.dimensions == 2:
        raise BadInput(f"{table.where}: a sensor of kind {kind!r} needs coordinates of 3 dimensions")
    units = [UNITS[c] for c in components]
    scales = table.scales("units", units)
    if not placed:
        std = table.quantities("std", [LENGTH] * len(units), above=0.0)
        return Instrument(name, components, scales, None, coordinates.on_axes(std))
    place = _place(table, "place", coordinates.units)
    return Instrument(name, components, scales, place, table.quantities("std", units, above=0.0))


def _motion(table: Section, coordinates: Coordinates) -> Motion:
    kind = table.choice("kind", tuple(MOTIONS))
    turning = "turn_rate" in MOTIONS[kind]
    table.only("kind", "noise_density", *(("turn_noise_density",) if turning else ()))
    density = table.quantities("noise_density", [DENSITY[kind]] * coordinates.dimensions, low=0.0)
    return Motion(kind, density, table.quantities("turn_noise_density", [TURN_DENSITY], low=0.0)[0] if turning else 0.0)


def _prior(table: Section, motion: Motion, coordinates: Coordinates) -> Prior:
    parts = MOTIONS[motion.kind] if table.value("start") == FIRST_FIX else ("position", *MOTIONS[motion.kind])
    table.only("start", *parts, *(f"{part}_std" for part in parts))
    mean, std = {}, {}
    for part in parts:
        units = [UNITS[part]] * (1 if part == "turn_rate" else coordinates.dimensions)
        std[part] = table.quantities(f"{part}_std", units, low=0.0)
        if part == "position":
            mean[part], std[part] = _place(table, part, coordinates.units), coordinates.on_axes(std[part])
        else:  # zero unless it is known
            mean[part] = table.quantities(part, units) if part in table.data else (0.0,) * len(units)
    return Prior(table.value("start"), mean, std)
