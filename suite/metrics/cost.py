"""What an estimator costs, from calls that are timed apart from the accuracy runs, and what else these calls show."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtr

from suite.estimator import Estimate
from suite.linalg import Array
from suite.metrics.evidence import Evidence
from suite.metrics.metric import Contributions, Metric
from suite.statistics import LEVEL

TAIL = 0.99
"""Share of the steps that take no longer than the latency of the tail."""
FEWEST_STEPS = 10
"""A log-likelihood over fewer steps is mostly that of the first measurement."""
MEBIBYTE = 2**20


@dataclass
class Calls(Estimate):
    """Timed calls in the place of runs: seconds[K, calls] and batch[calls], but no states.

    memory[calls]: peak bytes of a short call with as many runs. logliks[calls, runs]: log-likelihood of each run of a call
    over its steps, the same data in every call of several runs; NaN for a run that did not come through.
    """

    memory: Array | None = None
    logliks: Array | None = None


def latency(e: Evidence) -> Contributions:
    """Median microseconds of a step in each call that carried a single run [1, calls]."""
    return {"step": 1e6 * np.median(_seconds(e, _alone(e)), axis=0, keepdims=True)}


def tail_latency(e: Evidence) -> Contributions:
    """Microseconds of each step in each call that carried a single run [T, calls]; NaN where no step was timed by itself."""
    seconds = _seconds(e, _alone(e))
    return {"step": 1e6 * np.where(np.ptp(seconds, axis=0) > 0, seconds, np.nan)}


def seconds_per_run_step(e: Evidence) -> Contributions:
    """Mean seconds per run-step in each call that carried several runs [1, calls]."""
    return {"step": _seconds(e, ~_alone(e)).mean(axis=0, keepdims=True)}


def seconds_per_particle_step(e: Evidence) -> Contributions:
    """The same per particle [1, calls]; nothing of an estimator that has none."""
    if not e.particles:
        return {}
    return {block: seconds / e.particles for block, seconds in seconds_per_run_step(e).items()}


def memory(e: Evidence) -> Contributions:
    """Peak mebibytes of a short call, by the number of its runs, said once for each timed call with as many [1, calls]."""
    if not isinstance(e.estimate, Calls) or e.estimate.memory is None:
        return {}
    batch = np.asarray(e.estimate.batch)
    peak = e.estimate.memory[None] / MEBIBYTE
    return {"one run" if runs == 1 else f"{runs} runs": peak[:, batch == runs] for runs in np.unique(batch).tolist()}


def loglik_variance(e: Evidence) -> Contributions:
    """Variance over repeated calls of each run's log-likelihood, per step [1, runs]; NaN for runs that any call lost."""
    if not isinstance(e.estimate, Calls) or e.estimate.logliks is None:
        return {}
    repeated, steps = e.estimate.logliks[~_alone(e)], e.estimate.mean.shape[0]
    if len(repeated) < 2 or steps < FEWEST_STEPS:
        return {}
    spread = repeated - repeated[0]  # numbers that are all the same then have no variance at all
    return {"measurement": spread.var(axis=0, ddof=1)[None] / steps}


def quantile_ranks(count: int, share: float) -> tuple[int, int]:
    """Ranks (from 1) of the order statistics of `count` numbers between which their law's quantile lies, 95 % at least.

    The quantile lies below the k-th smallest if fewer than k numbers are below it, a binomial probability (Thompson, 1936).
    Rank 0 or count + 1: there are too few numbers for a limit on that side.
    """
    below = bdtr(np.arange(count), count, share)
    tail = (1 - LEVEL) / 2
    return int(np.searchsorted(below, tail, side="right")), int(np.searchsorted(below, 1 - tail)) + 1


def _tail(microseconds: Array) -> tuple[float, float, float]:
    """The quantile TAIL of all microseconds[T, calls] together, with its interval."""
    ordered = np.sort(microseconds, axis=None)
    low, high = quantile_ranks(ordered.size, TAIL)
    ends = np.concatenate([[0.0], ordered, [np.inf]])
    return float(np.quantile(ordered, TAIL, method="inverted_cdf")), float(ends[low]), float(ends[high])


def _exactly(values: Array) -> tuple[float, float, float]:
    """A number that is the same in all calls, and has no interval."""
    return float(values[0, 0]), np.nan, np.nan


def _alone(e: Evidence) -> NDArray[np.bool_]:
    """Which calls carried a single run [calls]."""
    return np.equal(e.estimate.batch, 1)


def _seconds(e: Evidence, wanted: NDArray[np.bool_]) -> Array:
    """Seconds [T, calls] of the wanted calls; of none when nothing was timed."""
    return np.empty((1, 0)) if e.estimate.seconds is None else e.estimate.seconds[:, wanted]


