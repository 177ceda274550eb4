"""The particle filter with uniform resampling (AUPF): some particles are drawn anew, evenly over the box of the best."""

from dataclasses import dataclass
from typing import ClassVar

from suite import particles, uniform_box
from suite.linalg import Array
from suite.model import StateSpaceModel
from suite.parameters import parameter
from suite.particle_filter import ParticleFilter
from suite.particles import Particles, Resampled
from suite.proposal import from_transition
from suite.random import Generators
from suite.resampling import SCHEMES, Indices
from suite.uniform_box import UniformBox


@dataclass(frozen=True)
class UniformResampling(ParticleFilter):
    """Bootstrap filter that resamples from the largest weights and fills up with even draws over a box around them.

    The even draws get the weight 1/N as all others do, so that the posterior they stand for is wider than the true one:
    unless `fraction` is 1, the filter does not converge to the exact answer as N grows.
    """

    name: ClassVar[str] = "uniform-resampling"
    reference: ClassVar[str] = (
        "W. Liu, W. Song, Z. Huang, Improved interacting multiple model particle filter for passive multi-sensor "
        "(in Chinese), Ship Science and Technology 39(3), 2017, 145-149, section 2.2"
    )
    fraction: float = uniform_box.fraction()
    box: str = uniform_box.box()
    threshold: float = parameter(1.0, "resample below this share of effective particles", low=0, high=1)
    resampling: str = parameter("multinomial", "resampling scheme", choices=tuple(SCHEMES))

    def step(self, model: StateSpaceModel, belief: Particles, y: Array, k: int, rng: Generators) -> Particles:
        start = particles.resample(belief, self.survivors, self.threshold, rng)
        origins = self.filled(belief, start, rng)
        x, fit, evidence = particles.blockwise(lambda part: from_transition(model, part, y, k, rng), origins)
        return particles.weighted(x, start.logw + fit + evidence, start.parents)

    @property
    def even(self) -> UniformBox:
        """The way of resampling."""
        return UniformBox.of(self.fraction, self.particles, self.box, SCHEMES[self.resampling])

    @property
    def keep(self) -> int:
        """How many particles are kept, and drawn from them."""
        return self.even.keep

    def survivors(self, weights: Array, rng: Generators) -> Indices:
        """Indices [R, N]: draws from the particles kept; the last one stands in for those that are drawn evenly."""
        return self.even.survivors(weights, rng)

    def filled(self, belief: Particles, start: Resampled, rng: Generators) -> Array:
        """The resampled particles [n, R, N], those behind the first `keep` drawn evenly over the box."""
        return self.even.filled(belief, start, rng)


ESTIMATORS = (UniformResampling(),)
