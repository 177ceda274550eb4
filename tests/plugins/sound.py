"""An estimator that keeps every rule and fills every part of an estimate but modes, and a hook for others to break one."""

import time
from dataclasses import dataclass

import numpy as np

from suite.estimator import Estimate
from suite.parameters import parameter
from suite.random import Streams


@dataclass(frozen=True)
class Sound:
    """Noise around the prior mean, pulled a little by each measurement."""

    particles: int = parameter(20, "what the made-up sample sizes refer to", low=1)
    name = "sound"
    reference = "none: made for the tests"

    def accepts(self, model):
        return None

    def run(self, model, y, seed=0):
        begin = time.perf_counter()
        steps, _, runs = y.shape
        seen = np.isfinite(y)
        pull = np.tanh(np.where(seen, y, 0.0)).sum(1)
        noise = Streams.of(seed).batch(0, runs).standard_normal((steps, runs))
        one = np.ones((steps, runs))
        estimate = Estimate(
            mean=model.prior.mean[:, None] + (pull + noise)[:, None, :],
            cov=np.eye(model.n)[None, :, :, None] * one[:, None, None, :],
            loglik=-1.0 * seen.sum(1),
            ess=one + (self.particles - 1) / 2,
            ancestors=one * self.particles,
            acceptance=one / 2,
            innovation=np.where(seen, np.tanh(y), np.nan),
            statistic=pull,
        )
        self.spoil(estimate, model, y, seed)
        estimate.seconds = one * (time.perf_counter() - begin) / (steps * runs)
        self.spoil_time(estimate)
        return estimate

    def spoil(self, estimate, model, y, seed):
        """Nothing here."""

    def spoil_time(self, estimate):
        """Nor here."""


ESTIMATORS = (Sound(),)
