"""Sequential importance sampling: the bootstrap filter without resampling, the baseline that degenerates."""

from dataclasses import dataclass
from typing import ClassVar

from suite import particles
from suite.estimator import Filter, Readout
from suite.linalg import Array
from suite.model import StateSpaceModel
from suite.parameters import parameter
from suite.particles import Particles
from suite.random import Generators


@dataclass(frozen=True)
class SequentialImportanceSampling(Filter):
    """Sequential importance sampling from the transition, without resampling."""

    name: ClassVar[str] = "sis"
    reference: ClassVar[str] = (
        "A. Doucet, S. Godsill, C. Andrieu, On sequential Monte Carlo sampling methods for Bayesian filtering, "
        "Statistics and Computing 10, 2000, 197-208"
    )
    particles: int = parameter(1000, "number of particles", low=1, high=10_000_000)

    def runs_at_once(self, model: StateSpaceModel) -> int:
        return particles.runs_at_once(self.particles)

    def init(self, model: StateSpaceModel, rng: Generators) -> Particles:
        return particles.drawn(model.prior, rng, self.particles)

    def step(self, model: StateSpaceModel, belief: Particles, y: Array, k: int, rng: Generators) -> Particles:
        x = model.dynamics.sample(rng, belief.x, k)
        return particles.weighted(x, belief.logw + model.sensor.logpdf(y, x, k), particles.all_of(*belief.weights.shape))

    def read(self, belief: Particles) -> Readout:
        return belief.read()


ESTIMATORS = (SequentialImportanceSampling(),)
