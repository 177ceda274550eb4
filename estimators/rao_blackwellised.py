"""The Rao-Blackwellised particle filter: some components are sampled, a Kalman filter a particle carries the others."""

from dataclasses import dataclass
from typing import ClassVar

from suite import marginal, particles
from suite.linalg import Array
from suite.marginal import Marginal
from suite.model import StateSpaceModel
from suite.parameters import parameter
from suite.particle_filter import ParticleFilter
from suite.random import Generators
from suite.resampling import SCHEMES


@dataclass(frozen=True)
class RaoBlackwellised(ParticleFilter):
    """Rao-Blackwellised (marginalised) particle filter that proposes from the transition of the sampled components."""

    name: ClassVar[str] = "rao-blackwellised"
    reference: ClassVar[str] = (
        "T. Schön, F. Gustafsson, P.-J. Nordlund, Marginalized particle filters for mixed linear/nonlinear state-space "
        "models, IEEE Transactions on Signal Processing 53(7), 2005, 2279-2289"
    )
    threshold: float = parameter(0.5, "resample below this share of effective particles", low=0, high=1)
    resampling: str = parameter("systematic", "resampling scheme", choices=tuple(SCHEMES))

    def accepts(self, model: StateSpaceModel) -> str | None:
        return marginal.accepts(model)

    def init(self, model: StateSpaceModel, rng: Generators) -> Marginal:
        return Marginal(marginal.drawn(model, rng, self.particles), model.linear)

    def step(self, model: StateSpaceModel, belief: Marginal, y: Array, k: int, rng: Generators) -> Marginal:
        start = particles.resample(belief.particles, SCHEMES[self.resampling], self.threshold, rng)
        x, fit = particles.blockwise(lambda x: marginal.update(model, marginal.predict(model, x, k, rng), y, k), start.x)
        return Marginal(particles.weighted(x, start.logw + fit, start.parents), model.linear)


ESTIMATORS = (RaoBlackwellised(),)
