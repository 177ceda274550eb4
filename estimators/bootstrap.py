"""The bootstrap filter: propagate, weight by the likelihood, resample at every step."""

from dataclasses import dataclass
from typing import ClassVar

from suite import particles
from suite.estimator import Filter, Readout
from suite.linalg import Array
from suite.model import StateSpaceModel
from suite.parameters import parameter
from suite.particles import Particles
from suite.random import Generators
from suite.resampling import SCHEMES


@dataclass(frozen=True)
class Bootstrap(Filter):
    """Bootstrap particle filter: resampling at every step."""

    name: ClassVar[str] = "bootstrap"
    reference: ClassVar[str] = (
        "N. J. Gordon, D. J. Salmond, A. F. M. Smith, Novel approach to nonlinear/non-Gaussian Bayesian state "
        "estimation, IEE Proceedings F 140(2), 1993, 107-113"
    )
    particles: int = parameter(1000, "number of particles", low=1, high=10_000_000)
    resampling: str = parameter("systematic", "resampling scheme", choices=tuple(SCHEMES))

    def runs_at_once(self, model: StateSpaceModel) -> int:
        return particles.runs_at_once(self.particles)

    def init(self, model: StateSpaceModel, rng: Generators) -> Particles:
        return particles.drawn(model.prior, rng, self.particles)

    def step(self, model: StateSpaceModel, belief: Particles, y: Array, k: int, rng: Generators) -> Particles:
        # The estimate is read before resampling, so resampling opens the next step.
        start = particles.resample(belief, SCHEMES[self.resampling], 1.0, rng)
        x = model.dynamics.sample(rng, start.x, k)
        return particles.weighted(x, start.logw + model.sensor.logpdf(y, x, k), start.parents)

    def read(self, belief: Particles) -> Readout:
        return belief.read()


ESTIMATORS = (Bootstrap(),)
