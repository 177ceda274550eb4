"""Particles of conditionally linear models: some components are drawn, the linear ones are kept as Gaussians given them.

Given the history of the drawn components u, the linear components z of a state are Gaussian: each particle carries a
Kalman filter of its own (Schön, Gustafsson and Nordlund, 2005; Doucet, de Freitas, Murphy and Russell, 2000). Particles are
packed x[n + p, R, N]: the state, with the conditional mean in the place of z, then the lower triangle of z's conditional
covariance, row by row.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from suite import pointwise
from suite.estimator import Readout
from suite.jacobian import derivative
from suite.linalg import Array
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian, Independent, Noise
from suite.particles import Particles, all_of, weighted
from suite.random import Generators

Triangle = list[list[Array]]
"""A symmetric matrix a particle: entries [i][j] and [j][i] are one array [R, N]."""


@dataclass(frozen=True)
class Marginal:
    """Weighted particles, packed, of a state whose components `linear` are integrated out."""

    particles: Particles
    linear: tuple[int, ...]

    def read(self) -> Readout:
        """Mean and covariance of the whole state; the covariance is that within particles plus that between them."""
        known, count = self.particles, len(self.linear)
        n = len(known.x) - count * (count + 1) // 2
        mean, cov = Particles(known.x[:n], known.logw, known.weights, known.loglik, known.ancestors).moments
        within = np.vecdot(known.x[n:], known.weights)
        rows, columns = np.tril_indices(count)
        for i, j, average in zip(np.take(self.linear, rows), np.take(self.linear, columns), within, strict=True):
            cov[i, j] += average
            cov[j, i] = cov[i, j]
        return Readout(mean, cov, known.loglik, known.ess, known.ancestors)


def accepts(model: StateSpaceModel) -> str | None:
    """None when a Rao-Blackwellised filter can run on the model, otherwise the reason why not."""
    dynamics, sensor = model.dynamics, model.sensor
    if not model.linear:
        return "no component of its state is declared conditionally linear"
    if not isinstance(dynamics, AdditiveTransition):
        return "its process noise is not additive"
    if not isinstance(sensor, AdditiveSensor):
        return "its measurement noise is not additive"
    measured = sensor.noise_at(1)
    if not isinstance(measured, Gaussian):
        return "its measurement noise is not Gaussian"
    if not np.diag(measured.lower).all():
        return "the covariance of its measurement noise is singular"
    if dynamics.gain is not None and not isinstance(dynamics.noise_at(1), Gaussian):
        return "its process noise enters through a gain and is not Gaussian"
    others = _not_gaussian(dynamics, 1)
    if set(others) & set(model.linear):
        return "the process noise of its linear components is not Gaussian"
    if others and _slope(dynamics, model.prior.mean[:, None, None], 1, model.linear)[others].any():
        return "its linear components drive one whose process noise is not Gaussian"
    return None


def drawn(model: StateSpaceModel, rng: Generators, count: int) -> Particles:
    """`count` equally weighted draws of u from the prior for each run, with the law of z given u."""
    order, n = (*_sampled(model), *model.linear), model.n
    joint = np.array(model.prior.cov[np.ix_(order, order)])[..., None, None]
    mean = np.broadcast_to(model.prior.mean[:, None, None], (n, rng.runs, count))
    x = _draw(rng, mean, joint, order, n - len(model.linear))
    return weighted(x, np.full(x.shape[1:], -np.log(count)), all_of(rng.runs, count))


def predict(model: StateSpaceModel, x: Array, k: int, rng: Generators) -> Array:
    """Packed particles of step k before y_k: u is drawn with z integrated out, z conditioned on that draw and moved.

    One elimination in the covariance of both, A P A' + Q, does what Schön, Gustafsson and Nordlund (2005, section II) do in
    turns, for noises of u and z that are correlated and for a singular Q as well. Raises ValueError when a component whose
    noise is not Gaussian depends on z.
    """
    dynamics, n = model.dynamics, model.n
    assert isinstance(dynamics, AdditiveTransition)
    others = _not_gaussian(dynamics, k)
    normal = [i for i in _sampled(model) if i not in others]
    order = (*normal, *model.linear)
    slope = _slope(dynamics, x[:n], k, model.linear)
    mean = dynamics.mean(x[:n], k) + dynamics.noise_mean(k)[:, None, None]
    if others:
        if (np.abs(slope[others]) > 0).any():  # the NaN of a lost run is not the others' fault
            raise ValueError("a component whose process noise is not Gaussian must not depend on linear ones")
        noise = dynamics.noise_at(k).marginal(tuple(others))
        mean[others] += noise.sample(rng, x.shape[1:]) - noise.mean[:, None, None]
    joint = _moved(slope[list(order)], _triangle(x[n:], len(model.linear)), dynamics.noise_cov(k)[np.ix_(order, order)])
    return _draw(rng, mean, joint, order, len(normal))


def update(model: StateSpaceModel, x: Array, y: Array, k: int) -> tuple[Array, Array]:
    """Packed particles x, changed in place, after y_k = y[m, R], and log p(y_k | u_1..u_k, y_1..y_{k-1}) [R, N].

    Decorrelated components of y update z one after the other. One that was not observed has slope 0, error 0, variance 1.
    """
    sensor, n, linear = model.sensor, model.n, model.linear
    assert isinstance(sensor, AdditiveSensor)
    noise = sensor.noise_at(k)
    if not isinstance(noise, Gaussian):
        raise ValueError("the measurement noise of this step is not Gaussian, as that of the first is")
    state, cov, seen = x[:n], _triangle(x[n:], len(linear)), ~np.isnan(y)
    error = sensor.residual(y[:, :, None], sensor.mean(state, k) + noise.mean[:, None, None])
    slope = _slope(sensor, state, k, linear)
    if not seen.all():
        error = np.where(seen[:, :, None], error, 0.0)
        slope = np.where(seen[:, None, :, None], slope, 0.0)
    error, slope, variances = _decorrelated(error, slope, noise.cov, seen)
    shift = [np.zeros(x.shape[1:]) for _ in linear]
    squares, log_determinant = np.zeros(x.shape[1:]), np.zeros(x.shape[1:])
    for e, row, variance in zip(error, slope, variances, strict=True):
        half = [pointwise.combine(row, entries) for entries in cov]
        total = variance + pointwise.combine(row, half)
        rest = e - pointwise.combine(row, shift)
        scaled = rest / total
        squares += rest * scaled
        log_determinant += np.log(total)
        if row.any():
            for i, part in enumerate(half):
                shift[i] += part * scaled
                share = part / total
                for j in range(i + 1):
                    cov[i][j] -= share * half[j]
    for i, moved in zip(linear, shift, strict=True):
        state[i] += moved
    return x, -0.5 * (squares + log_determinant + np.log(2 * np.pi) * seen.sum(0)[:, None])


def _draw(rng: Generators, mean: Array, joint: Array, order: tuple[int, ...], count: int) -> Array:
    """Packed particles: the first `count` components of `order` drawn, the others conditioned on the draw.

    mean[n, R, N] of all components; joint, the covariance of those in `order`, whose lower triangle is overwritten.
    """
    pointwise.eliminate(joint, count)
    normal = rng.standard_normal((count, *mean.shape[1:]))
    rows, columns = np.tril_indices(len(order) - count)
    x = np.empty((len(mean) + len(rows), *mean.shape[1:]))
    x[: len(mean)] = mean
    for i, component in enumerate(order):
        x[component] += pointwise.combine(joint[i, : min(i + 1, count)], normal[: i + 1])
    x[len(mean) :] = joint[rows + count, columns + count]
    return x


def _moved(slope: Array, cov: Triangle, noise: Array) -> Array:
    """A P A' + Q [p, p, R, N] for A[p, n, ...] and Q[p, p]; the lower triangle alone is filled."""
    joint = np.empty((len(slope), len(slope), *cov[0][0].shape))
    for i, row in enumerate(slope):
        half = [pointwise.combine(row, entries) for entries in cov]
        for j in range(i + 1):
            joint[i, j] = pointwise.combine(slope[j], half) + noise[i, j]
    return joint


