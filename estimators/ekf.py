"""The extended Kalman filter, batched over runs."""

from dataclasses import dataclass
from typing import ClassVar

from suite import gaussian, moment_rules
from suite.gaussian_filter import GaussianFilter
from suite.model import StateSpaceModel
from suite.moment_rules import Rule


@dataclass(frozen=True)
class Extended(GaussianFilter):
    """Extended Kalman filter of first order: dynamics and sensor are linearised at the latest mean."""

    name: ClassVar[str] = "ekf"
    reference: ClassVar[str] = "A. H. Jazwinski, Stochastic Processes and Filtering Theory, Academic Press, 1970, section 8.3"

    @property
    def rule(self) -> Rule:
        return moment_rules.taylor

    def accepts(self, model: StateSpaceModel) -> str | None:
        return gaussian.differentiable(model)


ESTIMATORS = (Extended(),)
