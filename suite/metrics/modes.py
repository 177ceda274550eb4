"""Whether the modes of a jump-Markov case are recognised, how surely and how soon."""

import functools
from collections.abc import Callable

import numpy as np

from suite.case import Card
from suite.linalg import Array
from suite.metrics.bound import ratio
from suite.metrics.evidence import Evidence, Flags
from suite.metrics.metric import Contributions, Metric, share

FLOOR = 1e-3
"""Smaller probabilities count as this one: of a thousand particles none may be in a mode that is not impossible."""


def of_modes(e: Evidence, score: Callable[[Card, Flags, Array], Array]) -> Contributions:
    """A score by the case, which mode is in force and what probability each was given [T, M, R]; nothing without either."""
    if e.truth.mode is None or e.estimate.mode is None:
        return {}
    right = np.arange(len(e.case.modes))[:, None] == e.truth.mode[:, None]
    return {"modes": score(e.case, right, e.estimate.mode)}


def brier(case: Card, right: Flags, given: Array) -> Array:
    """Squared distance [T, R] of the mode probabilities from the mode in force."""
    return np.asarray(((given - right) ** 2).sum(1))


def surprise(case: Card, right: Flags, given: Array) -> Array:
    """Minus the logarithm of the probability of the mode in force, in nat [T, R]; at most that of `FLOOR`."""
    return np.asarray(np.log(1 / np.clip(np.where(right, given, 0.0).sum(1), FLOOR, 1.0)))


def most_probable(case: Card, right: Flags, given: Array) -> Array:
    """1 where the mode in force is the most probable one, its share where several are, else 0 [T, R]."""
    top = given == given.max(1, keepdims=True)
    return np.asarray((top & right).sum(1) / top.sum(1))


def recognition(case: Card, right: Flags, given: Array) -> Array:
    """Seconds until switches were recognised or over, summed over those of a run, and their number [2, R]; NaN of none."""
    return of_switches(np.minimum(*waits(case, right, given)))


def missed(case: Card, right: Flags, given: Array) -> Array:
    """How many switches of a run were over before they were recognised, and their number [2, R]; NaN of none."""
    found, over = waits(case, right, given)
    return of_switches(np.where(np.isnan(over), np.nan, found >= over))


def of_switches(values: Array) -> Array:
    """Sum of values [T, R] over the switches of each run, and their number [2, R]; NaN of none."""
    count = (~np.isnan(values)).sum(0)
    return np.where(count > 0, np.stack([np.nansum(values, axis=0), count]), np.nan)


def waits(case: Card, right: Flags, given: Array) -> tuple[Array, Array]:
    """Seconds [T, R] from a switch of the mode in force until it is recognised, and until it is over; NaN without a switch.

    A mode is recognised at the first step at which it is more probable than every other one; the time is infinite where none
    follows. It is over at the step of the next switch, the last one an interval after the last step.
    """
    time = case.time[:, None]
    switched = np.diff(right, axis=0, prepend=right[:1]).any(1)
    recognised = np.where(right, given, 0.0).sum(1) > np.where(right, -np.inf, given).max(1)
    end = np.full((1, switched.shape[1]), time[-1] + case.interval)
    found = from_each_step_on(np.where(recognised, time, np.inf))
    over = from_each_step_on(np.concat([np.where(switched, time, np.inf)[1:], end]))
    counted = switched & ~np.isnan(given).all((0, 1))
    return np.where(counted, found - time, np.nan), np.where(counted, over - time, np.nan)


def from_each_step_on(times: Array) -> Array:
    """The smallest of times [T, R] from each step on."""
    return np.minimum.accumulate(times[::-1], axis=0)[::-1]


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
    fn=functools.partial(of_modes, score=brier),
)
LOG_SCORE = Metric(
    name="mode-log-score",
    family="modes",
    title="Log score of the modes",
    unit="nat",
    better="lower",
    formula=r"- \frac{1}{R\,T} \sum_{r,k} \log \max \left( \hat P(r_k = j_k), \epsilon \right)",
    words="Minus the logarithm of the probability given to the mode j in force, averaged over runs and time: 0 for a filter "
    "that is sure of the right mode, log M for one that holds all M modes for equally probable. Probabilities below ε = 0.001 "
    "count as 0.001, so a step costs 6.9 at most: it happens that no particle is in the right mode, and one such step would "
    "decide all.",
    reference="I. J. Good, Rational decisions, Journal of the Royal Statistical Society B 14(1), 1952",
    fn=functools.partial(of_modes, score=surprise),
)
ACCURACY = Metric(
    name="mode-accuracy",
    family="modes",
    title="Modes told right",
    unit="",
    better="higher",
    formula=r"\frac{1}{R\,T} \sum_{r,k} \left[ j_k = \operatorname{argmax}_j \hat P(r_k = j) \right]",
    words="Share of the steps at which the most probable mode is the one in force, averaged over runs and time; where several "
    "are equally probable each counts for its part. How sure the filter was of it does not matter. A filter that always names "
    "the most common mode has that mode's share of the time.",
    reference="Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, "
    "chapter 11 (the modes and their probabilities); E. L. Korn, B. I. Graubard, Confidence intervals for proportions with "
    "small expected number of positive counts estimated from survey data, Survey Methodology 24(2), 1998 (the interval)",
    fn=functools.partial(of_modes, score=most_probable),
    exact=share,
)
RECOGNITION = Metric(
    name="recognition-time",
    family="modes",
    title="Time to recognise a switch",
    unit="s",
    better="lower",
    formula=r"\frac{ \sum_{r,s} \min \left( t_{r,s} - \tau_{r,s},\ \tau_{r,s+1} - \tau_{r,s} \right) }{ \sum_r S_r }",
    words="Time from the step at which another mode comes into force to the first step at which the filter holds it for more "
    "probable than every other one, the mean over all S switches s of all runs r, at times τ. A switch that is not recognised "
    "before the next one counts for as long as it had until then, the last one until an interval after the last step: the mean "
    "is a restricted one. 0 where every switch is recognised at once, or the filter held that mode for the most probable "
    "before. Runs without a switch are left out.",
    reference="P. Royston, M. K. B. Parmar, Restricted mean survival time, BMC Medical Research Methodology 13:152, 2013 (the "
    "restricted mean)",
    fn=functools.partial(of_modes, score=recognition),
    link=ratio,
)
MISSED = Metric(
    name="missed-switches",
    family="modes",
    title="Switches missed",
    unit="",
    better="lower",
    formula=r"\frac{ \sum_{r,s} \left[ t_{r,s} \geq \tau_{r,s+1} \right] }{ \sum_r S_r }",
    words="Share of the switches of all runs that are not recognised before the next switch or the end. Read it beside the "
    "time to recognise a switch, to which they count for as long as they had; estimators are ranked by that. Runs without a "
    "switch are left out.",
    reference=ACCURACY.reference,
    fn=functools.partial(of_modes, score=missed),
    link=ratio,
    exact=functools.partial(share, link=ratio),
    ranked=False,
)
METRICS = (BRIER, LOG_SCORE, ACCURACY, RECOGNITION, MISSED)
