"""The base of particle filters that start from draws of the prior and carry weighted particles."""

from dataclasses import dataclass
from typing import Protocol

from suite import particles
from suite.estimator import Filter, Readout
from suite.model import StateSpaceModel
from suite.parameters import parameter
from suite.particles import Particles
from suite.proposal import has_likelihood
from suite.random import Generators


class Belief(Protocol):
    """What a particle filter carries from step to step: `Particles`, or these and what else it needs."""

    def read(self) -> Readout:
        """The weighted particles as a readout."""


@dataclass(frozen=True)
class ParticleFilter(Filter):
    """Base of particle filters: give `step`; the belief is `Particles` unless `init` says otherwise."""

    particles: int = parameter(1000, "number of particles", low=1, high=10_000_000)

    def accepts(self, model: StateSpaceModel) -> str | None:
        """None when measurements have a likelihood to weigh particles by, otherwise the reason why not."""
        return has_likelihood(model)

    def runs_at_once(self, model: StateSpaceModel) -> int:
        """As many runs as fill the processor's cache."""
        return particles.runs_at_once(self.particles)

    def init(self, model: StateSpaceModel, rng: Generators) -> Particles:
        """Equally weighted draws from the prior."""
        return particles.drawn(model.prior, rng, self.particles)

    def read(self, belief: Belief) -> Readout:
        """Weighted mean and covariance, with the health of the weights."""
        return belief.read()
