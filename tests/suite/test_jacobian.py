"""Dual numbers against complex steps and central differences."""

import numpy as np
import pytest

from cases.multistatic_radar import bistatic, bistatic_slope
from suite.jacobian import _PARTIALS, Dual, derivative

COMPLEX = (np.add, np.subtract, np.multiply, np.divide, np.power, np.negative, np.positive, np.square, np.sqrt, np.exp, np.log,
           np.sin, np.cos, np.tan, np.arctan, np.tanh)  # fmt: skip
"""Those that numpy evaluates on complex numbers: a complex step has no truncation or cancellation error."""


def complex_step(function, x):
    """Jacobian [p, n, ...] by x + i h, exact to rounding."""
    columns = []
    for j in range(len(x)):
        moved = x.astype(complex)
        moved[j] += 1e-30j
        columns.append(np.asarray(function(moved)).imag / 1e-30)
    return np.stack(columns, axis=1)


def central(function, x, h=1e-6):
    columns = []
    for j, step in enumerate(np.broadcast_to(h, len(x))):
        up, down = x.copy(), x.copy()
        up[j] += step
        down[j] -= step
        columns.append((np.asarray(function(up)) - np.asarray(function(down))) / (2 * step))
    return np.stack(columns, axis=1)


def points(seed=0, n=2, shape=(3, 4)):
    return np.random.default_rng(seed).uniform(0.2, 1.3, (n, *shape))


