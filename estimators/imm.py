"""The interacting multiple model filter, its modes filtered by linearisation or by sigma points."""

from dataclasses import dataclass
from typing import ClassVar

from suite import gaussian, imm, moment_rules
from suite.estimator import Readout
from suite.imm import Interacting
from suite.jump import JumpModel
from suite.jump_filter import JumpFilter
from suite.linalg import Array
from suite.model import StateSpaceModel
from suite.parameters import parameter
from suite.random import Generators

REFERENCE = (
    "H. A. P. Blom, Y. Bar-Shalom, The interacting multiple model algorithm for systems with Markovian switching "
    "coefficients, IEEE Transactions on Automatic Control 33(8), 1988, 780-783"
)


@dataclass(frozen=True)
class InteractingExtended(JumpFilter):
    """Interacting multiple model filter with an extended Kalman filter for each mode; Kalman filters for linear modes."""

    name: ClassVar[str] = "imm-ekf"
    reference: ClassVar[str] = REFERENCE

    def accepts_mode(self, model: StateSpaceModel) -> str | None:
        return gaussian.differentiable(model)

    def init(self, model: JumpModel, rng: Generators) -> Interacting:
        return imm.init(model, rng.runs)

    def step(self, model: JumpModel, belief: Interacting, y: Array, k: int, rng: Generators) -> Interacting:
        return imm.step(moment_rules.taylor, model, belief, y, k)

    def read(self, belief: Interacting) -> Readout:
        return belief.read()


@dataclass(frozen=True)
class InteractingUnscented(JumpFilter):
    """Interacting multiple model filter with an unscented Kalman filter for each mode."""

    name: ClassVar[str] = "imm-ukf"
    reference: ClassVar[str] = REFERENCE
    alpha: float = parameter(1.0, "spread of the sigma points", low=1e-6, high=1)
    beta: float = parameter(2.0, "extra weight of the central point in covariances; 2 suits a Gaussian", low=0)
    kappa: float = parameter(0.0, "second spread parameter", low=0)

    def accepts_mode(self, model: StateSpaceModel) -> str | None:
        return gaussian.accepts(model)

    def init(self, model: JumpModel, rng: Generators) -> Interacting:
        return imm.init(model, rng.runs)

    def step(self, model: JumpModel, belief: Interacting, y: Array, k: int, rng: Generators) -> Interacting:
        return imm.step(moment_rules.unscented(self.alpha, self.beta, self.kappa), model, belief, y, k)

    def read(self, belief: Interacting) -> Readout:
        return belief.read()


ESTIMATORS = (InteractingExtended(), InteractingUnscented())
