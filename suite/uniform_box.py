"""Uniform resampling: draws from the particles of largest weight, filled up with even draws over a box around them."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from suite import particles
from suite.linalg import Array
from suite.parameters import parameter
from suite.particles import Particles, Resampled
from suite.random import Generators
from suite.resampling import Indices, Scheme, select

BOXES = ("kept", "survivors", "deviations")


def fraction() -> Any:
    """The parameter of a filter that says how many of its particles are kept."""
    return parameter(0.9, "share of the particles kept, by weight; the paper: 0.8 to 1", above=0, high=1)


def box() -> Any:
    """The parameter of a filter that says what the box is."""
    words = "what the box encloses (assumed): the particles kept, those that survive, or their mean ± sqrt(3) deviations"
    return parameter("kept", words, choices=BOXES)


@dataclass(frozen=True)
class UniformBox:
    """`keep` particles are drawn from as many of largest weight, the rest evenly over a box (Liu, Song and Huang, 2017).

    box: what it encloses: the particles kept, those of them that survive, or the mean ± sqrt(3) deviations of the kept. Which
    of these the paper means is not known: the step that says so is missing from the text at hand.
    """

    keep: int
    box: str
    scheme: Scheme

    @classmethod
    def of(cls, fraction: float, count: int, box: str, scheme: Scheme) -> "UniformBox":
        """The box that keeps a fraction of `count` particles, at least one."""
        return cls(max(1, round(fraction * count)), box, scheme)

    def resample(self, belief: Particles, threshold: float, rng: Generators) -> Resampled:
        """As `particles.resample`; the particles behind the first `keep` are drawn evenly over the box."""
        start = particles.resample(belief, self.survivors, threshold, rng)
        return replace(start, x=self.filled(belief, start, rng))

    def survivors(self, weights: Array, rng: Generators) -> Indices:
        """Indices [R, N]: draws from the particles kept; the last one stands in for those that are drawn evenly."""
        kept = self.kept(weights)
        share = np.take_along_axis(weights, kept, axis=1)
        drawn = self.scheme(share / share.sum(1, keepdims=True), rng)
        survivors = np.take_along_axis(kept, drawn, axis=1)
        return np.pad(survivors, ((0, 0), (0, weights.shape[1] - self.keep)), mode="edge")

    def filled(self, belief: Particles, start: Resampled, rng: Generators) -> Array:
        """The resampled particles [n, R, N], those behind the first `keep` drawn evenly over the box."""
        runs, rest = start.runs, start.x.shape[-1] - self.keep
        if not len(runs) or not rest:
            return start.x
        low, high = self._corners(belief, start)
        x = start.x.copy()
        x[:, runs, self.keep :] = low + (high - low) * rng.of(runs).random((len(x), len(runs), rest))
        return x

    def kept(self, weights: Array) -> Indices:
        """The particles of largest weight [R, keep], in ascending order of index."""
        largest = np.argpartition(weights, weights.shape[1] - self.keep, axis=1)[:, -self.keep :]
        return np.sort(largest, axis=1)

    def _corners(self, belief: Particles, start: Resampled) -> tuple[Array, Array]:
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
