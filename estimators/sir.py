"""Sequential importance resampling: resample only when the effective sample size has fallen below a threshold."""

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
class SequentialImportanceResampling(ParticleFilter):
    """Particle filter that proposes from the transition and resamples when ESS < threshold · N."""

    name: ClassVar[str] = "sir"
    reference: ClassVar[str] = (
        "M. S. Arulampalam, S. Maskell, N. Gordon, T. Clapp, A tutorial on particle filters for online "
        "nonlinear/non-Gaussian Bayesian tracking, IEEE Transactions on Signal Processing 50(2), 2002, 174-188"
    )
    threshold: float = parameter(0.5, "resample below this share of effective particles", low=0, high=1)
    resampling: str = parameter("systematic", "resampling scheme", choices=tuple(SCHEMES))

    def step(self, model: StateSpaceModel, belief: Particles, y: Array, k: int, rng: Generators) -> Particles:
        start = particles.resample(belief, SCHEMES[self.resampling], self.threshold, rng)
        x, fit, evidence = particles.blockwise(lambda part: from_transition(model, part, y, k, rng), start.x)
        return particles.weighted(x, start.logw + fit + evidence, start.parents)


ESTIMATORS = (SequentialImportanceResampling(),)
