"""The interacting multiple model filter of filterpy 2 (R. Labbe), one object a run.

IMMEstimator hands one u and one z to all its filters and knows nothing else of them but x, P and likelihood. So the modes'
matrices and functions are set before each step; offsets of a transition are a matrix B of their own for a u of one; and a
step without a measurement is one of a number that has nothing to do with the state. (Its own `update(None)` weighs the modes
by the likelihoods of an old measurement.)
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from estimators.peers.filterpy import Observed, OneByOne, at_prior, informed, spread, unscented
from suite import modes
from suite.estimator import Readout
from suite.gaussian import additive
from suite.jump import JumpModel
from suite.jump_filter import JumpFilter
from suite.linalg import Array
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.parameters import parameter
from suite.random import Generators

if TYPE_CHECKING:
    from filterpy.kalman import IMMEstimator, KalmanFilter

ONE = np.ones(1)


@dataclass(frozen=True)
class ImmBelief:
    """One IMMEstimator a run, and the nominal mode, against which the others are weighed."""

    objects: OneByOne
    nominal: int


@dataclass(frozen=True)
class FilterpyImm(JumpFilter):
    """Interacting multiple model filter of filterpy 2; far from all modes its likelihoods underflow and it errs.

    Modes with matrices run its KalmanFilter, others its UnscentedKalmanFilter; its ExtendedKalmanFilter it cannot drive.
    A likelihood that underflows to zero, beyond some 38 standard deviations, becomes 2.2e-308. After a measurement that far
    from all modes their probabilities stay as predicted; and just before that point a mode can have less, and loses to worse.
    Where the chain of modes has zeros, a probability that underflows is divided by, and the run is lost.
    """

    name: ClassVar[str] = "filterpy:imm"
    reference: ClassVar[str] = "R. R. Labbe, filterpy 2, filterpy.kalman.IMMEstimator"
    alpha: float = parameter(1.0, "spread of the sigma points, in modes without matrices", above=0, high=1)
    beta: float = parameter(2.0, "extra weight of the central point in covariances; 2 suits a Gaussian", low=0)
    kappa: float = parameter(0.0, "second spread parameter", low=0)

    def accepts(self, model: Any) -> str | None:
        if reason := super().accepts(model):
            return reason
        if len(model.modes) < 2:
            return "filterpy asks for two modes at least"
        if not (model.initial @ model.transition > 0).all():
            return "at the first step a mode has probability zero, by which filterpy divides"
        return None

    def accepts_mode(self, model: StateSpaceModel) -> str | None:
        return additive(model) if has_matrices(model) else spread(model)

    def init(self, model: JumpModel, rng: Generators) -> ImmBelief:
        from filterpy.kalman import IMMEstimator, KalmanFilter  # slow to import, and seldom needed

        def made(mode: StateSpaceModel) -> Any:
            if has_matrices(mode):
                return at_prior(KalmanFilter(mode.n, mode.m, 1), mode)
            return at_prior(unscented(mode, self.alpha, self.beta, self.kappa), mode)

        runs = range(rng.runs)
        imms = tuple(IMMEstimator([made(mode) for mode in model.modes], model.initial, model.transition) for _ in runs)
        return ImmBelief(OneByOne(imms, np.zeros(rng.runs)), model.nominal)

    def step(self, model: JumpModel, belief: ImmBelief, y: Array, k: int, rng: Generators) -> ImmBelief:
        def advance(imm: "IMMEstimator", z: Array) -> float:
            for one, mode in zip(imm.filters, model.modes, strict=True):
                seen = Observed.of(mode.sensor, z, k)
                if has_matrices(mode):
                    given(one, mode, seen)
                else:
                    informed(one, mode, seen)
                if not len(seen.rows):
                    blinded(one)
            imm.predict(ONE)  # an unscented filter takes it for a time step, which its transition ignores
            predicted = imm.cbar
            rows = np.flatnonzero(~np.isnan(z))
            imm.update(z[rows] if len(rows) else np.zeros(1))
            return float(np.log(predicted @ imm.likelihood)) if len(rows) else 0.0

        return ImmBelief(belief.objects.stepped(y, advance), belief.nominal)

    def read(self, belief: ImmBelief) -> Readout:
        mode = np.stack([imm.mu for imm in belief.objects.filters], axis=-1)
        found = belief.objects.read()
        statistic = modes.log_odds(np.log(mode), belief.nominal)
        return Readout(found.mean, found.cov, found.loglik, mode=mode, statistic=statistic)


def has_matrices(model: StateSpaceModel) -> bool:
    """Whether matrices, and an offset of the transition, say all that a filter needs of a model."""
    dynamics, sensor = model.dynamics, model.sensor
    return (
        isinstance(dynamics, AdditiveTransition)
        and isinstance(sensor, AdditiveSensor)
        and isinstance(dynamics.mean, Affine)
        and isinstance(sensor.mean, Affine)
        and (sensor.mean.offset is None or not sensor.mean.offset.any())
        and not sensor.noise_at(1).mean.any()
        and not sensor.angles
    )


def given(kf: "KalmanFilter", model: StateSpaceModel, seen: Observed) -> None:
    """Give a Kalman filter of filterpy the matrices of a step."""
    dynamics, k = model.dynamics, seen.k
    shift = dynamics.noise_mean(k) + (0.0 if dynamics.mean.offset is None else dynamics.mean.offset)
    kf.F, kf.B, kf.Q = dynamics.mean.matrix(k), shift[:, None], dynamics.noise_cov(k)
    kf.H, kf.R, kf.dim_z = model.sensor.mean.matrix(k)[seen.rows], seen.cov, len(seen.rows)


def blinded(one: Any) -> None:
    """Let a filter of filterpy see one number, which has nothing to do with the state."""
    one.R, one.dim_z = np.eye(1), 1
    one.H = np.zeros((1, len(one.x)))  # what a Kalman filter takes
    one.hx = lambda x: np.zeros(1)  # what an unscented one takes


ESTIMATORS = (FilterpyImm(),)
