"""Linear algebra on small matrices against numpy.linalg, matrix by matrix."""

import numpy as np
import pytest

from suite.pointwise import (
    cholesky,
    combine,
    determinant,
    dot,
    eliminate,
    log_diagonal,
    solve_lower,
    solve_upper,
    times,
    transposed_times,
)

sizes = pytest.mark.parametrize("m", [1, 2, 3, 5])
trailing = pytest.mark.parametrize("shape", [(1,), (7,), (3, 11)], ids=str)


def stack(a, axes=2):
    """The array with its first axes moved to the end, as numpy.linalg wants it."""
    return np.moveaxis(a, range(axes), range(-axes, 0))


def positive_definite(m, shape, seed=0):
    root = np.random.default_rng(seed).standard_normal((*shape, m, m + 1))
    return np.moveaxis(root @ np.swapaxes(root, -1, -2), (-2, -1), (0, 1)).copy()


@sizes
@trailing
def test_products_are_those_of_numpy(m, shape):
    rng = np.random.default_rng(1)
    for n in (1, 2, 4):
        matrix, x, y = (rng.standard_normal((*head, *shape)) for head in ((m, n), (n,), (m,)))
        np.testing.assert_allclose(dot(x, x[::-1]), (x * x[::-1]).sum(0), rtol=1e-12, atol=1e-12)
        expected = (stack(matrix) @ stack(x, 1)[..., None])[..., 0]
        np.testing.assert_allclose(stack(times(matrix, x), 1), expected, rtol=1e-12, atol=1e-12)
        expected = (np.swapaxes(stack(matrix), -1, -2) @ stack(y, 1)[..., None])[..., 0]
        np.testing.assert_allclose(stack(transposed_times(matrix, y), 1), expected, rtol=1e-12, atol=1e-12)


