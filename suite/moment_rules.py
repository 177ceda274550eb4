"""Moment rules: from the Gaussian law of a state to the moments of a function of it.

A rule gives deviations rather than covariances, so that filters can work on square roots. With it an extended, unscented,
cubature or Gauss-Hermite filter is the one Gaussian filter of suite/gaussian.py.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np

from suite.linalg import Array
from suite.model import Affine


class Law(Protocol):
    """A function with what rules need to know of it."""

    @property
    def mean(self) -> Callable[[Array, int], Array]:
        """The function: mean(x[n, ...], k) -> [p, ...]."""

    def linearised(self, x: Array, k: int) -> tuple[Array, Array]:
        """Value [p, ...] and derivative [p, n, ...] at x[n, ...]."""

    def residual(self, z: Array, expected: Array) -> Array:
        """Difference of two values [p, ...], angles wrapped."""


@dataclass(frozen=True)
class Spread:
    """Mean value[R, p] of a function, and deviations dx[R, n, s] of its argument and dy[R, p, s] of itself.

    Their products are covariances: dx dxᵀ of the argument, dx dyᵀ of both, dy dyᵀ of the function. aside[R, p]: where the
    function was expanded about a point off the mean, `value` is that at the point, and the mean is value + aside.
    """

    value: Array
    dx: Array
    dy: Array
    aside: Array | None = None


Rule = Callable[[Array, Array, Law, int], Spread]
"""rule(mean[R, n], root[R, n, n], law, k) -> Spread, where root rootᵀ is the covariance of the argument."""


def affine(mean: Array, root: Array, law: Law, k: int) -> Spread:
    """The exact rule for affine functions: the Kalman filter (Kalman, 1960)."""
    assert isinstance(law.mean, Affine)
    matrix = law.mean.matrix(k)
    value = (matrix @ mean[..., None])[..., 0]
    return Spread(value if law.mean.offset is None else value + law.mean.offset, root, matrix @ root)


def taylor(mean: Array, root: Array, law: Law, k: int) -> Spread:
    """First-order Taylor expansion about the mean: the extended Kalman filter (Jazwinski, 1970, section 8.3)."""
    if isinstance(law.mean, Affine):
        return affine(mean, root, law, k)
    value, slope = _tangent(law, mean, k)
    return Spread(value, root, slope @ root)


def about(point: Array) -> Rule:
    """First-order Taylor expansion about a point [R, n] that need not be the mean: what an iterated filter relinearises by.

    Components that the argument has beyond those of the point, a noise inside the function, are expanded about their mean.
    """

    def rule(mean: Array, root: Array, law: Law, k: int) -> Spread:
        at = np.concat([point, mean[:, point.shape[1] :]], axis=1)
        value, slope = _tangent(law, at, k)
        # The two are kept apart: an angle's difference to the value wraps, what is extrapolated from there does not.
        return Spread(value, root, slope @ root, aside=(slope @ (mean - at)[..., None])[..., 0])

    return rule


def _tangent(law: Law, at: Array, k: int) -> tuple[Array, Array]:
    """Value [R, p] and derivative [R, p, n] at points [R, n]."""
    value, slope = law.linearised(np.ascontiguousarray(at.T), k)
    return value.T, np.ascontiguousarray(slope.transpose(2, 0, 1))


@lru_cache(maxsize=64)
def unscented(alpha: float, beta: float, kappa: float) -> Rule:
    """The scaled unscented rule with 2n + 1 sigma points (Julier and Uhlmann, 2004; Wan and van der Merwe, 2000).

    In covariances the paper gives the central point the weight 1 - n / (alpha² (n + kappa)) + 1 - alpha² + beta, which is
    negative for a small alpha. With deviations from the mean of the other points' values, rather than from the weighted mean
    of all, the same covariance has a weight beta + alpha² kappa / n, never negative for beta and kappa that are not.
    """

    def points(n: int) -> Points:
        spread = alpha**2 * (n + kappa)
        offsets = np.sqrt(spread) * np.concat([np.eye(n), -np.eye(n)], axis=1)
        return Points(offsets, np.full(2 * n, 0.5 / spread), beta + alpha**2 * kappa / n)

    return _sigma_points(points)


def cubature() -> Rule:
    """The third-degree spherical-radial cubature rule: 2n equally weighted points (Arasaratnam and Haykin, 2009)."""
    return unscented(1.0, 0.0, 0.0)


@lru_cache(maxsize=64)
def gauss_hermite(order: int) -> Rule:
    """The Gauss-Hermite product rule with order^n points (Ito and Xiong, 2000; Arasaratnam, Haykin and Elliott, 2007)."""
    line, weight = np.polynomial.hermite_e.hermegauss(order)
    weight = weight / weight.sum()

    def points(n: int) -> Points:
        grids = np.meshgrid(*[line] * n, indexing="ij")
        weights = np.prod(np.meshgrid(*[weight] * n, indexing="ij"), axis=0)
        return Points(np.stack([g.ravel() for g in grids]), weights.ravel(), bend=0.0)

    return _sigma_points(points)


@dataclass(frozen=True)
class Points:
    """Offsets [n, s] from the mean in units of the root, and their weights [s] in means and covariances.

    What the weights leave of one belongs to the mean itself. Values deviate from their own average; how far this average,
    times the sum of the weights, lies from the value at the mean has the weight `bend` in covariances.
    """

    offsets: Array
    weights: Array
    bend: float


def _sigma_points(points: Callable[[int], Points]) -> Rule:
    """The rule that sums over points.

    What is summed are differences to the value at the mean, which is right for angles as well.
    """
    points = lru_cache(maxsize=16)(points)

    def rule(mean: Array, root: Array, law: Law, k: int) -> Spread:
        known = points(mean.shape[1])
        away = root @ known.offsets
        (runs, n, size), half = away.shape, np.sqrt(known.weights)
        at = np.empty((n, runs, 1 + size))
        at[:, :, 0] = mean.T
        np.add(at[:, :, :1], away.transpose(1, 0, 2), out=at[:, :, 1:])
        values = law.mean(at, k)
        centre = values[:, :, :1]
        rest = law.residual(values[:, :, 1:], centre)
        shift = np.vecdot(rest, known.weights)
        extra = 1 if known.bend else 0
        dx, dy = np.zeros((runs, n, size + extra)), np.empty((runs, len(rest), size + extra))
        np.multiply(away, half, out=dx[:, :, :size])
        rest -= (shift / known.weights.sum())[..., None]
        np.multiply(rest.transpose(1, 0, 2), half, out=dy[:, :, :size])
        if extra:
            np.multiply(shift.T, np.sqrt(known.bend), out=dy[:, :, size])
        return Spread((centre[:, :, 0] + shift).T, dx, dy)

    return rule
