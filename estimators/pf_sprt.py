"""The repeated sequential probability ratio test with two particle filters: one of the nominal mode, one of a manoeuvre."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from scipy.special import expit, log_expit, logit

from suite import detection, mode_particles
from suite.estimator import Readout
from suite.jump import JumpModel
from suite.jump_filter import JumpFilter
from suite.linalg import Array
from suite.mode_particles import ModeParticles
from suite.model import StateSpaceModel
from suite.parameters import parameter
from suite.particle_filter import ParticleFilter
from suite.proposal import has_likelihood
from suite.random import Generators
from suite.resampling import SCHEMES


@dataclass(frozen=True)
class Rivals:
    """Two clouds of particles, the statistic g_k [R], the log-odds of a manoeuvre [R], and the log-likelihood of y_k [R]."""

    nominal: ModeParticles
    manoeuvre: ModeParticles
    total: Array
    odds: Array
    loglik: Array

    def read(self) -> Readout:
        """The mixture of both clouds by the odds; effective particles and ancestors are those of the one that has fewer."""
        a, b, share = self.nominal.read(), self.manoeuvre.read(), expit(self.odds)

        def blend(of_nominal: Array, of_manoeuvre: Array) -> Array:  # also where no nominal particle is left
            return np.where(share < 1, (1 - share) * of_nominal + share * of_manoeuvre, of_manoeuvre)

        mean = blend(a.mean, b.mean)
        p, q = a.mean - mean, b.mean - mean
        cov = blend(a.cov + p[:, None] * p, b.cov + q[:, None] * q)
        ess, ancestors = np.fmin(a.ess, b.ess), np.fmin(a.ancestors, b.ancestors)
        return Readout(mean, cov, self.loglik, ess, ancestors, mode=blend(a.mode, b.mode), statistic=self.total)


@dataclass(frozen=True)
class ParticleSprt(JumpFilter, ParticleFilter):
    """Repeated sequential probability ratio test between a particle filter of the nominal mode and one of a manoeuvre.

    The second moves in the other modes only, by their transitions renormalised. The statistic is the sum of the logs of the
    ratios of their predictive likelihoods. Where it falls to Wald's lower threshold the test accepts that nothing happened,
    the second filter becomes a copy of the first, and a new test begins at 0; a test that has seen nothing yet begins anew
    at every step. The estimate is the mixture of both by the posterior odds, exp(statistic) times the odds of leaving the
    nominal mode in one step; where a test begins both are the nominal one. Thresholds for an alarm are chosen afterwards,
    from the stored statistic, so neither filter is replaced after an alarm: one whose hypothesis was false for long has to
    find back to the target by its own noise.
    """

    name: ClassVar[str] = "pf-sprt"
    reference: ClassVar[str] = (
        "Z. Radosavljević, S. Stanković, Sekvencijalna metoda za detekciju manevra aviona (in Serbian), eq. 12; "
        "A. Wald, Sequential tests of statistical hypotheses, Annals of Mathematical Statistics 16, 1945, 117-186"
    )
    particles: int = parameter(1000, "number of particles of each of the two filters", low=1, high=10_000_000)
    threshold: float = parameter(1 / 3, "resample below this share of effective particles", low=0, high=1)
    resampling: str = parameter("systematic", "resampling scheme", choices=tuple(SCHEMES))
    false_alarm: float = parameter(0.01, "probability of a false alarm in Wald's lower threshold", above=0, high=0.49)
    miss: float = parameter(0.1, "probability of a miss in Wald's lower threshold", above=0, high=0.49)

    def accepts(self, model: JumpModel) -> str | None:
        refusal = super().accepts(model)
        return refusal or ("the model has no mode but the nominal one" if len(model.modes) == 1 else None)

    def accepts_mode(self, model: StateSpaceModel) -> str | None:
        return has_likelihood(model)

    def init(self, model: JumpModel, rng: Generators) -> Rivals:
        others = [mode for mode in range(len(model.modes)) if mode != model.nominal]
        start, total = mode_particles.drawn(model, rng, self.particles), np.zeros(rng.runs)
        nominal = replace(start, model=mode_particles.restricted(model, [model.nominal]))
        manoeuvre = replace(start, model=mode_particles.restricted(model, others))
        return Rivals(nominal, manoeuvre, total, _odds_of_leaving(model) + total, total)

    def step(self, model: JumpModel, belief: Rivals, y: Array, k: int, rng: Generators) -> Rivals:
        scheme, (lower, _) = SCHEMES[self.resampling], detection.wald(self.false_alarm, self.miss)
        a = mode_particles.step(belief.nominal, y, k, rng, scheme, self.threshold)
        b = mode_particles.step(belief.manoeuvre, y, k, rng, scheme, self.threshold)
        of_a, of_b = a.particles.loglik, b.particles.loglik
        total = detection.sprt(belief.total, detection.observed(detection.log_ratio(of_b, of_a), y), lower)
        loglik = np.logaddexp(log_expit(-belief.odds) + of_a, log_expit(belief.odds) + of_b)
        return Rivals(a, mode_particles.either(total == 0, a, b), total, _odds_of_leaving(model) + total, loglik)


def _odds_of_leaving(model: JumpModel) -> float:
    """Log of the odds that the nominal mode is left in one step."""
    return float(logit(np.delete(model.transition[model.nominal], model.nominal).sum()))


ESTIMATORS = (ParticleSprt(),)
