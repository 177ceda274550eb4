"""Independent oracles for the tests: other people's Kalman filter, explicit joint Gaussians, a grid filter."""

import itertools
from dataclasses import dataclass

import numpy as np
from filterpy.kalman import KalmanFilter
from scipy import stats

from suite.linalg import Array
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian
from suite.random import Generators, Streams


def generators(runs: int, *key: str | int) -> Generators:
    """Generators of a batch of runs, keyed by the test that draws from them."""
    return Streams(("test", *key)).batch(0, runs)


@dataclass(frozen=True)
class Linear:
    """x_k = A x_{k-1} + a + G w_k, y_k = H x_k + h + v_k with w ~ N(w, Q), v ~ N(v, R), x_0 ~ N(m0, P0)."""

    A: Array
    a: Array
    G: Array
    w: Array
    Q: Array
    H: Array
    h: Array
    v: Array
    R: Array
    m0: Array
    P0: Array

    @property
    def model(self) -> StateSpaceModel:
        """The same model in the words of filterbench."""
        return StateSpaceModel(
            prior=Gaussian(self.m0, self.P0),
            dynamics=AdditiveTransition(Affine(self.A, self.a), Gaussian(self.w, self.Q), gain=self.G),
            sensor=AdditiveSensor(Affine(self.H, self.h), Gaussian(self.v, self.R)),
        )

    def simulate(self, steps: int, runs: int, seed: int = 0) -> tuple[Array, Array]:
        """States [T, n, R] and measurements [T, m, R], drawn with numpy's own multivariate normal."""
        rng = np.random.default_rng(seed)
        x = rng.multivariate_normal(self.m0, self.P0, runs, method="eigh").T
        states, measurements = [], []
        for _ in range(steps):
            x = self.A @ x + self.a[:, None] + self.G @ rng.multivariate_normal(self.w, self.Q, runs, method="eigh").T
            states.append(x)
            noise = rng.multivariate_normal(self.v, self.R, runs, method="eigh").T
            measurements.append(self.H @ x + self.h[:, None] + noise)
        return np.stack(states), np.stack(measurements)


def random_linear(seed: int, n: int, m: int, q: int, dirac: bool = False) -> Linear:
    """A random linear model with non-zero means everywhere, correlated noises and q-dimensional process noise."""
    rng = np.random.default_rng(seed)

    def covariance(d):
        root = rng.standard_normal((d, d + 2))
        return root @ root.T

    rotation = np.linalg.qr(rng.standard_normal((n, n)))[0]
    return Linear(
        A=rotation * rng.uniform(0.5, 1.05, n),
        a=rng.standard_normal(n),
        G=rng.standard_normal((n, q)),
        w=rng.standard_normal(q),
        Q=covariance(q),
        H=rng.standard_normal((m, n)),
        h=rng.standard_normal(m),
        v=rng.standard_normal(m),
        R=covariance(m),
        m0=rng.standard_normal(n),
        P0=np.zeros((n, n)) if dirac else covariance(n),
    )


def filterpy_kalman(p: Linear, y: Array) -> tuple[Array, Array, Array]:
    """Means [T, n], covariances [T, n, n] and log-likelihoods [T] of one run's y[T, m]; NaN rows are struck out."""
    n = len(p.m0)
    x, P = p.m0, p.P0
    means, covs, logliks = [], [], []
    for z in y:
        rows = np.flatnonzero(~np.isnan(z))
        kf = KalmanFilter(dim_x=n, dim_z=max(1, len(rows)), dim_u=n)
        kf.x, kf.P = x[:, None].copy(), P.copy()
        kf.F, kf.B, kf.Q = p.A, np.eye(n), p.G @ p.Q @ p.G.T
        kf.predict(u=(p.a + p.G @ p.w)[:, None])
        loglik = 0.0
        if len(rows):
            kf.H, kf.R = p.H[rows], p.R[np.ix_(rows, rows)]
            kf.update((z - p.h - p.v)[rows][:, None])
            # The innovation's density from scipy; filterpy's own must say the same.
            loglik = stats.multivariate_normal(np.zeros(len(rows)), kf.S).logpdf(kf.y[:, 0])
            np.testing.assert_allclose(kf.log_likelihood, loglik, rtol=1e-9, atol=1e-9)
        x, P = kf.x[:, 0], kf.P
        means.append(x)
        covs.append(P)
        logliks.append(loglik)
    return np.stack(means), np.stack(covs), np.array(logliks)


