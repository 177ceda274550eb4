"""Resample-move: the bootstrap filter with a Metropolis-Hastings move after resampling."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from suite import particles
from suite.estimator import Filter, Readout
from suite.linalg import Array
from suite.model import StateSpaceModel
from suite.parameters import parameter
from suite.particles import Particles, Resampled
from suite.random import Generators
from suite.resampling import SCHEMES, select


@dataclass(frozen=True)
class MoveBelief:
    """Particles, with what a move needs: their parents' states, the log-likelihood of each, and the measurement."""

    particles: Particles
    origins: Array | None = None
    likelihood: Array | None = None
    y: Array | None = None
    k: int = 0


@dataclass(frozen=True)
class ResampleMove(Filter):
    """Bootstrap filter whose resampled particles are moved once, by fresh draws from their parents' transition."""

    name: ClassVar[str] = "resample-move"
    reference: ClassVar[str] = (
        "W. R. Gilks, C. Berzuini, Following a moving target: Monte Carlo inference for dynamic Bayesian models, Journal "
        "of the Royal Statistical Society B 63(1), 2001, 127-146"
    )
    particles: int = parameter(1000, "number of particles", low=1, high=10_000_000)
    threshold: float = parameter(1.0, "resample and move below this share of effective particles", low=0, high=1)
    resampling: str = parameter("systematic", "resampling scheme", choices=tuple(SCHEMES))

    def runs_at_once(self, model: StateSpaceModel) -> int:
        return particles.runs_at_once(self.particles)

    def init(self, model: StateSpaceModel, rng: Generators) -> MoveBelief:
        return MoveBelief(particles.drawn(model.prior, rng, self.particles))

    def step(self, model: StateSpaceModel, belief: MoveBelief, y: Array, k: int, rng: Generators) -> MoveBelief:
        start = particles.resample(belief.particles, SCHEMES[self.resampling], self.threshold, rng)
        origins, acceptance = self.move(model, belief, start, rng)
        x = model.dynamics.sample(rng, origins, k)
        likelihood = model.sensor.logpdf(y, x, k)
        made = particles.weighted(x, start.logw + likelihood, start.parents, acceptance)
        return MoveBelief(made, origins, likelihood, y, k)

    def move(self, model: StateSpaceModel, belief: MoveBelief, start: Resampled, rng: Generators) -> tuple[Array, Array]:
        """The resampled particles after one independence move, each from its own parent's transition."""
        x, runs = start.x, start.runs
        acceptance = np.full(x.shape[1], np.nan)
        if belief.origins is None or belief.likelihood is None or belief.y is None or not len(runs):
            return x, acceptance
        origins = select(belief.origins[:, runs], start.parents[runs])
        now = select(belief.likelihood[None, runs], start.parents[runs])[0]
        candidates = model.dynamics.sample(rng.of(runs), origins, belief.k)
        log_ratio = model.sensor.logpdf(belief.y[:, runs], candidates, belief.k) - now
        moved = x.copy()
        moved[:, runs], acceptance[runs] = particles.metropolis(x[:, runs], candidates, log_ratio, rng.of(runs))
        return moved, acceptance

    def read(self, belief: MoveBelief) -> Readout:
        return belief.particles.read()


ESTIMATORS = (ResampleMove(),)
