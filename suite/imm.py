"""The interacting multiple model algorithm: a Gaussian filter a mode, which exchange what they know before each step.

Of the M^k Gaussians of the exact posterior it keeps M, merging those that the next mode has in common (Blom and Bar-Shalom,
1988). With one prior for all modes the first step is exact.
"""

from dataclasses import dataclass, replace

import numpy as np

from suite import gaussian, modes
from suite.estimator import Readout
from suite.jump import JumpModel
from suite.jump_filter import filtered, priors
from suite.linalg import Array
from suite.moment_rules import Rule


@dataclass(frozen=True)
class Interacting:
    """What is known of x_k given that mode j is in force: mean[M, R, n] and a factor root[M, R, n, n] of its covariance.

    logp[M, R], log-probabilities of the modes given y_1..y_k; ahead[M, R], those given y_1..y_{k-1}; fits[M, R], each mode's
    log-likelihood of y_k; loglik[R], that of them all; nominal, the mode without a manoeuvre.
    """

    mean: Array
    root: Array
    logp: Array
    ahead: Array
    fits: Array
    loglik: Array
    nominal: int

    def read(self) -> Readout:
        """Moments of the mixture of the modes, their probabilities, and the log-odds of a manoeuvre; no innovation."""
        mode = np.exp(self.logp)
        output = gaussian.mixture(mode.T, self.mean, self.root).read()
        return replace(output, loglik=self.loglik, mode=mode, statistic=modes.log_odds(self.logp, self.nominal))


def init(model: JumpModel, runs: int) -> Interacting:
    """The priors of the modes."""
    logp = modes.initial(model, runs)
    return Interacting(*priors(model, runs), logp, logp, np.zeros_like(logp), np.zeros(runs), model.nominal)


def step(rule: Rule, model: JumpModel, belief: Interacting, y: Array, k: int) -> Interacting:
    """Belief about x_k and r_k given that about x_{k-1} and r_{k-1}, and y_k = y[m, R], where NaN means not observed."""
    ahead, mixing = modes.predicted(model, belief.logp)
    mean, root, fits = filtered(rule, model, *mixed(belief, mixing), y, k)
    logp, loglik = modes.posterior(ahead, fits)
    return Interacting(mean, root, logp, ahead, fits, loglik, belief.nominal)


def mixed(belief: Interacting, mixing: Array) -> tuple[Array, Array]:
    """What the filters of the modes start from, means and factors as in `belief`: modes i mixed by mixing[i, j, R]."""
    count, runs, n = belief.mean.shape
    means = np.concat([belief.mean] * count, axis=1)
    roots = np.concat([belief.root] * count, axis=1)
    start = gaussian.merged(mixing.reshape(count, -1).T, means, roots)
    return start.mean.reshape(count, runs, n), start.root.reshape(count, runs, n, n)
