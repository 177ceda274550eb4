"""The bootstrap filter: propagate, weight by the likelihood, resample at every step."""

from dataclasses import dataclass
from typing import ClassVar

from suite import particles
from suite.linalg import Array
from suite.model import StateSpaceModel
from suite.parameters import parameter
from suite.particle_filter import ParticleFilter
from suite.particles import Particles
from suite.proposal import from_transition
from suite.random import Generators
from suite.resampling import SCHEMES


@dataclass(frozen=True)
class Bootstrap(ParticleFilter):
    """Bootstrap particle filter: resampling at every step."""

    name: ClassVar[str] = "bootstrap"
    reference: ClassVar[str] = (
        "N. J. Gordon, D. J. Salmond, A. F. M. Smith, Novel approach to nonlinear/non-Gaussian Bayesian state "
        "estimation, IEE Proceedings F 140(2), 1993, 107-113"
    )
    resampling: str = parameter("systematic", "resampling scheme", choices=tuple(SCHEMES))

    def step(self, model: StateSpaceModel, belief: Particles, y: Array, k: int, rng: Generators) -> Particles:
        # The estimate is read before resampling, so resampling opens the next step.
        start = particles.resample(belief, SCHEMES[self.resampling], 1.0, rng)
        x, fit, evidence = particles.blockwise(lambda part: from_transition(model, part, y, k, rng), start.x)
        return particles.weighted(x, start.logw + fit + evidence, start.parents)


ESTIMATORS = (Bootstrap(),)
