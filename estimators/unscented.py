"""The unscented particle filter: each particle is proposed by an unscented Kalman filter of its own."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from suite import gaussian, moment_rules, particles
from suite.estimator import Readout
from suite.gaussian import GaussianBelief
from suite.linalg import Array
from suite.model import StateSpaceModel
from suite.parameters import parameter
from suite.particle_filter import ParticleFilter
from suite.particles import Particles
from suite.proposal import needs_density
from suite.random import Generators
from suite.resampling import SCHEMES, select


@dataclass(frozen=True)
class UnscentedBelief:
    """Particles, and the factor [n, n, R, N] of the covariance that each one's filter carries."""

    particles: Particles
    root: Array

    def read(self) -> Readout:
        """The weighted particles as a readout."""
        return self.particles.read()


@dataclass(frozen=True)
class UnscentedParticle(ParticleFilter):
    """Particle filter that proposes from each particle's own unscented Kalman filter.

    As in the authors' program, a particle's filter goes on from the particle itself and the covariance it had before. Where
    the process noise is narrow that covariance is far wider than the transition, and next to no draw gets any weight:
    `carried` scales it, and with 0 the filter starts from the particle alone, the sigma-point form of the optimal proposal.
    The paper's optional Markov chain move is left out; `isir` and `resample-move` show what a move brings.
    """

    name: ClassVar[str] = "unscented"
    reference: ClassVar[str] = (
        "R. van der Merwe, A. Doucet, N. de Freitas, E. Wan, The unscented particle filter, Advances in Neural "
        "Information Processing Systems 13, 2000, 584-590"
    )
    particles: int = parameter(200, "number of particles", low=1, high=10_000_000)
    threshold: float = parameter(1.0, "resample below this share of effective particles", low=0, high=1)
    resampling: str = parameter("residual", "resampling scheme", choices=tuple(SCHEMES))
    carried: float = parameter(1.0, "share of its covariance that a particle's filter starts from", low=0, high=1)
    alpha: float = parameter(1.0, "spread of the sigma points", low=1e-6, high=1)
    beta: float = parameter(0.0, "extra weight of the central point in covariances", low=0)
    kappa: float = parameter(2.0, "second spread parameter", low=0)

    def accepts(self, model: StateSpaceModel) -> str | None:
        return super().accepts(model) or gaussian.additive(model) or needs_density(model)

    def init(self, model: StateSpaceModel, rng: Generators) -> UnscentedBelief:
        begin = super().init(model, rng)
        shape = (*model.prior.cov.shape, *begin.logw.shape)
        return UnscentedBelief(begin, np.broadcast_to(model.prior.lower[:, :, None, None], shape))

    def step(self, model: StateSpaceModel, belief: UnscentedBelief, y: Array, k: int, rng: Generators) -> UnscentedBelief:
        start = particles.resample(belief.particles, SCHEMES[self.resampling], self.threshold, rng)
        spread = select(belief.root, start.parents) if len(start.runs) else belief.root
        x, fit, root = particles.blockwise(
            lambda origin, around: self.proposed(model, origin, around, y, k, rng), start.x, spread
        )
        return UnscentedBelief(particles.weighted(x, start.logw + fit, start.parents), root)

    def proposed(
        self, model: StateSpaceModel, origin: Array, around: Array, y: Array, k: int, rng: Generators
    ) -> tuple[Array, Array, Array]:
        """Draws [n, R, N] from each particle's filter, their log-weights [R, N], and the factors of its covariance."""
        n, runs, count = origin.shape
        rule = moment_rules.unscented(self.alpha, self.beta, self.kappa)
        each = GaussianBelief(origin.reshape(n, -1).T, np.moveaxis(np.sqrt(self.carried) * around.reshape(n, n, -1), -1, 0))
        after = gaussian.update(
            rule, gaussian.predict(rule, each, model.dynamics, k), model.sensor, np.repeat(y, count, axis=1), k
        )
        white = rng.standard_normal(origin.shape)
        moves = np.matmul(after.root, white.reshape(n, -1).T[..., None])[..., 0]
        x = (after.mean + moves).T.reshape(origin.shape)
        log_proposal = -0.5 * (n * np.log(2 * np.pi) + (white * white).sum(0))
        log_proposal -= np.log(np.abs(np.diagonal(after.root, axis1=1, axis2=2))).sum(-1).reshape(runs, count)
        fit = model.sensor.logpdf(y, x, k) + model.dynamics.logpdf(x, origin, k) - log_proposal
        blind = np.flatnonzero(np.isnan(y).all(0))
        if len(blind):  # where nothing was measured the transition itself is the best proposal
            x[:, blind] = model.dynamics.sample(rng.of(blind), origin[:, blind], k)
            fit[blind] = 0.0
        return x, fit, np.moveaxis(after.root, 0, -1).reshape(around.shape)


ESTIMATORS = (UnscentedParticle(),)