HERE = "measured by filterbench on the host named in the provenance"
LATENCY = Metric(
    name="latency",
    family="cost",
    title="Latency of a step",
    unit="µs",
    better="lower",
    formula=r"\operatorname{median}_k \left( t_k - t_{k-1} \right)",
    words="Time of one step with a single run, as a filter in the field would need it: median over the steps of a call, mean "
    "over calls; one thread, after a warm-up, with nothing else running beside it.",
    reference=HERE,
    fn=latency,
    timed=True,
)
TAIL_LATENCY = Metric(
    name="latency-p99",
    family="cost",
    title="Latency of the slowest steps",
    unit="µs",
    better="lower",
    formula=r"\min \left\{ t : \frac{1}{K} \sum_{k=1}^{K} \left[ t_k - t_{k-1} \leq t \right] \geq 0.99 \right\}",
    words="99th percentile of the time of one step with a single run, over the steps of all calls together: what a filter in "
    "the field must have time for. It includes the machine: what else a shared one does falls into the slowest steps, so it "
    "ranks nobody. The interval comes from the order of the times, and holds for independent steps of any distribution; its "
    "upper end is infinite below 368 steps, and slow estimators are timed over fewer. There is none for an estimator that does "
    "not time its steps one by one.",
    reference="W. R. Thompson, On confidence ranges for the median and other expectation distributions for populations of "
    "unknown distribution form, Annals of Mathematical Statistics 7(3), 1936 (the interval)",
    fn=tail_latency,
    exact=_tail,
    timed=True,
    ranked=False,
)
THROUGHPUT = Metric(
    name="throughput",
    family="cost",
    title="Throughput",
    unit="run-steps/s",
    better="higher",
    formula=r"\frac{R\,T}{\text{seconds}}",
    words="Steps of runs computed a second when a few runs are filtered together; one thread, after a warm-up. Filters that "
    "work on whole arrays compute more of them a second with more runs.",
    reference=HERE,
    fn=seconds_per_run_step,
    link=np.reciprocal,
    timed=True,
)
PARTICLE_THROUGHPUT = Metric(
    name="particle-throughput",
    family="cost",
    title="Throughput of particles",
    unit="particle-steps/s",
    better="higher",
    formula=r"\frac{N\,R\,T}{\text{seconds}}",
    words="Steps of particles computed a second when a few runs are filtered together: the throughput times the number of "
    "particles that the estimator is set to. Filters that carry as many in each mode, or in each of two filters, do so many "
    "times more, so estimators are not ranked by it. There is none for an estimator without particles.",
    reference=HERE,
    fn=seconds_per_particle_step,
    link=np.reciprocal,
    timed=True,
    ranked=False,
)
MEMORY = Metric(
    name="memory",
    family="cost",
    title="Peak memory",
    unit="MiB",
    better="lower",
    formula=r"\max_t \, \text{bytes in use at } t \; / \; 2^{20}",
    words="Most memory that a call has in use at any time beyond what was in use before it, with one run and with a few "
    "together: arrays of NumPy and objects of Python, what is returned included. The call has three steps, and is made apart "
    "from the timed ones, after a warm-up. What other libraries allot by themselves is left out, as are the program and its "
    "modules. It is counted, not sampled, so there is no interval; but objects of Python that are kept for reuse move it by up "
    "to 3 %, so it ranks nobody.",
    reference="the module tracemalloc of Python, to which NumPy reports its arrays; " + HERE,
    fn=memory,
    exact=_exactly,
    timed=True,
    ranked=False,
)
LOGLIK_VARIANCE = Metric(
    name="loglik-variance",
    family="particles",
    title="Variance of the log-likelihood estimate",
    unit="nat²/step",
    better="lower",
    formula=r"\frac{1}{R\,K} \sum_{r=1}^{R} \operatorname{var}_s \left( \sum_{k=1}^{K} "
    r"\log \hat p_s \left( y_k^{(r)} \mid y_1^{(r)}, \ldots, y_{k-1}^{(r)} \right) \right)",
    words="How much the log-likelihood of the same data differs between repeated filters s that draw other random numbers: "
    "variance over the timed calls of several runs, divided by the number of steps K of such a call, mean over its runs. It "
    "falls as one over the number of particles, when there are enough of them. Zero for a filter that draws nothing. Runs that "
    "any of the calls lost are left out. There is none where the calls have fewer than 10 steps, as with slow filters, nor "
    "without a log-likelihood.",
    reference="M. K. Pitt, R. dos Santos Silva, P. Giordani, R. Kohn, On some properties of Markov chain Monte Carlo "
    "simulation methods based on the particle filter, Journal of Econometrics 171(2), 2012, 134-151",
    fn=loglik_variance,
    timed=True,
    ranked=False,
)
METRICS = (LATENCY, TAIL_LATENCY, THROUGHPUT, PARTICLE_THROUGHPUT, MEMORY, LOGLIK_VARIANCE)
