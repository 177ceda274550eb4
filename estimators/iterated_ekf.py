"""The iterated extended Kalman filter: the update is repeated with the sensor linearised at what it gave."""

from dataclasses import dataclass
from typing import ClassVar

from suite import gaussian, moment_rules
from suite.gaussian import GaussianBelief
from suite.gaussian_filter import GaussianFilter
from suite.linalg import Array
from suite.model import StateSpaceModel
from suite.moment_rules import Rule
from suite.parameters import parameter
from suite.random import Generators


@dataclass(frozen=True)
class IteratedExtended(GaussianFilter):
    """Iterated extended Kalman filter: Gauss-Newton steps from the predicted mean towards the most probable state."""

    name: ClassVar[str] = "iterated-ekf"
    reference: ClassVar[str] = (
        "B. M. Bell, F. W. Cathey, The iterated Kalman filter update as a Gauss-Newton method, IEEE Transactions on "
        "Automatic Control 38(2), 1993, 294-297"
    )
    iterations: int = parameter(5, "linearisations of the sensor a step; 1 is the extended Kalman filter", low=1, high=1000)

    @property
    def rule(self) -> Rule:
        return moment_rules.taylor

    def accepts(self, model: StateSpaceModel) -> str | None:
        return gaussian.differentiable(model)

    def step(self, model: StateSpaceModel, belief: GaussianBelief, y: Array, k: int, rng: Generators) -> GaussianBelief:
        predicted = gaussian.predict(self.rule, belief, model.dynamics, k)
        updated = predicted
        for _ in range(self.iterations):
            updated = gaussian.update(moment_rules.about(updated.mean), predicted, model.sensor, y, k)
        return updated


ESTIMATORS = (IteratedExtended(),)
