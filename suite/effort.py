"""How much work goes into what is computed once a cell, or once a case, whatever the number of runs: running times, bounds."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Effort:
    """Timed calls of `steps` steps, `repeats` with one run and with `runs` together, and trajectories of a bound.

    seconds: about how long a call of several runs may take; slow estimators are timed over fewer steps. tail_seconds: how long
    the many steps may take that an upper limit of their 99th percentile needs. trajectories: of a bound at most; slopes:
    entries of the slopes of all of them at all steps at most.
    """

    steps: int
    runs: int
    repeats: int
    seconds: float
    tail_seconds: float
    trajectories: int
    slopes: int


BRIEF = Effort(steps=10, runs=4, repeats=3, seconds=0.006, tail_seconds=0.0, trajectories=250, slopes=2_000_000)
FULL = Effort(steps=50, runs=20, repeats=5, seconds=0.05, tail_seconds=0.2, trajectories=2000, slopes=15_000_000)
EFFORTS = (BRIEF, FULL)
"""From the least to the most thorough."""
