"""The unscented Kalman filter, batched over runs."""

from dataclasses import dataclass
from typing import ClassVar

from suite import gaussian
from suite.estimator import Filter, Readout
from suite.gaussian import GaussianBelief
from suite.linalg import Array
from suite.model import StateSpaceModel
from suite.parameters import parameter
from suite.random import Generators


@dataclass(frozen=True)
class Unscented(Filter):
    """Unscented Kalman filter for additive noise; the sigma points are drawn anew after the prediction."""

    name: ClassVar[str] = "ukf"
    reference: ClassVar[str] = (
        "S. J. Julier, J. K. Uhlmann, Unscented filtering and nonlinear estimation, Proceedings of the IEEE 92(3), "
        "2004, 401-422"
    )
    alpha: float = parameter(1.0, "spread of the sigma points", low=1e-6, high=1)
    beta: float = parameter(2.0, "extra weight of the central point in covariances; 2 suits a Gaussian", low=0)
    kappa: float = parameter(0.0, "second spread parameter", low=0)

    def accepts(self, model: StateSpaceModel) -> str | None:
        return gaussian.additive(model)

    def init(self, model: StateSpaceModel, rng: Generators) -> GaussianBelief:
        return gaussian.prior(model, rng.runs)

    def step(self, model: StateSpaceModel, belief: GaussianBelief, y: Array, k: int, rng: Generators) -> GaussianBelief:
        rule = gaussian.unscented(model.n, self.alpha, self.beta, self.kappa)
        predicted = gaussian.predict(rule, belief, model.dynamics, k)
        return gaussian.update(rule, predicted, model.sensor, y, k)

    def read(self, belief: GaussianBelief) -> Readout:
        return belief.read()


ESTIMATORS = (Unscented(),)
