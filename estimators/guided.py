"""The guided particle filter: the locally linearised optimal proposal, without a move."""

from dataclasses import dataclass
from typing import ClassVar

from suite import particles, proposal
from suite.linalg import Array
from suite.model import StateSpaceModel
from suite.parameters import parameter
from suite.particle_filter import ParticleFilter
from suite.particles import Particles
from suite.proposal import linearised
from suite.random import Generators
from suite.resampling import SCHEMES


@dataclass(frozen=True)
class Guided(ParticleFilter):
    """Particle filter that proposes from the locally linearised optimal proposal and resamples below a threshold."""

    name: ClassVar[str] = "guided"
    reference: ClassVar[str] = (
        "A. Doucet, S. Godsill, C. Andrieu, On sequential Monte Carlo sampling methods for Bayesian filtering, "
        "Statistics and Computing 10, 2000, 197-208"
    )
    threshold: float = parameter(0.6, "resample below this share of effective particles", low=0, high=1)
    resampling: str = parameter("multinomial", "resampling scheme", choices=tuple(SCHEMES))

    def accepts(self, model: StateSpaceModel) -> str | None:
        return super().accepts(model) or proposal.accepts(model)

    def step(self, model: StateSpaceModel, belief: Particles, y: Array, k: int, rng: Generators) -> Particles:
        start = particles.resample(belief, SCHEMES[self.resampling], self.threshold, rng)
        x, fit, evidence = particles.blockwise(lambda part: linearised(model, part, y, k, rng), start.x)
        return particles.weighted(x, start.logw + fit + evidence, start.parents)


ESTIMATORS = (Guided(),)
