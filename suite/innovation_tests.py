"""Tests on the innovations of a Gaussian filter: under its model they are white, and any signal in them is a manoeuvre."""

import numpy as np
from scipy import special

from suite.gaussian import GaussianBelief
from suite.linalg import Array

LARGEST = 1e150
"""Innovations are cut off here, so that their squares, and sums of these, stay numbers."""
TOLERANCE = 1e-10
"""A regressor is a combination of others when they leave less than this share of its square unexplained."""


def whitened(belief: GaussianBelief) -> Array:
    """The whitened innovations [R, m] of a belief's last measurement, zero where nothing was observed."""
    assert belief.innovation is not None
    white = np.clip(belief.innovation, -LARGEST, LARGEST)
    return np.ascontiguousarray(np.where(np.isnan(white), 0.0, white).T)


def log_survival(x: Array, dof: Array) -> Array:
    """Log-probability that a chi-square variable with dof[R] degrees of freedom exceeds x[R]: [R]; 0 for 0 degrees.

    By the finite sum for integer degrees (Abramowitz and Stegun, 1964, eqs 26.4.4-5), all of whose terms are positive: exact
    also where the probability itself is too small for a number, as it soon is after a manoeuvre.
    """
    half, odd = x / 2, dof % 2
    total = np.where(odd == 1, np.log(2) + special.log_ndtr(-np.sqrt(x)), -np.inf)
    for i in range(int(dof.max(initial=0)) // 2):
        power = i + odd / 2
        term = special.xlogy(power, half) - half - special.gammaln(power + 1)
        total = np.where(power < dof / 2, np.logaddexp(total, term), total)
    return np.where(dof > 0, total, 0.0)


def explained(moments: Array) -> Array:
    """How much of a sum of squares regressors explain: bᵀ A⁺ b [...] from moments [[A, b], [bᵀ, c]] [..., r + 1, r + 1].

    By Gaussian elimination; a pivot below TOLERANCE of its diagonal belongs to a regressor that is zero or a combination of
    those before it, and is passed over. As b is in the range of A, that gives what the pseudo-inverse does.
    """
    smallest = TOLERANCE * np.diagonal(moments, axis1=-2, axis2=-1)
    total = np.zeros(moments.shape[:-2])
    for j in range(moments.shape[-1] - 1):
        row, pivot = moments[..., j, :], moments[..., j, j]
        share = row * np.divide(1.0, pivot, out=np.zeros_like(pivot), where=pivot > smallest[..., j])[..., None]
        total = total + share[..., -1] * row[..., -1]
        moments = moments - share[..., :, None] * row[..., None, :]
    return total
