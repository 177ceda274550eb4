"""The generalised likelihood ratio test for the onset of a constant input, on an extended Kalman filter."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from suite import gaussian, innovation_tests, moment_rules
from suite.estimator import Filter, Readout
from suite.gaussian import GaussianBelief
from suite.linalg import Array, cholesky, factor, solve_lower
from suite.model import AdditiveSensor, StateSpaceModel
from suite.parameters import parameter
from suite.random import Generators


@dataclass(frozen=True)
class Signatures:
    """A filter's belief, and what an input u since each step in the window does to it and to the innovations.

    u has n components, one for each column of a factor of the noise's covariance; those of zero columns do nothing. error:
    Φ[R, n, W n], what is added to the state's error per unit of u, the oldest onset first. moments[R, W, n + 1, n + 1]: sums
    of products of the whitened signatures Ψ and innovations ν since the onset, [[ΣΨᵀΨ, ΣΨᵀν], [ΣνᵀΨ, Σνᵀν]].
    """

    filter: GaussianBelief
    error: Array
    moments: Array


@dataclass(frozen=True)
class LikelihoodRatio(Filter):
    """Detector by the likelihood ratio of a constant input from some step of the window on to none.

    A manoeuvre is an input u that enters as the process noise does, x_k = f(x_{k-1}) + G (w_k + u), in any direction that the
    noise has; size, direction and onset of it are unknown and maximised over. Where the noise varies in time, u is constant
    in units of its deviations. The statistic is the logarithm of the ratio for the likeliest onset.
    """

    name: ClassVar[str] = "glr"
    reference: ClassVar[str] = (
        "A. S. Willsky, H. L. Jones, A generalized likelihood ratio approach to the detection and estimation of jumps in "
        "linear systems, IEEE Transactions on Automatic Control 21(1), 1976, 108-112; for an input instead of a jump: "
        "Y. T. Chan, A. G. C. Hu, J. B. Plant, A Kalman filter based tracking scheme with input estimation, "
        "IEEE Transactions on Aerospace and Electronic Systems 15(2), 1979, 237-244"
    )
    window: int = parameter(10, "number of the last steps that may be the onset", low=1, high=1000)

    def accepts(self, model: StateSpaceModel) -> str | None:
        if refusal := gaussian.additive(model) or gaussian.differentiable(model):
            return refusal
        silent = not model.dynamics.noise_cov(1).any()
        return "it has no process noise, as which a manoeuvre could enter" if silent else None

    def init(self, model: StateSpaceModel, rng: Generators) -> Signatures:
        runs, n = rng.runs, model.n
        none = np.zeros((runs, n, self.window * n))
        return Signatures(gaussian.prior(model, runs), none, np.zeros((runs, self.window, n + 1, n + 1)))

    def step(self, model: StateSpaceModel, belief: Signatures, y: Array, k: int, rng: Generators) -> Signatures:
        predicted = gaussian.predict(moment_rules.taylor, belief.filter, model.dynamics, k)
        updated = gaussian.update(moment_rules.taylor, predicted, model.sensor, y, k)
        # The oldest onset gives way to a new one. Those before the first step are the first step's over again.
        error, moments = shifted(belief.error, 2, model.n), shifted(belief.moments, 1, 1)
        error = moment_rules.taylor(belief.filter.mean, error, model.dynamics, k).dy
        error = error + np.tile(factor(model.dynamics.noise_cov(k)), self.window)
        signature, error = observed(predicted, error, model.sensor, y, k)
        nu = innovation_tests.whitened(updated)
        regressors = np.moveaxis(signature.reshape(*nu.shape, self.window, model.n), 1, 2)
        joint = np.concat([regressors, np.broadcast_to(nu[:, None, :, None], (*regressors.shape[:3], 1))], axis=3)
        return Signatures(updated, error, moments + np.swapaxes(joint, 2, 3) @ joint)

    def read(self, belief: Signatures) -> Readout:
        return replace(belief.filter.read(), statistic=innovation_tests.explained(belief.moments).max(1) / 2)


def shifted(window: Array, axis: int, count: int) -> Array:
    """The same array without its first `count` entries along an axis, and as many zeros behind the last."""
    gone, kept = np.split(window, [count], axis)
    return np.concat([kept, np.zeros_like(gone)], axis)


def observed(predicted: GaussianBelief, error: Array, sensor: AdditiveSensor, y: Array, k: int) -> tuple[Array, Array]:
    """Whitened signatures Ψ = L⁻¹ H M [R, m, s] of errors M[R, n, s] of a prediction, and M - K H M, what an update leaves."""
    n, seen = error.shape[1], ~np.isnan(y.T)
    columns = np.concat([predicted.root, error], axis=2)
    images = np.where(seen[:, :, None], moment_rules.taylor(predicted.mean, columns, sensor, k).dy, 0.0)
    own = images[:, :, :n]
    noise = np.where(seen[:, :, None] & seen[:, None, :], sensor.noise_at(k).cov, np.eye(len(y)))
    white = solve_lower(cholesky(own @ np.swapaxes(own, 1, 2) + noise), images)
    own, signature = white[:, :, :n], white[:, :, n:]
    return signature, error - predicted.root @ (np.swapaxes(own, 1, 2) @ signature)


ESTIMATORS = (LikelihoodRatio(),)
