"""Jacobians of array expressions by forward-mode differentiation with dual numbers."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from suite.linalg import Array

ONE = 1.0
# Partial derivatives of each ufunc with respect to its inputs; ONE where there is nothing to multiply by.
_PARTIALS: dict[np.ufunc, Callable[..., tuple[Any, ...]]] = {
    np.add: lambda a, b: (ONE, ONE),
    np.subtract: lambda a, b: (ONE, -1.0),
    np.multiply: lambda a, b: (b, a),
    np.divide: lambda a, b: (1.0 / b, -a / (b * b)),
    np.power: lambda a, b: (b * np.power(a, b - 1), np.where(a > 0, np.log(np.where(a > 0, a, 1.0)) * np.power(a, b), 0)),
    np.negative: lambda a: (-1.0,),
    np.positive: lambda a: (ONE,),
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
    """An array v[...] with its derivatives by some variables: for each number of a variable, an array that broadcasts to v.

    A variable that v does not depend on has no entry, so that structural zeros cost nothing.
    """

    def __init__(self, value: Array, tangents: dict[int, Array]):
        self.value, self.tangents = value, tangents

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

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        raise TypeError(f"no derivative is known for the method {name} of an array; give the Jacobian analytically")

    def __array__(self, *_: Any, **__: Any) -> Any:
        raise TypeError("no derivative is known where an array is filled by hand; use numpy.stack or give the Jacobian")

    def __getitem__(self, index: Any) -> "Dual":
        value = self.value[index]
        found = {j: self._entry(t, index) for j, t in self.tangents.items()}
        return Dual(value, {j: t for j, t in found.items() if t.size > 1 or t.any()})

    def _entry(self, t: Array, index: Any) -> Array:
        """What stands at an index of derivatives that broadcast to the value."""
        if isinstance(index, int) and t.ndim == self.ndim:  # components are taken so, one by one, and often
            return np.asarray(t[index] if len(t) > 1 else t[0])
        return _compact(np.broadcast_to(t, self.shape)[index])

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        values = [x.value if isinstance(x, Dual) else x for x in inputs]
        if method != "__call__" or options.get("out") is not None:
            return NotImplemented
        if ufunc in _COMPARISONS:
            return ufunc(*values)
        if ufunc not in _PARTIALS:
            raise TypeError(f"no derivative is known for numpy.{ufunc.__name__}; give the Jacobian analytically")
        value = np.asarray(ufunc(*values))
        tangents: dict[int, Array] = {}
        for x, partial in zip(inputs, _PARTIALS[ufunc](*values), strict=True):
            for j, t in x.tangents.items() if isinstance(x, Dual) else ():
                term = t if partial is ONE else partial * t
                tangents[j] = tangents[j] + term if j in tangents else term
        return Dual(value, tangents)

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


def derivative(function: Callable[[Any], Any], x: Array, along: Sequence[int] | None = None) -> Array:
    """Jacobian [p, n, ...] of a function of x[n, ...] that is an expression of NumPy ufuncs, `stack`, `concat` and `where`.

    along: the components of x to differentiate by, in the order of the columns; all when left out. Raises TypeError when
    the function uses an operation whose derivative is not known here.
    """
    return value_and_derivative(function, x, along)[1]


def value_and_derivative(function: Callable[[Any], Any], x: Array, along: Sequence[int] | None = None) -> tuple[Array, Array]:
    """The value [p, ...] of a function at x[n, ...], and its Jacobian as `derivative` gives it."""
    n = len(x)
    units = np.eye(n).reshape(n, n, *(1,) * (x.ndim - 1))
    chosen = range(n) if along is None else along
    out = function(Dual(x, {j: units[j] for j in chosen}))
    if not isinstance(out, Dual):  # a constant function
        return np.asarray(out, float), np.zeros((len(out), len(chosen), *x.shape[1:]))
    jacobian = np.zeros((len(out), len(chosen), *out.shape[1:]))
    for column, j in enumerate(chosen):
        if j in out.tangents:
            jacobian[:, column] = out.tangents[j]
    return out.value, jacobian


def _compact(t: Array) -> Array:
    """The same derivatives with length 1 along those axes on which they repeat."""
    return np.asarray(t)[tuple(slice(0, 1) if step == 0 else slice(None) for step in np.asarray(t).strides)]


def _value(x: Any) -> Array:
    return x.value if isinstance(x, Dual) else np.asarray(x, float)


def _tangents(items: Sequence[Any], join: Callable[[list[Array]], Array]) -> dict[int, Array]:
    """The derivatives of several duals and constants, joined variable by variable; zero where one has none."""
    variables = dict.fromkeys(j for x in items if isinstance(x, Dual) for j in x.tangents)
    zero = np.zeros(())

    def part(x: Any, j: int) -> Array:
        t = x.tangents.get(j, zero) if isinstance(x, Dual) else zero
        return np.broadcast_to(t, np.shape(_value(x)))

    return {j: join([part(x, j) for x in items]) for j in variables}


def _stack(items: Sequence[Any], axis: int = 0) -> Dual:
    if axis != 0:
        raise TypeError("a derivative of numpy.stack is known along the first axis only")
    values = [_value(x) for x in items]
    shape = (len(items), *np.broadcast_shapes(*(value.shape for value in values)))

    def joined(parts: Iterable[tuple[int, Array]]) -> Array:
        whole = np.zeros(shape)
        for place, part in parts:
            whole[place] = part
        return whole

    known = [(i, x.tangents) for i, x in enumerate(items) if isinstance(x, Dual)]
    variables = dict.fromkeys(j for _, tangents in known for j in tangents)
    found = {j: joined((i, tangents[j]) for i, tangents in known if j in tangents) for j in variables}
    return Dual(joined(enumerate(values)), found)


def _concatenate(items: Sequence[Any], axis: int = 0) -> Dual:
    if axis != 0:
        raise TypeError("a derivative of numpy.concatenate is known along the first axis only")
    return Dual(np.concatenate([_value(x) for x in items]), _tangents(items, np.concatenate))


def _where(condition: Any, yes: Any, no: Any) -> Dual:
    def join(parts: Sequence[Array]) -> Array:
        return np.where(condition, *parts)

    return Dual(join([_value(yes), _value(no)]), _tangents([yes, no], join))
