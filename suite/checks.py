"""Checks of what a user gives: each raises ValueError of one line that names the field and what is wrong with it."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from suite.errors import one_line

KINDS = ("a number", "a vector", "a matrix")


def shown(value: Any) -> str:
    """A value on one line of bearable length."""
    return " ".join(repr(value).split())[:100]


def numbers(field: str, given: Any) -> NDArray[np.float64]:
    """`given` as an array of floating-point numbers."""
    try:
        array = np.asarray(given)
        if array.dtype.kind in "biufO":  # text and complex numbers are not taken for numbers
            return np.asarray(array, float)
    except (TypeError, ValueError):  # ragged, or of other objects
        pass
    raise ValueError(f"{field} is not an array of numbers")


def shaped(field: str, given: Any, axes: int) -> NDArray[np.float64]:
    """`given` as an array of numbers with so many axes."""
    array = numbers(field, given)
    if array.ndim != axes:
        raise ValueError(f"{field} has shape {array.shape}, it must be {KINDS[axes]}")
    return array


def finite(field: str, given: Any, axes: int) -> NDArray[np.float64]:
    """`given` as an array of finite numbers with so many axes."""
    array = shaped(field, given, axes)
    if not np.isfinite(array).all():
        at = tuple(np.argwhere(~np.isfinite(array))[0].tolist())
        raise ValueError(f"{field}{list(at) if at else ''} is {array[at]}, not a finite number")
    return array


def positive(field: str, given: Any) -> NDArray[np.float64]:
    """`given` as a vector of finite numbers above zero."""
    array = finite(field, given, 1)
    for i in np.flatnonzero(array <= 0)[:1]:
        raise ValueError(f"{field}[{i}] is {array[i]}, not positive")
    return array


def instance(field: str, given: Any, kind: type) -> None:
    """Whether `given` is of a type."""
    if not isinstance(given, kind):
        raise ValueError(f"{field} is of type {type(given).__name__}, not a {kind.__name__}")


def several(field: str, given: Any, kind: type) -> tuple[Any, ...]:
    """`given` as a tuple of at least one object of a type."""
    if not isinstance(given, tuple | list):
        raise ValueError(f"{field} is of type {type(given).__name__}, not a tuple of {kind.__name__}")
    if not given:
        raise ValueError(f"{field} is empty")
    for i, each in enumerate(given):
        instance(f"{field}[{i}]", each, kind)
    return tuple(given)


def is_integer(given: Any) -> bool:
    """Whether `given` is a whole number by its type; truth values are none."""
    return isinstance(given, int | np.integer) and not isinstance(given, bool)


def places(field: str, given: Sequence[int], count: int) -> tuple[int, ...]:
    """`given` as distinct indices of `count` components."""
    listed = given.tolist() if isinstance(given, np.ndarray) else given
    whole = isinstance(listed, tuple | list) and all(is_integer(i) and 0 <= i < count for i in listed)
    if not whole or len(set(listed)) < len(listed):
        raise ValueError(f"{field} must be distinct indices of {count} components, from 0 to {count - 1}, got {shown(given)}")
    return tuple(int(i) for i in listed)


def sized(field: str, function: Callable[..., Any], at: tuple[NDArray[np.float64], ...], size: int) -> None:
    """Whether a function of `at`, a state [n, 1] and perhaps a noise [q, 1], and the time index has so many components."""
    try:
        with np.errstate(all="ignore"):  # where it is not defined it still has a shape
            shape = np.shape(function(*at, 1))
    except Exception as error:
        raise ValueError(f"{field} fails at the prior mean: {one_line(error)}") from error
    if shape != (size, 1):
        given = " and a noise of shape ".join(str(x.shape) for x in at)
        raise ValueError(f"{field} maps a state of shape {given} to {shape}, not {(size, 1)}")
