"""The metrics of filterbench, in report order; one file a family."""

from suite.metrics import consistency, cost, error, modes, robustness
from suite.metrics.metric import Metric, Score
from suite.registry import Registry

METRICS: Registry[Metric] = Registry(
    "metric", (*error.METRICS, *consistency.METRICS, *modes.METRICS, *robustness.METRICS, *cost.METRICS)
)

__all__ = ["METRICS", "Metric", "Score"]
