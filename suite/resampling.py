"""Resampling schemes: from weights [R, N] to the indices [R, N] of the particles that survive."""

import numpy as np
from numpy.typing import NDArray

from suite.linalg import Array
from suite.random import Generators


def systematic(weights: Array, rng: Generators) -> NDArray[np.intp]:
    """Systematic resampling: one uniform number a run, offspring counts floor or ceil of N w (Kitagawa, 1996).

    Indices come out sorted. Slot s is filled by the first particle whose cumulative weight exceeds (s + u) / N, found
    by scattering each particle to its first slot and carrying the largest index forward: no search.
    """
    runs, count = weights.shape
    uniform = rng.random((1, runs, 1))[0]
    cumulative = np.cumsum(weights, axis=1)
    ends = np.clip(np.ceil(cumulative * count - uniform), 0, count)
    # Rounding must neither leave the last slots without a parent nor give them to one behind the last positive weight.
    # A run of NaN weights is lost already; any indices do, as long as they are indices.
    ends = np.where(cumulative < cumulative[:, -1:], ends, count).astype(np.intp)
    starts = np.concatenate([np.zeros((runs, 1), np.intp), ends[:, :-1]], axis=1)
    run, parent = np.nonzero(ends > starts)
    indices = np.zeros((runs, count), np.intp)
    indices[run, starts[run, parent]] = parent
    return np.asarray(np.maximum.accumulate(indices, axis=1))


def select(x: Array, indices: NDArray[np.intp]) -> Array:
    """Particles x[n, R, N] picked by indices [R, N] within each run."""
    runs, count = indices.shape
    flat = (indices + count * np.arange(runs)[:, None]).ravel()
    return np.asarray(np.take(x.reshape(len(x), -1), flat, axis=1, mode="clip")).reshape(x.shape)
