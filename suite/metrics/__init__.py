"""The metrics of filterbench, in report order; one file a family."""

from suite.metrics import bound, calibration, consistency, cost, detection, error, modes, particles, robustness
from suite.metrics.evidence import Evidence
from suite.metrics.metric import FAMILIES, SURVIVING, Metric, Score, counted
from suite.registry import Registry

METRICS: Registry[Metric] = Registry(
    "metric",
    (
        *error.METRICS,
        *bound.METRICS,
        *consistency.METRICS,
        *calibration.METRICS,
        *modes.METRICS,
        *detection.METRICS,
        *robustness.METRICS,
        *particles.METRICS,
        *cost.METRICS,
    ),
)

__all__ = ["FAMILIES", "METRICS", "SURVIVING", "Evidence", "Metric", "Score", "counted"]
