"""A manoeuvre detector: CUSUM of the likelihood ratios of an interacting multiple model filter."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from suite import detection, gaussian, imm, moment_rules
from suite.estimator import Readout
from suite.imm import Interacting
from suite.jump import JumpModel
from suite.jump_filter import JumpFilter
from suite.linalg import Array
from suite.model import StateSpaceModel
from suite.random import Generators


@dataclass(frozen=True)
class Monitored:
    """What the filter knows, and the sum [R] of the detector."""

    filtered: Interacting
    total: Array


@dataclass(frozen=True)
class InteractingCusum(JumpFilter):
    """CUSUM of the log-likelihood ratios of a manoeuvre against the nominal mode, from the extended IMM filter."""

    name: ClassVar[str] = "imm-cusum"
    reference: ClassVar[str] = (
        "J. Ru, V. P. Jilkov, X. R. Li, A. Bashi, Detection of target maneuver onset, IEEE Transactions on Aerospace and "
        "Electronic Systems 45(2), 2009, 536-554"
    )

    def accepts_mode(self, model: StateSpaceModel) -> str | None:
        return gaussian.differentiable(model)

    def init(self, model: JumpModel, rng: Generators) -> Monitored:
        return Monitored(imm.init(model, rng.runs), np.zeros(rng.runs))

    def step(self, model: JumpModel, belief: Monitored, y: Array, k: int, rng: Generators) -> Monitored:
        known = imm.step(moment_rules.taylor, model, belief.filtered, y, k)
        ratio = detection.log_likelihood_ratio(known.ahead, known.fits, model.nominal)
        return Monitored(known, detection.cusum(belief.total, detection.observed(ratio, y)))

    def read(self, belief: Monitored) -> Readout:
        return replace(belief.filtered.read(), statistic=belief.total)


ESTIMATORS = (InteractingCusum(),)
