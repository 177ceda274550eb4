"""The Epanechnikov kernel of kernel density estimation: optimal bandwidth and draws."""

import numpy as np
from scipy.special import gammaln

from suite.linalg import Array
from suite.random import Generators


def bandwidth(n: int, count: int) -> float:
    """Bandwidth h = A N^(-1/(n+4)) that is optimal for a Gaussian density with unit covariance (Silverman, 1986).

    A = [8 (n + 4) (2 sqrt(pi))^n / c_n]^(1/(n+4)) with c_n the volume of the unit ball in n dimensions.
    """
    log_volume = 0.5 * n * np.log(np.pi) - gammaln(n / 2 + 1)
    log_a = (np.log(8 * (n + 4)) + n * np.log(2 * np.sqrt(np.pi)) - log_volume) / (n + 4)
    return float(np.exp(log_a - np.log(count) / (n + 4)))


def epanechnikov(rng: Generators, n: int, count: int) -> Array:
    """Draws [n, R, N] from K(e) proportional to 1 - |e|² on the unit ball: mean zero, covariance I / (n + 4).

    |e|² is Beta(n/2, 2) and the direction uniform. A Beta variate is a ratio of Gamma ones.
    """
    shape = (1, rng.runs, count)
    a, b = rng.standard_gamma(n / 2, shape), rng.standard_gamma(2.0, shape)
    direction = rng.standard_normal((n, rng.runs, count))
    norm = direction[0] * direction[0]
    for row in direction[1:]:
        norm = norm + row * row
    return np.asarray(direction * np.sqrt(a[0] / ((a[0] + b[0]) * norm)))
