"""Standard motions of a target over irregular times, and what sensors on the ground see of it.

The state is position, velocity, then acceleration or turn rate: x[n, ...] with n = 2d, 3d or 2d + 1 in d dimensions. Units
are m, s and rad. Bearings run clockwise from the y axis (north), elevations upwards from the plane of x and y.
"""

import functools
import math
import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from suite.angles import difference
from suite.jacobian import derivative, value_and_derivative
from suite.linalg import Array
from suite.model import AdditiveTransition, Affine, Function
from suite.noise import Gaussian


def polynomial(intervals: Sequence[float], density: Sequence[float], order: int) -> AdditiveTransition:
    """Nearly constant velocity (order 1) or acceleration (order 2) over the intervals before the steps 1..T.

    density: of the white noise in the highest derivative, on each axis (Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation
    with Applications to Tracking and Navigation, 2001, section 6.2).
    """

    @functools.cache
    def matrix(time: float) -> Array:
        return _on_axes(_taylor(time, order), np.eye(len(density)))

    @functools.cache
    def noise(time: float) -> Gaussian:
        return Gaussian.noise(_on_axes(_integrated(time, order), np.diag(density)))

    return AdditiveTransition(Affine(lambda k: matrix(intervals[k - 1])), lambda k: noise(intervals[k - 1]))


def coordinated_turn(intervals: Sequence[float], density: Sequence[float], turn_density: float) -> AdditiveTransition:
    """Turns about the vertical at a nearly constant rate, counter-clockwise where it is positive; heights as in `polynomial`.

    density: of white accelerations on each axis; turn_density: of the white noise that drives the turn rate. Both noises are
    those of straight flight over the interval (Bar-Shalom, Li and Kirubarajan, 2001, section 11.7).
    """
    d = len(density)

    def move(x: Array, k: int) -> Array:
        time, east, north, rate = intervals[k - 1], x[d], x[d + 1], x[2 * d]
        angle = rate * time
        along = time * sinc(angle)
        aside = time * (0.5 * angle) * sinc(0.5 * angle) * sinc(0.5 * angle)
        sine, cosine = np.sin(angle), np.cos(angle)
        moved = [x[0] + along * east - aside * north, x[1] + aside * east + along * north]
        turned = [cosine * east - sine * north, sine * east + cosine * north]
        if d == 3:
            moved, turned = [*moved, x[2] + time * x[5]], [*turned, x[5]]
        return np.stack([*moved, *turned, rate])

    @functools.cache
    def noise(time: float) -> Gaussian:
        return Gaussian.noise(block_diag(_on_axes(_integrated(time, 1), np.diag(density)), np.eye(1) * turn_density * time))

    return AdditiveTransition(move, lambda k: noise(intervals[k - 1]))


def sinc(a: Array) -> Array:
    """sin(a) / a, and its limit near zero: by its series where that is exact in floating point."""
    small = np.abs(a) < 0.01
    square = a * a
    return np.where(small, 1.0 - square / 6.0 * (1.0 - square / 20.0), np.sin(a) / np.where(small, 1.0, a))


@dataclass(frozen=True, eq=False)
class Surface:
    """A curved ground s Q s + 2 up = 0 under the plane of the state, at s = (x, y, up) in m; bend: Q[3, 3] in 1/m."""

    bend: Array

    def rise(self, place: Sequence[Array], velocity: Sequence[Array]) -> tuple[Array, Array]:
        """Height [...] over the plane at a place (x, y) in it, and how fast it changes at a velocity (vx, vy) there."""
        (x, y), bend = place, self.bend
        aside = [bend[i, 0] * x + bend[i, 1] * y for i in range(3)]
        half, rest = 1.0 + aside[2], x * aside[0] + y * aside[1]
        # Near a quarter round the earth the ground stands upright; from there it goes on so that stray points have a height.
        root = np.sqrt(np.maximum(half * half - bend[2, 2] * rest, 0.01))
        up = -rest / (half + root)
        slopes = [(aside[i] + bend[i, 2] * up) / root for i in range(2)]
        return up, -_dot(slopes, velocity)