@pytest.mark.parametrize("ufunc", _PARTIALS, ids=lambda u: u.__name__)
def test_each_ufunc(ufunc):
    x = points()
    function = (lambda s: ufunc(s[:1])) if ufunc.nin == 1 else (lambda s: ufunc(s[:1], s[1:]))
    found = derivative(function, x)
    assert found.shape == (1, 2, 3, 4)
    np.testing.assert_allclose(found, central(function, x), rtol=1e-7, atol=1e-8)
    if ufunc in COMPLEX:
        np.testing.assert_allclose(found, complex_step(function, x), rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize("ufunc", [u for u in _PARTIALS if u.nin == 2], ids=lambda u: u.__name__)
@pytest.mark.parametrize("constant", [0.7, np.array([[0.3, 0.5, 0.9, 1.1]])], ids=["number", "array"])
def test_one_side_constant(ufunc, constant):
    x = points()
    for function in (lambda s: ufunc(s, constant), lambda s: ufunc(constant, s)):
        np.testing.assert_allclose(derivative(function, x), central(function, x), rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("ufunc", [np.absolute, np.arctan2, np.hypot, np.maximum, np.minimum, np.divide, np.tanh, np.square])
def test_negative_arguments(ufunc):
    x = points() * np.array([-1.0, 1.0])[:, None, None]
    function = ufunc if ufunc.nin == 1 else (lambda s: np.concat([ufunc(s[:1], s[1:]), ufunc(s[1:], s[:1])]))
    for at in (x, -x, -np.abs(x)):
        np.testing.assert_allclose(derivative(function, at), central(function, at), rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("power", [-2, -1, 1, 2, 3])
def test_whole_powers_of_negative_numbers(power):
    x = -points()
    np.testing.assert_allclose(derivative(lambda s: s**power, x), complex_step(lambda s: s**power, x), rtol=1e-12)


def everything(s):
    x, y, z = s
    r = np.sqrt(x * x + y * y)
    return np.stack(
        [
            np.where(x > 0.6, np.exp(-x) * y, x**3 - 2.0 / y),
            np.sin(r) / (1 + z**2) - (+x),
            2.0**z + z**1.5 - abs(y - 5),
            np.tan(0.3 * z) * np.log(r) + 3.0,
        ]
    )


@pytest.mark.parametrize("shape", [(), (5,), (3, 4), (2, 3, 2)], ids=str)
def test_expressions_over_any_trailing_axes(shape):
    x = points(1, 3, shape)
    found = derivative(everything, x)
    assert found.shape == (4, 3, *shape)
    np.testing.assert_allclose(found, central(everything, x), rtol=1e-6, atol=1e-7)
    for at in np.ndindex(*shape):
        np.testing.assert_allclose(found[(..., *at)], derivative(everything, x[(slice(None), *at)]), rtol=1e-13, atol=1e-15)


def test_along_some_components_alone():
    x = points(1, 3)
    whole = derivative(everything, x)
    for along in [(2,), (1, 0), (0, 1, 2)]:
        np.testing.assert_array_equal(derivative(everything, x, along), whole[:, list(along)])
    assert derivative(lambda s: np.ones((2, 3, 4)), x, (1,)).shape == (2, 1, 3, 4)


def test_constants_join_and_broadcast():
    x = points(2, 2, (3, 4))
    lever = np.arange(1.0, 4.0)[:, None]  # [3, 1], against runs [3, 4]

    def function(s):
        ahead = np.stack([s[0] * lever, 2.0 * np.ones_like(s[1]), s[1] + np.zeros_like(s[0])])
        return np.concat([ahead, s[:1] - 1.0, np.ones((1, 3, 4))])

    np.testing.assert_allclose(derivative(function, x), central(function, x), rtol=1e-8, atol=1e-8)


def test_indexing_with_arrays_and_slices():
    x = points(3, 4)
    function = lambda s: np.concat([s[[2, 0]] * s[[3, 3]], s[1:3], s[-1:]])  # noqa: E731
    np.testing.assert_allclose(derivative(function, x), complex_step(function, x), rtol=1e-14)


def test_where_takes_constants_on_either_side():
    x = points(4)
    for function in (lambda s: np.where(s > 0.7, s * s, 1.0), lambda s: np.where(s[:1] < 0.7, 0.0, s)):
        np.testing.assert_allclose(derivative(function, x), central(function, x), rtol=1e-7, atol=1e-8)


def test_a_constant_function_has_derivative_zero():
    assert (derivative(lambda s: np.ones((3, 4)), points(0, 2, (4,))) == np.zeros((3, 2, 4))).all()


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (np.sinh, "numpy.sinh"),
        (lambda s: np.matmul(np.eye(2), s), "numpy.matmul"),
        (lambda s: np.sum(s), "numpy.sum"),
        (lambda s: np.stack([s, s], axis=1), "first axis"),
        (lambda s: np.concatenate([s, s], axis=1), "first axis"),
        (lambda s: np.linalg.norm(s, axis=0), "numpy"),
        (lambda s: np.add.reduce(s), "operand type|unsupported|Dual"),
        (lambda s: np.add(s, s, out=s), "operand type|unsupported|Dual"),
    ],
)
def test_unknown_operations_are_refused_not_guessed(function, words):
    with pytest.raises(TypeError, match=words):
        derivative(function, points())


def test_arrays_seen_from_inside():
    dual = Dual(np.ones((2, 3)), {0: np.ones((2, 1)), 3: np.arange(6.0).reshape(2, 3)})
    assert dual.shape == (2, 3)
    assert dual.ndim == 2
    assert len(dual) == 2
    assert (dual < 2).all()
    assert {j: t.tolist() for j, t in dual[:, 1].tangents.items()} == {0: [1.0, 1.0], 3: [1.0, 4.0]}


def test_variables_that_a_component_does_not_depend_on_cost_nothing():
    x = Dual(np.ones((3, 5)), {j: unit[:, None] for j, unit in enumerate(np.eye(3))})
    assert list((np.sin(x[0]) * x[2]).tangents) == [0, 2]
    assert list(np.stack([x[1], x[1] + 1.0]).tangents) == [1]


def test_bistatic_range_to_rounding():
    x = np.random.default_rng(1).uniform(-20_000, 20_000, (6, 30))
    found = derivative(lambda s: bistatic(s, 1), x)
    exact = complex_step(lambda s: bistatic(s, 1), x)
    np.testing.assert_allclose(found, exact, rtol=1e-11, atol=1e-18)
    np.testing.assert_allclose(bistatic_slope(x, 1), exact, rtol=1e-11, atol=1e-18)
