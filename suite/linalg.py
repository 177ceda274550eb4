"""Small dense algebra: constant matrices on components-first arrays, and stacks of matrices one a run."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from suite.checks import finite

Array = NDArray[np.float64]
_tri = lru_cache(maxsize=64)(np.tri)


def apply(matrix: Array, x: Array) -> Array:
    """Product of a constant matrix [p, n] with x[n, ...], over any trailing axes: [p, ...].

    Written as a loop over matrix entries: structural zeros cost nothing, and a run's bits do not depend on how many
    runs stand beside it (a BLAS call over the flattened trailing axes would not promise that). Dual numbers are not written
    into an array: they get the same sums as an expression. Raises ValueError when the matrix does not fit.
    """
    if matrix.shape[1:] != (len(x),):
        raise ValueError(f"a matrix of shape {matrix.shape} does not fit a vector of {len(x)} components")
    if not isinstance(x, np.ndarray):
        zero = np.zeros(x.shape[1:])
        return np.stack([sum((a * part for a, part in zip(row, x, strict=True) if a), zero) for row in matrix.tolist()])
    out = np.empty((len(matrix), *x.shape[1:]))
    for i, row in enumerate(matrix.tolist()):
        total = out[i, ...]  # a view even of a single number
        terms = [(entry, component) for entry, component in zip(row, x, strict=True) if entry]
        entry, component = terms[0] if terms else (0.0, 0.0)
        np.multiply(entry, component, out=total)
        for entry, component in terms[1:]:
            total += component if entry == 1.0 else entry * component
    return out


def apply_by_run(stack: Array, x: Array) -> Array:
    """Product of one matrix a run [R, p, n] with x[n, R, N]: [p, R, N]."""
    return np.moveaxis(stack @ np.moveaxis(x, 1, 0), 0, 1)


def factor(cov: Array, field: str = "covariance") -> Array:
    """Lower-triangular L with L Lᵀ = cov for a symmetric positive semidefinite matrix [n, n], singular or not.

    A zero pivot of a semidefinite matrix has a zero column below it, so Cholesky's recursion simply skips it.
    Raises ValueError, which calls it `field`, when cov is not square, not symmetric or not positive semidefinite.
    """
    cov = finite(field, cov, 2)
    if cov.shape[0] != cov.shape[1]:
        raise ValueError(f"{field} has shape {cov.shape}, it must be square")
    variances = np.diag(cov)
    if (variances < 0).any():
        i = int(np.argmin(variances))
        raise ValueError(f"{field}[{i}, {i}] is {cov[i, i]}, a negative variance")
    # Entries and pivots are judged against their own rows: components may differ by many orders of magnitude.
    scale = np.sqrt(variances)
    size = scale[:, None] * scale
    uneven = np.abs(cov - cov.T) > 1e-9 * size + 1e-300
    if uneven.any():
        i, j = np.argwhere(uneven)[0].tolist()
        raise ValueError(f"{field} is not symmetric: [{i}, {j}] is {cov[i, j]}, [{j}, {i}] is {cov[j, i]}")
    lower = np.zeros_like(cov)
    for j in range(len(cov)):
        pivot = cov[j, j] - lower[j, :j] @ lower[j, :j]
        if pivot > 1e-12 * cov[j, j]:
            lower[j, j] = np.sqrt(pivot)
            lower[j + 1 :, j] = (cov[j + 1 :, j] - lower[j + 1 :, :j] @ lower[j, :j]) / lower[j, j]
    if (np.abs(lower @ lower.T - cov) <= 1e-8 * size + 1e-300).all():
        return lower
    try:  # a pivot that small was no zero after all
        return np.asarray(np.linalg.cholesky(cov), float)
    except np.linalg.LinAlgError:
        raise ValueError(f"{field} is not positive semidefinite") from None


def cholesky(stack: Array) -> Array:
    """Lower Cholesky factors of a stack of matrices [R, n, n]; NaN for those that are not positive definite.

    One bad run must not disturb its neighbours, so numpy's all-or-nothing error is resolved run by run.
    """
    try:
        return np.asarray(np.linalg.cholesky(stack), float)
    except np.linalg.LinAlgError:
        if len(stack) == 1:
            return np.full_like(stack, np.nan)
        return np.concatenate([cholesky(one[None]) for one in stack])


def square_root(stack: Array) -> Array:
    """Matrices B[R, n, n] with B Bᵀ = stack, for semidefinite ones too; NaN for those that are not.

    Cholesky where it exists; otherwise eigenvectors of the correlation matrix, whose small negative eigenvalues are
    rounding and count as zero.
    """
    if not stack.any():  # all is known: no need to try one matrix after the other
        return np.zeros_like(stack)
    root = cholesky(stack)
    for r in np.flatnonzero(np.isnan(root[:, 0, 0])):
        scale = np.sqrt(np.maximum(np.diag(stack[r]), 0.0))
        inverse = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0)
        if np.isfinite(stack[r]).all():
            # One factor after the other: the product of two inverses overflows where variances are next to nothing.
            values, directions = np.linalg.eigh(stack[r] * inverse[:, None] * inverse)
            found = scale[:, None] * directions * np.sqrt(np.maximum(values, 0.0))
            tolerance = 1e-9 * np.outer(scale, scale) + 1e-12 * np.abs(stack[r]).max()
            if (np.abs(found @ found.T - stack[r]) <= tolerance).all():
                root[r] = found
    return root


def lower_triangular(columns: Array) -> Array:
    """Lower-triangular L[R, p, p] with L Lᵀ = A Aᵀ for matrices A[R, p, s], of any rank; signs on the diagonal are arbitrary.

    By orthogonal triangularisation: A Aᵀ, whose condition number is the square of A's, is never formed.
    """
    runs, p, s = columns.shape
    if s < p:
        columns = np.concat([columns, np.zeros((runs, p, p - s))], axis=2)
    packed, _ = np.linalg.qr(np.swapaxes(columns, 1, 2), mode="raw")
    return np.asarray(packed[:, :, :p] * _tri(p))


def solve_lower(lower: Array, b: Array) -> Array:
    """Solutions z[R, p, ...] of L z = b for lower-triangular L[R, p, p] and b[R, p, ...]; not finite where L is singular."""
    z = b.reshape(*b.shape[:2], -1).copy()
    for j in range(b.shape[1]):
        z[:, j] /= lower[:, j, j, None]
        z[:, j + 1 :] -= lower[:, j + 1 :, j, None] * z[:, j, None]
    return z.reshape(b.shape)
