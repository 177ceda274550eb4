"""Angles in radians, and differences of vectors some of whose components are angles."""

import numpy as np

from suite.linalg import Array


def wrap(angle: Array) -> Array:
    """Angles in radians, brought to (-pi, pi]."""
    return angle - 2 * np.pi * np.ceil(angle / (2 * np.pi) - 0.5)


def difference(z: Array, expected: Array, angles: tuple[int, ...]) -> Array:
    """Difference z - expected [m, ...], those components listed in `angles` wrapped to (-pi, pi]."""
    rest = z - expected
    for i in angles:
        rest[i] = wrap(rest[i])
    return rest
