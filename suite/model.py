"""State-space models: x_k = f(x_{k-1}, k) + G w_k, y_k = h(x_k, k) + v_k, and more general conditional laws.

Arrays are components first: a state is x[n, ...] over any trailing axes (runs, particles, sigma points). The prior is
the law of x_0; every measurement y_k, k = 1..T, follows one transition. A NaN in a measurement means "not observed".
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from suite.angles import difference, wrap
from suite.checks import finite, instance, places, shaped, sized
from suite.jacobian import value_and_derivative
from suite.linalg import Array, apply
from suite.noise import Gaussian, Law, Noise
from suite.nonadditive import NonadditiveSensor, NonadditiveTransition
from suite.random import Generators

Function = Callable[[Array, int], Array]


class Transition(Protocol):
    """Law of x_k given x_{k-1}."""

    def sample(self, rng: Generators, x: Array, k: int) -> Array:
        """Draws of x_k [n, R, ...] given x_{k-1} = x[n, R, ...]."""

    def logpdf(self, z: Array, x: Array, k: int) -> Array:
        """Log-density of x_k = z[n, ...] given x_{k-1} = x[n, ...]: [...]."""


class Sensor(Protocol):
    """Law of y_k given x_k."""

    @property
    def dim(self) -> int:
        """Number of measurement components m."""

    def sample(self, rng: Generators, x: Array, k: int) -> Array:
        """Draws of y_k [m, R, ...] given x_k = x[n, R, ...]."""

    def logpdf(self, z: Array, x: Array, k: int) -> Array:
        """Log-density of y_k = z[m, R] given x_k = x[n, R, ...]: [R, ...]; NaN components carry no information."""


class Affine:
    """The function x -> A x + b, with A[p, n] and b[p] constant or functions of the time index."""

    def __init__(self, matrix: Array | Sequence[Sequence[float]] | Callable[[int], Array], offset: Array | None = None):
        self._matrix = matrix if callable(matrix) else shaped("Affine.matrix", matrix, 2)
        self.offset = None if offset is None else shaped("Affine.offset", offset, 1)
        if self.offset is not None and not callable(self._matrix) and len(self.offset) != len(self._matrix):
            raise ValueError(f"Affine.offset has {len(self.offset)} entries, Affine.matrix has {len(self._matrix)} rows")

    def matrix(self, k: int) -> Array:
        """The matrix A at time index k."""
        return self._matrix(k) if callable(self._matrix) else self._matrix

    def __call__(self, x: Array, k: int) -> Array:
        """A x + b for x[n, ...]."""
        out = apply(self.matrix(k), x)
        return out if self.offset is None else out + self.offset.reshape(-1, *(1,) * (x.ndim - 1))


@dataclass(frozen=True, eq=False)
class AdditiveTransition:
    """x_k = mean(x_{k-1}, k) + G w_k with w_k from `noise`.

    mean: function of x[n, ...] and k, giving [n, ...]. noise: law of w[q], constant or a function of k.
    gain: G[n, q], identity when left out; with q < n the process noise is singular. jacobian_of_mean: analytic
    derivative [n, n, ...], derived by dual numbers when left out.
    """

    mean: Function
    noise: Noise | Callable[[int], Noise]
    gain: Array | None = None
    jacobian_of_mean: Function | None = None

    def __post_init__(self) -> None:
        if not callable(self.noise):
            instance("AdditiveTransition.noise", self.noise, Law)
        if self.gain is not None:
            object.__setattr__(self, "gain", finite("AdditiveTransition.gain", self.gain, 2))

    def noise_at(self, k: int) -> Noise:
        """Law of w_k."""
        return self.noise(k) if callable(self.noise) else self.noise

    def noise_mean(self, k: int) -> Array:
        """Mean of G w_k: [n]."""
        mean = self.noise_at(k).mean
        return mean if self.gain is None else self.gain @ mean

    def noise_cov(self, k: int) -> Array:
        """Covariance of G w_k: [n, n]."""
        cov = self.noise_at(k).cov
        return cov if self.gain is None else self.gain @ cov @ self.gain.T

    def jacobian(self, x: Array, k: int) -> Array:
        """Derivative of the mean with respect to x[n, ...]: [n, n, ...]."""
        return self.linearised(x, k)[1]

    def linearised(self, x: Array, k: int) -> tuple[Array, Array]:
        """Mean [n, ...] and its derivative [n, n, ...] at x[n, ...]."""
        return _linearised(self.mean, self.jacobian_of_mean, x, k)

    def residual(self, z: Array, expected: Array) -> Array:
        """Difference of two states [n, ...]."""
        return z - expected

    def disturbance(self, rng: Generators, shape: tuple[int, ...], k: int) -> Array:
        """Draws of G w_k [n, *shape]; shape[0] is the number of runs."""
        noise = self.noise_at(k).sample(rng, shape)
        return noise if self.gain is None else apply(self.gain, noise)

    def sample(self, rng: Generators, x: Array, k: int) -> Array:
        """Draws of x_k [n, R, ...] given x_{k-1} = x[n, R, ...]."""
        moved = self.disturbance(rng, x.shape[1:], k)
        moved += self.mean(x, k)
        return moved

    def logpdf(self, z: Array, x: Array, k: int) -> Array:
        """Log-density of x_k = z given x_{k-1} = x; raises ValueError when noise enters through a gain."""
        if self.gain is not None:
            raise ValueError("a transition whose noise enters through a gain has no density over the whole state")
        return self.noise_at(k).logpdf(z - self.mean(x, k))


@dataclass(frozen=True, eq=False)
class AdditiveSensor:
    """y_k = mean(x_k, k) + v_k with v_k from `noise`; components listed in `angles` are in radians and wrap.

    mean: function of x[n, ...] and k, giving [m, ...]. noise: law of v[m], constant or a function of k. jacobian_of_mean:
    analytic derivative [m, n, ...], derived by dual numbers when left out.
    """

    mean: Function
    noise: Noise | Callable[[int], Noise]
    angles: tuple[int, ...] = ()
    jacobian_of_mean: Function | None = None

    def __post_init__(self) -> None:
        instance("AdditiveSensor.noise", self.noise_at(1), Law)
        object.__setattr__(self, "angles", places("AdditiveSensor.angles", self.angles, self.dim))

    @property
    def dim(self) -> int:
        """Number of measurement components m."""
        return len(self.noise_at(1).mean)

    def noise_at(self, k: int) -> Noise:
        """Law of v_k."""
        return self.noise(k) if callable(self.noise) else self.noise

    def jacobian(self, x: Array, k: int) -> Array:
        """Derivative of the mean with respect to x[n, ...]: [m, n, ...]."""
        return self.linearised(x, k)[1]

    def linearised(self, x: Array, k: int) -> tuple[Array, Array]:
        """Mean [m, ...] and its derivative [m, n, ...] at x[n, ...]."""
        return _linearised(self.mean, self.jacobian_of_mean, x, k)

    def residual(self, z: Array, expected: Array) -> Array:
        """Difference z - expected [m, ...], its angular components wrapped to (-pi, pi]."""
        return difference(z, expected, self.angles)

    def sample(self, rng: Generators, x: Array, k: int) -> Array:
        """Draws of y_k [m, R, ...] given x_k = x[n, R, ...]."""
        y = self.mean(x, k) + self.noise_at(k).sample(rng, x.shape[1:])
        for i in self.angles:
            y[i] = wrap(y[i])
        return y

    def logpdf(self, z: Array, x: Array, k: int) -> Array:
        """Log-density of y_k = z[m, R] given x_k = x[n, R, ...]: [R, ...]; missing components drop out."""
        expected = self.mean(x, k)
        return self.noise_logpdf(z, self.residual(z.reshape(*z.shape, *(1,) * (expected.ndim - z.ndim)), expected), k)

    def noise_logpdf(self, z: Array, error: Array, k: int) -> Array:
        """Log-density of the noise at error[m, R, ...], over those components that are not NaN in z[m, R]: [R, ...]."""
        noise = self.noise_at(k)
        if not np.isnan(z).any():
            return noise.logpdf(error)
        total = np.zeros(error.shape[1:])
        for rows, runs in outage_patterns(z):
            if rows:
                total[runs] = noise.marginal(rows).logpdf(error[np.asarray(rows)[:, None], runs])
        return total


@dataclass(frozen=True, eq=False)
class StateSpaceModel:
    """A prior for x_0, a transition and a sensor.

    linear: components of the state in which, given the others, the mean functions of dynamics and sensor are affine; what
    Rao-Blackwellised filters integrate out. Raises ValueError that names the field when dimensions disagree, or a mean
    function is not affine.
    """

    prior: Gaussian
    dynamics: Transition
    sensor: Sensor
    linear: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        instance("StateSpaceModel.prior", self.prior, Gaussian)
        dynamics, sensor, at = self.dynamics, self.sensor, self.prior.mean[:, None]
        if isinstance(dynamics, AdditiveTransition | NonadditiveTransition):
            instance(f"{type(dynamics).__name__}.noise", dynamics.noise_at(1), Law)
        if isinstance(dynamics, AdditiveTransition):
            _check_gain(dynamics, self.n)
        for law, size in ((dynamics, self.n), (sensor, self.m)):
            if isinstance(law, AdditiveTransition | AdditiveSensor):
                sized(f"{type(law).__name__}.mean", law.mean, (at,), size)
            elif isinstance(law, NonadditiveTransition | NonadditiveSensor):
                sized(f"{type(law).__name__}.function", law.function, (at, law.noise_at(1).mean[:, None]), size)
        object.__setattr__(self, "linear", places("StateSpaceModel.linear", self.linear, self.n))
        self._check_linear()

    @property
    def n(self) -> int:
        """Number of state components."""
        return len(self.prior.mean)

    @property
    def m(self) -> int:
        """Number of measurement components."""
        return self.sensor.dim

    def _check_linear(self) -> None:
        """Second differences along the linear components, about the prior mean and some points of the prior's size away."""
        linear = list(self.linear)
        if not linear:
            return
        size, at = np.sqrt(np.diag(self.prior.cov))[:, None], self.prior.mean[:, None]
        angle = np.arange(4.0 * self.n).reshape(-1, 4)  # sines and cosines of integers: points in no special position
        x, step = at + size * np.sin(angle), np.zeros_like(angle)
        x[:, 0] = at[:, 0]
        step[linear] = ((1 + size + np.abs(at)) * np.cos(angle))[linear]
        for law in (self.dynamics, self.sensor):
            if isinstance(law, AdditiveTransition | AdditiveSensor):
                with np.errstate(all="ignore"):  # a point where the function is not defined proves nothing
                    below, middle, above = (np.asarray(law.mean(x + side * step, 1)) for side in (-1, 0, 1))
                    bend = np.abs(law.residual(law.residual(above, middle), law.residual(middle, below)))
                    values = np.abs(below) + np.abs(middle) + np.abs(above)
                    bent = bend > 1e-6 * values + 1e-11 * np.max(values, where=np.isfinite(values), initial=0.0)
                if bent.any():
                    raise ValueError(f"StateSpaceModel.linear is {self.linear}, where {type(law).__name__}.mean is not affine")


