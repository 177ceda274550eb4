"""Filters of filterpy 2 (R. Labbe), one filter object a run."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from suite.estimator import Filter, Readout
from suite.gaussian import additive
from suite.linalg import Array
from suite.model import AdditiveSensor, StateSpaceModel, wrap
from suite.parameters import parameter
from suite.random import Generators

if TYPE_CHECKING:
    from filterpy.kalman import UnscentedKalmanFilter


@dataclass(frozen=True)
class FilterpyBelief:
    """One filterpy filter a run, and the log-likelihood of the last measurement [R]."""

    filters: "tuple[UnscentedKalmanFilter, ...]"
    loglik: Array


@dataclass(frozen=True)
class FilterpyUnscented(Filter):
    """Unscented Kalman filter of filterpy 2, run by run with van der Merwe's sigma points."""

    name: ClassVar[str] = "filterpy:ukf"
    reference: ClassVar[str] = "R. R. Labbe, filterpy 2, filterpy.kalman.UnscentedKalmanFilter"
    alpha: float = parameter(1.0, "spread of the sigma points", above=0, high=1)
    beta: float = parameter(2.0, "extra weight of the central point in covariances; 2 suits a Gaussian", low=0)
    kappa: float = parameter(0.0, "second spread parameter", low=0)

    def accepts(self, model: StateSpaceModel) -> str | None:
        if not np.diag(model.prior.lower).all():
            return "its prior has a singular covariance, of which filterpy cannot draw sigma points"
        return additive(model)

    def init(self, model: StateSpaceModel, rng: Generators) -> FilterpyBelief:
        from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter  # slow to import, and seldom needed

        points = MerweScaledSigmaPoints(model.n, self.alpha, self.beta, self.kappa)
        filters = []
        for _ in range(rng.runs):
            ukf = UnscentedKalmanFilter(model.n, model.m, 1.0, None, None, points)
            ukf.x, ukf.P = model.prior.mean.copy(), model.prior.cov.copy()
            filters.append(ukf)
        return FilterpyBelief(tuple(filters), np.zeros(rng.runs))

    def step(self, model: StateSpaceModel, belief: FilterpyBelief, y: Array, k: int, rng: Generators) -> FilterpyBelief:
        dynamics, sensor = model.dynamics, model.sensor
        shift, cov = dynamics.noise_mean(k), dynamics.noise_cov(k)

        def transition(x: Array, dt: float) -> Array:
            return dynamics.mean(x[:, None], k)[:, 0] + shift

        loglik = np.zeros(rng.runs)
        for r, (ukf, z) in enumerate(zip(belief.filters, y.T, strict=True)):
            ukf.Q = cov
            try:
                ukf.predict(fx=transition)
                _update(ukf, sensor, z, k)
                loglik[r] = 0.0 if np.isnan(z).all() else ukf.log_likelihood
            except (np.linalg.LinAlgError, ValueError):  # no factor, or no number: this run is lost, the others go on
                ukf.x = np.full(model.n, np.nan)
        return FilterpyBelief(belief.filters, loglik)

    def read(self, belief: FilterpyBelief) -> Readout:
        mean = np.stack([ukf.x for ukf in belief.filters], axis=-1)
        cov = np.stack([ukf.P for ukf in belief.filters], axis=-1)
        return Readout(mean, cov, belief.loglik)


def _update(ukf: "UnscentedKalmanFilter", sensor: AdditiveSensor, z: Array, k: int) -> None:
    """Update with the components of z[m] that were observed; filterpy knows a missing measurement only as a whole."""
    rows = np.flatnonzero(~np.isnan(z))
    if not len(rows):
        ukf.update(None)
        return
    noise = sensor.noise.marginal(tuple(rows.tolist()))
    angles = np.isin(rows, sensor.angles)

    def measurement(x: Array) -> Array:
        return sensor.mean(x[:, None], k)[rows, 0] + noise.mean

    def residual(a: Array, b: Array) -> Array:
        return np.where(angles, wrap(np.subtract(a, b)), np.subtract(a, b))

    def average(points: Array, weights: Array) -> Array:
        return points[0] + weights @ residual(points, points[0])

    if angles.any():
        ukf.z_mean, ukf.residual_z = average, residual
    else:
        ukf.z_mean, ukf.residual_z = None, np.subtract
    ukf.update(z[rows], R=noise.cov, hx=measurement)


ESTIMATORS = (FilterpyUnscented(),)
