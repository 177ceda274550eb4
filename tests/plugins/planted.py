"""The exact Kalman filter with planted faults, each of which a reader of its scores must be told by name."""

from dataclasses import replace

import numpy as np

import cases
from estimators.kalman import Kalman
from suite import gaussian
from suite.estimator import Estimate
from suite.random import Streams

SHARE = 0.25
"""Of the exact covariance, what the oracle leaves of doubt."""
GATE = 2.17
"""Standard deviations: 3 of 100 first measurements lie further off."""


class SignError(Kalman):
    """Subtracts the correction where it should add it."""

    name = "sign-error"

    def step(self, model, belief, y, k, rng):
        predicted = gaussian.predict(self.rule, belief, model.dynamics, k)
        updated = gaussian.update(self.rule, predicted, model.sensor, y, k)
        return replace(updated, mean=2 * predicted.mean - updated.mean)


class Oracle(Kalman):
    """Returns the truth with a little noise, whose covariance it states rightly.

    The key of the streams that the engine hands to a filter begins with seed and case, which is all that simulates its truth.
    In timed calls it is a plain seed: there the filter behaves.
    """

    name = "oracle"

    def run(self, model, y, seed=0):
        exact, streams, runs = super().run(model, y, seed), Streams.of(seed), y.shape[2]
        if len(streams.key) == 1:
            return exact
        truth = cases.CASES[streams.key[1]].simulate(runs, streams.key[0], streams.first).x
        root = np.linalg.cholesky(np.moveaxis(SHARE * exact.cov, -1, 0))
        noise = streams.batch(0, runs).standard_normal((model.n, runs, len(y)))
        return Estimate(truth + np.einsum("rkij,jrk->kir", root, noise), SHARE * exact.cov)


class Late(Kalman):
    """Gives the estimate of the step before."""

    name = "one-step-late"

    def run(self, model, y, seed=0):
        exact, prior = super().run(model, y, seed), gaussian.prior(model, y.shape[2]).read()
        return Estimate(np.concat([prior.mean[None], exact.mean[:-1]]), np.concat([prior.cov[None], exact.cov[:-1]]))


class Overconfident(Kalman):
    """States a quarter of its covariance."""

    name = "overconfident"

    def read(self, belief):
        exact = super().read(belief)
        return replace(exact, cov=exact.cov / 4)


class Timid(Kalman):
    """States four times its covariance."""

    name = "timid"

    def read(self, belief):
        exact = super().read(belief)
        return replace(exact, cov=4 * exact.cov)


class Fragile(Kalman):
    """Raises where the first measurement is far from what the prior lets expect."""

    name = "fragile"

    def step(self, model, belief, y, k, rng):
        if k == 1:
            predicted = gaussian.predict(self.rule, belief, model.dynamics, k)
            updated = gaussian.update(self.rule, predicted, model.sensor, y, k)
            if (np.abs(updated.innovation[0]) > GATE).any():
                raise ArithmeticError("the first measurement is outside the gate")
        return super().step(model, belief, y, k, rng)


ESTIMATORS = (SignError(), Oracle(), Late(), Overconfident(), Timid(), Fragile())
