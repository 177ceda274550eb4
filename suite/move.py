"""Resample-move: particle filters that move their particles after resampling, to make copies differ again."""

from dataclasses import dataclass

import numpy as np

from suite import particles
from suite.estimator import Readout
from suite.linalg import Array
from suite.model import StateSpaceModel
from suite.particles import Particles, Resampled
from suite.proposal import Proposal
from suite.random import Generators
from suite.resampling import Scheme, select


@dataclass(frozen=True)
class Moving:
    """Particles of step k, and what a move of them needs: where they came from, how well each fits, the measurement.

    origins[n, R, N], the states of step k - 1; fit[R, N] and y[m, R] as in `suite.proposal`; k = 0 before any step.
    """

    particles: Particles
    origins: Array
    fit: Array
    y: Array
    k: int

    def read(self) -> Readout:
        """The weighted particles as a readout."""
        return self.particles.read()


def start(begin: Particles) -> Moving:
    """Draws from the prior: no proposal made them, so nothing will move them."""
    return Moving(begin, begin.x, begin.logw, np.empty((0, begin.x.shape[1])), 0)


def step(
    propose: Proposal,
    model: StateSpaceModel,
    belief: Moving,
    y: Array,
    k: int,
    rng: Generators,
    scheme: Scheme,
    threshold: float,
) -> Moving:
    """Resample below the threshold, move what was resampled, propose and weight.

    The estimate is read before resampling, so resampling and the move that follows it open the next step.
    """
    resampled = particles.resample(belief.particles, scheme, threshold, rng)
    origins, acceptance = _moved(propose, model, belief, resampled, rng)
    x, fit, evidence = particles.blockwise(lambda part: propose(model, part, y, k, rng), origins)
    made = particles.weighted(x, resampled.logw + fit + evidence, resampled.parents, acceptance)
    return Moving(made, origins, fit, y, k)


def metropolis(
    propose: Proposal, model: StateSpaceModel, origins: Array, x: Array, fit: Array, y: Array, k: int, rng: Generators
) -> tuple[Array, Array]:
    """One independence Metropolis-Hastings step of each particle x[n, R, N], whose target is p(x_k | origin, y_k).

    The candidate is a fresh proposal from the particle's own origin[n, R, N]. Returns the particles after the step, and
    where the candidate was accepted [R, N] (Metropolis et al., 1953; Hastings, 1970; Gilks and Berzuini, 2001).
    """
    candidates, new_fit, _ = propose(model, origins, y, k, rng)
    accepted = np.log(rng.random((1, *fit.shape))[0]) < new_fit - fit
    return np.where(accepted, candidates, x), accepted


def _moved(
    propose: Proposal, model: StateSpaceModel, belief: Moving, resampled: Resampled, rng: Generators
) -> tuple[Array, Array]:
    """The particles [n, R, N] after one move in the runs that were resampled, and the share accepted in each run [R]."""
    runs, x = resampled.runs, resampled.x
    acceptance = np.full(x.shape[1], np.nan)
    if belief.k == 0 or not len(runs):
        return x, acceptance
    parents, some = resampled.parents[runs], rng.of(runs)
    origins, fit = select(belief.origins[:, runs], parents), select(belief.fit[None, runs], parents)[0]
    moved, accepted = particles.blockwise(
        lambda o, a, f: metropolis(propose, model, o, a, f, belief.y[:, runs], belief.k, some), origins, x[:, runs], fit
    )
    acceptance[runs] = accepted.mean(-1)
    if len(runs) == x.shape[1]:
        return moved, acceptance
    x = x.copy()
    x[:, runs] = moved
    return x, acceptance
