"""The guided particle filter: the locally linearised optimal proposal, without a move."""

from dataclasses import dataclass
from typing import ClassVar

from suite import particles, proposal
from suite.estimator import Filter, Readout
from suite.linalg import Array
from suite.model import StateSpaceModel
from suite.parameters import parameter
from suite.particles import Particles
from suite.random import Generators
from suite.resampling import SCHEMES


@dataclass(frozen=True)
class Guided(Filter):
    """Particle filter that proposes from the locally linearised optimal proposal and resamples below a threshold."""

    name: ClassVar[str] = "guided"
    reference: ClassVar[str] = (
        "A. Doucet, S. Godsill, C. Andrieu, On sequential Monte Carlo sampling methods for Bayesian filtering, "
        "Statistics and Computing 10, 2000, 197-208"
    )
    particles: int = parameter(1000, "number of particles", low=1, high=10_000_000)
    threshold: float = parameter(0.6, "resample below this share of effective particles", low=0, high=1)
    resampling: str = parameter("systematic", "resampling scheme", choices=tuple(SCHEMES))

    def accepts(self, model: StateSpaceModel) -> str | None:
        return proposal.accepts(model)

    def runs_at_once(self, model: StateSpaceModel) -> int:
        return particles.runs_at_once(self.particles)

    def init(self, model: StateSpaceModel, rng: Generators) -> Particles:
        return particles.drawn(model.prior, rng, self.particles)

    def step(self, model: StateSpaceModel, belief: Particles, y: Array, k: int, rng: Generators) -> Particles:
        start = particles.resample(belief, SCHEMES[self.resampling], self.threshold, rng)
        guide = proposal.linearise(model, start.x, y, k)
        x = guide.draw(rng)
        return particles.weighted(x, start.logw + guide.excess(x) + guide.evidence(), start.parents)

    def read(self, belief: Particles) -> Readout:
        return belief.read()


ESTIMATORS = (Guided(),)
