"""The interacting multiple model filter whose modes are particle filters with uniform resampling (IMM-AUPF)."""

from dataclasses import dataclass
from typing import ClassVar

from estimators.imm_pf import InteractingParticles
from suite import uniform_box
from suite.particles import Particles, Resampled
from suite.random import Generators
from suite.resampling import SCHEMES
from suite.uniform_box import UniformBox


@dataclass(frozen=True)
class InteractingUniformResampling(InteractingParticles):
    """IMM-PF with uniform resampling: some particles of each mode are drawn anew, evenly over a box around the best.

    The even draws count as much as all others in a mode's moments, which are therefore wider than they should be: unless
    `fraction` is 1, the filter does not become the IMM as N grows.
    """

    name: ClassVar[str] = "imm-aupf"
    reference: ClassVar[str] = (
        "W. Liu, W. Song, Z. Huang, Improved interacting multiple model particle filter for passive multi-sensor "
        "(in Chinese), Ship Science and Technology 39(3), 2017, 145-149, section 3.2"
    )
    fraction: float = uniform_box.fraction()
    box: str = uniform_box.box()

    def resampled(self, cloud: Particles, rng: Generators) -> Resampled:
        """A mode's particles after resampling: most of them survivors, the rest spread evenly."""
        even = UniformBox.of(self.fraction, self.particles, self.box, SCHEMES[self.resampling])
        return even.resample(cloud, self.threshold, rng)


ESTIMATORS = (InteractingUniformResampling(),)
