"""ISIR: the locally linearised optimal proposal, resampling below a threshold, and a Metropolis-Hastings move."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from suite import particles, proposal
from suite.estimator import Filter, Readout
from suite.linalg import Array
from suite.model import StateSpaceModel
from suite.parameters import parameter
from suite.particles import Particles, Resampled
from suite.proposal import Linearised
from suite.random import Generators
from suite.resampling import SCHEMES, select


@dataclass(frozen=True)
class IsirBelief:
    """Particles, the proposals that they came from, and how far each exceeds its linear sensor's likelihood [R, N]."""

    particles: Particles
    guide: Linearised | None = None
    excess: Array | None = None


@dataclass(frozen=True)
class Isir(Filter):
    """Improved SIR filter: linearised optimal proposal, resampling below a threshold, one Metropolis-Hastings move."""

    name: ClassVar[str] = "isir"
    reference: ClassVar[str] = (
        "A. A. Pavlov, M. G. S. Bruno, tracking of a ballistic target by particle filters (in Portuguese), Table I"
    )
    particles: int = parameter(1000, "number of particles", low=1, high=10_000_000)
    threshold: float = parameter(0.6, "resample and move below this share of effective particles", low=0, high=1)
    resampling: str = parameter("systematic", "resampling scheme", choices=tuple(SCHEMES))

    def accepts(self, model: StateSpaceModel) -> str | None:
        return proposal.accepts(model)

    def runs_at_once(self, model: StateSpaceModel) -> int:
        return particles.runs_at_once(self.particles)

    def init(self, model: StateSpaceModel, rng: Generators) -> IsirBelief:
        return IsirBelief(particles.drawn(model.prior, rng, self.particles))

    def step(self, model: StateSpaceModel, belief: IsirBelief, y: Array, k: int, rng: Generators) -> IsirBelief:
        # The estimate is read before resampling, so resampling and the move that follows it open the next step.
        start = particles.resample(belief.particles, SCHEMES[self.resampling], self.threshold, rng)
        x, acceptance = self.move(belief, start, rng)
        guide = proposal.linearise(model, x, y, k)
        x = guide.draw(rng)
        excess = guide.excess(x)
        logw = start.logw + excess + guide.evidence()
        return IsirBelief(particles.weighted(x, logw, start.parents, acceptance), guide, excess)

    def move(self, belief: IsirBelief, start: Resampled, rng: Generators) -> tuple[Array, Array]:
        """The resampled particles after one independence move, each by the proposal of its own parent."""
        x, runs = start.x, start.runs
        acceptance = np.full(x.shape[1], np.nan)
        if belief.guide is None or belief.excess is None or not len(runs):
            return x, acceptance
        guide = belief.guide.of(runs, start.parents[runs])
        candidates = guide.draw(rng.of(runs))
        now = select(belief.excess[None, runs], start.parents[runs])[0]
        moved = x.copy()
        moved[:, runs], acceptance[runs] = particles.metropolis(
            x[:, runs], candidates, guide.excess(candidates) - now, rng.of(runs)
        )
        return moved, acceptance

    def read(self, belief: IsirBelief) -> Readout:
        return belief.particles.read()


ESTIMATORS = (Isir(),)
