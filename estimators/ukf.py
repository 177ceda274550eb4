"""The unscented Kalman filter, batched over runs."""

from dataclasses import dataclass
from typing import ClassVar

from suite import moment_rules
from suite.gaussian_filter import GaussianFilter
from suite.moment_rules import Rule
from suite.parameters import parameter


@dataclass(frozen=True)
class Unscented(GaussianFilter):
    """Unscented Kalman filter in square-root form; the sigma points are drawn anew after the prediction."""

    name: ClassVar[str] = "ukf"
    reference: ClassVar[str] = (
        "S. J. Julier, J. K. Uhlmann, Unscented filtering and nonlinear estimation, Proceedings of the IEEE 92(3), "
        "2004, 401-422"
    )
    alpha: float = parameter(1.0, "spread of the sigma points", low=1e-6, high=1)
    beta: float = parameter(2.0, "extra weight of the central point in covariances; 2 suits a Gaussian", low=0)
    kappa: float = parameter(0.0, "second spread parameter", low=0)

    @property
    def rule(self) -> Rule:
        return moment_rules.unscented(self.alpha, self.beta, self.kappa)


ESTIMATORS = (Unscented(),)
