"""How well the particles of a filter are used. None of it is a goal: it says why errors are what they are."""

import functools

import numpy as np

from suite.linalg import Array
from suite.metrics.evidence import Evidence
from suite.metrics.metric import Contributions, Metric, share

NO_GOAL = "It is no goal by itself, and estimators are not ranked by it."


def trace(e: Evidence, name: str) -> Contributions:
    """A part of the estimate that is one number a step and run [T, R]; nothing where it is not stored."""
    values: Array | None = getattr(e.estimate, name)
    return {} if values is None else {"particles": values}


def share_of_particles(e: Evidence) -> Contributions:
    """Effective sample size over the number of particles [T, R]; nothing where one of them is not known."""
    return {} if e.particles is None else {block: values / e.particles for block, values in trace(e, "ess").items()}


def least(e: Evidence) -> Contributions:
    """Smallest effective sample size over time of each run [1, R]."""
    return {block: np.fmin.reduce(values, axis=0)[None] for block, values in trace(e, "ess").items()}


ESS = Metric(
    name="ess",
    family="particles",
    title="Effective sample size",
    unit="particles",
    better="higher",
    formula=r"\frac{1}{R\,T} \sum_{r,k} \frac{ \left( \sum_i w_k^{(i)} \right)^2 }{ \sum_i \left( w_k^{(i)} \right)^2 }",
    words="How many particles of equal weight would tell as much as those that the filter has once they are weighed, before "
    "they are drawn anew: mean over runs and time. With few of them estimates scatter, yet a filter that looks at the "
    "measurement first may do well with fewer. " + NO_GOAL,
    reference="A. Kong, J. S. Liu, W. H. Wong, Sequential imputations and Bayesian missing data problems, Journal of the "
    "American Statistical Association 89(425), 1994",
    fn=functools.partial(trace, name="ess"),
    ranked=False,
)
ESS_SHARE = Metric(
    name="ess-share",
    family="particles",
    title="Effective share of the particles",
    unit="",
    better="higher",
    formula=r"\frac{1}{R\,T} \sum_{r,k} \frac{ \mathrm{ESS}_k }{ N }",
    words="Effective sample size over the number of particles, of each mode where every mode has its own: mean over runs and "
    "time. 1 where all weights are equal. " + NO_GOAL,
    reference=ESS.reference,
    fn=share_of_particles,
    exact=share,
    ranked=False,
)
LEAST_ESS = Metric(
    name="least-ess",
    family="particles",
    title="Smallest effective sample size",
    unit="particles",
    better="higher",
    formula=r"\frac{1}{R} \sum_{r=1}^{R} \min_k \mathrm{ESS}_k",
    words="Smallest effective sample size over the steps of a run, the mean over runs: near 1 where some measurement leaves a "
    "single particle with weight, which a mean over time does not show. " + NO_GOAL,
    reference=ESS.reference,
    fn=least,
    ranked=False,
)
ANCESTORS = Metric(
    name="ancestors",
    family="particles",
    title="Particles with offspring",
    unit="particles",
    better="higher",
    formula=r"\frac{1}{R\,T} \sum_{r,k} \left| \left\{ a_k^{(1)}, \ldots, a_k^{(N)} \right\} \right|",
    words="How many different particles of the step before have offspring: mean over runs and time. All of them where none are "
    "drawn anew. " + NO_GOAL,
    reference="M. S. Arulampalam, S. Maskell, N. Gordon, T. Clapp, A tutorial on particle filters for online "
    "nonlinear/non-Gaussian Bayesian tracking, IEEE Transactions on Signal Processing 50(2), 2002 (sample impoverishment)",
    fn=functools.partial(trace, name="ancestors"),
    ranked=False,
)
ACCEPTANCE = Metric(
    name="acceptance",
    family="particles",
    title="Acceptance rate of moves",
    unit="",
    better="higher",
    formula=r"\frac{1}{T} \sum_{k=1}^{T} \frac{1}{\left| R_k \right|} \sum_{r \in R_k} "
    r"\frac{ \text{particles moved} }{ N }",
    words="Share of the particles that a Metropolis-Hastings move brought to another place: mean over the runs R_k in which a "
    "move was tried at a step, then over the steps at which one was. Near 0 the moves are too bold to help against equal "
    "particles; near 1 they may be too timid to do so. " + NO_GOAL,
    reference="W. R. Gilks, C. Berzuini, Following a moving target: Monte Carlo inference for dynamic Bayesian models, Journal "
    "of the Royal Statistical Society B 63(1), 2001",
    fn=functools.partial(trace, name="acceptance"),
    exact=share,
    ranked=False,
)
METRICS = (ESS, ESS_SHARE, LEAST_ESS, ANCESTORS, ACCEPTANCE)
