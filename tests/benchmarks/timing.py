"""Timing on a machine that others use too: processor time, what is compared in turns, and the medians of the turns' ratios.

Processor time is that of all threads of this process; on an idle machine a filter's is what a clock on the wall shows.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pytest

from suite.linalg import Array
from suite.metrics.cost import quantile_ranks
from suite.random import Generators

Job = Callable[[], object]
Shapes = list[tuple[int, ...]]
TIMER = time.process_time


@dataclass(frozen=True)
class Turns:
    """Seconds of each round, of the subject and of the rivals that were timed right before it."""

    subject: Array
    rivals: Mapping[str, Array]

    def ratio(self, rival: str) -> float:
        """How many times as long as a rival the subject takes."""
        return float(np.median(self.subject / self.rivals[rival]))

    def intervals(self) -> dict[str, list[float]]:
        """By rival the ratio and the ends of its exact 95 % interval, which are NaN for fewer than six rounds."""
        found = {}
        for rival, seconds in self.rivals.items():
            ordered = np.concatenate([[np.nan], np.sort(self.subject / seconds), [np.nan]])
            found[rival] = [self.ratio(rival), *(float(ordered[rank]) for rank in quantile_ranks(len(seconds), 0.5))]
        return found

    def medians(self) -> dict[str, float]:
        """Median seconds of the rivals, by name."""
        return {name: float(np.median(seconds)) for name, seconds in self.rivals.items()}


def in_turns(benchmark, subject: Job, rivals: Mapping[str, Job], rounds: int) -> Turns:
    """Time the rivals and then the subject, round after round; the benchmark's own figures are the subject's.

    Its file keeps the ratios, as `turns`: `filterbench report` shows those whose rival a benchmark names, as "ratio_to_floor".
    """
    seconds: dict[str, list[float]] = {name: [] for name in rivals}

    def rivals_first() -> None:
        for name, job in rivals.items():
            seconds[name].append(clock(job))

    benchmark.pedantic(subject, setup=rivals_first, rounds=rounds, warmup_rounds=1)
    turns = Turns(np.array(benchmark.stats.stats.data), {name: np.array(s[-rounds:]) for name, s in seconds.items()})
    benchmark.extra_info["turns"] = turns.intervals()
    return turns


def clock(job: Job) -> float:
    """Seconds of processor time that a job takes."""
    begin = TIMER()
    job()
    return TIMER() - begin


def rounds_within(seconds: float, job: Job, low: int = 3, high: int = 15) -> int:
    """How many rounds of a job fit into so many seconds, after one that shows how long it takes."""
    return int(np.clip(seconds / clock(job), low, high))


def normals_drawn(job: Job) -> Shapes:
    """Shapes of the arrays that a job fills with standard normal numbers, in order, one array a run and fill.

    All that the job draws through `Generators.standard_normal` counts: of the prior, the process noise, the measurement
    noise of a proposal, candidates that a move rejects. Uniform, exponential and Gamma numbers do not.
    """
    shapes: Shapes = []
    draw = Generators.standard_normal

    def counted(self: Generators, shape: tuple[int, ...]) -> Array:
        components, runs, *rest = shape
        shapes.extend([(components, *rest)] * runs)
        return draw(self, shape)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Generators, "standard_normal", counted)
        job()
    return shapes


def floor(shapes: Shapes) -> Job:
    """A job that does nothing but fill arrays of these shapes with standard normal numbers from SFC64.

    The arrays are made beforehand, one a shape, and filled again and again: they stay in the cache.
    """
    rng = np.random.Generator(np.random.SFC64(1))
    buffers = {shape: np.empty(shape) for shape in set(shapes)}

    def fill() -> None:
        for shape in shapes:
            rng.standard_normal(out=buffers[shape])

    return fill
