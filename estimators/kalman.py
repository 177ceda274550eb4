"""The Kalman filter, exact on linear-Gaussian models."""

from dataclasses import dataclass
from typing import ClassVar

from suite import moment_rules
from suite.gaussian import GaussianBelief
from suite.gaussian_filter import GaussianFilter
from suite.linalg import Array
from suite.model import StateSpaceModel, is_linear_gaussian
from suite.moment_rules import Rule
from suite.noise import Gaussian
from suite.random import Generators


@dataclass(frozen=True)
class Kalman(GaussianFilter):
    """Kalman filter: the exact posterior of a linear model with Gaussian noises."""

    name: ClassVar[str] = "kalman"
    reference: ClassVar[str] = (
        "R. E. Kalman, A new approach to linear filtering and prediction problems, Journal of Basic Engineering 82(1), "
        "1960, 35-45"
    )

    @property
    def rule(self) -> Rule:
        return moment_rules.affine

    def accepts(self, model: StateSpaceModel) -> str | None:
        return None if is_linear_gaussian(model) else "the model is not linear with Gaussian noises"

    def step(self, model: StateSpaceModel, belief: GaussianBelief, y: Array, k: int, rng: Generators) -> GaussianBelief:
        for part, law in (("process", model.dynamics), ("measurement", model.sensor)):
            if not isinstance(law.noise_at(k), Gaussian):
                raise ValueError(f"the {part} noise of this step is not Gaussian, as that of the first is")
        return super().step(model, belief, y, k, rng)


ESTIMATORS = (Kalman(),)
