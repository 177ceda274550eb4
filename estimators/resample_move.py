"""Resample-move: the bootstrap filter with a Metropolis-Hastings move after resampling."""

from dataclasses import dataclass
from typing import ClassVar

from suite import move
from suite.linalg import Array
from suite.model import StateSpaceModel
from suite.move import Moving
from suite.parameters import parameter
from suite.particle_filter import ParticleFilter
from suite.proposal import from_transition
from suite.random import Generators
from suite.resampling import SCHEMES


@dataclass(frozen=True)
class ResampleMove(ParticleFilter):
    """Bootstrap filter whose resampled particles are moved once, by fresh draws from their parents' transition."""

    name: ClassVar[str] = "resample-move"
    reference: ClassVar[str] = (
        "W. R. Gilks, C. Berzuini, Following a moving target: Monte Carlo inference for dynamic Bayesian models, Journal "
        "of the Royal Statistical Society B 63(1), 2001, 127-146"
    )
    threshold: float = parameter(1.0, "resample and move below this share of effective particles", low=0, high=1)
    resampling: str = parameter("systematic", "resampling scheme", choices=tuple(SCHEMES))

    def init(self, model: StateSpaceModel, rng: Generators) -> Moving:
        return move.start(super().init(model, rng))

    def step(self, model: StateSpaceModel, belief: Moving, y: Array, k: int, rng: Generators) -> Moving:
        return move.step(from_transition, model, belief, y, k, rng, SCHEMES[self.resampling], self.threshold)


ESTIMATORS = (ResampleMove(),)
