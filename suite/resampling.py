"""Resampling schemes: from weights [R, N] to the sorted indices [R, N] of the particles that survive.

Each gives particle i an expected number of N w_i offspring and never picks a particle of weight zero. A run whose weights
are NaN is lost already; it gets some indices, and the other runs of the batch do not notice.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from suite.linalg import Array
from suite.random import Generators

Indices = NDArray[np.intp]
Scheme = Callable[[Array, Generators], Indices]


def multinomial(weights: Array, rng: Generators) -> Indices:
    """Multinomial resampling: N independent draws (Gordon, Salmond and Smith, 1993).

    The uniform numbers are made in ascending order, as normalised partial sums of exponential ones.
    """
    runs, count = weights.shape
    sums = np.cumsum(rng.standard_exponential((1, runs, count + 1))[0], axis=1)
    points = sums[:, :-1] * (count / sums[:, -1:])
    cumulative = _cumulative(weights)
    # Both are sorted, and to merge them takes half the time of a search for each.
    merged = np.argsort(np.concat([cumulative, points], axis=1), axis=1, kind="stable")
    places = np.nonzero(merged < count)[1].reshape(runs, count)
    return _carried(np.asarray(places - np.arange(count), float), cumulative)


def residual(weights: Array, rng: Generators) -> Indices:
    """Residual resampling: floor(N w) copies for certain, multinomial draws for the rest (Liu and Chen, 1998).

    What is left of a particle is N w - floor(N w); some libraries take w - floor(N w), which is wrong.
    """
    runs, count = weights.shape
    expected = np.nan_to_num(weights) * count
    # A weight that is a multiple of 1/N but for rounding leaves nothing.
    certain = np.floor(expected * (1 + 1e-12) + 1e-12)
    left = np.maximum(expected - certain, 0.0)
    open_slots = np.maximum(count - certain.sum(1), 0.0)
    sums = np.cumsum(rng.standard_exponential((1, runs, count + 1))[0], axis=1)
    drawn = np.zeros_like(certain)
    for r, slots in enumerate(open_slots.astype(int)):
        total = np.cumsum(left[r])
        if slots and total[-1] > 0:
            ends = np.searchsorted(sums[r, :slots] * (total[-1] / sums[r, slots]), total)
            ends[total >= total[-1]] = slots
            drawn[r] = np.diff(ends, prepend=0)
    return _carried(np.cumsum(certain + drawn, axis=1), _cumulative(weights))


def stratified(weights: Array, rng: Generators) -> Indices:
    """Stratified resampling: one uniform number in each of N equal strata (Kitagawa, 1996)."""
    runs, count = weights.shape
    uniform = rng.random((1, runs, count))[0]
    cumulative = _cumulative(weights)
    stratum = np.floor(np.nan_to_num(cumulative))
    inside = np.take_along_axis(uniform, np.clip(stratum, 0, count - 1).astype(np.intp), axis=1)
    return _carried(stratum + (inside < cumulative - stratum), cumulative)


def systematic(weights: Array, rng: Generators) -> Indices:
    """Systematic resampling: one uniform number a run, offspring counts floor or ceil of N w (Kitagawa, 1996)."""
    uniform = rng.random((1, len(weights), 1))[0]
    cumulative = _cumulative(weights)
    return _carried(np.ceil(cumulative - uniform), cumulative)


SCHEMES: Mapping[str, Scheme] = MappingProxyType(
    {scheme.__name__: scheme for scheme in (systematic, stratified, residual, multinomial)}
)


def select(x: Array, indices: Indices) -> Array:
    """Particles x[n, R, N] picked by indices [R, M] within each run: [n, R, M]."""
    *axes, runs, count = x.shape
    flat = (indices + count * np.arange(runs)[:, None] if runs > 1 else indices).ravel()
    picked = np.take(x.reshape(*axes, runs * count), flat, axis=-1, mode="clip")
    return np.asarray(picked).reshape(*axes, *indices.shape)


def _cumulative(weights: Array) -> Array:
    """Expected number of offspring [R, N] of each particle and all before it."""
    return np.asarray(np.cumsum(weights, axis=1) * weights.shape[1])


def _carried(ends: Array, cumulative: Array) -> Indices:
    """Indices [R, N] from the number of slots `ends` that are filled by each particle and all before it.

    Rounding must neither leave the last slots without a parent nor give them to one behind the last positive weight.
    """
    runs, count = cumulative.shape
    ends = np.where(cumulative < cumulative[:, -1:], np.minimum(ends, count), count)
    offspring = np.empty((runs, count), np.intp)
    offspring[:, 0] = ends[:, 0]
    np.subtract(ends[:, 1:], ends[:, :-1], out=offspring[:, 1:], casting="unsafe")
    parents = np.repeat(np.arange(runs * count), offspring.ravel()).reshape(runs, count)
    return parents - count * np.arange(runs)[:, None] if runs > 1 else parents
