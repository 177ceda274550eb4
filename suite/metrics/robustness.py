"""How often an estimator loses its target."""

import numpy as np

from suite.metrics.evidence import Evidence
from suite.metrics.metric import Contributions, Metric


def diverged(e: Evidence) -> Contributions:
    """1 for each run that diverged by the case's definition or was lost, else 0 [1, R]; NaN where the truth is not known."""
    return {"runs": np.where(np.isnan(e.away), np.nan, np.isfinite(e.away))[None]}


DIVERGENCE = Metric(
    name="divergence",
    family="robustness",
    title="Divergence rate",
    unit="",
    better="lower",
    formula=r"\frac{1}{R} \sum_{r=1}^{R} \left[ \text{run } r \text{ is beyond the limit for } j \text{ steps on end} \right]",
    words="Share of runs in which the error stays beyond the case's limit for its number of consecutive steps, or in which "
    "the estimator lost the target altogether; the interval is the exact binomial one; on a recording, whose runs are "
    "all of the same data, a table of scores gives none. Steps whose truth is not known are left out.",
    reference="C. J. Clopper, E. S. Pearson, The use of confidence or fiducial limits, Biometrika 26, 1934 (the interval)",
    fn=diverged,
    binomial=True,
)
METRICS = (DIVERGENCE,)
