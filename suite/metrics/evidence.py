"""What a metric looks at: the runs of an estimator on a case, and what is known beside them."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from suite import divergence
from suite.case import Card, Truth
from suite.case_bounds import BlockBound
from suite.estimator import Estimate
from suite.linalg import Array, cholesky, solve_lower

Flags = NDArray[np.bool_]
ROUNDING = 1e-9
"""Part of the largest value of a component of the state below which differences are rounding."""
REGULAR = 1e-8
"""Pivots of a correlation matrix above this leave no doubt that it is positive definite."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """Runs of an estimator on a case.

    bounds: those of the case. calm: the same estimator's runs on the twin of the case in which no manoeuvre happens, None
    without one. particles: how many the estimator carries, None where it has none.
    """

    case: Card
    truth: Truth
    estimate: Estimate
    bounds: Sequence[BlockBound] = ()
    calm: Estimate | None = None
    particles: int | None = None

    @functools.cached_property
    def error(self) -> Array:
        """Estimate minus truth [T, n, R]."""
        return self.estimate.mean - self.truth.x

    @functools.cached_property
    def squared_error(self) -> dict[str, Array]:
        """Squared Euclidean error [T, R] of each state block."""
        return {block.name: (self.error[:, list(block.components)] ** 2).sum(1) for block in self.case.blocks}

    @functools.cached_property
    def negligible(self) -> Array:
        """What of each component of the state counts as rounding [n]."""
        return rounding_of(self.truth.x)

    @functools.cached_property
    def certain(self) -> Flags:
        """Which components [T, n, R] the estimator knows exactly, and rightly so: the case lets nothing happen to them."""
        limit = self.negligible[:, None]
        deviation = np.sqrt(np.einsum("taar->tar", self.estimate.cov))
        return np.asarray((np.abs(self.error) <= limit) & (deviation <= limit))

    @functools.cached_property
    def dimension(self) -> Array:
        """How many components of the state there are to be uncertain about [T, R]; NaN where there are none."""
        found = (~self.certain).sum(1)
        return np.where(found, found, np.nan)

    @functools.cached_property
    def distance(self) -> Array:
        """eᵀ P⁻¹ e of the components that are not certain [T, R]; infinite where their covariance is singular."""
        certain = np.moveaxis(self.certain, 1, -1)
        error = np.where(certain, 0.0, np.moveaxis(self.error, 1, -1))
        cov = np.moveaxis(self.estimate.cov, (1, 2), (-2, -1))
        if certain.any():
            either = certain[..., :, None] | certain[..., None, :]
            cov = np.where(either, np.eye(certain.shape[-1]), cov)
        return mahalanobis(error, cov)

    @functools.cached_property
    def away(self) -> Array:
        """Step [R] from which on each run has diverged; see `suite.divergence.onset`."""
        return divergence.onset(self.case, self.truth, self.estimate)


def mahalanobis(error: Array, cov: Array) -> Array:
    """eᵀ P⁻¹ e for errors [..., n] and covariances [..., n, n].

    Components are brought to unit variance first: they differ in unit and size. NaN stays NaN; a covariance that is
    not positive definite in floating point gives infinity.
    """
    with np.errstate(all="ignore"):
        scale = np.sqrt(np.diagonal(cov, axis1=-2, axis2=-1))
        unit = error / scale
        correlation = cov / (scale[..., :, None] * scale[..., None, :])
    known = np.isfinite(error).all(-1) & np.isfinite(cov).all((-2, -1))
    sound = known & np.isfinite(correlation).all((-2, -1)) & np.isfinite(unit).all(-1)
    out = np.where(known, np.inf, np.nan)
    n = error.shape[-1]
    safe = np.where(sound[..., None, None], correlation, np.eye(n)).reshape(-1, n, n)
    unit = np.where(sound[..., None], unit, 0.0).reshape(-1, n)
    lower = cholesky(safe)
    regular = np.asarray((np.diagonal(lower, axis1=-2, axis2=-1) ** 2 > REGULAR).all(-1))
    distance = (solve_lower(np.where(regular[:, None, None], lower, np.eye(n)), unit) ** 2).sum(-1)
    distance[~regular] = _along_axes(unit[~regular], safe[~regular])
    return np.where(sound, distance.reshape(sound.shape), out)


def _along_axes(unit: Array, correlation: Array) -> Array:
    """eᵀ C⁻¹ e by the eigenvalues of C[R, n, n], where Cholesky's pivots leave doubt; infinite where C is singular."""
    values, directions = np.linalg.eigh(correlation)
    positive = values[:, 0] > unit.shape[1] * np.finfo(float).eps * values[:, -1]
    along = np.einsum("rij,ri->rj", directions, unit)
    return np.where(positive, (along**2 / np.where(values > 0, values, 1.0)).sum(-1), np.inf)


def rounding_of(x: Array) -> Array:
    """What of each component of states x[T, n, R] counts as rounding [n]: a share of its largest size."""
    with np.errstate(all="ignore"):
        return np.asarray(ROUNDING * np.fmax.reduce(np.abs(x), axis=(0, 2), initial=0.0))