@dataclass(frozen=True, eq=False)
class Station:
    """A place on the ground; the rows of axes[q, q] are its east, north (and up) in the coordinates of place[q].

    These are those of a target in the state. Where there is a surface, q is 3, and targets have two and are on that surface.
    """

    place: Array
    axes: Array
    surface: Surface | None = None

    @property
    def dimensions(self) -> int:
        """How many coordinates a target has in the state."""
        return len(self.place) if self.surface is None else 2

    def look(self, components: Sequence[str]) -> Callable[[Array], list[Array]]:
        """The components of a measurement from here, as a function of the state x[n, ...]."""
        d = self.dimensions

        def seen(x: Array) -> list[Array]:
            at, velocity = [x[i] for i in range(d)], [x[d + i] for i in range(d)]
            if self.surface is not None:
                at, velocity = [[*part, up] for part, up in zip((at, velocity), self.surface.rise(at, velocity), strict=True)]
            away = [a - own for a, own in zip(at, self.place, strict=True)]
            distance = np.sqrt(_dot(away, away))
            level = [_dot(row[row != 0], [a for a, entry in zip(away, row, strict=True) if entry]) for row in self.axes]
            rows: dict[str, Callable[[], Array]] = {
                "range": lambda: distance,
                "range-rate": lambda: _dot(away, velocity) / distance,
                "bearing": lambda: np.atan2(level[0], level[1]),
                "elevation": lambda: np.atan2(level[2], np.sqrt(level[0] * level[0] + level[1] * level[1])),
            }
            return [rows[component]() for component in components]

        return seen

    def fix(self, components: Sequence[str], y: Array, cov: Array) -> tuple[Array, Array] | None:
        """The position [d] that a measurement y[m] with covariance [m, m] means, and its covariance to first order.

        None when it determines no position, as at range zero (Bar-Shalom, Li and Kirubarajan, 2001, section 10.4).
        """
        d = self.dimensions
        needed = ("range", "bearing", "elevation")[:d]
        if not set(needed) <= set(components) or y[components.index("range")] == 0:
            return None
        rows = [components.index(name) for name in needed]

        def position(polar: Array) -> Array:
            level = polar[0] if len(polar) == 2 else polar[0] * np.cos(polar[2])
            plane = [level * np.sin(polar[1]), level * np.cos(polar[1])]
            return np.stack(plane if len(polar) == 2 else [*plane, polar[0] * np.sin(polar[2])])

        back, seen, cov = np.linalg.inv(self.axes), y[rows], cov[np.ix_(rows, rows)]
        if self.surface is None:
            slope = back @ derivative(position, seen)
            return self.place + back @ position(seen), slope @ cov @ slope.T
        look = self.look(needed)
        found = (self.place + back @ position(np.array([*seen, 0.0])))[:d]
        for _ in range(9):  # from the horizon down to the surface, by Newton's method
            expected, slopes = value_and_derivative(lambda x: np.stack(look(x)), np.concat([found, np.zeros(d)]), range(d))
            off, slope = difference(seen, expected, (1,)), np.asarray(np.linalg.inv(slopes))
            found = found + slope @ off
        return (found, slope @ cov @ slope.T) if abs(off[0]) < 1e-3 else None


def stacked(parts: Sequence[Callable[[Array], Sequence[Array]]]) -> Function:
    """The components that all parts give, one below the other."""
    return lambda x, k: np.stack([row for part in parts for row in part(x)])


def _dot(a: Sequence[Array] | Array, b: Sequence[Array]) -> Array:
    return functools.reduce(operator.add, [p * q for p, q in zip(a, b, strict=True)])


def _on_axes(block: Array, axes: Array) -> Array:
    """A matrix for one axis, on all axes of a state that holds one derivative after the other."""
    return np.asarray(np.kron(block, axes), float)


def _taylor(time: float, order: int) -> Array:
    """Entries T^(j-i) / (j-i)! at and above the diagonal."""
    size = range(order + 1)
    return np.array([[time ** (j - i) / math.factorial(j - i) if j >= i else 0.0 for j in size] for i in size])


def _integrated(time: float, order: int) -> Array:
    """Covariance of white noise of unit density, integrated over a time `order` + 1 times and fewer."""
    size = range(order + 1)
    return np.array(
        [
            [time ** (1 + i + j) / ((1 + i + j) * math.factorial(i) * math.factorial(j)) for j in reversed(size)]
            for i in reversed(size)
        ]
    )
