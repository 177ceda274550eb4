"""The multiple-model particle filter: the mode is one more component of each particle."""

from dataclasses import dataclass
from typing import ClassVar

from suite import mode_particles
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
class MultipleModelParticleFilter(JumpFilter, ParticleFilter):
    """Bootstrap filter for state and mode together: the mode is drawn from its chain, then the state from that mode's dynamics.

    A mode that no particle is in has probability zero, until a particle jumps there.
    """

    name: ClassVar[str] = "multiple-model-pf"
    reference: ClassVar[str] = (
        "S. McGinnity, G. W. Irwin, Multiple model bootstrap filter for maneuvering target tracking, IEEE Transactions on "
        "Aerospace and Electronic Systems 36(3), 2000, 1006-1012"
    )
    threshold: float = parameter(0.5, "resample below this share of effective particles", low=0, high=1)
    resampling: str = parameter("systematic", "resampling scheme", choices=tuple(SCHEMES))

    def accepts_mode(self, model: StateSpaceModel) -> str | None:
        return has_likelihood(model)

    def init(self, model: JumpModel, rng: Generators) -> ModeParticles:
        return mode_particles.drawn(model, rng, self.particles)

    def step(self, model: JumpModel, belief: ModeParticles, y: Array, k: int, rng: Generators) -> ModeParticles:
        return mode_particles.step(belief, y, k, rng, SCHEMES[self.resampling], self.threshold)


ESTIMATORS = (MultipleModelParticleFilter(),)
