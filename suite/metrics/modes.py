"""Whether the modes of a jump-Markov case are recognised."""

import numpy as np

from suite.metrics.evidence import Evidence
from suite.metrics.metric import Contributions, Metric


def brier(e: Evidence) -> Contributions:
    """Squared distance [T, R] of the mode probabilities from the mode in force; nothing where either is not known."""
    if e.truth.mode is None or e.estimate.mode is None:
        return {}
    in_force = np.arange(len(e.case.modes))[:, None] == e.truth.mode[:, None]
    return {"modes": ((e.estimate.mode - in_force) ** 2).sum(1)}


BRIER = Metric(
    name="brier",
    family="modes",
    title="Brier score of the modes",
    unit="",
    better="lower",
    formula=r"B = \frac{1}{R\,T} \sum_{r,k} \sum_{j} \left( \hat P(r_k = j) - [r_k = j] \right)^2",
    words="Squared distance of the mode probabilities from the mode in force, averaged over runs and time: 0 for a filter that "
    "is sure of the right mode, 2 for one that is sure of a wrong one.",
    reference="G. W. Brier, Verification of forecasts expressed in terms of probability, Monthly Weather Review 78(1), 1950",
    fn=brier,
)
METRICS = (BRIER,)
