"""The bootstrap filter: propagate, weight by the likelihood, resample at every step."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from suite.estimator import Filter, Readout
from suite.linalg import Array
from suite.model import StateSpaceModel
from suite.parameters import parameter
from suite.particles import Particles, normalise
from suite.random import Generators
from suite.resampling import select, systematic

CACHE = 16_384
"""Particles of all runs carried together: their arrays stay in the processor's cache."""


@dataclass(frozen=True)
class Bootstrap(Filter):
    """Bootstrap particle filter with systematic resampling at every step."""

    name: ClassVar[str] = "bootstrap"
    reference: ClassVar[str] = (
        "N. J. Gordon, D. J. Salmond, A. F. M. Smith, Novel approach to nonlinear/non-Gaussian Bayesian state "
        "estimation, IEE Proceedings F 140(2), 1993, 107-113"
    )
    particles: int = parameter(1000, "number of particles", low=1, high=10_000_000)

    def runs_at_once(self, model: StateSpaceModel) -> int:
        return max(1, CACHE // self.particles)

    def init(self, model: StateSpaceModel, rng: Generators) -> Particles:
        shape = (rng.runs, self.particles)
        return Particles(model.prior.sample(rng, shape), np.full(shape, 1 / self.particles), np.zeros(rng.runs))

    def step(self, model: StateSpaceModel, belief: Particles, y: Array, k: int, rng: Generators) -> Particles:
        # The estimate is read before resampling, so resampling opens the next step; the prior's draws need none.
        x = select(belief.x, systematic(belief.weights, rng)) if k > 1 else belief.x
        x = model.dynamics.sample(rng, x, k)
        weights, total = normalise(model.sensor.logpdf(y, x, k))
        return Particles(x, weights, total - np.log(self.particles))

    def read(self, belief: Particles) -> Readout:
        mean, cov = belief.moments()
        return Readout(mean, cov, belief.loglik, belief.ess)


ESTIMATORS = (Bootstrap(),)
