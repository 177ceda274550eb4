"""Sequential importance sampling: the bootstrap filter without resampling, the baseline that degenerates."""

from dataclasses import dataclass
from typing import ClassVar

from suite import particles
from suite.linalg import Array
from suite.model import StateSpaceModel
from suite.particle_filter import ParticleFilter
from suite.particles import Particles
from suite.proposal import from_transition
from suite.random import Generators


@dataclass(frozen=True)
class SequentialImportanceSampling(ParticleFilter):
    """Sequential importance sampling from the transition, without resampling."""

    name: ClassVar[str] = "sis"
    reference: ClassVar[str] = (
        "A. Doucet, S. Godsill, C. Andrieu, On sequential Monte Carlo sampling methods for Bayesian filtering, "
        "Statistics and Computing 10, 2000, 197-208"
    )

    def step(self, model: StateSpaceModel, belief: Particles, y: Array, k: int, rng: Generators) -> Particles:
        x, fit, evidence = particles.blockwise(lambda part: from_transition(model, part, y, k, rng), belief.x)
        return particles.weighted(x, belief.logw + fit + evidence, particles.all_of(*belief.logw.shape))


ESTIMATORS = (SequentialImportanceSampling(),)
