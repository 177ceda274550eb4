"""Linear algebra on small matrices, one for each particle: a[m, n, ...], matrix axes first.

Loops over matrix indices of whole arrays: some tens of times faster than `numpy.linalg` on a stack of small matrices, and a
particle's bits do not depend on how many stand beside it.
"""

from collections.abc import Sequence

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
    lower = np.zeros(matrix.shape)  # unlike zeros_like, it leaves untouched what is never used
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
    total = np.log(lower[0, 0])
    for i in range(1, len(lower)):
        total = total + np.log(lower[i, i])
    return np.asarray(total)


def combine(entries: Array, rows: Array | Sequence[Array]) -> Array:
    """Sum of entries[n, ...] times n arrays; entries that are zero everywhere cost nothing."""
    terms = [entry * row for entry, row in zip(entries, rows, strict=True) if entry.any()]
    total = terms[0] if terms else np.zeros((1,) * (entries.ndim - 1))
    for term in terms[1:]:
        total += term
    return np.asarray(total)


def eliminate(cov: Array, count: int) -> None:
    """Cholesky's recursion on the lower triangle of cov[n, n, ...], in place, stopped after `count` columns.

    These become the first columns of the Cholesky factor; what remains is the covariance of the other components given the
    first ones (the Schur complement). A covariance may be singular: a zero pivot leaves a zero column.
    """
    smallest = [1e-12 * cov[j, j] for j in range(count)]
    for j in range(count):
        pivot = cov[j, j]
        cov[j:, j] /= np.sqrt(np.where(pivot <= smallest[j], np.inf, pivot))
        for i in range(j + 1, len(cov)):
            cov[i, j + 1 : i + 1] -= cov[i, j] * cov[j + 1 : i + 1, j]


def determinant(matrix: Array) -> Array:
    """Determinant of matrix[m, m, ...] by elimination without exchange of rows: [...].

    For matrices whose symmetric part is near a positive definite one, whose pivots are not near zero.
    """
    rest, product = matrix.copy(), np.ones(matrix.shape[2:])
    for j in range(len(rest)):
        pivot = rest[j, j]
        product *= pivot
        for i in range(j + 1, len(rest)):
            rest[i, j + 1 :] -= rest[i, j] / pivot * rest[j, j + 1 :]
    return product
