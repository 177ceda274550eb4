"""What an estimator costs, from timed calls that are made apart from the accuracy runs."""

import numpy as np

from suite.estimator import Estimate
from suite.linalg import Array
from suite.metrics.evidence import Evidence
from suite.metrics.metric import Contributions, Metric


def latency(e: Evidence) -> Contributions:
    """Median microseconds of a step in each call that carried a single run [1, calls]."""
    seconds = _calls(e.estimate, np.asarray(e.estimate.batch) == 1)
    return {"step": 1e6 * np.median(seconds, axis=0, keepdims=True)}


def seconds_per_run_step(e: Evidence) -> Contributions:
    """Mean seconds per run-step in each call that carried several runs [1, calls]."""
    seconds = _calls(e.estimate, np.asarray(e.estimate.batch) > 1)
    return {"step": seconds.mean(axis=0, keepdims=True)}


def _calls(estimate: Estimate, wanted: "np.ndarray[tuple[int], np.dtype[np.bool_]]") -> Array:
    """Seconds [T, calls] of the wanted calls; of none when nothing was timed."""
    return np.empty((1, 0)) if estimate.seconds is None else estimate.seconds[:, wanted]


LATENCY = Metric(
    name="latency",
    family="cost",
    title="Latency of a step",
    unit="µs",
    better="lower",
    formula=r"\operatorname{median}_k \left( t_k - t_{k-1} \right)",
    words="Time of one step with a single run, as a filter in the field would need it: median over the steps of a call, mean "
    "over calls; one thread, after a warm-up, with nothing else running beside it.",
    reference="measured by filterbench on the host named in the provenance",
    fn=latency,
    timed=True,
)
THROUGHPUT = Metric(
    name="throughput",
    family="cost",
    title="Throughput",
    unit="run-steps/s",
    better="higher",
    formula=r"\frac{R\,T}{\text{seconds}}",
    words="Steps of runs computed a second when many runs are filtered together; one thread, after a warm-up.",
    reference="measured by filterbench on the host named in the provenance",
    fn=seconds_per_run_step,
    link=np.reciprocal,
    timed=True,
)
METRICS = (LATENCY, THROUGHPUT)
