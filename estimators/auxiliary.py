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
from suite.proposal import from_transition
from suite.random import Generators
from suite.resampling import SCHEMES, select


@dataclass(frozen=True)
class Auxiliary(ParticleFilter):
    """Auxiliary particle filter: parents chosen by the likelihood of a point drawn from, or typical of, their transition.

    A drawn point, as in the multistatic radar paper, is a poor guide where the sensor is sharper than the transition: the
    weights divide by the likelihood of that draw, their mean is as it should be but their variance need not be finite.
    """

    name: ClassVar[str] = "auxiliary"
    reference: ClassVar[str] = (
        "M. K. Pitt, N. Shephard, Filtering via simulation: auxiliary particle filters, Journal of the American "
        "Statistical Association 94(446), 1999, 590-599"
    )
    look: str = parameter("sample", "point that stands for a particle's future", choices=("sample", "mean"))
    resampling: str = parameter("systematic", "resampling scheme", choices=tuple(SCHEMES))

    def accepts(self, model: StateSpaceModel) -> str | None:
        if reason := super().accepts(model):
            return reason
        if self.look == "mean" and not isinstance(model.dynamics, AdditiveTransition):
            return "its transition has no mean to look ahead to; set look=sample"
        return None

    def step(self, model: StateSpaceModel, belief: Particles, y: Array, k: int, rng: Generators) -> Particles:
        dynamics, sensor = model.dynamics, model.sensor

        def look(x: Array) -> Array:
            if self.look == "mean":
                return dynamics.mean(x, k) + dynamics.noise_mean(k)[:, None, None]
            return dynamics.sample(rng, x, k)

        (preview,) = particles.blockwise(lambda x: (sensor.logpdf(y, look(x), k),), belief.x)
        first = particles.weighted(belief.x, belief.logw + preview, particles.all_of(*preview.shape))
        parents = SCHEMES[self.resampling](first.weights, rng)
        x, fit, evidence = particles.blockwise(lambda part: from_transition(model, part, y, k, rng), select(belief.x, parents))
        evidence = evidence - select(preview[None], parents)[0] + (first.loglik - np.log(self.particles))[:, None]
        return particles.weighted(x, fit + evidence, parents)


ESTIMATORS = (Auxiliary(),)
