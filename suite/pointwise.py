"""Linear algebra on small matrices, one for each particle: a[m, n, ...], matrix axes first.

Loops over matrix indices of whole arrays: some tens of times faster than `numpy.linalg` on a stack of small matrices, and a
particle's bits do not depend on how many stand beside it.
"""

import numpy as np

from suite.linalg import Array


def dot(a: Array, b: Array) -> Array:
    """Sum of products over the leading axis, in a fixed order."""
    total = a[0] * b[0]
    for p, q in zip(a[1:], b[1:], strict=True):
        total += p * q
    return np.asarray(total)


def times(matrix: Array, x: Array) -> Array:
    """Product of matrix[m, n, ...] and x[n, ...]: [m, ...]."""
    return np.stack([dot(row, x) for row in matrix])


def transposed_times(matrix: Array, x: Array) -> Array:
    """Product of the transpose of matrix[m, n, ...] and x[m, ...]: [n, ...]."""
    return np.stack([dot(column, x) for column in np.swapaxes(matrix, 0, 1)])


def cholesky(matrix: Array) -> Array:
    """Lower Cholesky factor of matrix[m, m, ...]; NaN where it is not positive definite."""
    m = len(matrix)
    lower = np.zeros_like(matrix)
    for j in range(m):
        pivot = matrix[j, j] - dot(lower[j, :j], lower[j, :j]) if j else matrix[j, j]
        np.sqrt(pivot, out=lower[j, j])
        for i in range(j + 1, m):
            rest = matrix[i, j] - dot(lower[i, :j], lower[j, :j]) if j else matrix[i, j]
            np.divide(rest, lower[j, j], out=lower[i, j])
    return lower


def solve_lower(lower: Array, b: Array) -> Array:
    """Solution z of L z = b[m, ...]."""
    z = np.empty(np.broadcast_shapes(lower.shape[1:], b.shape))
    for i, row in enumerate(b):
        rest = row - dot(lower[i, :i], z[:i]) if i else row
        np.divide(rest, lower[i, i], out=z[i])
    return z


def solve_upper(lower: Array, b: Array) -> Array:
    """Solution z of L' z = b[m, ...]."""
    m = len(b)
    z = np.empty(np.broadcast_shapes(lower.shape[1:], b.shape))
    for i in reversed(range(m)):
        rest = b[i] - dot(lower[i + 1 :, i], z[i + 1 :]) if i < m - 1 else b[i]
        np.divide(rest, lower[i, i], out=z[i])
    return z


def log_diagonal(lower: Array) -> Array:
    """Half the log-determinant of L L': the sum of the logarithms of L's diagonal [...]."""
    product = lower[0, 0]
    for i in range(1, len(lower)):
        product = product * lower[i, i]
    return np.asarray(np.log(product))
