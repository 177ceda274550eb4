"""CUSUM on a particle filter: a manoeuvre's evidence, summed for as long as it is positive."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from suite import detection, mode_particles
from suite.estimator import Readout
from suite.jump import JumpModel
from suite.jump_filter import JumpFilter
from suite.linalg import Array
from suite.mode_particles import ModeParticles
from suite.model import StateSpaceModel
from suite.parameters import parameter
from suite.particle_filter import ParticleFilter
from suite.proposal import has_likelihood
from suite.random import Generators
from suite.resampling import SCHEMES


@dataclass(frozen=True)
class Summed:
    """The particles, and the cumulative sum g_k [R]."""

    cloud: ModeParticles
    total: Array

    def read(self) -> Readout:
        """What the particles say, but for the statistic."""
        return replace(self.cloud.read(), statistic=self.total)


@dataclass(frozen=True)
class ParticleCusum(JumpFilter, ParticleFilter):
    """Multiple-model particle filter whose statistic is Page's cumulative sum of log-likelihood ratios.

    The ratio s_k is that of the predictive likelihoods of y_k that the particles in the modes of a manoeuvre, and those in the
    nominal one, give before they are weighted; g_k = max(0, g_{k-1} + s_k). The paper's eq. 16 is a ratio of sums of point
    masses, which is not defined; this is what it must mean. All else is as in the multiple-model particle filter.
    """

    name: ClassVar[str] = "pf-cusum"
    reference: ClassVar[str] = (
        "Z. Radosavljević, S. Stanković, Sekvencijalna metoda za detekciju manevra aviona (in Serbian), eqs 13-16; "
        "E. S. Page, Continuous inspection schemes, Biometrika 41, 1954, 100-115"
    )
    threshold: float = parameter(1 / 3, "resample below this share of effective particles", low=0, high=1)
    resampling: str = parameter("systematic", "resampling scheme", choices=tuple(SCHEMES))

    def accepts_mode(self, model: StateSpaceModel) -> str | None:
        return has_likelihood(model)

    def init(self, model: JumpModel, rng: Generators) -> Summed:
        return Summed(mode_particles.drawn(model, rng, self.particles), np.zeros(rng.runs))

    def step(self, model: JumpModel, belief: Summed, y: Array, k: int, rng: Generators) -> Summed:
        cloud = mode_particles.step(belief.cloud, y, k, rng, SCHEMES[self.resampling], self.threshold)
        ratio = detection.log_likelihood_ratio(cloud.predicted, cloud.evidence, model.nominal)
        return Summed(cloud, detection.cusum(belief.total, detection.observed(ratio, y)))


ESTIMATORS = (ParticleCusum(),)
