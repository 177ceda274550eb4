"""The particle filter with uniform resampling (AUPF): some particles are drawn anew, evenly over the box of the best."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from suite import particles
from suite.linalg import Array
from suite.model import StateSpaceModel
from suite.parameters import parameter
from suite.particle_filter import ParticleFilter
from suite.particles import Particles, Resampled
from suite.proposal import from_transition
from suite.random import Generators
from suite.resampling import SCHEMES, Indices, select


@dataclass(frozen=True)
class UniformResampling(ParticleFilter):
    """Bootstrap filter that resamples from the largest weights and fills up with even draws over a box around them.

    The even draws get the weight 1/N as all others do, so that the posterior they stand for is wider than the true one:
    unless `fraction` is 1, the filter does not converge to the exact answer as N grows.
    """

    name: ClassVar[str] = "uniform-resampling"
    reference: ClassVar[str] = (
        "W. Liu, W. Song, Z. Huang, Improved interacting multiple model particle filter for passive multi-sensor "
        "(in Chinese), Ship Science and Technology 39(3), 2017, 145-149, section 2.2"
    )
    fraction: float = parameter(0.9, "share of the particles kept, by weight; the paper: 0.8 to 1", above=0, high=1)
    box: str = parameter(
        "kept",
        "what the box encloses: the particles kept, those of them that survive, or the mean ± sqrt(3) deviations of the kept",
        choices=("kept", "survivors", "deviations"),
    )
    threshold: float = parameter(1.0, "resample below this share of effective particles", low=0, high=1)
    resampling: str = parameter("multinomial", "resampling scheme", choices=tuple(SCHEMES))

    def step(self, model: StateSpaceModel, belief: Particles, y: Array, k: int, rng: Generators) -> Particles:
        start = particles.resample(belief, self.survivors, self.threshold, rng)
        origins = self.filled(belief, start, rng)
        x, fit, evidence = particles.blockwise(lambda part: from_transition(model, part, y, k, rng), origins)
        return particles.weighted(x, start.logw + fit + evidence, start.parents)

    @property
    def keep(self) -> int:
        """How many particles are kept, and drawn from them."""
        return max(1, round(self.fraction * self.particles))

    def kept(self, weights: Array) -> Indices:
        """The particles of largest weight [R, keep], in ascending order of index."""
        largest = np.argpartition(weights, self.particles - self.keep, axis=1)[:, -self.keep :]
        return np.sort(largest, axis=1)

    def survivors(self, weights: Array, rng: Generators) -> Indices:
        """Indices [R, N]: draws from the particles kept; the last one stands in for those that are drawn evenly."""
        kept = self.kept(weights)
        share = np.take_along_axis(weights, kept, axis=1)
        drawn = SCHEMES[self.resampling](share / share.sum(1, keepdims=True), rng)
        survivors = np.take_along_axis(kept, drawn, axis=1)
        return np.pad(survivors, ((0, 0), (0, self.particles - self.keep)), mode="edge")

    def filled(self, belief: Particles, start: Resampled, rng: Generators) -> Array:
        """The resampled particles [n, R, N], those behind the first `keep` drawn evenly over the box."""
        runs, rest = start.runs, self.particles - self.keep
        if not len(runs) or not rest:
            return start.x
        low, high = self.corners(belief, start)
        x = start.x.copy()
        x[:, runs, self.keep :] = low + (high - low) * rng.of(runs).random((len(x), len(runs), rest))
        return x

    def corners(self, belief: Particles, start: Resampled) -> tuple[Array, Array]:
        """Lowest and highest corner of the box in each resampled run, [n, R, 1] each."""
        if self.box == "survivors":
            inside = start.x[:, start.runs, : self.keep]
            return inside.min(-1, keepdims=True), inside.max(-1, keepdims=True)
        weights = belief.weights[start.runs]
        kept = self.kept(weights)
        inside, share = select(belief.x[:, start.runs], kept), np.take_along_axis(weights, kept, axis=1)
        alive = share > 0  # where fewer than `keep` have any weight, the rest of the kept are arbitrary
        if self.box == "kept":
            low, high = np.where(alive, inside, np.inf), np.where(alive, inside, -np.inf)
            return low.min(-1, keepdims=True), high.max(-1, keepdims=True)
        inside, share = np.where(alive, inside, 0.0), share / share.sum(1, keepdims=True)
        mean = (inside * share).sum(-1, keepdims=True)
        half = np.sqrt(3 * ((inside - mean) ** 2 * share).sum(-1, keepdims=True))
        return mean - half, mean + half


ESTIMATORS = (UniformResampling(),)
