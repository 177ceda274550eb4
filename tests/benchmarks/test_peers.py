"""The bootstrap filter against those of other libraries, on the ballistic model: first the same answers, then the time."""

import os
import sys
from collections.abc import Iterator
from dataclasses import replace
from importlib.metadata import version

import numpy as np
import pytest

from cases import CASES
from estimators import ESTIMATORS
from suite.case import draw
from suite.linalg import Array
from suite.noise import Gaussian
from suite.random import Streams
from tests.benchmarks.peers import LIBRARIES, prepare
from tests.benchmarks.timing import TIMER, in_turns, rounds_within

pytestmark = pytest.mark.benchmark(timer=TIMER)

CASE = CASES["ballistic/1"]
MODEL = CASE.model
COUNT = 8000
OURS = ESTIMATORS[f"bootstrap[particles={COUNT}]"]


@pytest.fixture
def one_core() -> Iterator[None]:
    """Keep the threads that a library starts, those of JAX, on one processor."""
    if sys.platform != "linux":
        yield
        return
    usual = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(usual)})
    yield
    os.sched_setaffinity(0, usual)


def deviations(cov: Array) -> Array:
    """Standard deviations [..., n] from covariances [..., n, n]."""
    return np.sqrt(np.einsum("...ii->...i", cov))


def check_agreement(library: str) -> None:
    """Both filters estimate the same posterior means, standard deviations and log-likelihood, within Monte Carlo error.

    On the ballistic model with more process noise: in the case itself the uncertainty of the prior hides it, and a peer
    without it would pass. Here noises a third off or without their correlation do not, but for the range's.
    12 repetitions of each filter: the difference of their averages over its standard error is about t with 22 degrees of
    freedom; 8 of these is exceeded by chance with 6e-8, in 31 comparisons with 2e-6.
    """
    larger = np.array([10.0, 10.0, 10.0, 10.0, 300.0])
    noise = Gaussian.noise(MODEL.dynamics.noise_cov(1) * np.outer(larger, larger))
    model = replace(MODEL, dynamics=replace(MODEL.dynamics, noise=noise))
    y = draw(model, 25, Streams(("agreement",)).batch(0, 1)).y
    repeats, at = 12, [0, 4, 24]
    ours = OURS.run(model, np.repeat(y, repeats, axis=2), seed=2)
    peer = prepare(library, model, y[:, :, 0], COUNT)
    theirs = [peer(seed) for seed in range(repeats)]
    compared = [
        (np.stack([p.mean[at] for p in theirs]), np.moveaxis(ours.mean[at], -1, 0)),
        (np.stack([deviations(p.cov[at]) for p in theirs]), deviations(np.moveaxis(ours.cov[at], -1, 0))),
    ]
    if theirs[0].loglik is not None:
        compared.append((np.array([p.loglik for p in theirs]), ours.loglik.sum(0)))
    for a, b in compared:
        error = np.sqrt((a.var(0, ddof=1) + b.var(0, ddof=1)) / repeats)
        assert (abs(a.mean(0) - b.mean(0)) < 8 * error).all()


@pytest.mark.parametrize("library", LIBRARIES)
def test_bootstrap_against(benchmark, one_core, library: str) -> None:
    pytest.importorskip(library, exc_type=ImportError)
    check_agreement(library)
    y = CASE.simulate(runs=1, seed=1).y
    peer = prepare(library, MODEL, y[:, :, 0], COUNT)
    rounds = rounds_within(8, lambda: peer(1))
    turns = in_turns(benchmark, lambda: peer(1), {"filterbench": lambda: OURS.run(MODEL, y, seed=1)}, rounds)
    per_particle_step = 1e9 / (COUNT * len(y))
    benchmark.group = f"ballistic/1, bootstrap with {COUNT} particles, other libraries"
    benchmark.extra_info |= {
        "table": f"Bootstrap filters on ballistic/1, {COUNT} particles, resampled at every step, one thread, float64",
        "library": library,
        "version": version(library),
        "ns_per_particle_step": per_particle_step * float(np.median(turns.subject)),
        "filterbench_ns": per_particle_step * turns.medians()["filterbench"],
        "ratio_to_filterbench": turns.ratio("filterbench"),
    }
