"""Proposals of particle filters: from particles of step k - 1 and the measurement y_k to particles of step k.

A proposal returns draws x[n, R, N], their `fit` [R, N] and the `evidence` [R, N] of where they came from. The log of a
draw's weight is fit + evidence; the evidence does not depend on the draw, so in a Metropolis-Hastings ratio of two draws
from one parent only their fits remain.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from suite import pointwise
from suite.errors import one_line
from suite.linalg import Array
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


Row = dict[int, Array]
"""One row of a matrix a particle: the entries [R, N] that are not zero everywhere, by column."""


@dataclass(frozen=True)
class Linearised:
    """Where each particle is predicted to be, the linear sensor there, and the measurement.

    predicted[n, R, N]; slope, the m rows of the sensor's Jacobian H there; cross, the m rows of H Q; error[m, R, N],
    measurement minus prediction; lower[m, m, R, N], Cholesky factor of S. Components that were not observed have slope 0,
    error 0 and unit variance of their own: they drop out of all that follows.
    """

    model: StateSpaceModel
    y: Array
    k: int
    predicted: Array
    slope: list[Row]
    cross: list[Row]
    error: Array
    lower: Array

    def draw(self, rng: Generators) -> Array:
        """One draw [n, R, N] for each particle, by Matheron's rule: a prior draw, moved by its simulated residual.

        With w ~ N(0, Q) and v ~ N(0, R): x = Psi + w + K (nu - H w - v). It needs neither the inverse of Q, which may be
        singular, nor a factor of the posterior covariance.
        """
        dynamics, shape = self.model.dynamics, self.predicted.shape[1:]
        assert isinstance(dynamics, AdditiveTransition)
        assert isinstance(self.model.sensor, AdditiveSensor)
        drawn = dynamics.disturbance(rng, shape, self.k)
        rest = self.error - _times(self.slope, drawn)
        rest -= self.model.sensor.noise_at(self.k).sample(rng, shape)  # what was not observed meets a slope of 0
        rest = pointwise.solve_upper(self.lower, pointwise.solve_lower(self.lower, rest))
        drawn += self.predicted
        for row, weight in zip(self.cross, rest, strict=True):
            for i, entry in row.items():
                drawn[i] += entry * weight
        return drawn

    def fit(self, x: Array) -> Array:
        """log p(y | x) - log N(linear residual; 0, R) [R, N]: how far the likelihood at x is from the linear sensor's."""
        sensor = self.model.sensor
        assert isinstance(sensor, AdditiveSensor)
        rest = self.error - _times(self.slope, x - self.predicted)
        return sensor.logpdf(self.y, x, self.k) - sensor.noise_logpdf(self.y, rest, self.k)

    def evidence(self) -> Array:
        """log N(nu; 0, S) [R, N]: likelihood of the measurement under the linear sensor, given the parent."""
        white = pointwise.solve_lower(self.lower, self.error)
        constant = -0.5 * np.log(2 * np.pi) * np.isfinite(self.y).sum(0)[:, None]
        return np.asarray(constant - 0.5 * pointwise.dot(white, white) - pointwise.log_diagonal(self.lower))


def accepts(model: StateSpaceModel) -> str | None:
    """None when the model has additive Gaussian noises of mean zero, otherwise why the linearised proposal refuses it."""
    for part, law, kind in (("process", model.dynamics, AdditiveTransition), ("measurement", model.sensor, AdditiveSensor)):
        if not isinstance(law, AdditiveTransition | AdditiveSensor) or not isinstance(law, kind):
            return f"its {part} noise is not additive"
        noise = law.noise_at(1)
        if not isinstance(noise, Gaussian) or noise.mean.any():
            return f"its {part} noise is not Gaussian with mean zero"
    at = model.prior.mean[:, None, None]
    try:
        with np.errstate(all="ignore"):
            model.sensor.linearised(at, 1)  # type: ignore[attr-defined]
    except Exception as error:
        return f"its sensor cannot be differentiated: {one_line(error)}"
    return None


def centred_noise(law: AdditiveTransition | AdditiveSensor, k: int) -> Gaussian:
    """The noise at step k. Raises ValueError when it is not Gaussian with mean zero there, as it was at the first."""
    noise = law.noise_at(k)
    if not isinstance(noise, Gaussian) or noise.mean.any():
        part = "process" if isinstance(law, AdditiveTransition) else "measurement"
        raise ValueError(f"the {part} noise of this step is not Gaussian with mean zero, as that of the first is")
    return noise


def has_likelihood(model: StateSpaceModel) -> str | None:
    """None when measurements have a density given the state, otherwise why there is nothing to weigh particles by."""
    try:
        with np.errstate(all="ignore"):
            model.sensor.logpdf(np.zeros((model.m, 1)), model.prior.mean[:, None, None], 1)
    except ValueError as error:
        return f"its measurements have no likelihood: {one_line(error)}"
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
    centred_noise(dynamics, k)
    predicted = dynamics.mean(x, k)
    expected, slope = sensor.linearised(predicted, k)
    error = sensor.residual(y[:, :, None], expected)
    seen = np.isfinite(y)
    noise = np.repeat(centred_noise(sensor, k).cov[:, :, None, None], y.shape[1], axis=2)
    if not seen.all():
        both = (seen[:, None] & seen[None])[..., None]
        noise = np.where(both, noise, np.eye(len(y))[:, :, None, None])
        error = np.where(seen[:, :, None], error, 0.0)
        slope = np.where(seen[:, None, :, None], slope, 0.0)
    rows = [_sparse(row) for row in slope]
    cross = [_projected(row, dynamics.noise_cov(k).tolist()) for row in rows]
    spread = np.empty((len(y), len(y), *x.shape[1:]))  # S, its lower triangle
    for i, j in zip(*np.tril_indices(len(y)), strict=True):
        spread[i, j] = _dot(cross[i], rows[j]) + noise[i, j]
    return Linearised(model, y, k, predicted, rows, cross, error, pointwise.cholesky(spread))


def _sparse(entries: Array) -> Row:
    """The row with entries[n, R, N]."""
    return {j: e for j, e in enumerate(entries) if e.flat[0] or e.any()}


def _projected(row: Row, cov: list[list[float]]) -> Row:
    """A row times a constant symmetric matrix."""
    products = {i: [column[j] * entry for j, entry in row.items() if column[j]] for i, column in enumerate(cov)}
    return {i: _total(terms) for i, terms in products.items() if terms}


def _dot(a: Row, b: Row) -> Array | float:
    """Product of one row and another, transposed."""
    terms = [entry * b[j] for j, entry in a.items() if j in b]
    return _total(terms) if terms else 0.0


def _total(terms: list[Array]) -> Array:
    """Sum of fresh arrays, in the first of them."""
    for term in terms[1:]:
        terms[0] += term
    return terms[0]


def _times(rows: list[Row], x: Array) -> Array:
    """Product of a matrix, row by row, and x[n, R, N]."""
    out = np.zeros((len(rows), *x.shape[1:]))
    for total, row in zip(out, rows, strict=True):
        for j, entry in row.items():
            total += entry * x[j]
    return out
