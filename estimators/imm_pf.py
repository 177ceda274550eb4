"""The interacting multiple model particle filter: moments are mixed, and each mode's particles redrawn from a Gaussian."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from suite import imm, imm_particles, modes, particles
from suite.estimator import Readout
from suite.imm import Interacting
from suite.jump import JumpModel
from suite.jump_filter import JumpFilter
from suite.linalg import Array
from suite.model import AdditiveSensor, StateSpaceModel
from suite.parameters import parameter
from suite.particles import Particles, Resampled
from suite.proposal import has_likelihood
from suite.random import Generators
from suite.resampling import SCHEMES


@dataclass(frozen=True)
class InteractingParticles(JumpFilter):
    """IMM with a particle filter in each mode, as the source of `imm-aupf` compares it.

    With as many particles as one likes it is the moment-matching IMM, not the exact posterior. Moments are those of the
    resampled particles; as these are redrawn from a Gaussian anyway, resampling adds noise and no more: with a `threshold`
    of 0 it is left out. The reference prints weights in the covariance of the prediction that know the measurement already;
    here they are equal.
    """

    name: ClassVar[str] = "imm-pf"
    reference: ClassVar[str] = (
        "H. A. P. Blom, Y. Bar-Shalom, The interacting multiple model algorithm for systems with Markovian switching "
        "coefficients, IEEE Transactions on Automatic Control 33(8), 1988, 780-783; with particles as in W. Liu, W. Song, "
        "Z. Huang, Ship Science and Technology 39(3), 2017, 145-149, section 3.2"
    )
    particles: int = parameter(500, "number of particles in each mode", low=1, high=10_000_000)
    likelihood: str = parameter(
        "gaussian",
        "likelihood of a mode: of the innovation, by the moments of the predicted measurements, or the mean of its particles'",
        choices=("gaussian", "particles"),
    )
    threshold: float = parameter(1.0, "resample below this share of effective particles", low=0, high=1)
    resampling: str = parameter("multinomial", "resampling scheme", choices=tuple(SCHEMES))

    def accepts_mode(self, model: StateSpaceModel) -> str | None:
        if self.likelihood == "gaussian" and not isinstance(model.sensor, AdditiveSensor):
            return "its measurement noise is not additive"
        return has_likelihood(model)

    def runs_at_once(self, model: JumpModel) -> int:
        return particles.runs_at_once(self.particles)

    def init(self, model: JumpModel, rng: Generators) -> Interacting:
        return imm.init(model, rng.runs)

    def step(self, model: JumpModel, belief: Interacting, y: Array, k: int, rng: Generators) -> Interacting:
        ahead, mixing = modes.predicted(model, belief.logp)
        clouds, fits, ess = [], [], []
        for mode, mean, root in zip(model.modes, *imm.mixed(belief, mixing), strict=True):
            start = imm_particles.redrawn(mean, root, self.particles, rng)
            cloud = imm_particles.moved(mode, start, y, k, rng)
            fits.append(self.loglik(mode, cloud, y, k))
            ess.append(cloud.ess)
            after = self.resampled(cloud, rng)
            clouds.append(particles.weighted(after.x, after.logw, after.parents))
        return imm_particles.updated(belief, ahead, fits, clouds, ess)

    def loglik(self, mode: StateSpaceModel, cloud: Particles, y: Array, k: int) -> Array:
        """Log-likelihood of a mode [R]; zero likelihood where all its particles have none."""
        if self.likelihood == "particles":
            return cloud.loglik
        return np.where(cloud.loglik > -np.inf, imm_particles.gaussian_loglik(mode.sensor, cloud.x, y, k), -np.inf)

    def resampled(self, cloud: Particles, rng: Generators) -> Resampled:
        """A mode's particles after resampling."""
        return particles.resample(cloud, SCHEMES[self.resampling], self.threshold, rng)

    def read(self, belief: Interacting) -> Readout:
        return belief.read()


ESTIMATORS = (InteractingParticles(),)
