"""Probabilities of the modes of a jump-Markov model, in the log domain: arrays logp[M, ...], one row a mode.

In the linear domain the likelihoods of a measurement far from every prediction underflow together, and with them what was
known of the modes.
"""

import numpy as np

from suite.jump import JumpModel
from suite.linalg import Array

LARGEST = 1e300


def initial(model: JumpModel, runs: int) -> Array:
    """Log-probabilities of r_0 [M, R]."""
    with np.errstate(divide="ignore"):
        return np.repeat(np.log(model.initial)[:, None], runs, axis=1)


def predicted(model: JumpModel, logp: Array) -> tuple[Array, Array]:
    """Log-probabilities of r_k given those of r_{k-1}, and the mixing weights P(r_{k-1} = i | r_k = j) [M, M, R] at [i, j].

    Into a mode that cannot be reached, modes mix as they are (Blom and Bar-Shalom, 1988, eqs 11-12).
    """
    mixing, ahead = _normalised(model.log_transition[:, :, None] + logp[:, None])
    return ahead, np.where(ahead > -np.inf, np.exp(mixing), np.exp(logp)[:, None])


def posterior(logp: Array, loglik: Array) -> tuple[Array, Array]:
    """Log-probabilities of the modes given a measurement with log-likelihoods [M, ...], and the measurement's own [...].

    A likelihood of NaN counts as zero; where all are zero there are no probabilities, which are NaN.
    """
    return _normalised(np.fmax(logp + loglik, -np.inf))


def log_odds(logp: Array, nominal: int) -> Array:
    """Log of the odds of all modes but the nominal one [R]: what detects a manoeuvre by its probability, without saturating."""
    with np.errstate(invalid="ignore"):  # of a lost run
        others = np.logaddexp.reduce(logp[np.arange(len(logp)) != nominal], axis=0)
        return np.asarray(np.clip(others - logp[nominal], -LARGEST, LARGEST))


def _normalised(joint: Array) -> tuple[Array, Array]:
    """Logarithms [M, ...] less that of the sum of their exponentials, and the latter [...].

    The largest is taken off first: among logarithms of -1e17 a difference of 1 is lost in the sum, but not among themselves.
    """
    top = joint.max(0)
    with np.errstate(invalid="ignore"):
        rest = joint - top
        total = np.logaddexp.reduce(rest, axis=0)
        return rest - total, np.where(top == -np.inf, top, top + total)
