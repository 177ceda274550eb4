"""The interacting multiple model particle filter of Boers and Driessen: each mode draws from the clouds of all modes."""

from dataclasses import dataclass
from typing import ClassVar

from suite import imm, imm_particles, modes, particles
from suite.estimator import Readout
from suite.imm import Interacting
from suite.jump import JumpModel
from suite.jump_filter import JumpFilter
from suite.kernel import bandwidth, epanechnikov
from suite.linalg import Array, apply_by_run
from suite.model import StateSpaceModel
from suite.parameters import parameter
from suite.particles import Particles
from suite.proposal import has_likelihood
from suite.random import Generators
from suite.resampling import SCHEMES


@dataclass(frozen=True)
class Clouds:
    """The weighted particles of each mode, and their moments."""

    particles: list[Particles]
    moments: Interacting


@dataclass(frozen=True)
class InteractingRegularized(JumpFilter):
    """Particle filter with as many particles in every mode, whatever its probability.

    Each cloud is resampled and moved by a kernel; each particle of mode j then starts from a place in the cloud of a mode i,
    drawn with probability mu_{i|j}. Without the kernel the product of the evidences is an unbiased estimate of the likelihood
    at any number of particles: given the clouds, c_j times the mean of any function over the starts of mode j has the
    expectation sum_i p_ij mu_i times its mean over cloud i, whatever the clouds share. So the filter is consistent.
    """

    name: ClassVar[str] = "imm-pf-bd"
    reference: ClassVar[str] = (
        "Y. Boers, J. N. Driessen, Interacting multiple model particle filter, IEE Proceedings Radar, Sonar and Navigation "
        "150(5), 2003, 344-349"
    )
    particles: int = parameter(500, "number of particles in each mode", low=1, high=10_000_000)
    kernel: float = parameter(1.0, "width of the Epanechnikov kernel in optimal bandwidths; 0: none", low=0)
    resampling: str = parameter("systematic", "resampling scheme", choices=tuple(SCHEMES))

    def accepts_mode(self, model: StateSpaceModel) -> str | None:
        return has_likelihood(model)

    def runs_at_once(self, model: JumpModel) -> int:
        return particles.runs_at_once(self.particles * len(model.modes))

    def init(self, model: JumpModel, rng: Generators) -> Clouds:
        clouds = [particles.drawn(mode.prior, rng, self.particles) for mode in model.modes]
        return Clouds(clouds, imm.init(model, rng.runs))

    def step(self, model: JumpModel, belief: Clouds, y: Array, k: int, rng: Generators) -> Clouds:
        ahead, mixing = modes.predicted(model, belief.moments.logp)
        around = zip(belief.particles, belief.moments.root, strict=True)
        origins = [self.regularised(cloud, root, rng) for cloud, root in around]
        clouds = []
        for j, mode in enumerate(model.modes):
            start = imm_particles.picked(mixing[:, j], origins, rng)
            clouds.append(imm_particles.moved(mode, start, y, k, rng))
        fits, ess = [cloud.loglik for cloud in clouds], [cloud.ess for cloud in clouds]
        return Clouds(clouds, imm_particles.updated(belief.moments, ahead, fits, clouds, ess))

    def regularised(self, cloud: Particles, root: Array, rng: Generators) -> Array:
        """A cloud [n, R, N] resampled, and moved by the kernel in those runs that were; root [R, n, n] tells its spread."""
        start = particles.resample(cloud, SCHEMES[self.resampling], 1.0, rng)
        runs, (n, _, count) = start.runs, start.x.shape
        if not self.kernel or not len(runs):
            return start.x
        width = self.kernel * bandwidth(n, count)
        moves = apply_by_run(width * root[runs], epanechnikov(rng.of(runs), n, count))
        moved = start.x.copy()
        moved[:, runs] += moves
        return moved

    def read(self, belief: Clouds) -> Readout:
        return belief.moments.read()


ESTIMATORS = (InteractingRegularized(),)
