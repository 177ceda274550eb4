"""The Gauss-Hermite Kalman filter, batched over runs."""

from dataclasses import dataclass
from typing import ClassVar

from suite import gaussian, moment_rules, particles
from suite.gaussian_filter import GaussianFilter
from suite.model import StateSpaceModel
from suite.moment_rules import Rule
from suite.parameters import parameter

LIMIT = 100_000


@dataclass(frozen=True)
class GaussHermite(GaussianFilter):
    """Gauss-Hermite Kalman filter: moments by the product rule that is exact up to the degree 2 order - 1 of each component."""

    name: ClassVar[str] = "ghkf"
    reference: ClassVar[str] = (
        "K. Ito, K. Xiong, Gaussian filters for nonlinear filtering problems, IEEE Transactions on Automatic Control 45(5), "
        "2000, 910-927"
    )
    order: int = parameter(3, "points a component; their number is this to the power of the state's dimension", low=2, high=100)

    @property
    def rule(self) -> Rule:
        return moment_rules.gauss_hermite(self.order)

    def accepts(self, model: StateSpaceModel) -> str | None:
        if reason := super().accepts(model):
            return reason
        if self.points(model) > LIMIT:
            return f"its rule needs {self.points(model)} points, more than {LIMIT}; set a lower order"
        return None

    def runs_at_once(self, model: StateSpaceModel) -> int:
        return particles.runs_at_once(self.points(model))

    def points(self, model: StateSpaceModel) -> int:
        """How many points the rule has for the model's state, and the noises inside its functions."""
        return int(self.order ** gaussian.arguments(model))


ESTIMATORS = (GaussHermite(),)