def joint(p: Linear, steps: int) -> tuple[Array, Array, Array, Array]:
    """Mean and covariance of all states stacked [T n], and the matrix and offset from these to all measurements.

    Built from x_k = A^k x_0 + sum_j A^(k-j) (a + G w_j), without any recursion over beliefs.
    """
    n, q = len(p.m0), len(p.w)
    power = [np.linalg.matrix_power(p.A, j) for j in range(steps + 1)]
    push = p.a + p.G @ p.w
    mean = np.concatenate([power[k] @ p.m0 + sum(power[j] @ push for j in range(k)) for k in range(1, steps + 1)])
    into = np.zeros((steps * n, n + steps * q))
    for k in range(1, steps + 1):
        into[(k - 1) * n : k * n, :n] = power[k]
        for j in range(1, k + 1):
            into[(k - 1) * n : k * n, n + (j - 1) * q : n + j * q] = power[k - j] @ p.G
    source = np.zeros((n + steps * q, n + steps * q))
    source[:n, :n] = p.P0
    source[n:, n:] = np.kron(np.eye(steps), p.Q)
    return mean, into @ source @ into.T, np.kron(np.eye(steps), p.H), np.tile(p.h + p.v, steps)


def joint_loglik(p: Linear, y: Array) -> float:
    """log p(y_1, ..., y_T) of one run's y[T, m] from the joint Gaussian of its observed components."""
    mean, cov, H, offset = joint(p, len(y))
    seen = ~np.isnan(y.ravel())
    cov_y = (H @ cov @ H.T + np.kron(np.eye(len(y)), p.R))[np.ix_(seen, seen)]
    return float(stats.multivariate_normal((H @ mean + offset)[seen], cov_y).logpdf(y.ravel()[seen]))


def joint_posterior(p: Linear, y: Array) -> tuple[Array, Array]:
    """Mean [n] and covariance [n, n] of x_T given one run's y[T, m], by conditioning the joint Gaussian at once."""
    mean, cov, H, offset = joint(p, len(y))
    seen, n = ~np.isnan(y.ravel()), len(p.m0)
    H, noise = H[seen], np.kron(np.eye(len(y)), p.R)[np.ix_(seen, seen)]
    gain = np.linalg.solve(H @ cov @ H.T + noise, H @ cov).T
    posterior = cov - gain @ H @ cov
    error = y.ravel()[seen] - offset[seen] - H @ mean
    return (mean + gain @ error)[-n:], posterior[-n:, -n:]


def grid_filter(grid: Array, prior: Array, drift, drift_std: float, likelihood, y: Array) -> tuple[Array, Array, Array]:
    """Means [T], variances [T] and log-likelihoods [T] of a scalar model on a fine, even grid.

    prior: density on the grid; drift(x, k), and likelihood(y, x); by the rectangle rule, which converges faster than
    any power of the spacing for densities that vanish at both ends.
    """
    dx = grid[1] - grid[0]
    density = prior / (prior.sum() * dx)
    means, variances, logliks = [], [], []
    for k, z in enumerate(y, start=1):
        kernel = stats.norm.pdf(grid[:, None], drift(grid, k)[None, :], drift_std)
        density = kernel @ density * dx
        if not np.isnan(z):
            density = density * likelihood(z, grid)
        evidence = density.sum() * dx
        density = density / evidence
        mean = (grid * density).sum() * dx
        means.append(mean)
        variances.append(((grid - mean) ** 2 * density).sum() * dx)
        logliks.append(np.log(evidence))
    return np.array(means), np.array(variances), np.array(logliks)


def range_bearing(west: bool = False) -> StateSpaceModel:
    """A target (x, vx, y, vy) that crosses the negative x axis, seen by range and bearing from the origin.

    Bearings are from east, and jump from pi to -pi on the target's way; or from west, and pass through zero.
    """
    side = -1.0 if west else 1.0

    def look(x, k):
        return np.stack([np.sqrt(x[0] * x[0] + x[2] * x[2]), np.atan2(side * x[2], side * x[0])])

    axis, noise = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[1 / 3, 1 / 2], [1 / 2, 1.0]])
    return StateSpaceModel(
        Gaussian([-1000.0, 0.0, 60.0, -6.0], np.diag([20.0, 2.0, 20.0, 2.0]) ** 2),
        AdditiveTransition(Affine(np.kron(np.eye(2), axis)), Gaussian.noise(0.1 * np.kron(np.eye(2), noise))),
        AdditiveSensor(look, Gaussian.diagonal([5.0**2, 0.02**2]), angles=(1,)),
    )


def from_west(y: Array) -> Array:
    """Range and bearing from east [T, 2, R] as range and bearing from west."""
    other = np.angle(np.exp(1j * (y[:, 1] + np.pi)))
    return np.stack([y[:, 0], other], axis=1)


