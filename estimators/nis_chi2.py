"""The chi-square test of the normalised innovation squared over a sliding window, on an extended Kalman filter."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from suite import gaussian, innovation_tests, moment_rules
from suite.estimator import Filter, Readout
from suite.gaussian import GaussianBelief
from suite.linalg import Array
from suite.model import StateSpaceModel
from suite.parameters import parameter
from suite.random import Generators


@dataclass(frozen=True)
class Windowed:
    """A filter's belief, and of the steps in the window [R, W] the normalised innovation squared and the components seen."""

    filter: GaussianBelief
    nis: Array
    seen: Array


@dataclass(frozen=True)
class InnovationSquared(Filter):
    """Detector by the sum of the normalised innovations squared of the last steps.

    Its statistic is minus the log-probability that a chi-square variable exceeds the sum, with as many degrees of freedom as
    components were observed in the window: so one threshold means the same whatever was missing, and while the window fills.
    """

    name: ClassVar[str] = "nis-chi2"
    reference: ClassVar[str] = (
        "Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, Wiley, 2001, "
        "section 11.2"
    )
    window: int = parameter(5, "number of steps summed over", low=1, high=1000)

    def accepts(self, model: StateSpaceModel) -> str | None:
        return gaussian.differentiable(model)

    def init(self, model: StateSpaceModel, rng: Generators) -> Windowed:
        nothing = np.zeros((rng.runs, self.window))
        return Windowed(gaussian.prior(model, rng.runs), nothing, nothing)

    def step(self, model: StateSpaceModel, belief: Windowed, y: Array, k: int, rng: Generators) -> Windowed:
        predicted = gaussian.predict(moment_rules.taylor, belief.filter, model.dynamics, k)
        updated = gaussian.update(moment_rules.taylor, predicted, model.sensor, y, k)
        white = innovation_tests.whitened(updated)
        nis = np.concat([belief.nis[:, 1:], np.vecdot(white, white)[:, None]], axis=1)
        seen = np.concat([belief.seen[:, 1:], (~np.isnan(y)).sum(0)[:, None]], axis=1)
        return Windowed(updated, nis, seen)

    def read(self, belief: Windowed) -> Readout:
        statistic = -innovation_tests.log_survival(belief.nis.sum(1), belief.seen.sum(1))
        return replace(belief.filter.read(), statistic=statistic)


ESTIMATORS = (InnovationSquared(),)
