"""What filters that know the modes of a jump-Markov model share: their base, and one Gaussian filter a mode."""

from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np

from suite import gaussian
from suite.estimator import Filter
from suite.gaussian import GaussianBelief
from suite.jump import JumpModel
from suite.linalg import Array, lower_triangular
from suite.model import StateSpaceModel
from suite.moment_rules import Rule


class JumpFilter(Filter):
    """Base of filters that are told a jump-Markov model whole; they refuse models of a single mode."""

    takes_modes: ClassVar[bool] = True

    def accepts(self, model: Any) -> str | None:
        """None when the filter takes the model; `accepts_mode` decides for each of its modes."""
        if not isinstance(model, JumpModel):
            return "the model has a single mode"
        reasons = ((name, self.accepts_mode(mode)) for name, mode in zip(model.names, model.modes, strict=True))
        return next((f"{name}: {reason}" for name, reason in reasons if reason), None)

    @abstractmethod
    def accepts_mode(self, model: StateSpaceModel) -> str | None:
        """None when the filter can run with such a mode, otherwise the reason why not."""


def priors(model: JumpModel, runs: int) -> tuple[Array, Array]:
    """The priors of the modes, once a run: means [M, R, n] and factors of covariances [M, R, n, n]."""
    each = [gaussian.prior(mode, runs) for mode in model.modes]
    return np.stack([belief.mean for belief in each]), np.stack([belief.root for belief in each])


def filtered(rule: Rule, model: JumpModel, mean: Array, root: Array, y: Array, k: int) -> tuple[Array, Array, Array]:
    """One step of a Gaussian filter a mode with y[m, R]: means [M, R, n], factors of covariances and log-likelihoods [M, R].

    The means [M, R, n] and factors [M, R, n, n] that they start from have no leading axis where all modes start from one.
    Modes that share a sensor are updated together. Where a mode's numbers are lost its likelihood is zero and they become
    zeros, so that they can be weighed with those of the others.
    """
    mean, root, loglik = _updated(rule, model, *_predicted(rule, model, mean, root, k), y, k)
    lost = ~(np.isfinite(mean).all(-1) & np.isfinite(root).all((-1, -2)) & (loglik > -np.inf))
    if lost.any():
        mean[lost], root[lost], loglik[lost] = 0.0, 0.0, -np.inf
    return mean, root, loglik


def _predicted(rule: Rule, model: JumpModel, mean: Array, root: Array, k: int) -> tuple[Array, Array]:
    """Means [M, R, n] and factors [M, R, n, n] before y_k; all are triangularised at once."""
    count, (runs, n), shared = len(model.modes), mean.shape[-2:], mean.ndim == 2
    starts = zip([mean] * count if shared else mean, [root] * count if shared else root, model.modes, strict=True)
    ahead = [gaussian.moved(rule, GaussianBelief(m, q), mode.dynamics, k) for m, q, mode in starts]
    columns = np.zeros((count, runs, n, max(one.root.shape[2] for one in ahead)))
    for into, one in zip(columns, ahead, strict=True):
        into[:, :, : one.root.shape[2]] = one.root
    lower = lower_triangular(columns.reshape(count * runs, n, -1))
    return np.stack([one.mean for one in ahead]), lower.reshape(count, runs, n, n)


def _updated(rule: Rule, model: JumpModel, mean: Array, root: Array, y: Array, k: int) -> tuple[Array, Array, Array]:
    """Means, factors and log-likelihoods [M, R] after y[m, R]."""
    count, runs, n = mean.shape
    loglik = np.empty((count, runs))
    for sensor in {id(mode.sensor): mode.sensor for mode in model.modes}.values():
        at = [j for j, mode in enumerate(model.modes) if mode.sensor is sensor]
        own = slice(None) if len(at) == count else at  # views of the arrays, where that is all of them
        before = GaussianBelief(mean[own].reshape(-1, n), root[own].reshape(-1, n, n))
        after = gaussian.update(rule, before, sensor, np.concat([y] * len(at), axis=1), k)
        assert after.loglik is not None
        mean[own], root[own] = after.mean.reshape(-1, runs, n), after.root.reshape(-1, runs, n, n)
        loglik[own] = after.loglik.reshape(-1, runs)
    return mean, root, loglik
