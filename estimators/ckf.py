"""The cubature Kalman filter, batched over runs."""

from dataclasses import dataclass
from typing import ClassVar

from suite import moment_rules
from suite.gaussian_filter import GaussianFilter
from suite.moment_rules import Rule


@dataclass(frozen=True)
class Cubature(GaussianFilter):
    """Cubature Kalman filter: moments by the spherical-radial rule of third degree, 2n equally weighted points."""

    name: ClassVar[str] = "ckf"
    reference: ClassVar[str] = (
        "I. Arasaratnam, S. Haykin, Cubature Kalman filters, IEEE Transactions on Automatic Control 54(6), 2009, 1254-1269"
    )

    @property
    def rule(self) -> Rule:
        return moment_rules.cubature()


ESTIMATORS = (Cubature(),)
