"""The progressive-proposal particle filter: particles flow from the transition towards the measurement, step by step.

All particles of a run share their pseudo-time steps. The paper controls them for each particle, but then a particle's steps
depend on where it is, and the derivative of that dependence is missing in its weight, a bias that more particles do not cure;
a grid shared by a run's cloud leaves a bias that vanishes as 1/N, like any tempering that adapts to the cloud.

Defaults are the authors': no diffusion (their experiments), tolerance, number of steps and the rule for the next step (their
program). They take 200 particles; 50 here cost as much as some ten thousand of a bootstrap filter. Their tolerance is in
units of the state, here it is in standard deviations; their first try is 0.001, but a try that fails costs little, and from
0.1 on the effective sample size is the same after fewer steps.
"""

from dataclasses import dataclass
from typing import ClassVar

from suite import flow, particles, proposal
from suite.flow import Control
from suite.linalg import Array
from suite.model import StateSpaceModel
from suite.parameters import parameter
from suite.particle_filter import ParticleFilter
from suite.particles import Particles
from suite.random import Generators
from suite.resampling import SCHEMES

MOST = 12
"""Components of the state. A step of a run takes 0.08 s with 10, 0.7 s with 20 and 10 s with 50."""


@dataclass(frozen=True)
class Progressive(ParticleFilter):
    """Particle filter whose proposal is a Gaussian flow in pseudo-time towards the optimal proposal, weighted exactly."""

    name: ClassVar[str] = "progressive"
    reference: ClassVar[str] = (
        "P. Bunch, S. Godsill, Approximations of the optimal importance density using Gaussian particle flow importance "
        "sampling, Journal of the American Statistical Association 111(514), 2016, 748-762"
    )
    particles: int = parameter(50, "number of particles; the authors take 200", low=1, high=10_000_000)
    threshold: float = parameter(1.0, "resample below this share of effective particles", low=0, high=1)
    resampling: str = parameter("systematic", "resampling scheme", choices=tuple(SCHEMES))
    gamma: float = parameter(0.0, "diffusion of the flow; 0 moves the particles without noise", low=0)
    tolerance: float = parameter(0.1, "error allowed in one pseudo-time step, in standard deviations", above=0)
    first: float = parameter(0.1, "first pseudo-time step tried", above=0, high=1)
    steps: int = parameter(50, "pseudo-time steps tried at most; the last goes to the end", low=1, high=10_000)

    def runs_at_once(self, model: StateSpaceModel) -> int:
        return max(1, flow.BLOCK // self.particles)

    def accepts(self, model: StateSpaceModel) -> str | None:
        if model.n > MOST:
            return f"the flow's second derivatives cost too much with more than {MOST} components of the state"
        return super().accepts(model) or proposal.accepts(model)

    def step(self, model: StateSpaceModel, belief: Particles, y: Array, k: int, rng: Generators) -> Particles:
        start = particles.resample(belief, SCHEMES[self.resampling], self.threshold, rng)
        control = Control(self.gamma, self.tolerance, self.first, self.steps)
        x, fit, evidence = particles.blockwise(lambda part: flow.propose(model, part, y, k, rng, control), start.x)
        return particles.weighted(x, start.logw + fit + evidence, start.parents)


ESTIMATORS = (Progressive(),)
