"""The auxiliary particle filter: look at the measurement before choosing which particles to propagate."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from suite import particles
from suite.linalg import Array
from suite.model import AdditiveTransition, StateSpaceModel
from suite.parameters import parameter
from suite.particle_filter import ParticleFilter
from suite.particles import Particles
from suite.random import Generators
from suite.resampling import SCHEMES, select


@dataclass(frozen=True)
class Auxiliary(ParticleFilter):
    """Auxiliary particle filter: parents chosen by the likelihood of a point drawn from, or typical of, their transition."""

    name: ClassVar[str] = "auxiliary"
    reference: ClassVar[str] = (
        "M. K. Pitt, N. Shephard, Filtering via simulation: auxiliary particle filters, Journal of the American "
        "Statistical Association 94(446), 1999, 590-599"
    )
    look: str = parameter("sample", "point that stands for a particle's future", choices=("sample", "mean"))
    resampling: str = parameter("systematic", "resampling scheme", choices=tuple(SCHEMES))

    def accepts(self, model: StateSpaceModel) -> str | None:
        if self.look == "mean" and not isinstance(model.dynamics, AdditiveTransition):
            return "its transition has no mean to look ahead with"
        return None

    def step(self, model: StateSpaceModel, belief: Particles, y: Array, k: int, rng: Generators) -> Particles:
        dynamics, sensor = model.dynamics, model.sensor
        ahead = dynamics.sample(rng, belief.x, k) if self.look == "sample" else dynamics.mean(belief.x, k)
        preview = sensor.logpdf(y, ahead, k)
        first = particles.weighted(belief.x, belief.logw + preview, particles.all_of(*preview.shape))
        parents = SCHEMES[self.resampling](first.weights, rng)
        x = dynamics.sample(rng, select(belief.x, parents), k)
        second = sensor.logpdf(y, x, k) - select(preview[None], parents)[0]
        return particles.weighted(x, second + (first.loglik - np.log(self.particles))[:, None], parents)


ESTIMATORS = (Auxiliary(),)
