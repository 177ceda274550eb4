"""The locally linearised optimal proposal of a particle filter, for additive Gaussian noises.

For each particle the sensor is linearised at the predicted state Psi = f(x_{k-1}); the proposal is the posterior of the
state under that linear sensor, N(Psi + K nu, (I - K H) Q) with S = H Q H' + R, K = Q H' S^-1, nu = z - h(Psi) (Doucet,
Godsill and Andrieu, 2000; Pavlov and Bruno, eqs 18-20). Particle-wise matrices are components first, [m, n, R, N], and
their algebra is written as loops over matrix indices.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from suite.linalg import Array, apply
from suite.model import AdditiveSensor, AdditiveTransition, StateSpaceModel
from suite.noise import Gaussian
from suite.random import Generators
from suite.resampling import Indices, select


@dataclass(frozen=True)
class Linearised:
    """The proposal of every particle at one step: where it stands, its linear sensor, and the measurement.

    predicted[n, R, N]; slope[m, n, R, N], the sensor's Jacobian there; error[m, R, N], measurement minus prediction;
    lower[m, m, R, N], Cholesky factor of S; noise[m, m, R, 1], that of R. Components that were not observed have slope 0,
    error 0 and unit variance of their own: they drop out of all that follows.
    """

    model: StateSpaceModel
    y: Array
    k: int
    predicted: Array
    slope: Array
    error: Array
    lower: Array
    noise: Array

    def draw(self, rng: Generators) -> Array:
        """One draw [n, R, N] for each particle, by Matheron's rule: a prior draw, moved by its simulated residual.

        With w ~ N(0, Q) and v ~ N(0, R): x = Psi + w + K (nu - H w - v). It needs neither the inverse of Q, which may be
        singular, nor a factor of the posterior covariance.
        """
        dynamics, shape = self.model.dynamics, self.predicted.shape[1:]
        assert isinstance(dynamics, AdditiveTransition)
        jitter = dynamics.disturbance(rng, shape, self.k)
        rest = self.error - _times(self.slope, jitter) - self._measurement_noise(rng)
        weights = _solve_upper(self.lower, _solve_lower(self.lower, rest))
        return self.predicted + jitter + apply(dynamics.noise_cov(self.k), _transposed_times(self.slope, weights))

    def excess(self, x: Array) -> Array:
        """log p(y | x) - log N(linear residual; 0, R) [R, N]: how far the likelihood at x is from the linear sensor's.

        The logarithm of a particle's weight is this plus `evidence`; in a Metropolis-Hastings ratio `evidence` cancels.
        """
        rest = self.error - _times(self.slope, x - self.predicted)
        return self.model.sensor.logpdf(self.y, x, self.k) - self._log_normal(self.noise, rest)

    def evidence(self) -> Array:
        """log N(nu; 0, S) [R, N]: likelihood of the measurement under the linear sensor, given the parent."""
        return self._log_normal(self.lower, self.error)

    def of(self, runs: NDArray[np.intp], parents: Indices) -> "Linearised":
        """The proposals of the chosen runs and, in each of them, of the chosen parents [runs, N]."""
        return replace(
            self,
            y=self.y[:, runs],
            predicted=select(self.predicted[:, runs], parents),
            slope=select(self.slope[:, :, runs], parents),
            error=select(self.error[:, runs], parents),
            lower=select(self.lower[:, :, runs], parents),
            noise=self.noise[:, :, runs],
        )

    def _log_normal(self, lower: Array, e: Array) -> Array:
        """log N(e; 0, L L') over the components observed [R, N]."""
        white = _solve_lower(lower, e)
        total = -0.5 * np.log(2 * np.pi) * np.isfinite(self.y).sum(0)[:, None]
        for i, row in enumerate(white):
            total = total - 0.5 * row * row - np.log(lower[i, i])
        return np.asarray(total)

    def _measurement_noise(self, rng: Generators) -> Array:
        sensor = self.model.sensor
        assert isinstance(sensor, AdditiveSensor)
        draws = sensor.noise.sample(rng, self.predicted.shape[1:])
        return np.where(np.isfinite(self.y)[:, :, None], draws, 0.0)


def accepts(model: StateSpaceModel) -> str | None:
    """None when the model has additive Gaussian noises of mean zero, otherwise why the proposal does not take it."""
    for part, law, kind in (("process", model.dynamics, AdditiveTransition), ("measurement", model.sensor, AdditiveSensor)):
        if not isinstance(law, AdditiveTransition | AdditiveSensor) or not isinstance(law, kind):
            return f"its {part} noise is not additive"
        noise = law.noise_at(1) if isinstance(law, AdditiveTransition) else law.noise
        if not isinstance(noise, Gaussian) or noise.mean.any():
            return f"its {part} noise is not Gaussian with mean zero"
    return None


def linearise(model: StateSpaceModel, x: Array, y: Array, k: int) -> Linearised:
    """The proposals of the particles x[n, R, N] of step k - 1, given y_k = y[m, R]."""
    dynamics, sensor = model.dynamics, model.sensor
    assert isinstance(dynamics, AdditiveTransition)
    assert isinstance(sensor, AdditiveSensor)
    predicted = dynamics.mean(x, k)
    error = sensor.residual(y[:, :, None], sensor.mean(predicted, k))
    slope = np.asarray(sensor.jacobian(predicted, k))
    seen = np.isfinite(y)
    noise = np.repeat(sensor.noise.cov[:, :, None, None], y.shape[1], axis=2)
    if not seen.all():
        both = (seen[:, None] & seen[None])[..., None]
        noise = np.where(both, noise, np.eye(len(y))[:, :, None, None])
        error = np.where(seen[:, :, None], error, 0.0)
        slope = np.where(seen[:, None, :, None], slope, 0.0)
    lower = _cholesky(_projected(slope, dynamics.noise_cov(k)) + noise)
    return Linearised(model, y, k, predicted, slope, error, lower, _cholesky(noise))


def _projected(slope: Array, cov: Array) -> Array:
    """H Q H' [m, m, R, N] for slopes H[m, n, R, N] and one covariance Q[n, n]."""
    m = len(slope)
    out = np.empty((m, m, *slope.shape[2:]))
    for i in range(m):
        row = apply(cov, slope[i])
        for j in range(i + 1):
            out[i, j] = out[j, i] = _dot(row, slope[j])
    return out


def _dot(a: Array, b: Array) -> Array:
    """Sum of products over the leading axis, in a fixed order."""
    total = a[0] * b[0]
    for p, q in zip(a[1:], b[1:], strict=True):
        total = total + p * q
    return np.asarray(total)


def _times(matrix: Array, x: Array) -> Array:
    """Particle-wise product of matrix[m, n, ...] and x[n, ...]."""
    return np.stack([_dot(row, x) for row in matrix])


def _transposed_times(matrix: Array, x: Array) -> Array:
    """Particle-wise product of the transpose of matrix[m, n, ...] and x[m, ...]."""
    total = matrix[0] * x[0]
    for row, factor in zip(matrix[1:], x[1:], strict=True):
        total = total + row * factor
    return np.asarray(total)


def _cholesky(matrix: Array) -> Array:
    """Particle-wise lower Cholesky factor of matrix[m, m, ...]; NaN where it is not positive definite."""
    m = len(matrix)
    lower = np.zeros_like(matrix)
    for j in range(m):
        lower[j, j] = np.sqrt(matrix[j, j] - _dot(lower[j, :j], lower[j, :j]) if j else matrix[j, j])
        for i in range(j + 1, m):
            rest = matrix[i, j] - _dot(lower[i, :j], lower[j, :j]) if j else matrix[i, j]
            lower[i, j] = rest / lower[j, j]
    return lower


def _solve_lower(lower: Array, b: Array) -> Array:
    """Particle-wise solution of L z = b[m, ...]."""
    z: list[Array] = []
    for i, row in enumerate(b):
        rest = row
        for j in range(i):
            rest = rest - lower[i, j] * z[j]
        z.append(rest / lower[i, i])
    return np.stack(z)


def _solve_upper(lower: Array, b: Array) -> Array:
    """Particle-wise solution of L' z = b[m, ...]."""
    m = len(b)
    z: list[Array] = [b[0]] * m
    for i in reversed(range(m)):
        rest = b[i]
        for j in range(i + 1, m):
            rest = rest - lower[j, i] * z[j]
        z[i] = rest / lower[i, i]
    return np.stack(z)