def outage_patterns(z: Array) -> Iterator[tuple[tuple[int, ...], NDArray[np.intp]]]:
    """Groups of runs of z[m, R] that miss the same components: (rows observed, indices of runs)."""
    seen = ~np.isnan(z)
    if z.shape[1] and (seen == seen[:, :1]).all():  # as nearly always
        yield tuple(np.flatnonzero(seen[:, 0]).tolist()), np.arange(z.shape[1])
        return
    patterns, group = np.unique(seen, axis=1, return_inverse=True)
    for g, observed in enumerate(patterns.T):
        yield tuple(np.flatnonzero(observed).tolist()), np.flatnonzero(group == g)


def is_linear_gaussian(model: StateSpaceModel) -> bool:
    """Whether the model's functions are affine and all its noises Gaussian."""
    dynamics, sensor = model.dynamics, model.sensor
    return (
        isinstance(dynamics, AdditiveTransition)
        and isinstance(sensor, AdditiveSensor)
        and isinstance(dynamics.mean, Affine)
        and isinstance(sensor.mean, Affine)
        and not sensor.angles
        and isinstance(dynamics.noise_at(1), Gaussian)
        and isinstance(sensor.noise_at(1), Gaussian)
    )


def _check_gain(dynamics: AdditiveTransition, n: int) -> None:
    """Whether the noise's components fit a state of n, by the gain where there is one."""
    q = len(dynamics.noise_at(1).mean)
    if dynamics.gain is None and q != n:
        raise ValueError(f"AdditiveTransition.noise has {q} components without a gain, the state has {n}")
    if dynamics.gain is not None and dynamics.gain.shape != (n, q):
        shape = dynamics.gain.shape
        raise ValueError(f"AdditiveTransition.gain has shape {shape}, {n} state and {q} noise components need {(n, q)}")


def _linearised(function: Function, analytic: Function | None, x: Array, k: int) -> tuple[Array, Array]:
    if analytic is not None:
        return function(x, k), analytic(x, k)
    if isinstance(function, Affine):
        matrix = function.matrix(k)
        slope = np.broadcast_to(matrix.reshape(*matrix.shape, *(1,) * (x.ndim - 1)), (*matrix.shape, *x.shape[1:]))
        return function(x, k), slope
    return value_and_derivative(lambda s: function(s, k), x)
