"""The IMM filter as the EKF/UKF toolbox has it, for models of unequal dimension: an oracle in plain numpy, runs first.

A rule gives, for x[R, d] and P[R, d, d], the mean, the covariance and the cross-covariance of a function of a Gaussian state.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from suite.linalg import Array

Rule = Callable[[Array, Array], tuple[Array, Array, Array]]


def transposed(a):
    return np.swapaxes(a, -1, -2)


def linear(matrix) -> Rule:
    """The exact rule of a linear function."""
    return lambda x, P: (x @ matrix.T, matrix @ P @ matrix.T, P @ matrix.T)


def extended(f, slope) -> Rule:
    """Linearisation: f(x[R, d]) and slope(x) give values [R, p] and Jacobians [R, p, d]."""

    def rule(x, P):
        across = P @ transposed(slope(x))
        return f(x), slope(x) @ across, across

    return rule


def unscented(f) -> Rule:
    """The toolbox's sigma points, alpha = 1, beta = 0 and kappa = 3 - d: d + kappa = 3, and 1 - d / 3 for the central one."""

    def rule(x, P):
        d = x.shape[1]
        away = np.sqrt(3) * transposed(np.linalg.cholesky(P + 1e-14 * np.eye(d)))
        points = np.concatenate([x[:, None], x[:, None] + away, x[:, None] - away], axis=1)
        values = f(points.reshape(-1, d)).reshape(len(x), 2 * d + 1, -1)
        weights = np.array([1 - d / 3] + [1 / 6] * (2 * d))
        mean = weights @ values
        off = values - mean[:, None]
        return mean, transposed(off) * weights @ off, transposed(points - x[:, None]) * weights @ off

    return rule


@dataclass(frozen=True)
class Member:
    """One model, of the first d components of the state: its start, x_k = move(x_{k-1}) + N(0, Q) and y = look(x) + N(0, R).

    residual: the difference of two measurements.
    """

    mean: Array
    cov: Array
    move: Rule
    Q: Array
    look: Rule
    R: Array
    residual: Callable[[Array, Array], Array] = np.subtract

    def step(self, x, P, z):
        """Mean, covariance and log-likelihood after measurements z[R, m]."""
        x, P, _ = self.move(x, P)
        P = P + self.Q
        expected, S, across = self.look(x, P)
        S = S + self.R
        error = self.residual(z, expected)
        gain = transposed(np.linalg.solve(S, transposed(across)))
        fit = -0.5 * ((error[:, None] @ np.linalg.solve(S, error[..., None]))[:, 0, 0] + np.linalg.slogdet(2 * np.pi * S)[1])
        return x + (gain @ error[..., None])[..., 0], P - gain @ S @ transposed(gain), fit


def kalman(member: Member, y: Array) -> Array:
    """Means [T, R, d] of one model's filter, given y[T, R, m]."""
    x, P = np.tile(member.mean, (y.shape[1], 1)), np.tile(member.cov, (y.shape[1], 1, 1))
    means = []
    for z in y:
        x, P, _ = member.step(x, P, z)
        means.append(x)
    return np.stack(means)


def imm(members: Sequence[Member], transition: Array, initial: Array, y: Array, spread: bool) -> tuple[Array, Array]:
    """Means [T, R, n] and probabilities of the models [T, R, M], given y[T, R, m].

    A component that a model lacks is zero, without any variance. spread: whether it enters the covariance of a mixture by its
    distance from the mean, as every other component does; in the toolbox it does not.
    """
    runs, n = y.shape[1], max(len(member.mean) for member in members)
    sizes = [len(member.mean) for member in members]
    x = [np.tile(np.pad(member.mean, (0, n - d)), (runs, 1)) for member, d in zip(members, sizes, strict=True)]
    P = [np.tile(np.pad(member.cov, (0, n - d)), (runs, 1, 1)) for member, d in zip(members, sizes, strict=True)]
    mu, means, probabilities = np.tile(initial, (runs, 1)), [], []
    for z in y:
        ahead = mu @ transition
        mixing = transition * mu[:, :, None] / ahead[:, None]
        mixed_x, mixed_P, fits = [], [], []
        for j, (member, d) in enumerate(zip(members, sizes, strict=True)):
            centre = sum(mixing[:, i, j, None] * x[i] for i in range(len(x)))
            cov = np.zeros((runs, n, n))
            for i, own in enumerate(sizes):
                off = x[i] - centre
                if not spread:
                    off[:, own:] = 0
                cov += mixing[:, i, j, None, None] * (P[i] + off[:, :, None] * off[:, None])
            mean, cov, fit = member.step(centre[:, :d], cov[:, :d, :d], z)
            mixed_x.append(np.pad(mean, ((0, 0), (0, n - d))))
            mixed_P.append(np.pad(cov, ((0, 0), (0, n - d), (0, n - d))))
            fits.append(fit)
        x, P = mixed_x, mixed_P
        logs = np.stack(fits, axis=1)
        mu = ahead * np.exp(logs - logs.max(1, keepdims=True))
        mu = mu / mu.sum(1, keepdims=True)
        means.append(sum(mu[:, i, None] * x[i] for i in range(len(x))))
        probabilities.append(mu)
    return np.stack(means), np.stack(probabilities)
