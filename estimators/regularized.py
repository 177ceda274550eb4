"""The regularized particle filter: after resampling, draw from a kernel density instead of repeating particles."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from suite import particles
from suite.kernel import bandwidth, epanechnikov
from suite.linalg import Array, apply_by_run, square_root
from suite.model import StateSpaceModel
from suite.parameters import parameter
from suite.particle_filter import ParticleFilter
from suite.particles import Particles
from suite.random import Generators
from suite.resampling import SCHEMES


@dataclass(frozen=True)
class Regularized(ParticleFilter):
    """Post-regularised particle filter: Epanechnikov kernel of optimal bandwidth in whitened coordinates."""

    name: ClassVar[str] = "regularized"
    reference: ClassVar[str] = (
        "C. Musso, N. Oudjane, F. Le Gland, Improving regularised particle filters, in A. Doucet, N. de Freitas, "
        "N. Gordon (eds.), Sequential Monte Carlo Methods in Practice, Springer, 2001, 247-271"
    )
    threshold: float = parameter(0.5, "resample below this share of effective particles", low=0, high=1)
    shrink: bool = parameter(False, "draw particles towards their mean first, so that the kernel leaves the covariance alone")
    resampling: str = parameter("systematic", "resampling scheme", choices=tuple(SCHEMES))

    def step(self, model: StateSpaceModel, belief: Particles, y: Array, k: int, rng: Generators) -> Particles:
        start = particles.resample(belief, SCHEMES[self.resampling], self.threshold, rng)
        origins = self.regularised(belief, start.x, start.runs, rng)
        x = model.dynamics.sample(rng, origins, k)
        return particles.weighted(x, start.logw + model.sensor.logpdf(y, x, k), start.parents)

    def regularised(self, belief: Particles, x: Array, runs: Array, rng: Generators) -> Array:
        """Resampled particles x[n, R, N] of the given runs, moved by the kernel; `belief` tells their spread."""
        if not len(runs):
            return x
        n, _, count = x.shape
        mean, cov = belief.moments
        h = bandwidth(n, count)
        root = h * square_root(np.ascontiguousarray(np.moveaxis(cov, -1, 0)[runs]))
        moves = apply_by_run(root, epanechnikov(rng.of(runs), n, count))
        moved = x.copy()
        if self.shrink:  # kernel covariance h² S / (n + 4)
            centre = mean[:, runs, None]
            moved[:, runs] = centre + np.sqrt(1 - h * h / (n + 4)) * (x[:, runs] - centre) + moves
        else:
            moved[:, runs] += moves
        return moved


ESTIMATORS = (Regularized(),)
