"""Sequential importance resampling: resample only when the effective sample size has fallen below a threshold."""

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
class SequentialImportanceResampling(Filter):
    """Particle filter that proposes from the transition and resamples when ESS < threshold · N."""

    name: ClassVar[str] = "sir"
    reference: ClassVar[str] = (
        "M. S. Arulampalam, S. Maskell, N. Gordon, T. Clapp, A tutorial on particle filters for online "
        "nonlinear/non-Gaussian Bayesian tracking, IEEE Transactions on Signal Processing 50(2), 2002, 174-188"
    )
    particles: int = parameter(1000, "number of particles", low=1, high=10_000_000)
    threshold: float = parameter(0.5, "resample below this share of effective particles", low=0, high=1)
    resampling: str = parameter("systematic", "resampling scheme", choices=tuple(SCHEMES))

    def runs_at_once(self, model: StateSpaceModel) -> int:
        return particles.runs_at_once(self.particles)

    def init(self, model: StateSpaceModel, rng: Generators) -> Particles:
        return particles.drawn(model.prior, rng, self.particles)

    def step(self, model: StateSpaceModel, belief: Particles, y: Array, k: int, rng: Generators) -> Particles:
        start = particles.resample(belief, SCHEMES[self.resampling], self.threshold, rng)
        x = model.dynamics.sample(rng, start.x, k)
        return particles.weighted(x, start.logw + model.sensor.logpdf(y, x, k), start.parents)

    def read(self, belief: Particles) -> Readout:
        return belief.read()


ESTIMATORS = (SequentialImportanceResampling(),)
