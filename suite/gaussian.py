"""The Gaussian filter: prediction and update by moments, whatever rule computes them (suite/moment_rules.py).

It is written in square-root form: a belief carries a factor of its covariance, and a rule gives deviations whose products are
covariances. One orthogonal triangularisation of the deviations of state and measurement side by side gives the factor of the
innovation, the gain and the factor of the posterior at once (Kailath, Sayed and Hassibi, 2000, section 12.3). No covariance
is ever subtracted from another, so it stays positive semidefinite whatever the rounding, its condition number counts by its
root only, and singular priors and noises are no special case. Joseph's form would keep the sign but not the digits, and
would still ask for a Cholesky factor wherever sigma points are drawn. Stacks are one matrix a run, [R, n, n].
"""

from dataclasses import dataclass, replace

import numpy as np

from suite.errors import one_line
from suite.estimator import Readout
from suite.linalg import Array, factor, lower_triangular, solve_lower
from suite.model import AdditiveSensor, AdditiveTransition, Sensor, StateSpaceModel, Transition, outage_patterns
from suite.moment_rules import Rule, Spread
from suite.noise import Gaussian, Noise
from suite.nonadditive import Augmented, NonadditiveSensor, NonadditiveTransition

HALF_LOG_2PI = 0.5 * np.log(2 * np.pi)
NONADDITIVE = (NonadditiveTransition, NonadditiveSensor)


@dataclass(frozen=True)
class GaussianBelief:
    """Mean [R, n] of the state and a factor [R, n, n] of its covariance: cov = root rootᵀ.

    loglik[R] and innovation[m, R], whitened, are those of this step's measurement.
    """

    mean: Array
    root: Array
    loglik: Array | None = None
    innovation: Array | None = None

    @property
    def cov(self) -> Array:
        """Covariance of the state [R, n, n]."""
        return np.asarray(self.root @ np.swapaxes(self.root, 1, 2))

    def read(self) -> Readout:
        """The belief as a readout, components first."""
        return Readout(self.mean.T, self.cov.transpose(1, 2, 0), self.loglik, innovation=self.innovation)


def prior(model: StateSpaceModel, runs: int) -> GaussianBelief:
    """The model's prior, once a run."""
    return GaussianBelief(np.tile(model.prior.mean, (runs, 1)), np.tile(model.prior.lower, (runs, 1, 1)))


def additive(model: StateSpaceModel) -> str | None:
    """None when both noises of the model are additive, otherwise why a filter that needs this does not take it."""
    for part, law, kind in (("process", model.dynamics, AdditiveTransition), ("measurement", model.sensor, AdditiveSensor)):
        if not isinstance(law, kind):
            return f"its {part} noise is not additive"
    return None


def accepts(model: StateSpaceModel) -> str | None:
    """None when state and measurement are functions of a state and a noise, otherwise why no Gaussian filter takes them."""
    if not isinstance(model.dynamics, AdditiveTransition | NonadditiveTransition):
        return "its transition is not a function of the state and a noise"
    if not isinstance(model.sensor, AdditiveSensor | NonadditiveSensor):
        return "its measurement is not a function of the state and a noise"
    return None


def differentiable(model: StateSpaceModel) -> str | None:
    """None when a Gaussian filter can linearise both functions of the model, otherwise why not."""
    if refusal := accepts(model):
        return refusal
    for part, law in (("transition", model.dynamics), ("sensor", model.sensor)):
        try:
            with np.errstate(all="ignore"):
                if isinstance(law, AdditiveTransition | AdditiveSensor):
                    law.linearised(model.prior.mean[:, None], 1)
                elif isinstance(law, NONADDITIVE):
                    at = np.concat([model.prior.mean, law.noise_at(1).mean])
                    Augmented(law, model.n).linearised(at[:, None], 1)
        except Exception as error:
            return f"its {part} cannot be differentiated: {one_line(error)}"
    return None


def arguments(model: StateSpaceModel) -> int:
    """The most numbers that a rule is given at once: the state's, with those of a noise inside one of the functions."""
    inside = [len(law.noise_at(1).mean) for law in (model.dynamics, model.sensor) if isinstance(law, NONADDITIVE)]
    return model.n + max(inside, default=0)


def predict(rule: Rule, belief: GaussianBelief, dynamics: Transition, k: int) -> GaussianBelief:
    """Belief about x_k from the belief about x_{k-1}. Raises TypeError when the dynamics are no function of a noise."""
    wide = moved(rule, belief, dynamics, k)
    return GaussianBelief(wide.mean, lower_triangular(wide.root))


def moved(rule: Rule, belief: GaussianBelief, dynamics: Transition, k: int) -> GaussianBelief:
    """The same with a factor [R, n, s] that is not triangular yet: those of several models can then be made so together."""
    if isinstance(dynamics, AdditiveTransition):
        noise = _root(dynamics.noise_at(k))
        spread = rule(belief.mean, belief.root, dynamics, k)
        columns = _beside(spread.dy, noise if dynamics.gain is None else dynamics.gain @ noise)
        mean = spread.value + dynamics.noise_mean(k)
    elif isinstance(dynamics, NonadditiveTransition):
        spread = _augmented(rule, belief, dynamics, k)
        columns, mean = spread.dy, spread.value
    else:
        raise TypeError(f"a Gaussian filter cannot predict through {type(dynamics).__name__}")
    return GaussianBelief(mean, columns)