def _decorrelated(error: Array, slope: Array, cov: Array, seen: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
    """Errors [m, R, N], slopes [m, n, ...] and variances [m, R, 1] of measurements made independent: R = U D U', U^-1 y."""
    seen = seen[:, :1] if seen.all() else seen
    both = (seen[:, None] & seen[None]).T
    lower = np.linalg.cholesky(np.where(both, cov, np.eye(len(cov))))
    scale = np.diagonal(lower, axis1=1, axis2=2)
    if np.tril(cov, -1).any():
        inverse = np.moveaxis(np.linalg.inv(lower / scale[:, None]), 0, -1)[..., None]
        error = np.stack([pointwise.combine(row, error) for row in inverse])
        slope = np.stack([pointwise.combine(row[:, None], slope) for row in inverse])
    return error, slope, (scale**2).T[..., None]


def _slope(law: AdditiveTransition | AdditiveSensor, x: Array, k: int, linear: tuple[int, ...]) -> Array:
    """Derivative of a mean function with respect to the linear components: [p, n, R, N], or [p, n, 1, 1] if constant."""
    if isinstance(law.mean, Affine):
        return law.mean.matrix(k)[:, list(linear), None, None]
    if law.jacobian_of_mean is not None:
        return law.jacobian(x, k)[:, list(linear)]
    return derivative(lambda s: law.mean(s, k), x, linear)


def _triangle(packed: Array, count: int) -> Triangle:
    """The symmetric matrices [count, count] whose lower triangles are packed[p, R, N], row by row."""
    place = np.zeros((count, count), int)
    place[np.tril_indices(count)] = range(len(packed))
    return [[packed[max(place[i, j], place[j, i])] for j in range(count)] for i in range(count)]


def _sampled(model: StateSpaceModel) -> list[int]:
    """The components that are drawn, not integrated out."""
    return [i for i in range(model.n) if i not in model.linear]


def _not_gaussian(dynamics: AdditiveTransition, k: int) -> list[int]:
    """The components of the state whose process noise is not Gaussian; none where noise enters through a gain."""
    if dynamics.gain is not None:
        return []
    return [i for i, gaussian in enumerate(_gaussian(dynamics.noise_at(k))) if not gaussian]


def _gaussian(noise: Noise) -> list[bool]:
    """Whether each component of a noise is Gaussian, and independent of those that are not."""
    if isinstance(noise, Independent):
        return [gaussian for part in noise.parts for gaussian in _gaussian(part)]
    return [isinstance(noise, Gaussian)] * len(noise.mean)