class Given(Generators):
    """Generators whose uniform or exponential numbers are given, [R, K] at a time."""

    def __init__(self, numbers):
        super().__init__(generators(len(numbers)).generators)
        self.numbers = np.asarray(numbers, float)

    def random(self, shape):
        assert shape == (1, *self.numbers.shape)
        return self.numbers[None]

    standard_exponential = random


def wavy_model(gain: Array | None = None) -> StateSpaceModel:
    """A scalar sensor whose slope changes, of a scalar state or of three states that one scalar noise drives."""
    n = 1 if gain is None else len(gain)

    def drift(x, k):
        return 0.8 * x + 0.2 * np.sin(2 * x)

    def look(x, k):
        return np.stack([x[0] + 0.4 * np.sin(2 * x[0]) + sum(0.3 * row for row in x[1:])])

    return StateSpaceModel(
        Gaussian(np.zeros(n), np.eye(n)),
        AdditiveTransition(drift, Gaussian.noise([[0.7]]), gain=gain),
        AdditiveSensor(look, Gaussian.noise([[0.5]])),
    )


@dataclass(frozen=True)
class Posterior:
    """Law of the first state component given its parent and one of R measurements: cdf[R, G] at the points x[G]."""

    likelihood: Array
    mean: Array
    x: Array
    cdf: Array


def quadrature_of_transition(model: StateSpaceModel, origin: Array, y: Array, k: int) -> Posterior:
    """p(x_k | x_{k-1} = origin[n], y_k) for scalar measurements y[R] and a scalar noise, by a sum over a fine grid of it."""
    w = np.linspace(-12, 12, 48_001)
    gain = np.ones((1, 1)) if model.dynamics.gain is None else model.dynamics.gain
    std = np.sqrt(model.dynamics.noise_at(k).cov[0, 0])
    x = model.dynamics.mean(origin[:, None], k) + gain * (std * w)
    expected = model.sensor.mean(x, k)[0]
    density = stats.norm.pdf(w) * stats.norm.pdf(y[:, None], expected, np.sqrt(model.sensor.noise.cov[0, 0]))
    likelihood = density.sum(1) * (w[1] - w[0])
    share = density / density.sum(1, keepdims=True)
    return Posterior(likelihood, share @ x[0], x[0], np.cumsum(share, axis=1) - share / 2)


def strata(weights: Array) -> Array:
    """Chance [slot, particle] that a slot of stratified resampling takes a particle: how much they overlap."""
    count, slot = len(weights), np.arange(len(weights))[:, None]
    ends = np.cumsum(weights) * count
    return np.maximum(np.minimum(ends, slot + 1) - np.maximum(ends - count * weights, slot), 0)


def slots(scheme: str, weights: Array) -> Array:
    """Chance [slot, particle] of the slots that a resampling scheme other than systematic fills independently."""
    if scheme == "stratified":
        return strata(weights)
    left = len(weights) * weights if scheme == "multinomial" else len(weights) * weights % 1
    return np.tile(left / left.sum(), (round(left.sum()), 1))


def offspring_law(scheme: str, weights: Array) -> dict[tuple[int, ...], float]:
    """Exact law of the offspring counts of a resampling scheme: {counts: probability}."""
    count, law = len(weights), {}
    if scheme == "systematic":
        ends = np.cumsum(weights) * count
        edges = np.unique(np.concatenate([[0.0, 1.0], ends[:-1] % 1]))
        for a, b in itertools.pairwise(edges[np.diff(edges, append=2) > 1e-12]):  # counts change where u passes an end
            parents = np.searchsorted(ends, np.arange(count) + (a + b) / 2)
            key = tuple(np.bincount(parents, minlength=count).tolist())
            law[key] = law.get(key, 0.0) + b - a
        return law
    certain = np.floor(count * weights) if scheme == "residual" else np.zeros(count)
    law[tuple(certain.astype(int).tolist())] = 1.0
    for slot in slots(scheme, weights):
        found = {}
        for (so_far, p), (i, chance) in itertools.product(law.items(), enumerate(slot)):
            now = (*so_far[:i], so_far[i] + 1, *so_far[i + 1 :])
            found[now] = found.get(now, 0.0) + p * chance
        law = found
    return law


def offspring_variance(scheme: str, weights: Array, phi: Array) -> float:
    """Exact variance of the sum of phi[N] over the offspring: over independent slots, or over the one uniform number."""
    if scheme == "systematic":
        law = offspring_law(scheme, weights)
        values, chance = np.array(list(law)) @ phi, np.array(list(law.values()))
        return float(chance @ (values - chance @ values) ** 2)
    chances = slots(scheme, weights)
    return float((chances @ phi**2 - (chances @ phi) ** 2).sum())
