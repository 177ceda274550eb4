"""The base of filters that carry one Gaussian and differ in the rule that computes moments."""

from abc import abstractmethod

from suite import gaussian
from suite.estimator import Filter, Readout
from suite.gaussian import GaussianBelief
from suite.linalg import Array
from suite.model import StateSpaceModel
from suite.moment_rules import Rule
from suite.random import Generators


class GaussianFilter(Filter):
    """Base of Gaussian filters: give `rule`, and in `accepts` what it needs to know of a model."""

    @property
    @abstractmethod
    def rule(self) -> Rule:
        """How the moments of the model's functions are found."""

    def accepts(self, model: StateSpaceModel) -> str | None:
        """None when state and measurement are functions of a state and a noise, otherwise the reason why not."""
        return gaussian.accepts(model)

    def init(self, model: StateSpaceModel, rng: Generators) -> GaussianBelief:
        """The model's prior."""
        return gaussian.prior(model, rng.runs)

    def step(self, model: StateSpaceModel, belief: GaussianBelief, y: Array, k: int, rng: Generators) -> GaussianBelief:
        """Prediction and update by the rule."""
        predicted = gaussian.predict(self.rule, belief, model.dynamics, k)
        return gaussian.update(self.rule, predicted, model.sensor, y, k)

    def read(self, belief: GaussianBelief) -> Readout:
        """Mean and covariance, with the likelihood and the innovation of the measurement."""
        return belief.read()
