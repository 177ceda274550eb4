"""Weighted particles that carry the mode of a jump-Markov model along with the state."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from suite import jump, particles
from suite.estimator import Readout
from suite.jump import JumpModel, Modes
from suite.linalg import Array
from suite.modes import log_odds
from suite.particles import Particles
from suite.random import Generators
from suite.resampling import Scheme

Law = TypeVar("Law")


@dataclass(frozen=True)
class ModeParticles:
    """Particles of (x_k, r_k): `particles` with x[n, R, N], and their modes r[R, N].

    before[R, N]: the log-weights that the same particles had before y_k. model: what they follow.
    """

    model: JumpModel
    particles: Particles
    modes: Modes
    before: Array

    @cached_property
    def predicted(self) -> Array:
        """Log-probabilities of r_k given y_1..y_{k-1} [M, R]: minus infinity for a mode without particles."""
        return _log_sums(self.before, self.modes, len(self.model.modes))

    @cached_property
    def logp(self) -> Array:
        """Log-probabilities of r_k given y_1..y_k [M, R]: sums of weights, which in the log domain do not underflow."""
        return _log_sums(self.particles.logw, self.modes, len(self.model.modes))

    @property
    def evidence(self) -> Array:
        """Log of p(y_k | r_k, y_1..y_{k-1}) / p(y_k | y_1..y_{k-1}) [M, R]; minus infinity for a mode without particles."""
        nobody = np.full_like(self.predicted, -np.inf)
        return np.subtract(self.logp, self.predicted, out=nobody, where=self.predicted > -np.inf)

    def read(self) -> Readout:
        """The weighted particles as a readout, with the modes' probabilities and the log of the odds of a manoeuvre."""
        odds = log_odds(self.logp, self.model.nominal)
        return replace(self.particles.read(), mode=np.exp(self.logp), statistic=odds)


def drawn(model: JumpModel, rng: Generators, count: int) -> ModeParticles:
    """`count` equally weighted draws of r_0, and of x_0 from that mode's prior, for each run."""
    shape = (rng.runs, count)
    modes = jump.started(model, rng, shape)
    x = jump.chosen(modes, [each.prior.sample(rng, shape) for each in model.modes])
    logw = np.full(shape, -np.log(count))
    return ModeParticles(model, particles.weighted(x, logw, particles.all_of(*shape)), modes, logw)


def step(belief: ModeParticles, y: Array, k: int, rng: Generators, scheme: Scheme, threshold: float) -> ModeParticles:
    """Resample below the threshold, draw modes and then states from their dynamics, weight by the likelihood of y[m, R].

    The estimate is read before resampling, so resampling opens the next step.
    """
    model = belief.model
    start = particles.resample(belief.particles, scheme, threshold, rng)
    modes = np.take_along_axis(belief.modes, start.parents, axis=1) if len(start.runs) else belief.modes
    modes = jump.evolved(model, modes, rng)

    def move(x: Array, mode: Modes) -> tuple[Array, Array]:
        ahead = _each_by_its_own(model, [m.dynamics for m in model.modes], mode, lambda law: law.sample(rng, x, k))
        return ahead, _each_by_its_own(model, [m.sensor for m in model.modes], mode, lambda law: law.logpdf(y, ahead, k))

    x, fit = particles.blockwise(move, start.x, modes)
    return ModeParticles(model, particles.weighted(x, start.logw + fit, start.parents), modes, start.logw)


def restricted(model: JumpModel, allowed: Sequence[int]) -> JumpModel:
    """The model whose modes from k = 1 on are among those allowed: its transitions into the others are struck out.

    The rows left are renormalised; from a mode that leads to none of those allowed, each of them follows equally likely.
    """
    kept = np.isin(np.arange(len(model.modes)), allowed).astype(float)
    rows = model.transition * kept
    rows = np.where(rows.any(1, keepdims=True), rows, kept)
    return replace(model, transition=rows / rows.sum(1, keepdims=True))


def either(first: NDArray[np.bool_], a: ModeParticles, b: ModeParticles) -> ModeParticles:
    """The particles of `a` in those runs that `first`[R] names, of `b` in the others; they follow the model of `b`."""
    wide, one, other = first[:, None], a.particles, b.particles
    both = Particles(
        np.where(wide, one.x, other.x),
        np.where(wide, one.logw, other.logw),
        np.where(wide, one.weights, other.weights),
        np.where(first, one.loglik, other.loglik),
        np.where(first, one.ancestors, other.ancestors),
    )
    return ModeParticles(b.model, both, np.where(wide, a.modes, b.modes), np.where(wide, a.before, b.before))


def _each_by_its_own(model: JumpModel, laws: Sequence[Law], modes: Modes, value: Callable[[Law], Array]) -> Array:
    """value(law)[..., R, N] at each particle by the law of its mode.

    Every law is evaluated for all particles, so that what is drawn depends on the model alone; but only once if modes share
    it, and not at all if no transition leads to its modes.
    """
    reachable = np.flatnonzero(model.transition.sum(0)).tolist()
    out: Array | None = None
    for law in {id(laws[j]): laws[j] for j in reachable}.values():
        found = value(law)
        out = found if out is None else np.where(np.array([each is law for each in laws])[modes], found, out)
    assert out is not None
    return out


def _log_sums(logw: Array, modes: Modes, count: int) -> Array:
    """Log of the sum of exp(logw)[R, N] over the particles in each mode [count, R]."""
    sums = np.empty((count, len(logw)))
    for mode, into in enumerate(sums):
        inside = np.where(modes == mode, logw, -np.inf)
        top = inside.max(-1)
        top = np.where(top == -np.inf, 0.0, top)
        with np.errstate(divide="ignore"):  # nobody is in this mode
            into[:] = top + np.log(np.exp(inside - top[:, None]).sum(-1))
    return sums
