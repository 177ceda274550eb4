"""Proposals of particle filters: from particles of step k - 1 and the measurement y_k to particles of step k.

A proposal returns draws x[n, R, N], their `fit` [R, N] and the `evidence` [R, N] of where they came from. The log of a
draw's weight is fit + evidence; the evidence does not depend on the draw, so in a Metropolis-Hastings ratio of two draws
from one parent only their fits remain.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from suite import pointwise
from suite.linalg import Array, apply
from suite.model import AdditiveSensor, AdditiveTransition, StateSpaceModel
from suite.noise import Gaussian
from suite.random import Generators

Proposed = tuple[Array, Array, Array]
Proposal = Callable[[StateSpaceModel, Array, Array, int, Generators], Proposed]
"""propose(model, x[n, R, N], y[m, R], k, rng) -> (draws[n, R, N], fit[R, N], evidence[R, N])."""


def from_transition(model: StateSpaceModel, x: Array, y: Array, k: int, rng: Generators) -> Proposed:
    """Draws from the transition, blind to y_k: their fit is the likelihood (Gordon, Salmond and Smith, 1993)."""
    drawn = model.dynamics.sample(rng, x, k)
    return drawn, model.sensor.logpdf(y, drawn, k), np.zeros(x.shape[1:])


def linearised(model: StateSpaceModel, x: Array, y: Array, k: int, rng: Generators) -> Proposed:
    """Draws from the locally linearised optimal proposal, for additive Gaussian noises.

    The sensor is linearised at each predicted state Psi = f(x); the proposal is the posterior under that linear sensor,
    N(Psi + K nu, (I - K H) Q) with S = H Q H' + R, K = Q H' S^-1, nu = z - h(Psi) (Doucet, Godsill and Andrieu, 2000;
    Pavlov and Bruno, eqs 18-20). The evidence is log N(nu; 0, S), the fit log p(y | x) - log N(nu - H (x - Psi); 0, R).
    """
    ahead = linearise(model, x, y, k)
    drawn = ahead.draw(rng)
    return drawn, ahead.fit(drawn), ahead.evidence()


@dataclass(frozen=True)
class Linearised:
    """Where each particle is predicted to be, the linear sensor there, and the measurement.

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
        assert isinstance(self.model.sensor, AdditiveSensor)
        drawn = dynamics.disturbance(rng, shape, self.k)
        rest = self.error - pointwise.times(self.slope, drawn)
        rest -= self.model.sensor.noise.sample(rng, shape)  # what was not observed meets a slope of 0
        rest = pointwise.solve_upper(self.lower, pointwise.solve_lower(self.lower, rest))
        drawn += apply(dynamics.noise_cov(self.k), pointwise.transposed_times(self.slope, rest))
        drawn += self.predicted
        return drawn

    def fit(self, x: Array) -> Array:
        """log p(y | x) - log N(linear residual; 0, R) [R, N]: how far the likelihood at x is from the linear sensor's."""
        rest = self.error - pointwise.times(self.slope, x - self.predicted)
        return self.model.sensor.logpdf(self.y, x, self.k) - self._log_normal(self.noise, rest)

    def evidence(self) -> Array:
        """log N(nu; 0, S) [R, N]: likelihood of the measurement under the linear sensor, given the parent."""
        return self._log_normal(self.lower, self.error)

    def _log_normal(self, lower: Array, e: Array) -> Array:
        """log N(e; 0, L L') over the components observed [R, N]."""
        white = pointwise.solve_lower(lower, e)
        constant = -0.5 * np.log(2 * np.pi) * np.isfinite(self.y).sum(0)[:, None]
        return np.asarray(constant - 0.5 * pointwise.dot(white, white) - pointwise.log_diagonal(lower))


def accepts(model: StateSpaceModel) -> str | None:
    """None when the model has additive Gaussian noises of mean zero, otherwise why the linearised proposal refuses it."""
    for part, law, kind in (("process", model.dynamics, AdditiveTransition), ("measurement", model.sensor, AdditiveSensor)):
        if not isinstance(law, AdditiveTransition | AdditiveSensor) or not isinstance(law, kind):
            return f"its {part} noise is not additive"
        noise = law.noise_at(1) if isinstance(law, AdditiveTransition) else law.noise
        if not isinstance(noise, Gaussian) or noise.mean.any():
            return f"its {part} noise is not Gaussian with mean zero"
    return None


def needs_density(model: StateSpaceModel) -> str | None:
    """None when the transition has a density over the whole state, otherwise why a proposal that weighs by it refuses."""
    at = model.prior.mean[:, None]
    try:
        model.dynamics.logpdf(at, at, 1)
    except ValueError:
        return "its process noise is singular or enters through a gain: the transition has no density"
    return None


def linearise(model: StateSpaceModel, x: Array, y: Array, k: int) -> Linearised:
    """The linear sensors of the particles x[n, R, N] of step k - 1, given y_k = y[m, R]."""
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
    lower = pointwise.cholesky(_projected(slope, dynamics.noise_cov(k)) + noise)
    return Linearised(model, y, k, predicted, slope, error, lower, pointwise.cholesky(noise))


def _projected(slope: Array, cov: Array) -> Array:
    """H Q H' [m, m, R, N] for slopes H[m, n, R, N] and one covariance Q[n, n]; the lower triangle alone is filled."""
    m = len(slope)
    out = np.zeros((m, m, *slope.shape[2:]))
    for i in range(m):
        row = apply(cov, slope[i])
        for j in range(i + 1):
            out[i, j] = pointwise.dot(row, slope[j])
    return out