def update(rule: Rule, belief: GaussianBelief, sensor: Sensor, y: Array, k: int) -> GaussianBelief:
    """Belief about x_k after the measurement y[m, R]; missing components (NaN) drop out, run by run.

    A missing row gets an innovation of zero, no correlation with the state, and a unit variance of its own: it then
    factors out of the gain exactly, and all runs keep one shape.
    """
    seen = ~np.isnan(y)
    whole = seen.all()
    if isinstance(sensor, AdditiveSensor):
        spread = rule(belief.mean, belief.root, sensor, k)
        law = sensor.noise_at(k)
        error = sensor.residual(y, (spread.value + law.mean).T).T
        noise = _root(law) if whole else _noise_root(law, y)
    elif isinstance(sensor, NonadditiveSensor):
        spread = _augmented(rule, belief, sensor, k)
        error = sensor.residual(y, spread.value.T).T
        noise = np.where(seen.T[:, :, None], 0.0, np.eye(len(y)))
    else:
        raise TypeError(f"a Gaussian filter cannot update by {type(sensor).__name__}")
    if spread.aside is not None:
        error = error - spread.aside
    if not whole:
        error = np.where(seen.T, error, 0.0)
        spread = replace(spread, dy=np.where(seen.T[:, :, None], spread.dy, 0.0))
    return conditioned(belief, spread, noise, error, seen)


def conditioned(belief: GaussianBelief, spread: Spread, noise: Array, error: Array, seen: Array) -> GaussianBelief:
    """The belief given an innovation error[R, m] whose deviations, with the noise's factor, are in `spread`.

    With S the innovation's covariance, C that of state and measurement and P that of the state, the triangular factor of
    [[S, Cᵀ], [C, P]] is [[L, 0], [C L⁻ᵀ, root of P - C S⁻¹ Cᵀ]].
    """
    m, n = error.shape[1], belief.mean.shape[1]
    size = spread.dy.shape[2]
    columns = np.zeros((len(error), m + n, size + noise.shape[-1]))
    columns[:, :m, :size] = spread.dy
    columns[:, m:, :size] = spread.dx[:, :n]
    columns[:, :m, size:] = noise
    joint = lower_triangular(columns)
    lower, gain, root = joint[:, :m, :m], joint[:, m:, :m], joint[:, m:, m:]
    white = solve_lower(lower, error)  # not finite where S is singular: that run is lost, and it alone
    mean = belief.mean + (gain @ white[..., None])[..., 0]
    scale = np.diagonal(lower, axis1=1, axis2=2)
    loglik = -0.5 * np.vecdot(white, white) - np.log(np.abs(scale)).sum(-1) - HALF_LOG_2PI * seen.sum(0)
    return GaussianBelief(mean, root, loglik, np.where(seen, (white * np.sign(scale)).T, np.nan))


def merged(weights: Array, means: Array, roots: Array) -> GaussianBelief:
    """The Gaussian with the moments of a mixture: weights[R, M], means[M, R, n], factors of covariances [M, R, n, n]."""
    wide = mixture(weights, means, roots)
    return GaussianBelief(wide.mean, lower_triangular(wide.root))


def mixture(weights: Array, means: Array, roots: Array) -> GaussianBelief:
    """The same with a factor [R, n, M (n + 1)] that is not triangular: enough to read the moments from.

    A component of weight zero does not count, whatever it is.
    """
    share = weights.T[..., None]
    means, roots = np.where(share > 0, means, 0.0), np.where(share[..., None] > 0, roots, 0.0)
    mean = np.asarray(sum(share * means))  # one after the other: NumPy's order of addition depends on the shape
    columns = np.sqrt(share)[..., None] * np.concat([roots, (means - mean)[..., None]], axis=3)
    return GaussianBelief(mean, np.concat(list(columns), axis=2))


def _augmented(rule: Rule, belief: GaussianBelief, law: NonadditiveTransition | NonadditiveSensor, k: int) -> Spread:
    """Deviations of the state and of a function of state and noise, from a rule on both stacked."""
    noise = law.noise_at(k)
    (runs, n), q = belief.mean.shape, len(noise.mean)
    root = np.zeros((runs, n + q, n + q))
    root[:, :n, :n] = belief.root
    root[:, n:, n:] = _root(noise)
    mean = np.concat([belief.mean, np.broadcast_to(noise.mean, (runs, q))], axis=1)
    return rule(mean, root, Augmented(law, n), k)


def _beside(columns: Array, constant: Array) -> Array:
    """Columns [R, n, s] with those of a constant matrix [n, q] beside them."""
    runs, n, size = columns.shape
    whole = np.empty((runs, n, size + constant.shape[1]))
    whole[:, :, :size], whole[:, :, size:] = columns, constant
    return whole


def _root(noise: Noise) -> Array:
    """A factor of a noise's covariance."""
    return noise.lower if isinstance(noise, Gaussian) else factor(noise.cov)


def _noise_root(noise: Noise, y: Array) -> Array:
    """Factors [R, m, m] of the covariance of the components of a noise that were observed in y[m, R]; 1 for the others."""
    roots = np.zeros((y.shape[1], len(y), len(y)))
    for rows, runs in outage_patterns(y):
        whole = np.eye(len(y))
        if rows:
            whole[np.ix_(rows, rows)] = _root(noise.marginal(rows))
        roots[runs] = whole
    return roots
