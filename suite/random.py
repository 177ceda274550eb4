"""Random streams: one a run, keyed by names, so that no result depends on what else is run, or how it is grouped."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from suite.linalg import Array

Fill = Callable[[np.random.Generator, Array], object]


class Generators:
    """The generators of a batch of runs, drawn from together: every shape is [components, runs, ...].

    Each run fills its own part in one call, so its numbers depend on that part's shape alone, never on the batch.
    """

    def __init__(self, generators: Sequence[np.random.Generator]):
        self.generators = tuple(generators)

    @property
    def runs(self) -> int:
        """Number of runs in the batch."""
        return len(self.generators)

    def of(self, runs: "Sequence[int] | np.ndarray[tuple[int], np.dtype[np.intp]]") -> "Generators":
        """The generators of some of the runs, by their place in the batch; those of the others stay where they are."""
        return Generators([self.generators[r] for r in runs])

    def _fill(self, shape: tuple[int, ...], fill: Fill) -> Array:
        components, runs, *rest = shape
        if runs != self.runs:
            raise ValueError(f"{runs} runs were asked of generators for {self.runs}")
        buffer = np.empty((runs, components, *rest))
        for generator, part in zip(self.generators, buffer, strict=True):
            fill(generator, part)
        return np.moveaxis(buffer, 0, 1)

    def standard_normal(self, shape: tuple[int, ...]) -> Array:
        """Standard normal numbers of shape [components, runs, ...]."""
        return self._fill(shape, lambda g, out: g.standard_normal(out=out))

    def random(self, shape: tuple[int, ...]) -> Array:
        """Uniform numbers in [0, 1) of shape [components, runs, ...]."""
        return self._fill(shape, lambda g, out: g.random(out=out))

    def standard_exponential(self, shape: tuple[int, ...]) -> Array:
        """Exponential numbers with mean 1, of shape [components, runs, ...]."""
        return self._fill(shape, lambda g, out: g.standard_exponential(out=out))

    def standard_gamma(self, alpha: float, shape: tuple[int, ...]) -> Array:
        """Gamma numbers with shape parameter `alpha` and scale 1, of shape [components, runs, ...]."""
        return self._fill(shape, lambda g, out: g.standard_gamma(alpha, out=out))


@dataclass(frozen=True)
class Streams:
    """A family of random streams, one for each run number; `first` is the number of the batch's first run."""

    key: tuple[str | int, ...]
    first: int = 0

    @classmethod
    def of(cls, seed: "int | Streams") -> "Streams":
        """Streams of a plain seed, or the streams given."""
        return seed if isinstance(seed, Streams) else cls((int(seed),))

    def batch(self, start: int, count: int) -> Generators:
        """Generators of the `count` runs that begin `start` runs after the first."""
        digest = hashlib.sha256("\x1f".join(map(str, self.key)).encode()).digest()
        entropy = int.from_bytes(digest[:16], "big")
        runs = range(self.first + start, self.first + start + count)
        return Generators([np.random.Generator(np.random.SFC64(np.random.SeedSequence(entropy, spawn_key=(r,)))) for r in runs])
