"""The classic Runge-Kutta rule of fourth order, and the same rule for the equations linearised about each of its stages."""

from collections.abc import Callable

import numpy as np

from suite.linalg import Array


def step(velocity: Callable[[Array], Array], x: Array, dt: float) -> Array:
    """State [n, ...] a time dt after x[n, ...] (Kutta, 1901)."""
    first = velocity(x)
    second = velocity(x + dt / 2 * first)
    third = velocity(x + dt / 2 * second)
    fourth = velocity(x + dt * third)
    return x + dt / 6 * (first + 2.0 * (second + third) + fourth)


def step_with_slopes(
    velocity: Callable[[Array], Array], stretched: Callable[[Array, Array], Array], x: Array, d: Array, dt: float
) -> tuple[Array, Array]:
    """What `step` gives, and deviations [n, n, ...] that are d[n, n, ...] at x. stretched: the Jacobian of velocity times d."""
    first, d_first = velocity(x), stretched(x, d)
    second, d_second = velocity(x + dt / 2 * first), stretched(x + dt / 2 * first, d + dt / 2 * d_first)
    third, d_third = velocity(x + dt / 2 * second), stretched(x + dt / 2 * second, d + dt / 2 * d_second)
    fourth, d_fourth = velocity(x + dt * third), stretched(x + dt * third, d + dt * d_third)
    after = x + dt / 6 * (first + 2.0 * (second + third) + fourth)
    return after, d + dt / 6 * (d_first + 2.0 * (d_second + d_third) + d_fourth)


def unit_deviations(x: Array) -> Array:
    """Deviations [n, n, ...] of one in each component of states x[n, ...]."""
    n = len(x)
    return np.broadcast_to(np.eye(n).reshape(n, n, *[1] * (x.ndim - 1)), (n, *x.shape))
