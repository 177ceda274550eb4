"""Filters of filterpy 2 (R. Labbe) for models of one mode, one filter object a run.

Each is called as its documentation says and left as it is: what is wrong with it shows in its results, and is said with it.
All of them leave a part of the measurement out of the log-likelihood where the innovation's covariance has a condition number
above 4.5e9, which filterpy takes for singular; a range in metres beside an angle in radians comes near that.
"""

import functools
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgWarning

from suite.angles import wrap
from suite.estimator import Filter, Readout
from suite.gaussian import additive, differentiable
from suite.linalg import Array
from suite.model import AdditiveSensor, AdditiveTransition, StateSpaceModel
from suite.parameters import parameter
from suite.random import Generators

if TYPE_CHECKING:
    from filterpy.kalman import CubatureKalmanFilter, ExtendedKalmanFilter, UnscentedKalmanFilter

FAULTS = (np.linalg.LinAlgError, ValueError, OverflowError)
"""What filterpy raises where a matrix has no factor or no inverse, or a number is none."""


@dataclass(frozen=True)
class OneByOne:
    """One filterpy object a run, which a step changes in place, and the log-likelihood of the last measurement [R]."""

    filters: tuple[Any, ...]
    loglik: Array

    def stepped(self, y: Array, advance: Callable[[Any, Array], float]) -> "OneByOne":
        """Each object advanced by its run's measurement of y[m, R]; where that fails, this run is lost and the others go on."""
        loglik = np.full(len(self.filters), np.nan)
        with warnings.catch_warnings(action="ignore", category=LinAlgWarning):  # the numbers will tell
            for r, (one, z) in enumerate(zip(self.filters, y.T, strict=True)):
                try:
                    loglik[r] = advance(one, z)
                except FAULTS:
                    one.x = np.full(one.x.shape, np.nan)
        return OneByOne(self.filters, loglik)

    def read(self) -> Readout:
        """Moments of the belief."""
        mean = np.stack([one.x.ravel() for one in self.filters], axis=-1)
        return Readout(mean, np.stack([one.P for one in self.filters], axis=-1), self.loglik)


@dataclass(frozen=True, eq=False)
class Observed:
    """A sensor at step k without those rows that were not observed, as functions of one state x[n]."""

    sensor: AdditiveSensor
    rows: NDArray[np.intp]
    k: int

    @classmethod
    def of(cls, sensor: AdditiveSensor, z: Array, k: int) -> "Observed":
        """What is left of the sensor where the measurement z[m] holds numbers."""
        return cls(sensor, np.flatnonzero(~np.isnan(z)), k)

    @property
    def cov(self) -> Array:
        """Covariance of the noise."""
        return self.sensor.noise_at(self.k).marginal(tuple(self.rows.tolist())).cov if len(self.rows) else np.zeros((0, 0))

    @functools.cached_property
    def angles(self) -> NDArray[np.bool_]:
        """Which of the rows are angles."""
        return np.array([row in self.sensor.angles for row in self.rows.tolist()], bool)

    @property
    def wraps(self) -> bool:
        """Whether any of the rows is an angle."""
        return bool(self.angles.any())

    def mean(self, x: Array) -> Array:
        """Measurement expected in a state."""
        return (self.sensor.mean(x.reshape(-1, 1), self.k)[:, 0] + self.sensor.noise_at(self.k).mean)[self.rows]

    def jacobian(self, x: Array) -> Array:
        """Derivative of the measurement with respect to the state."""
        return self.sensor.jacobian(x[:, None], self.k)[self.rows, :, 0]

    def residual(self, a: Array, b: Array) -> Array:
        """Difference of measurements [..., rows], angles wrapped."""
        rest = np.subtract(a, b)
        return np.where(self.angles, wrap(rest), rest) if self.wraps else rest

    def average(self, points: Array, weights: Array) -> Array:
        """Weighted mean of measurements, of angles about the first."""
        return points[0] + weights @ self.residual(points, points[0])


def moved(dynamics: AdditiveTransition, k: int) -> Callable[[Array, float], Array]:
    """The transition to step k as a function of one state x[n] and a time step, which is no concern of it."""
    shift = dynamics.noise_mean(k)
    return lambda x, dt: dynamics.mean(x[:, None], k)[:, 0] + shift


def spread(model: StateSpaceModel) -> str | None:
    """None when filterpy can draw sigma points of the model's prior, otherwise why not."""
    if not np.diag(model.prior.lower).all():
        return "its prior has a singular covariance, of which filterpy cannot draw sigma points"
    return additive(model)


def at_prior(one: Any, model: StateSpaceModel) -> Any:
    """A filterpy object, brought to the model's prior."""
    one.x, one.P = model.prior.mean.copy(), model.prior.cov.copy()
    return one


def started(model: StateSpaceModel, runs: int, make: Callable[[], Any]) -> OneByOne:
    """Objects made for each run, at the model's prior."""
    return OneByOne(tuple(at_prior(make(), model) for _ in range(runs)), np.zeros(runs))


