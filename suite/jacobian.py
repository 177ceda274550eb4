"""Jacobians of array expressions by forward-mode differentiation with dual numbers."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from suite.linalg import Array

# Partial derivatives of each ufunc with respect to its inputs; None where the result does not depend smoothly on them.
_PARTIALS: dict[np.ufunc, Callable[..., tuple[Any, ...]]] = {
    np.add: lambda a, b: (1.0, 1.0),
    np.subtract: lambda a, b: (1.0, -1.0),
    np.multiply: lambda a, b: (b, a),
    np.divide: lambda a, b: (1.0 / b, -a / (b * b)),
    np.power: lambda a, b: (b * np.power(a, b - 1), np.where(a > 0, np.log(np.where(a > 0, a, 1.0)) * np.power(a, b), 0)),
    np.negative: lambda a: (-1.0,),
    np.positive: lambda a: (1.0,),
    np.square: lambda a: (2 * a,),
    np.sqrt: lambda a: (0.5 / np.sqrt(a),),
    np.exp: lambda a: (np.exp(a),),
    np.log: lambda a: (1.0 / a,),
    np.sin: lambda a: (np.cos(a),),
    np.cos: lambda a: (-np.sin(a),),
    np.tan: lambda a: (1.0 + np.tan(a) ** 2,),
    np.arctan: lambda a: (1.0 / (1.0 + a * a),),
    np.arctan2: lambda a, b: (b / (a * a + b * b), -a / (a * a + b * b)),
    np.hypot: lambda a, b: (a / np.hypot(a, b), b / np.hypot(a, b)),
    np.tanh: lambda a: (1.0 - np.tanh(a) ** 2,),
    np.absolute: lambda a: (np.sign(a),),
    np.maximum: lambda a, b: (np.where(a >= b, 1.0, 0.0), np.where(a >= b, 0.0, 1.0)),
    np.minimum: lambda a, b: (np.where(a <= b, 1.0, 0.0), np.where(a <= b, 0.0, 1.0)),
}
_COMPARISONS = (np.less, np.less_equal, np.greater, np.greater_equal, np.equal, np.not_equal)


class Dual(NDArrayOperatorsMixin):
    """An array v[...] together with its derivatives dv[d, ...] with respect to d variables."""

    def __init__(self, value: Array, tangent: Array):
        self.value, self.tangent = value, tangent

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the value."""
        return self.value.shape

    @property
    def ndim(self) -> int:
        """Number of axes of the value."""
        return self.value.ndim

    def __len__(self) -> int:
        return len(self.value)

    def __getitem__(self, index: Any) -> "Dual":
        index = index if isinstance(index, tuple) else (index,)
        return Dual(self.value[index], self.tangent[(slice(None), *index)])

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        values = [x.value if isinstance(x, Dual) else x for x in inputs]
        if method != "__call__" or options.get("out") is not None:
            return NotImplemented
        if ufunc in _COMPARISONS:
            return ufunc(*values)
        if ufunc not in _PARTIALS:
            raise TypeError(f"no derivative is known for numpy.{ufunc.__name__}; give the Jacobian analytically")
        value = np.asarray(ufunc(*values))
        terms = [
            _aligned(x.tangent, value.ndim) * partial
            for x, partial in zip(inputs, _PARTIALS[ufunc](*values), strict=True)
            if isinstance(x, Dual)
        ]
        return Dual(value, np.broadcast_to(sum(terms[1:], start=terms[0]), (len(terms[0]), *value.shape)))

    def __array_function__(self, function: Any, types: Any, args: Any, options: Any) -> Any:
        if function is np.stack:
            return _stack(*args, **options)
        if function is np.concatenate:
            return _concatenate(*args, **options)
        if function is np.where:
            return _where(*args)
        if function is np.zeros_like:
            return np.zeros(self.shape)
        if function is np.ones_like:
            return np.ones(self.shape)
        raise TypeError(f"no derivative is known for numpy.{function.__name__}; give the Jacobian analytically")


def derivative(function: Callable[[Any], Any], x: Array) -> Array:
    """Jacobian [p, n, ...] of a function of x[n, ...] that is an expression of NumPy ufuncs, `stack`, `concat` and `where`.

    Raises TypeError when the function uses an operation whose derivative is not known here.
    """
    n = len(x)
    tangent = np.zeros((n, *x.shape))
    tangent[range(n), range(n)] = 1.0
    out = function(Dual(x, tangent))
    if not isinstance(out, Dual):  # a constant function
        return np.zeros((len(out), *x.shape))
    return np.moveaxis(out.tangent, 0, 1)


def _aligned(tangent: Array, ndim: int) -> Array:
    """Tangent [d, ...] with axes inserted after the first, to broadcast against a value of `ndim` axes."""
    return tangent.reshape(len(tangent), *(1,) * (ndim + 1 - tangent.ndim), *tangent.shape[1:])


def _parts(items: Sequence[Any]) -> tuple[list[Array], list[Array]]:
    """Values and tangents of a list of duals and constants, all broadcast to one shape."""
    d = next(len(x.tangent) for x in items if isinstance(x, Dual))
    values = np.broadcast_arrays(*[x.value if isinstance(x, Dual) else np.asarray(x, float) for x in items])
    shape = values[0].shape
    tangents = [np.broadcast_to(_aligned(x.tangent, len(shape)) if isinstance(x, Dual) else 0.0, (d, *shape)) for x in items]
    return list(values), tangents


def _stack(items: Sequence[Any], axis: int = 0) -> Dual:
    if axis != 0:
        raise TypeError("a derivative of numpy.stack is known along the first axis only")
    values, tangents = _parts(items)
    return Dual(np.stack(values), np.stack(tangents, axis=1))


def _concatenate(items: Sequence[Any], axis: int = 0) -> Dual:
    if axis != 0:
        raise TypeError("a derivative of numpy.concatenate is known along the first axis only")
    d, trailing = next((len(x.tangent), x.shape[1:]) for x in items if isinstance(x, Dual))
    values = [x.value if isinstance(x, Dual) else np.asarray(x, float) for x in items]
    tangents = [x.tangent if isinstance(x, Dual) else np.zeros((d, len(x), *trailing)) for x in items]
    return Dual(np.concatenate(values), np.concatenate(tangents, axis=1))


def _where(condition: Any, yes: Any, no: Any) -> Dual:
    (a, b), (da, db) = _parts([yes, no])
    return Dual(np.where(condition, a, b), np.where(condition, da, db))
