"""Matrix factors by their defining property, on matrices that are singular, badly scaled or bad."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from suite.jacobian import Dual, value_and_derivative
from suite.linalg import apply, cholesky, factor, lower_triangular, solve_lower, square_root


@st.composite
def semidefinite(draw, stack=False):
    """B Bᵀ scaled by 1e-12..1e12 on its diagonal; often singular, some components zero."""
    n = draw(st.integers(1, 6))
    rank = draw(st.integers(0, n))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    exponents = draw(st.lists(st.floats(-6, 6), min_size=n, max_size=n))
    zero = draw(st.lists(st.booleans(), min_size=n, max_size=n)) if draw(st.booleans()) else [False] * n
    count = draw(st.integers(1, 4)) if stack else 1
    root = rng.standard_normal((count, n, rank)) * (10.0 ** np.array(exponents) * ~np.array(zero))[:, None]
    cov = root @ np.swapaxes(root, 1, 2)
    return cov if stack else cov[0]


def reproduces(root, cov, tolerance=1e-8):
    scale = np.sqrt(np.diagonal(cov, axis1=-2, axis2=-1))
    error = np.abs(root @ np.swapaxes(root, -1, -2) - cov)
    return (error <= tolerance * scale[..., :, None] * scale[..., None, :]).all()


@settings(max_examples=200, deadline=None, derandomize=True)
@given(semidefinite())
def test_factor_is_lower_triangular_and_reproduces(cov):
    lower = factor(cov)
    assert (np.triu(lower, 1) == 0).all()
    assert (np.diag(lower) >= 0).all()
    assert reproduces(lower, cov)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(semidefinite(stack=True))
def test_square_root_reproduces(stack):
    assert reproduces(square_root(stack), stack)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(semidefinite())
def test_factor_of_a_definite_matrix_is_cholesky(cov):
    correlation = cov / np.maximum(np.sqrt(np.outer(np.diag(cov), np.diag(cov))), 1e-300)
    correlation = (correlation + np.eye(len(cov))) / 2
    np.testing.assert_allclose(factor(correlation), np.linalg.cholesky(correlation), rtol=1e-9, atol=1e-12)


def test_factor_keeps_rank():
    gain = np.array([[0.5], [1.0], [2.0]])
    lower = factor(gain @ gain.T)
    np.testing.assert_allclose(lower, np.concatenate([gain, np.zeros((3, 2))], axis=1), atol=1e-15)
    assert (factor(np.zeros((3, 3))) == 0).all()


@pytest.mark.parametrize(
    ("cov", "words"),
    [
        (np.ones((2, 3)), r"covariance has shape \(2, 3\), it must be square"),
        (np.ones(3), r"covariance has shape \(3,\), it must be a matrix"),
        ([[1.0, 0.5], [0.4, 1.0]], r"covariance is not symmetric: \[0, 1\] is 0.5, \[1, 0\] is 0.4"),
        ([[1e6, 5e-4], [-5e-4, 1e-6]], r"covariance is not symmetric: \[0, 1\] is 0.0005, \[1, 0\] is -0.0005"),
        ([[1e6, 0.0], [1e-100, 0.0]], "covariance is not symmetric"),
        ([[1.0, 2.0], [2.0, 1.0]], "covariance is not positive semidefinite"),
        ([[-1.0]], r"covariance\[0, 0\] is -1.0, a negative variance"),
        ([[0.0, 1.0], [1.0, 1.0]], "covariance is not positive semidefinite"),
        ([[1e-20, 1e-9], [1e-9, 1.0]], "covariance is not positive semidefinite"),
        ([[1.0, 0.0], [0.0, -1e-14]], r"covariance\[1, 1\] is -1e-14, a negative variance"),
        ([[np.nan]], r"covariance\[0, 0\] is nan, not a finite number"),
        ([[1.0, 0.0], [-np.inf, 1.0]], r"covariance\[1, 0\] is -inf, not a finite number"),
    ],
)
def test_factor_names_what_is_wrong(cov, words):
    with pytest.raises(ValueError, match="^" + words):
        factor(np.array(cov))
    with pytest.raises(ValueError, match="^" + words.replace("covariance", "Law.field")):
        factor(np.array(cov), "Law.field")


@settings(max_examples=200, deadline=None, derandomize=True)
@given(semidefinite(), st.integers(0, 2**32 - 1), st.booleans())
def test_symmetry_is_judged_against_the_two_variances_of_an_entry(cov, seed, gross):
    """Whatever the size of the other variances: a difference of a millionth is an error, one of 1e-10 is rounding."""
    rng = np.random.default_rng(seed)
    n = len(cov)
    i, j = rng.integers(0, n, 2)
    if i == j:
        return
    i, j = sorted((int(i), int(j)))
    scale = np.sqrt(cov[i, i] * cov[j, j])
    uneven = cov.copy()
    uneven[j, i] += (1e-6 if gross else 1e-10) * scale * rng.choice([-1, 1])
    if gross and scale:
        with pytest.raises(ValueError, match=rf"not symmetric: \[{i}, {j}\] is "):
            factor(uneven)
    else:
        assert reproduces(factor(uneven), cov)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(semidefinite(), st.integers(0, 5), st.floats(-12, 12))
def test_a_negative_variance_is_named_however_small(cov, i, exponent):
    i %= len(cov)
    cov[i, i] = -(10.0**exponent)
    with pytest.raises(ValueError, match=rf"covariance\[{i}, {i}\] is {cov[i, i]}, a negative variance".replace("+", r"\+")):
        factor(cov)


BAD = {
    "indefinite": [[1.0, 2.0], [2.0, 1.0]],
    "negative": [[-1.0, 0.0], [0.0, 1.0]],
    "negative and small": [[-1e-3, 0.0], [0.0, 1.0]],
    "correlated with a constant": [[0.0, 1.0], [1.0, 1.0]],
    "correlated constants": [[0.0, 1.0], [1.0, 0.0]],
    "nan": [[np.nan, 0.0], [0.0, 1.0]],
    "nan aside": [[1.0, np.nan], [np.nan, 1.0]],
    "infinite": [[np.inf, 0.0], [0.0, 1.0]],
}


@pytest.mark.parametrize("bad", BAD.values(), ids=BAD)
def test_a_bad_matrix_is_not_finite_and_its_neighbours_are_as_if_alone(bad):
    good, singular = np.array([[2.0, 0.3], [0.3, 1.0]]), np.array([[1.0, 2.0], [2.0, 4.0]])
    stack = np.stack([good, np.array(bad), singular, good * 3])
    root, lower = square_root(stack), cholesky(stack)
    assert not np.isfinite(root[1]).all()
    assert not np.isfinite(lower[1]).all()
    if np.isfinite(bad).all():
        assert np.isnan(root[1]).all()
        assert np.isnan(lower[1]).all()
    assert reproduces(root[[0, 2, 3]], stack[[0, 2, 3]])
    for i in (0, 2, 3):
        np.testing.assert_array_equal(root[i], square_root(stack[i : i + 1])[0])
        np.testing.assert_array_equal(lower[i], cholesky(stack[i : i + 1])[0])
    np.testing.assert_array_equal(lower[0], np.linalg.cholesky(good))


def test_square_root_forgives_rounding():
    """A variance, or an eigenvalue, that is negative by rounding counts as zero."""
    nearly = np.array([[1.0, 1.0], [1.0, 1.0 - 1e-14]])
    below = np.diag([1.0, -1e-17])
    root = square_root(np.stack([nearly, below]))
    np.testing.assert_allclose(root @ np.swapaxes(root, 1, 2), [np.ones((2, 2)), np.diag([1.0, 0.0])], atol=1e-12)


@settings(max_examples=50, deadline=None, derandomize=True)
@given(st.integers(1, 5), st.integers(1, 5), st.integers(0, 3), st.integers(0, 2**32 - 1))
def test_apply_is_the_matrix_product_over_trailing_axes(p, n, trailing, seed):
    rng = np.random.default_rng(seed)
    matrix = rng.standard_normal((p, n)) * rng.integers(0, 2, (p, n))
    x = rng.standard_normal((n, *range(2, 2 + trailing)))
    before = x.copy()
    np.testing.assert_allclose(apply(matrix, x), np.tensordot(matrix, x, axes=1), rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(x, before)


def test_apply_gives_each_column_the_same_bits_alone():
    rng = np.random.default_rng(0)
    matrix, x = rng.standard_normal((4, 5)), rng.standard_normal((5, 33))
    whole = apply(matrix, x)
    for r in range(33):
        np.testing.assert_array_equal(apply(matrix, x[:, r : r + 1])[:, 0], whole[:, r])


@settings(max_examples=50, deadline=None, derandomize=True)
@given(st.integers(1, 4), st.integers(1, 4), st.integers(0, 2), st.integers(0, 2**32 - 1))
def test_apply_is_differentiated_where_it_stands_in_an_expression(p, n, trailing, seed):
    """y = sin(A x) (C x)² has the derivative cos(A x) (C x)² A + 2 sin(A x) (C x) C."""
    rng = np.random.default_rng(seed)
    A, C = (rng.integers(-1, 2, (p, n)) * rng.choice([1.0, 0.7], (p, n)) for _ in range(2))
    x = rng.standard_normal((n, *range(2, 2 + trailing)))
    value, found = value_and_derivative(lambda s: np.sin(apply(A, s)) * apply(C, s) ** 2, x)
    a, c = apply(A, x)[:, None], apply(C, x)[:, None]
    column = (p, n, *(1,) * trailing)
    expected = np.cos(a) * c**2 * A.reshape(column) + 2 * np.sin(a) * c * C.reshape(column)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-13)
    np.testing.assert_array_equal(value, np.sin(a[:, 0]) * c[:, 0] ** 2)


@pytest.mark.parametrize("shape", [(2, 3), (2,), (2, 2, 2)], ids=str)
@pytest.mark.parametrize("make", [np.asarray, lambda x: Dual(x, {})], ids=["array", "dual"])
def test_a_matrix_that_does_not_fit_is_named(shape, make):
    if shape == (2, 3):
        assert apply(np.ones(shape), make(np.ones((3, 1)))).shape == (2, 1)
    with pytest.raises(ValueError, match=r"a matrix of shape \(.*\) does not fit a vector of 4 components"):
        apply(np.ones(shape), make(np.ones((4, 1))))


def test_factor_of_a_nearly_singular_covariance():
    lower = np.array([[1.0, 0.0, 0.0], [1.0, 7e-7, 0.0], [0.0, 1.0, 1.0]])
    cov = lower @ lower.T
    np.testing.assert_allclose(factor(cov) @ factor(cov).T, cov, rtol=1e-12, atol=1e-12)


@st.composite
def columns(draw):
    """Stacks [R, p, s] of any rank, their rows scaled by 1e-6..1e6; more or fewer columns than rows, some rows zero."""
    runs, p, s = draw(st.integers(1, 3)), draw(st.integers(1, 6)), draw(st.integers(1, 9))
    rank = draw(st.integers(0, min(p, s)))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    scale = 10.0 ** rng.uniform(-6, 6, p) * (rng.random(p) > draw(st.sampled_from([0.0, 0.3])))
    return scale[:, None] * (rng.standard_normal((runs, p, rank)) @ rng.standard_normal((runs, rank, s)))


@settings(max_examples=300, deadline=None, derandomize=True)
@given(columns())
def test_triangularisation_keeps_the_products_of_rows(stack):
    lower = lower_triangular(stack)
    assert lower.shape == (*stack.shape[:2], stack.shape[1])
    assert (np.triu(lower, 1) == 0).all()
    assert reproduces(lower, stack @ np.swapaxes(stack, 1, 2), tolerance=1e-14)


def test_triangularisation_keeps_digits_that_the_product_of_rows_has_lost():
    # Rows that differ by 1e-10: in their product that is 1e-20 beside 1, here it is the last pivot.
    stack = np.array([[[1.0, 0.0], [1.0, 1e-10]]])
    lower = lower_triangular(stack @ np.array([[0.6, 0.8], [-0.8, 0.6]]))
    np.testing.assert_allclose(abs(lower[0, 1, 1]), 1e-10, rtol=1e-5)
    product = lower @ np.swapaxes(lower, 1, 2)
    assert np.linalg.det(product[0]) == 0


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e308])
@pytest.mark.parametrize("where", [(0, 0), (1, 0), (2, 2)], ids=str)
def test_a_bad_run_is_triangularised_alone(bad, where):
    stack = np.random.default_rng(5).standard_normal((4, 3, 5))
    stack[1] = np.eye(3, 5)
    stack[1][where] = bad
    with np.errstate(all="ignore"):
        lower = lower_triangular(stack)
        product = lower[1] @ lower[1].T
    assert not np.isfinite(product).all()
    for r in (0, 2, 3):
        np.testing.assert_array_equal(lower[r], lower_triangular(stack[r : r + 1])[0])
        assert np.isfinite(lower[r]).all()


@settings(max_examples=100, deadline=None, derandomize=True)
@given(st.integers(1, 4), st.integers(1, 8), st.integers(0, 2**32 - 1))
def test_substitution_solves_triangular_equations(runs, p, seed):
    rng = np.random.default_rng(seed)
    lower = (np.tril(rng.standard_normal((runs, p, p)), -1) + np.eye(p) * rng.uniform(1, 2, p)) * 10.0 ** rng.uniform(
        -6, 6, (p, 1)
    )
    z = rng.standard_normal((runs, p))
    b = (lower @ z[..., None])[..., 0]
    before = b.copy()
    np.testing.assert_allclose(solve_lower(lower, b), z, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(b, before)


def test_a_singular_triangle_is_not_finite_and_its_neighbours_are_as_if_alone():
    rng = np.random.default_rng(6)
    lower, b = np.tril(rng.standard_normal((3, 3, 3))), rng.standard_normal((3, 3))
    lower[1, 1, 1] = 0.0
    with np.errstate(all="ignore"):
        z = solve_lower(lower, b)
    assert not np.isfinite(z[1]).all()
    for r in (0, 2):
        np.testing.assert_array_equal(z[r], solve_lower(lower[r : r + 1], b[r : r + 1])[0])


def test_a_square_root_of_next_to_nothing_is_one():
    """Variances may be so small that the product of two of their inverses is too large for a number."""
    cov = np.full((2, 3, 3), 5e-320)
    cov[1] = np.eye(3)
    root = square_root(cov)
    np.testing.assert_allclose(root[0] @ root[0].T, cov[0], atol=1e-320)
    np.testing.assert_array_equal(root[1], np.eye(3))
