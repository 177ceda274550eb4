"""Oracles for jump-Markov models: the exact posterior of linear-Gaussian ones, by a Kalman filter for every mode sequence."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import logsumexp

from suite.jump import JumpModel
from suite.linalg import Array
from tests.oracles import Linear


@dataclass(frozen=True)
class JumpLinear:
    """Linear-Gaussian modes r_k with P[i, j] = P(r_k = j | r_{k-1} = i) and the law of r_0; x_0 follows the prior of r_0."""

    modes: tuple[Linear, ...]
    P: Array
    p0: Array

    @property
    def model(self) -> JumpModel:
        """The same model in the words of filterbench."""
        return JumpModel(tuple(mode.model for mode in self.modes), self.P, self.p0)

    def simulate(self, steps: int, runs: int, seed: int = 0) -> tuple[Array, Array, Array]:
        """States [T, n, R], measurements [T, m, R] and modes [T, R], run by run with numpy's own generators."""
        rng = np.random.default_rng(seed)
        found = [self._simulate(steps, rng) for _ in range(runs)]
        states, measurements, modes = (np.stack(part, axis=-1) for part in zip(*found, strict=True))
        return states, measurements, modes

    def _simulate(self, steps: int, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        r = rng.choice(len(self.p0), p=self.p0)
        x = rng.multivariate_normal(self.modes[r].m0, self.modes[r].P0)
        states, measurements, modes = [], [], []
        for _ in range(steps):
            r = rng.choice(len(self.p0), p=self.P[r])
            p = self.modes[r]
            x = p.A @ x + p.a + p.G @ rng.multivariate_normal(p.w, p.Q)
            states.append(x)
            measurements.append(p.H @ x + p.h + rng.multivariate_normal(p.v, p.R))
            modes.append(r)
        return np.stack(states), np.stack(measurements), np.array(modes)


@dataclass(frozen=True)
class Exact:
    """mean[T, n, R], cov[T, n, n, R], loglik[T, R] and mode[T, M, R] as in an Estimate, and logp[T, M, R] = log mode."""

    mean: Array
    cov: Array
    loglik: Array
    mode: Array
    logp: Array


def enumeration(p: JumpLinear, y: Array) -> Exact:
    """The exact posterior given measurements y[T, m, R], NaN where missing; costs M^(T+1) Kalman filters a run."""
    found = [_one_run(p, y[:, :, r]) for r in range(y.shape[2])]
    mean, cov, loglik, logp = (np.stack(part, axis=-1) for part in zip(*found, strict=True))
    return Exact(mean, cov, loglik, np.exp(logp), logp)


def _one_run(p: JumpLinear, y: Array) -> tuple[Array, Array, Array, Array]:
    with np.errstate(divide="ignore"):
        law, logw = np.log(p.P), np.log(p.p0)
    last, mean = np.arange(len(p.p0)), np.stack([mode.m0 for mode in p.modes])
    cov, total, found = np.stack([mode.P0 for mode in p.modes]), 0.0, []
    for z in y:
        grown = []
        for j, mode in enumerate(p.modes):  # every sequence goes on with every mode that may follow
            alive = logw + law[last, j] > -np.inf
            x, P, fit = _kalman(mode, mean[alive], cov[alive], z)
            grown.append((x, P, (logw + law[last, j])[alive] + fit, np.full(alive.sum(), j)))
        mean, cov, logw, last = (np.concatenate(part) for part in zip(*grown, strict=True))
        weights, before = np.exp(logw - logsumexp(logw)), total
        total = logsumexp(logw)
        centre = weights @ mean
        spread = np.einsum("s,sij->ij", weights, cov + (mean - centre)[:, :, None] * (mean - centre)[:, None])
        by_mode = [logsumexp(logw[last == j]) if (last == j).any() else -np.inf for j in range(len(p.p0))]
        found.append((centre, spread, total - before, np.array(by_mode) - total))
    mean, cov, loglik, logp = (np.stack(part) for part in zip(*found, strict=True))
    return mean, cov, loglik, logp


def _kalman(p: Linear, x: Array, P: Array, z: Array) -> tuple[Array, Array, Array]:
    """The textbook's Kalman filter for means [S, n] and covariances [S, n, n] at once, and log p(z | each)[S]."""
    x, P = x @ p.A.T + p.a + p.G @ p.w, p.A @ P @ p.A.T + p.G @ p.Q @ p.G.T
    rows = np.flatnonzero(~np.isnan(z))
    H, R = p.H[rows], p.R[np.ix_(rows, rows)]
    S = H @ P @ H.T + R
    error = (z - p.h - p.v)[rows] - x @ H.T
    gain = P @ H.T @ np.linalg.inv(S)
    fit = -0.5 * np.einsum("si,si->s", error, np.linalg.solve(S, error[..., None])[..., 0])
    fit -= 0.5 * (np.linalg.slogdet(S)[1] + len(rows) * np.log(2 * np.pi))
    return x + (gain @ error[..., None])[..., 0], P - gain @ H @ P, fit


_MOVING = Linear(
    A=np.array([[1.0, 1.0], [0.0, 1.0]]), a=np.zeros(2),
    G=np.array([[0.5], [1.0]]), w=np.zeros(1), Q=np.array([[0.04]]),
    H=np.array([[1.0, 0.0], [0.3, 1.0]]), h=np.zeros(2), v=np.zeros(2), R=np.array([[1.0, 0.2], [0.2, 0.8]]),
    m0=np.array([0.0, 1.0]), P0=np.array([[2.0, 0.3], [0.3, 0.5]]),
)  # fmt: skip


TWO = JumpLinear(
    (_MOVING, replace(_MOVING, w=np.array([0.5]), Q=np.array([[1.5]]))),
    np.array([[0.9, 0.1], [0.25, 0.75]]),
    np.array([0.8, 0.2]),
)
"""Constant velocity, and a manoeuvre that is pushed one way; two correlated sensors, one prior for both modes."""

THREE = JumpLinear(
    (
        _MOVING,
        replace(_MOVING, A=np.array([[0.6, -0.8], [0.8, 0.6]]), a=np.array([0.3, -0.2]), h=np.array([0.5, -1.0])),
        replace(
            _MOVING, G=np.eye(2), w=np.array([0.1, -0.4]), Q=np.array([[0.6, 0.2], [0.2, 0.9]]), v=np.array([0.2, -0.3]),
            R=np.array([[4.0, -1.0], [-1.0, 3.0]]), m0=np.array([1.0, -1.0]), P0=np.diag([0.5, 2.0]),
        ),
    ),
    np.array([[0.8, 0.1, 0.1], [0.3, 0.7, 0.0], [0.0, 0.6, 0.4]]),
    np.array([0.6, 0.0, 0.4]),
)  # fmt: skip
"""Three modes that differ in everything that can differ, priors too, with jumps and a beginning that are impossible."""

PARTS = ("mean", "cov", "loglik", "mode")
"""What an exact posterior and an estimate have in common."""


def near(found: Any, expected: Any, parts: Sequence[str] = PARTS, rtol: float = 1e-10) -> None:
    """Assert that the parts of two posteriors agree relative to each number or, where these are small, to the largest."""
    for part in parts:
        value = getattr(expected, part)
        np.testing.assert_allclose(getattr(found, part), value, rtol=rtol, atol=rtol * np.abs(value).max(), err_msg=part)
