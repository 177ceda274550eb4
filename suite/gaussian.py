"""The Gaussian filter: prediction and update by moments, whatever rule computes them.

A rule turns the Gaussian N(mean, cov) of a state and a function of it into the moments of the function's value. The
Kalman filter and the unscented filter are this filter with different rules. Stacks are one matrix a run, [R, n, n].
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from suite.estimator import Readout
from suite.linalg import Array, cholesky, square_root, symmetric
from suite.model import AdditiveSensor, AdditiveTransition, Affine, Function, StateSpaceModel

Moments = tuple[Array, Array, Array]
"""Mean [R, p] and covariance [R, p, p] of the value, and cross-covariance [R, n, p] of state and value."""

Residual = Callable[[Array, Array], Array]
Rule = Callable[[Array, Array, Function, int, Residual], Moments]
"""rule(mean[R, n], cov[R, n, n], function, k, residual) -> Moments; residual subtracts values, wrapping angles."""


@dataclass(frozen=True)
class GaussianBelief:
    """Mean [R, n] and covariance [R, n, n] of the state, with this step's log-likelihood and whitened innovation."""

    mean: Array
    cov: Array
    loglik: Array | None = None
    innovation: Array | None = None

    def read(self) -> Readout:
        """The belief as a readout, components first."""
        return Readout(self.mean.T, np.moveaxis(self.cov, 0, -1), self.loglik, innovation=self.innovation)


def prior(model: StateSpaceModel, runs: int) -> GaussianBelief:
    """The model's prior, once a run."""
    mean, cov = model.prior.mean, model.prior.cov
    return GaussianBelief(np.tile(mean, (runs, 1)), np.tile(cov, (runs, 1, 1)))


def additive(model: StateSpaceModel) -> str | None:
    """None when both noises of the model are additive, otherwise why a Gaussian filter does not take it."""
    for part, law, kind in (("process", model.dynamics, AdditiveTransition), ("measurement", model.sensor, AdditiveSensor)):
        if not isinstance(law, kind):
            return f"its {part} noise is not additive"
    return None


def predict(rule: Rule, belief: GaussianBelief, dynamics: AdditiveTransition, k: int) -> GaussianBelief:
    """Belief about x_k from the belief about x_{k-1}."""
    mean, cov, _ = rule(belief.mean, belief.cov, dynamics.mean, k, np.subtract)
    return GaussianBelief(mean + dynamics.noise_mean(k), symmetric(cov + dynamics.noise_cov(k)))


def update(rule: Rule, belief: GaussianBelief, sensor: AdditiveSensor, y: Array, k: int) -> GaussianBelief:
    """Belief about x_k after the measurement y[m, R]; missing components (NaN) drop out, run by run.

    A missing row gets an innovation of zero, no correlation with the state, and a unit variance of its own: it then
    factors out of the gain exactly, and all runs keep one shape.
    """
    expected, cov, cross = rule(belief.mean, belief.cov, sensor.mean, k, sensor.residual)
    cov = cov + sensor.noise.cov
    error = sensor.residual(np.ascontiguousarray(y), np.ascontiguousarray((expected + sensor.noise.mean).T)).T
    observed = ~np.isnan(error)
    if not observed.all():
        error = np.where(observed, error, 0.0)
        cross = np.where(observed[:, None, :], cross, 0.0)
        both = observed[:, :, None] & observed[:, None, :]
        cov = np.where(both, cov, np.eye(len(y)))
    lower = cholesky(symmetric(cov))
    # With S = L Lᵀ and A = C L⁻ᵀ: gain K = A L⁻¹, so K e = A (L⁻¹ e) and K S Kᵀ = A Aᵀ.
    half = np.linalg.solve(lower, np.swapaxes(cross, 1, 2))
    white = np.linalg.solve(lower, error[..., None])
    half_t = np.ascontiguousarray(np.swapaxes(half, 1, 2))
    mean = belief.mean + (half_t @ white)[..., 0]
    posterior = symmetric(belief.cov - half_t @ half)
    white = white[..., 0]
    log_det = np.log(np.where(observed, np.diagonal(lower, axis1=1, axis2=2), 1.0)).sum(-1)
    loglik = -0.5 * (white * white).sum(-1) - log_det - 0.5 * np.log(2 * np.pi) * observed.sum(-1)
    return GaussianBelief(mean, posterior, loglik, np.where(observed, white, np.nan).T)


def affine(mean: Array, cov: Array, function: Function, k: int, residual: Residual) -> Moments:
    """The exact rule for affine functions: the Kalman filter (Kalman, 1960)."""
    assert isinstance(function, Affine)
    matrix = function.matrix(k)
    value = function(np.ascontiguousarray(mean.T), k).T
    cross = cov @ matrix.T
    return value, matrix @ cross, cross


def unscented(n: int, alpha: float, beta: float, kappa: float) -> Rule:
    """The scaled unscented rule with 2n + 1 sigma points (Julier and Uhlmann, 2004; Wan and van der Merwe, 2000)."""
    spread = alpha**2 * (n + kappa)
    offsets = np.sqrt(spread) * np.concatenate([np.zeros((n, 1)), np.eye(n), -np.eye(n)], axis=1)
    weights = np.full(2 * n + 1, 0.5 / spread)
    weights[0] = 1.0 - n / spread
    cov_weights = weights.copy()
    cov_weights[0] += 1.0 - alpha**2 + beta

    def rule(mean: Array, cov: Array, function: Function, k: int, residual: Residual) -> Moments:
        away = square_root(cov) @ offsets
        points = np.ascontiguousarray(np.moveaxis(mean[..., None] + away, 1, 0))
        values = function(points, k)
        # Averaging differences to the central point, not values, is right for angles as well.
        centre = values[..., :1]
        difference = residual(values, centre)
        shift = (difference * weights).sum(-1)
        value = centre[..., 0] + shift
        rest = np.ascontiguousarray(np.moveaxis(difference - shift[..., None], 1, 0))
        weighted = np.swapaxes(rest * cov_weights, 1, 2)
        return value.T, rest @ weighted, away @ weighted

    return rule
