"""What filters that know the modes of a jump-Markov model share: their base, and one Gaussian filter a mode."""

from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np

from suite import gaussian
from suite.estimator import Filter
from suite.gaussian import GaussianBelief
from suite.jump import JumpModel
from suite.linalg import Array
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
    count, (runs, n) = len(model.modes), mean.shape[-2:]
    mean, root = np.broadcast_to(mean, (count, runs, n)).copy(), np.broadcast_to(root, (count, runs, n, n)).copy()
    loglik = np.empty((count, runs))
    for j, mode in enumerate(model.modes):
        ahead = gaussian.predict(rule, GaussianBelief(mean[j], root[j]), mode.dynamics, k)
        mean[j], root[j] = ahead.mean, ahead.root
    for sensor in {id(mode.sensor): mode.sensor for mode in model.modes}.values():
        at = [j for j, mode in enumerate(model.modes) if mode.sensor is sensor]
        stacked = GaussianBelief(mean[at].reshape(-1, n), root[at].reshape(-1, n, n))
        after = gaussian.update(rule, stacked, sensor, np.tile(y, len(at)), k)
        assert after.loglik is not None
        mean[at], root[at] = after.mean.reshape(-1, runs, n), after.root.reshape(-1, runs, n, n)
        loglik[at] = after.loglik.reshape(-1, runs)
    lost = ~(np.isfinite(mean).all(-1) & np.isfinite(root).all((-1, -2)) & (loglik > -np.inf))
    if lost.any():
        mean[lost], root[lost], loglik[lost] = 0.0, 0.0, -np.inf
    return mean, root, loglik