@dataclass(frozen=True)
class FilterpyExtended(Filter):
    """Extended Kalman filter of filterpy 2, run by run."""

    name: ClassVar[str] = "filterpy:ekf"
    reference: ClassVar[str] = "R. R. Labbe, filterpy 2, filterpy.kalman.ExtendedKalmanFilter"

    def accepts(self, model: StateSpaceModel) -> str | None:
        return additive(model) or differentiable(model)

    def init(self, model: StateSpaceModel, rng: Generators) -> OneByOne:
        from filterpy.kalman import ExtendedKalmanFilter  # slow to import, and seldom needed

        class Moved(ExtendedKalmanFilter):
            """Goes to the state that `predict` is given, where its parent would multiply by the derivative."""

            def predict_x(self, u: Array) -> None:
                self.x = u

        return started(model, rng.runs, lambda: Moved(model.n, model.m))

    def step(self, model: StateSpaceModel, belief: OneByOne, y: Array, k: int, rng: Generators) -> OneByOne:
        dynamics, shift, cov = model.dynamics, model.dynamics.noise_mean(k), model.dynamics.noise_cov(k)

        def advance(ekf: "ExtendedKalmanFilter", z: Array) -> float:
            ahead, slope = dynamics.linearised(ekf.x[:, None], k)
            ekf.F, ekf.Q = slope[..., 0], cov
            ekf.predict(ahead[:, 0] + shift)
            seen = Observed.of(model.sensor, z, k)
            if not len(seen.rows):
                return 0.0
            ekf.update(z[seen.rows], seen.jacobian, seen.mean, seen.cov, residual=seen.residual)
            return float(ekf.log_likelihood)

        return belief.stepped(y, advance)

    def read(self, belief: OneByOne) -> Readout:
        return belief.read()


@dataclass(frozen=True)
class FilterpyUnscented(Filter):
    """Unscented Kalman filter of filterpy 2, run by run with van der Merwe's sigma points."""

    name: ClassVar[str] = "filterpy:ukf"
    reference: ClassVar[str] = "R. R. Labbe, filterpy 2, filterpy.kalman.UnscentedKalmanFilter"
    alpha: float = parameter(1.0, "spread of the sigma points", above=0, high=1)
    beta: float = parameter(2.0, "extra weight of the central point in covariances; 2 suits a Gaussian", low=0)
    kappa: float = parameter(0.0, "second spread parameter", low=0)

    def accepts(self, model: StateSpaceModel) -> str | None:
        return spread(model)

    def init(self, model: StateSpaceModel, rng: Generators) -> OneByOne:
        return started(model, rng.runs, lambda: unscented(model, self.alpha, self.beta, self.kappa))

    def step(self, model: StateSpaceModel, belief: OneByOne, y: Array, k: int, rng: Generators) -> OneByOne:
        def advance(ukf: "UnscentedKalmanFilter", z: Array) -> float:
            seen = Observed.of(model.sensor, z, k)
            informed(ukf, model, seen)
            ukf.predict()
            if not len(seen.rows):
                return 0.0
            ukf.update(z[seen.rows])
            return float(ukf.log_likelihood)

        return belief.stepped(y, advance)

    def read(self, belief: OneByOne) -> Readout:
        return belief.read()


def unscented(model: StateSpaceModel, alpha: float, beta: float, kappa: float) -> "UnscentedKalmanFilter":
    """An unscented filter of filterpy, as yet without functions."""
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

    return UnscentedKalmanFilter(model.n, model.m, 1.0, None, None, MerweScaledSigmaPoints(model.n, alpha, beta, kappa))


def informed(ukf: "UnscentedKalmanFilter", model: StateSpaceModel, seen: Observed) -> None:
    """Give an unscented filter of filterpy the functions and noises of a step."""
    ukf.fx, ukf.Q = moved(model.dynamics, seen.k), model.dynamics.noise_cov(seen.k)
    ukf.hx, ukf.R = seen.mean, seen.cov
    ukf.z_mean, ukf.residual_z = (seen.average, seen.residual) if seen.wraps else (None, np.subtract)


@dataclass(frozen=True)
class FilterpyCubature(Filter):
    """Cubature Kalman filter of filterpy 2, whose update leaves out the process noise; not the Kalman filter on linear models.

    Its update takes the points that came through the transition, without drawing new ones from the predicted covariance: the
    innovation's covariance and that with the state lack the process noise (P = 1.618 in place of 0.618 where all matrices are
    one). Its covariances are differences of squares and lose digits where a component is large beside its spread. It never
    calls the z_mean_fn that it takes, so here angles are counted from that of the predicted mean before it sees them.
    """

    name: ClassVar[str] = "filterpy:ckf"
    reference: ClassVar[str] = "R. R. Labbe, filterpy 2, filterpy.kalman.CubatureKalmanFilter"

    def accepts(self, model: StateSpaceModel) -> str | None:
        return spread(model)

    def init(self, model: StateSpaceModel, rng: Generators) -> OneByOne:
        from filterpy.kalman import CubatureKalmanFilter

        return started(model, rng.runs, lambda: CubatureKalmanFilter(model.n, model.m, 1.0, None, None))

    def step(self, model: StateSpaceModel, belief: OneByOne, y: Array, k: int, rng: Generators) -> OneByOne:
        transition, cov = moved(model.dynamics, k), model.dynamics.noise_cov(k)

        def advance(ckf: "CubatureKalmanFilter", z: Array) -> float:
            ckf.fx, ckf.Q = transition, cov
            ckf.predict()
            seen = Observed.of(model.sensor, z, k)
            if not len(seen.rows):
                return 0.0
            centre = seen.mean(ckf.x)
            ckf.hx = lambda x: centre + seen.residual(seen.mean(x), centre)
            ckf.residual_z = lambda a, b: seen.residual(a.T, b.T).T  # it works on columns
            ckf.sigmas_h = np.zeros((2 * model.n, len(seen.rows)))  # its buffer, else of all components
            ckf.update(z[seen.rows, None], seen.cov)
            return float(ckf.log_likelihood)

        return belief.stepped(y, advance)

    def read(self, belief: OneByOne) -> Readout:
        return belief.read()


ESTIMATORS = (FilterpyExtended(), FilterpyUnscented(), FilterpyCubature())
