"""What the files of a recording hold: the readings of its sensors, its truth, and the frame in which both are put."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement

import numpy as np
import pymap3d  # type: ignore[import-untyped]

from suite.columns import Columns, read
from suite.description import TIME, Description, Instrument
from suite.errors import BadInput, near
from suite.kinematics import Station, Surface
from suite.linalg import Array


@dataclass(frozen=True, eq=False)
class Reading:
    """What a sensor, counted from 0, reported at an instant: y[m], and its covariance [m, m] where the row has one."""

    instant: float
    sensor: int
    y: Array
    cov: Array | None


@dataclass(frozen=True)
class Frame:
    """The coordinates of the state: local metres, or east, north and up of a geodetic origin (rad, rad, m)."""

    dimensions: int
    origin: tuple[float, ...] | None

    def position(self, place: Sequence[float] | Array) -> Array:
        """A place in the coordinates of the state [d]; in two dimensions all is at the height of the origin."""
        return self._in_space(place)[: self.dimensions]

    def station(self, place: Sequence[float]) -> Station:
        """A place that is measured from: its east, north and up are turned against those of the origin."""
        at = self._in_space(place)
        if self.origin is None:
            return Station(at, np.eye(self.dimensions))
        axes = _to_earth(*self.origin[:2])
        return Station(at, _to_earth(*place[:2]).T @ axes, _ground(axes, self.origin) if self.dimensions == 2 else None)

    def _in_space(self, place: Sequence[float] | Array) -> Array:
        """A place as local metres [d], or as east, north and up of the origin [3]."""
        if self.origin is None:
            return np.array(place, float)
        latitude, longitude, height = (*place, self.origin[2])[:3]
        return np.array(pymap3d.geodetic2enu(latitude, longitude, height, *self.origin, deg=False), float)


def recorded(told: Description) -> tuple[list[Reading], Frame]:
    """The readings of the described file, in its order, and their frame. Raises BadInput."""
    table = read(told.measurements)
    found = [_reading(told, table, row, columns) for row, columns in enumerate(_columns(told, table))]
    for row, (reading, before) in enumerate(zip(found[1:], found, strict=False), start=1):
        if reading.instant < before.instant:
            raise BadInput(f"{table.at(row, 'time')}: is before the time of the row above")
    seen: set[tuple[float, int]] = set()
    for row, reading in enumerate(found):
        if (reading.instant, reading.sensor) in seen:
            raise BadInput(f"{table.at(row)}: sensor {told.instruments[reading.sensor].name!r} reports twice at one time")
        seen.add((reading.instant, reading.sensor))
    frame = Frame(told.coordinates.dimensions, _origin(told, found))
    placed = [told.instruments[r.sensor].place is not None for r in found]
    return [r if p else replace(r, y=frame.position(r.y)) for r, p in zip(found, placed, strict=True)], frame


def known(told: Description, frame: Frame, names: Sequence[str], instants: Sequence[float]) -> Array:
    """The true states [T, n] at some instants, NaN where unknown; linear between the rows of the described file.

    Raises BadInput when the file is not as it must be, or its times do not reach over the instants.
    """
    if told.truth is None:
        return np.full((len(instants), len(names)), np.nan)
    table, place, d = read(told.truth), told.coordinates.names, frame.dimensions
    table.need(("time", *place))
    table.only(("time", *place, *names[d:]))
    rows = range(len(table.lines))
    times = [table.instant(row, told.time) for row in rows]
    for row in rows[1:]:
        if times[row] <= times[row - 1]:
            raise BadInput(f"{table.at(row, 'time')}: is not after the time of the row above")
    at, since = np.array([t - times[0] for t in instants], float), np.array([t - times[0] for t in times], float)
    outside = np.flatnonzero((at < 0) | (at > since[-1]))
    if len(outside):
        end, step = ("begins", 0) if at[outside[0]] < 0 else ("ends", -1)
        gap = abs(instants[outside[step]] - times[step]) * TIME[told.time]
        side = "after the first" if step == 0 else "before the last"
        raise BadInput(f"{table.at(rows[step], 'time')}: the truth {end} {gap:g} s {side} measurement to be estimated")
    x = np.full((len(instants), len(names)), np.nan)
    degrees = np.array([np.pi / 180 if n in ("latitude", "longitude") else 1.0 for n in place])
    places = [degrees * [table.number(row, n) for n in place] for row in rows]
    if told.coordinates.geodetic:
        for row in rows:
            _on_globe(places[row][0], table, row, "latitude")
    positions = [frame.position(at) for at in places]
    x[:, :d] = np.transpose([np.interp(at, since, column) for column in np.transpose(positions)])
    for i, name in enumerate(names[d:], start=d):
        if name in table.cells:
            x[:, i] = np.interp(at, since, [table.number(row, name) for row in rows])
    return x


def _columns(told: Description, table: Columns) -> list[tuple[int, Sequence[str]]]:
    """For each row, which sensor reports and in which columns its components stand."""
    table.need(("time", "sensor"))
    widest = max(len(i.components) for i in told.instruments)
    numbered = [f"z{j}" for j in range(1, widest + 1)] if "z1" in table.cells else []
    own = [numbered[: len(i.components)] or i.components for i in told.instruments]
    covariances = [f"cov{i}{j}" for i, j in combinations_with_replacement(range(1, widest + 1), 2)]
    table.only(("time", "sensor", *dict.fromkeys(c for columns in own for c in columns), *covariances))
    for columns in own:
        table.need(columns)
    names = [i.name for i in told.instruments]
    found: list[tuple[int, Sequence[str]]] = []
    for row in range(len(table.lines)):
        name = table.text(row, "sensor")
        if name not in names:
            raise BadInput(f"{table.at(row, 'sensor')}: unknown sensor {name!r}; {near(name, names)}")
        found.append((names.index(name), own[names.index(name)]))
    return found


def _reading(told: Description, table: Columns, row: int, where: tuple[int, Sequence[str]]) -> Reading:
    sensor, columns = where
    instrument, size = told.instruments[sensor], range(1, len(columns) + 1)
    pairs = [f"cov{i}{j}" for i, j in combinations_with_replacement(size, 2)]
    for column in table.cells:
        if column not in ("time", "sensor", *columns, *pairs) and not table.blank(row, column):
            raise BadInput(f"{table.at(row, column)}: sensor {instrument.name!r} has no such component")
    y = np.array([table.number(row, c) for c in columns]) * instrument.scale
    if instrument.components[0] == "latitude":
        _on_globe(y[0], table, row, columns[0])
    if instrument.components[0] == "range" and y[0] < 0:
        raise BadInput(f"{table.at(row, columns[0])}: a range must be zero or above")
    given = any(c in table.cells and not table.blank(row, c) for c in pairs)
    return Reading(table.instant(row, told.time), sensor, y, _covariance(told, table, row, instrument) if given else None)


def _on_globe(latitude: float, table: Columns, row: int, column: str) -> None:
    if abs(latitude) > np.pi / 2:
        raise BadInput(f"{table.at(row, column)}: a latitude must be from -90 to 90 degrees")


def _covariance(told: Description, table: Columns, row: int, instrument: Instrument) -> Array:
    """A row's covariance [m, m] in m, s and rad, of a position along the axes of the state.

    Covariances, but not variances, that are left blank are zero.
    """
    size = len(instrument.components)
    cov = np.zeros((size, size))
    for i, j in combinations_with_replacement(range(size), 2):
        column = f"cov{i + 1}{j + 1}"
        if i == j:
            table.need((column,))
        if i == j or (column in table.cells and not table.blank(row, column)):
            cov[i, j] = cov[j, i] = table.number(row, column)
    try:
        np.linalg.cholesky(cov)
    except np.linalg.LinAlgError:
        raise BadInput(f"{table.at(row)}: the covariance is not positive definite") from None
    if instrument.components[0] == "latitude":  # in m² already
        order = told.coordinates.on_axes(range(size))
        return cov[np.ix_(order, order)]
    return np.asarray(cov * np.outer(instrument.scale, instrument.scale))


def _origin(told: Description, found: Sequence[Reading]) -> tuple[float, ...] | None:
    """The stated origin, or the first measured position."""
    if not told.coordinates.geodetic or told.coordinates.origin is not None:
        return told.coordinates.origin
    for reading in found:
        if told.instruments[reading.sensor].place is None:
            return (*reading.y.tolist(), 0.0)[:3]
    raise BadInput(f"{told.path}, [coordinates]: no position is measured; state an origin")


def _ground(axes: Array, origin: Sequence[float]) -> Surface:
    """The places at the height of the origin: the ellipsoid with that height added to its semi-axes, exact to 1 cm."""
    globe = pymap3d.Ellipsoid.from_name("wgs84")
    equator, pole = globe.semimajor_axis + origin[2], globe.semiminor_axis + origin[2]
    weights = np.array([equator, equator, pole]) ** -2.0
    centre = np.array(pymap3d.geodetic2ecef(*origin, deg=False))
    return Surface(axes.T * weights @ axes / (axes[:, 2] * weights @ centre))


def _to_earth(latitude: float, longitude: float) -> Array:
    """East, north and up at a place as columns of a matrix [3, 3], in earth-centred coordinates."""
    return np.stack(pymap3d.enu2uvw(*np.eye(3), latitude, longitude, deg=False))
