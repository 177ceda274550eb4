"""An estimator that knows its prior only."""

from dataclasses import dataclass

import numpy as np

from suite.estimator import Estimate
from suite.parameters import parameter


@dataclass(frozen=True)
class Packaged:
    """The prior's moments, at every step."""

    fails: bool = parameter(False, "whether to fail")
    name = "packaged"
    reference = "none"

    def accepts(self, model):
        return None

    def run(self, model, y, seed=0):
        if self.fails:
            raise RuntimeError("told to fail")
        steps, runs = len(y), y.shape[2]
        mean = np.broadcast_to(model.prior.mean[None, :, None], (steps, model.n, runs))
        cov = np.broadcast_to(model.prior.cov[None, :, :, None], (steps, model.n, model.n, runs))
        return Estimate(mean.copy(), cov.copy())


ESTIMATORS = (Packaged(),)
