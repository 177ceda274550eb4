"""ISIR: the locally linearised optimal proposal, resampling below a threshold, and a Metropolis-Hastings move."""

from dataclasses import dataclass
from typing import ClassVar

from suite import move, proposal
from suite.linalg import Array
from suite.model import StateSpaceModel
from suite.move import Moving
from suite.parameters import parameter
from suite.particle_filter import ParticleFilter
from suite.proposal import linearised
from suite.random import Generators
from suite.resampling import SCHEMES


@dataclass(frozen=True)
class Isir(ParticleFilter):
    """Improved SIR filter: linearised optimal proposal, resampling below a threshold, one Metropolis-Hastings move."""

    name: ClassVar[str] = "isir"
    reference: ClassVar[str] = (
        "A. Pavlov, M. G. S. Bruno, Filtro de partículas aperfeiçoado para rastreamento de alvos com coeficiente balístico "
        "variável (in Portuguese), Tables I and II"
    )
    threshold: float = parameter(0.6, "resample and move below this share of effective particles", low=0, high=1)
    resampling: str = parameter("multinomial", "resampling scheme", choices=tuple(SCHEMES))

    def accepts(self, model: StateSpaceModel) -> str | None:
        return super().accepts(model) or proposal.accepts(model)

    def init(self, model: StateSpaceModel, rng: Generators) -> Moving:
        return move.start(super().init(model, rng))

    def step(self, model: StateSpaceModel, belief: Moving, y: Array, k: int, rng: Generators) -> Moving:
        return move.step(linearised, model, belief, y, k, rng, SCHEMES[self.resampling], self.threshold)


ESTIMATORS = (Isir(),)
