"""Interacting multiple models whose modes carry particles: what mixing needs to know of each mode's cloud."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from suite import gaussian, modes, particles
from suite.estimator import Readout
from suite.gaussian import GaussianBelief
from suite.imm import Interacting
from suite.jump import chosen, drawn
from suite.linalg import Array, apply_by_run, square_root
from suite.model import Sensor, StateSpaceModel
from suite.moment_rules import Law, Spread
from suite.particles import Particles
from suite.proposal import from_transition
from suite.random import Generators


@dataclass(frozen=True)
class InteractingClouds(Interacting):
    """What is known of the state in each mode by its particles' moments; fits[M, R] are the likelihoods that they gave it.

    ess[R], the effective sample size of as many particles as one mode has, shared out by the modes' probabilities: the mean
    of 1/ess over the modes, inverted. It lies between 1 and N; that of all particles weighted together would exceed N.
    """

    ess: Array

    def read(self) -> Readout:
        """As of any interacting modes, with the health of the weights."""
        return replace(super().read(), ess=self.ess)


def updated(
    belief: Interacting, ahead: Array, fits: Sequence[Array], clouds: Sequence[Particles], ess: Sequence[Array]
) -> InteractingClouds:
    """The belief given the log-probabilities predicted [M, R], and for each mode its log-likelihood, its cloud and its ess[R].

    Where a mode's probability is zero, whatever became of its particles does not count.
    """
    logp, loglik = modes.posterior(ahead, np.stack(fits))
    moments = [cloud.moments for cloud in clouds]
    mean = np.stack([m.T for m, _ in moments])
    root = np.stack([square_root(np.ascontiguousarray(np.moveaxis(c, -1, 0))) for _, c in moments])
    share = np.where(logp > -np.inf, np.exp(logp) / np.stack(ess), 0.0)
    return InteractingClouds(mean, root, logp, ahead, np.stack(fits), loglik, belief.nominal, 1 / share.sum(0))


def redrawn(mean: Array, root: Array, count: int, rng: Generators) -> Array:
    """Draws [n, R, N] from Gaussians with mean[R, n] and covariance root rootᵀ [R, n, n]."""
    runs, n = mean.shape
    return mean.T[:, :, None] + apply_by_run(root, rng.standard_normal((n, runs, count)))


def picked(share: Array, options: Sequence[Array], rng: Generators) -> Array:
    """Columns [n, R, N], each from the same place in one of the arrays, drawn with probabilities share[M, R]."""
    everywhere = np.broadcast_to(share.T[:, None], (*options[0].shape[1:], len(share)))
    return chosen(drawn(everywhere, rng), options)


def moved(mode: StateSpaceModel, x: Array, y: Array, k: int, rng: Generators) -> Particles:
    """Equally weighted particles x[n, R, N], moved by a mode's dynamics and weighted by its likelihood."""
    runs, count = x.shape[1:]
    ahead, fit, evidence = particles.blockwise(lambda part: from_transition(mode, part, y, k, rng), x)
    return particles.weighted(ahead, fit + evidence - np.log(count), particles.all_of(runs, count))


def gaussian_loglik(sensor: Sensor, x: Array, y: Array, k: int) -> Array:
    """log N(nu; 0, S) [R] with the moments of the measurements predicted by equally weighted particles x[n, R, N].

    nu is y[m, R] less their mean, S their sample covariance and the noise's; missing components of y drop out.
    """
    n, runs, count = x.shape

    def rule(mean: Array, root: Array, law: Law, k: int) -> Spread:
        # Differences to one of them are summed, as in suite/moment_rules.py, which is right for angles as well.
        values = law.mean(x, k)
        away = law.residual(values, values[..., :1])
        shift = away.mean(-1)
        away -= shift[..., None]
        cov = np.stack([np.vecdot(away, row) for row in away]) / count
        dy = square_root(np.ascontiguousarray(np.moveaxis(cov, -1, 0)))
        return Spread((values[..., 0] + shift).T, np.zeros((runs, n, len(values))), dy)

    unknown = GaussianBelief(np.zeros((runs, n)), np.zeros((runs, n, n)))
    loglik = gaussian.update(rule, unknown, sensor, y, k).loglik
    assert loglik is not None
    return loglik