@sizes
@trailing
def test_the_factor_is_that_of_numpy(m, shape):
    matrix = positive_definite(m, shape)
    before = matrix.copy()
    lower = cholesky(matrix)
    np.testing.assert_array_equal(matrix, before)
    np.testing.assert_allclose(stack(lower), np.linalg.cholesky(stack(matrix)), rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(stack(lower), np.tril(stack(lower)))
    np.testing.assert_allclose(log_diagonal(lower), 0.5 * np.linalg.slogdet(stack(matrix))[1], rtol=1e-9, atol=1e-9)


@sizes
def test_the_upper_triangle_is_not_looked_at(m):
    matrix = positive_definite(m, (5,))
    spoilt = matrix.copy()
    spoilt[np.triu_indices(m, 1)] = np.nan
    np.testing.assert_array_equal(cholesky(spoilt), cholesky(matrix))


@sizes
@trailing
def test_triangular_systems_are_solved(m, shape):
    lower, b = cholesky(positive_definite(m, shape)), np.random.default_rng(2).standard_normal((m, *shape))
    right = stack(b, 1)[..., None]
    for solve, matrix in ((solve_lower, stack(lower)), (solve_upper, np.swapaxes(stack(lower), -1, -2))):
        expected = np.linalg.solve(matrix, right)[..., 0]
        np.testing.assert_allclose(stack(solve(lower, b), 1), expected, rtol=1e-9, atol=1e-9)
    # One matrix of each run serves all its particles.
    if len(shape) == 2:
        for solve in (solve_lower, solve_upper):
            one = np.broadcast_to(lower[..., :1], lower.shape).copy()
            np.testing.assert_array_equal(solve(lower[..., :1], b), solve(one, b))
    before = b.copy()
    solve_lower(lower, b)
    solve_upper(lower, b)
    np.testing.assert_array_equal(b, before)


@sizes
def test_a_matrix_that_is_not_positive_definite_gives_nan_and_disturbs_no_other(m):
    matrix, b = positive_definite(m, (6,)), np.ones((m, 6))
    bad = matrix.copy()
    bad[m - 1, m - 1, 1] -= 1e3
    bad[..., 2] = np.nan
    bad[0, 0, 3] = -1.0
    with np.errstate(invalid="ignore"):
        lower = cholesky(bad)
        solved = solve_upper(lower, solve_lower(lower, b))
    lost, sound = [1, 2, 3], [0, 4, 5]
    good = cholesky(matrix)
    np.testing.assert_array_equal(lower[..., sound], good[..., sound])
    np.testing.assert_array_equal(solved[:, sound], solve_upper(good, solve_lower(good, b))[:, sound])
    assert np.isnan(lower[m - 1, m - 1, lost]).all()
    assert np.isnan(solved[:, lost]).all()
    with np.errstate(invalid="ignore"):
        assert np.isnan(log_diagonal(lower)[lost]).all()


def test_a_particle_has_the_same_bits_alone():
    matrix, b = positive_definite(3, (2, 1001)), np.random.default_rng(3).standard_normal((3, 2, 1001))
    whole = cholesky(matrix)
    for r, i in ((0, 0), (1, 500), (1, 1000)):
        one = (..., slice(r, r + 1), slice(i, i + 1))
        lower = cholesky(matrix[one])
        np.testing.assert_array_equal(lower, whole[one])
        np.testing.assert_array_equal(solve_lower(lower, b[one]), solve_lower(whole, b)[one])
        np.testing.assert_array_equal(solve_upper(lower, b[one]), solve_upper(whole, b)[one])
        np.testing.assert_array_equal(times(matrix[one], b[one]), times(matrix, b)[one])
        np.testing.assert_array_equal(transposed_times(matrix[one], b[one]), transposed_times(matrix, b)[one])
        np.testing.assert_array_equal(log_diagonal(lower), log_diagonal(whole)[one])


@pytest.mark.parametrize("scale", [1e-4, 1e4])
def test_the_logarithm_of_the_diagonal_neither_overflows_nor_vanishes(scale):
    """A hundred bearings of 0.1 mrad: the product of their standard deviations leaves the range of a number."""
    lower = np.eye(100)[:, :, None] * scale
    np.testing.assert_allclose(log_diagonal(lower), 100 * np.log(scale))


@pytest.mark.parametrize("entries", [[1.0, -2.0, 0.5], [0.0, 3.0, 0.0], [0.0, 0.0, 0.0]], ids=str)
def test_a_combination_is_the_weighted_sum_of_its_rows(entries):
    rows = np.random.default_rng(0).standard_normal((3, 2, 9))
    before = rows.copy()
    expected = np.tensordot(entries, rows, 1)
    for shaped in (np.array(entries).reshape(3, 1, 1), np.broadcast_to(np.array(entries).reshape(3, 1, 1), rows.shape)):
        found = combine(shaped, rows)
        np.testing.assert_allclose(np.broadcast_to(found, expected.shape), expected, rtol=1e-12, atol=1e-12)
        np.testing.assert_array_equal(found, combine(shaped, list(rows)))
    np.testing.assert_array_equal(rows, before)


@pytest.mark.parametrize(("n", "count"), [(1, 1), (3, 1), (3, 2), (4, 4), (5, 0)])
@trailing
def test_elimination_leaves_the_factor_and_the_schur_complement(n, count, shape):
    cov = positive_definite(n, shape)
    full, found = stack(cov), cov.copy()
    eliminate(found, count)
    first, rest = slice(None, count), slice(count, None)
    np.testing.assert_allclose(np.tril(stack(found))[..., :count], np.linalg.cholesky(full)[..., :count], rtol=1e-9, atol=1e-12)
    schur = full[..., rest, rest] - full[..., rest, first] @ np.linalg.solve(full[..., first, first], full[..., first, rest])
    np.testing.assert_allclose(np.tril(stack(found)[..., rest, rest]), np.tril(schur), rtol=1e-9, atol=1e-9)


def test_elimination_of_what_is_known_already_changes_nothing():
    """Components without variance, or that are linear in those before them, in some particles and not in others."""
    cov = positive_definite(3, (4,))
    cov[0, :, 1] = cov[:, 0, 1] = 0.0
    cov[..., 2] = np.outer([1.0, 2.0, -1.0], [1.0, 2.0, -1.0])
    cov[..., 3] = 0.0
    found = cov.copy()
    eliminate(found, 3)
    lower = np.tril(stack(found))
    np.testing.assert_allclose(lower @ np.swapaxes(lower, -1, -2), stack(cov), atol=1e-9)
    np.testing.assert_array_equal(lower[1, :, 0], 0)
    np.testing.assert_allclose(lower[2, :, 1:], 0, atol=1e-9)
    np.testing.assert_array_equal(lower[3], 0)


@sizes
@trailing
def test_the_determinant_is_that_of_numpy(m, shape):
    skew = np.random.default_rng(5).standard_normal((m, m, *shape))
    matrix = positive_definite(m, shape) + (skew - np.swapaxes(skew, 0, 1)) / 4  # positive definite, not symmetric
    before = matrix.copy()
    np.testing.assert_allclose(determinant(matrix), np.linalg.det(stack(matrix)), rtol=1e-8, atol=1e-9)
    np.testing.assert_array_equal(matrix, before)
