"""The Rao-Blackwellised particle filter of jump-Markov linear models: modes are sampled, Kalman filters carry the states."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from suite import modes, moment_rules, particles
from suite.estimator import Readout
from suite.jump import JumpModel, drawn
from suite.jump_filter import JumpFilter, filtered, priors
from suite.linalg import Array
from suite.model import StateSpaceModel, is_linear_gaussian
from suite.noise import Gaussian
from suite.parameters import parameter
from suite.particles import Particles
from suite.random import Generators
from suite.resampling import SCHEMES, Indices


@dataclass(frozen=True)
class Branches:
    """Histories r_0..r_{k-1} of modes, weighted given y_1..y_k, and what is known of x_k should each go on in mode j.

    histories: particles whose x[n, R, N] is the mean of x_k; mean[M, R, N, n] and root[M, R, N, n, n], a factor of the
    covariance, given mode j as well; logp[M, R, N], log-probabilities of the modes given history and measurements.
    """

    histories: Particles
    mean: Array
    root: Array
    logp: Array
    nominal: int

    def read(self) -> Readout:
        """Moments and mode probabilities of all branches; the health of the weights is that of the histories."""
        known = self.histories
        weights = known.weights * np.exp(self.logp)
        deviations = np.concat([self.root, (self.mean - known.mean.T[:, None])[..., None]], axis=4)
        columns = (np.sqrt(weights)[..., None, None] * deviations).transpose(1, 3, 0, 2, 4)
        columns = columns.reshape(*columns.shape[:2], -1)
        cov = np.moveaxis(columns @ columns.swapaxes(1, 2), 0, -1)
        logp = np.logaddexp.reduce(known.logw + self.logp, axis=2)
        return Readout(
            known.mean, cov, known.loglik, known.ess, known.ancestors,
            mode=weights.sum(2), statistic=modes.log_odds(logp, self.nominal),
        )  # fmt: skip


def branched(mean: Array, root: Array, logp: Array, logw: Array, parents: Indices, nominal: int) -> Branches:
    """Branches of histories with log-weights [R, N] that are not normalised yet."""
    logp = np.fmax(logp, -np.inf)  # a history of weight zero has no probabilities, and must not spoil the sums
    x = np.asarray(sum(np.exp(logp)[..., None] * mean))
    return Branches(particles.weighted(np.ascontiguousarray(np.moveaxis(x, -1, 0)), logw, parents), mean, root, logp, nominal)


@dataclass(frozen=True)
class ModeRaoBlackwellised(JumpFilter):
    """Rao-Blackwellised particle filter that draws each mode from its exact law given the modes before and y_1..y_k.

    A history's weight does not depend on the mode drawn next, so that drawing waits for the next step: histories are
    selected first, and estimates weigh all modes that a history may go on in.
    """

    name: ClassVar[str] = "rao-blackwellised-modes"
    reference: ClassVar[str] = (
        "A. Doucet, N. J. Gordon, V. Krishnamurthy, Particle filters for state estimation of jump Markov linear systems, "
        "IEEE Transactions on Signal Processing 49(3), 2001, 613-624"
    )
    particles: int = parameter(100, "number of particles, each a history of modes", low=1, high=100_000)
    threshold: float = parameter(0.5, "resample below this share of effective particles", low=0, high=1)
    resampling: str = parameter("systematic", "resampling scheme", choices=tuple(SCHEMES))

    def accepts_mode(self, model: StateSpaceModel) -> str | None:
        return None if is_linear_gaussian(model) else "the mode is not linear with Gaussian noises"

    def runs_at_once(self, model: JumpModel) -> int:
        return particles.runs_at_once(self.particles * len(model.modes))

    def init(self, model: JumpModel, rng: Generators) -> Branches:
        shape = (rng.runs, self.particles)
        mean, root = (np.repeat(part[:, :, None], self.particles, axis=2) for part in priors(model, rng.runs))
        logp = np.repeat(modes.initial(model, rng.runs)[:, :, None], self.particles, axis=2)
        even = np.full(shape, -np.log(self.particles))
        return branched(mean, root, logp, even, particles.all_of(*shape), model.nominal)

    def step(self, model: JumpModel, belief: Branches, y: Array, k: int, rng: Generators) -> Branches:
        for part, laws in (("process", [m.dynamics for m in model.modes]), ("measurement", [m.sensor for m in model.modes])):
            if not all(isinstance(law.noise_at(k), Gaussian) for law in laws):
                raise ValueError(f"the {part} noise of this step is not Gaussian, as that of the first is")
        start = particles.resample(belief.histories, SCHEMES[self.resampling], self.threshold, rng)
        run, parent = np.arange(rng.runs)[:, None], start.parents
        mode = drawn(np.exp(np.moveaxis(belief.logp[:, run, parent], 0, -1)), rng)
        origin = belief.mean[mode, run, parent].reshape(-1, model.n)
        around = belief.root[mode, run, parent].reshape(-1, model.n, model.n)
        each = np.repeat(y, self.particles, axis=1)
        mean, root, fits = filtered(moment_rules.affine, model, origin, around, each, k)
        ahead = model.log_transition.T[:, mode]
        logp, fit = modes.posterior(ahead, fits.reshape(ahead.shape))
        shape = (*ahead.shape, model.n)
        after = mean.reshape(shape), root.reshape(*shape, model.n)
        return branched(*after, logp, start.logw + fit, parent, model.nominal)

    def read(self, belief: Branches) -> Readout:
        return belief.read()


ESTIMATORS = (ModeRaoBlackwellised(),)
