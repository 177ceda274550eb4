"""Whether manoeuvres are told from nominal motion by the statistic of a detector, and how fast."""

import numpy as np

from suite import roc
from suite.linalg import Array
from suite.metrics.evidence import Evidence
from suite.metrics.metric import Contributions, Metric
from suite.statistics import Resampled, bounded, means

LIMIT = 0.1
"""False-alarm rate up to which the partial area goes."""
ALARMED = 0.1
"""Level of the threshold at which manoeuvres are detected: probability of an alarm in a manoeuvre-free run."""


def scores(e: Evidence) -> Contributions:
    """The statistic in nominal motion [0] and in manoeuvres [1], NaN in the other: of scans [2, T, R], of onsets [2, 1, R]."""
    statistic, manoeuvring = e.estimate.statistic, roc.manoeuvres(e.case, e.truth)
    first = roc.onsets(e.case, e.truth, e.estimate)
    if first is None or manoeuvring is None or statistic is None:
        return {}
    return {"scan": np.where([~manoeuvring, manoeuvring], statistic, np.nan), "manoeuvre": first.scores}


def detected(e: Evidence) -> Contributions:
    """Whether first manoeuvres are detected [C + 1, R], at an infinite threshold and at the C peaks of the twin's runs."""
    return {"manoeuvre": found[0].detected(found[1])} if (found := _calibration(e)) else {}


def delay(e: Evidence) -> Contributions:
    """Time in s from the onset of first manoeuvres to the alarm [C + 1, R], at the same thresholds."""
    return {"manoeuvre": found[0].delay(found[1])} if (found := _calibration(e)) else {}


def _calibration(e: Evidence) -> tuple[roc.Onsets, Array] | None:
    """First manoeuvres and thresholds; None where the twin's runs are too few for a threshold of the level."""
    first, peaks = roc.onsets(e.case, e.truth, e.estimate), roc.peaks(e.calm)
    return (first, np.append(np.inf, peaks)) if first and roc.place(ALARMED, len(peaks)) else None


def area(contributions: Array) -> tuple[float, float, float]:
    """Area under the curve, with its interval."""
    sample = roc.area(contributions)
    return float(sample.value[0]), *bounded(sample)


def index(contributions: Array) -> Resampled:
    """McClish's index of the partial area [1]."""
    return roc.partial_area(contributions, LIMIT).map(lambda mean: roc.standardised(mean, LIMIT))


def partial_area(contributions: Array) -> tuple[float, float, float]:
    """McClish's index, with the interval of the mean detection rate that it stands for."""
    sample = roc.partial_area(contributions, LIMIT)
    value, low, high = roc.standardised(np.array([sample.value[0], *bounded(sample)]), LIMIT).tolist()
    return value, low, high


def at_level(contributions: Array) -> Resampled:
    """Mean [1] at the threshold of the level."""
    row = roc.place(ALARMED, len(contributions) - 1)
    return means(contributions[row : row + 1])


def rate(contributions: Array) -> tuple[float, float, float]:
    """Mean at the threshold of the level, with its interval."""
    return roc.calibrated(contributions, ALARMED)


def duration(contributions: Array) -> tuple[float, float, float]:
    """The same of times, which are within 0 and the longest manoeuvre: that is how long it takes at an infinite threshold."""
    longest = contributions[0].max()
    value, low, high = roc.calibrated(contributions / longest, ALARMED)
    return value * longest, low * longest, high * longest


EGAN = (
    "J. P. Egan, Signal Detection Theory and ROC Analysis, 1975; by counting pairs: H. B. Mann, D. R. Whitney, Annals of "
    "Mathematical Statistics 18(1), 1947, 50-60"
)
MANOEUVRE = (
    "Manoeuvre: the largest statistic of each run in its first manoeuvre against the largest on the nominal steps before it, "
    "from the third on; runs whose first manoeuvre leaves no such step are left out."
)
THRESHOLD = (
    "An alarm is raised where the statistic is above a threshold, from the third step on. The threshold is set on the runs of "
    "the twin case without manoeuvres, so that an alarm comes in 10 % of them, at whatever step: of C runs it is the j-th "
    "largest of their highest values, j the whole part of 0.1 (C + 1), and there is none for fewer than nine. "
)
CHANCE = (
    "The interval covers the choice of the threshold too, and at least 95 %: below 36 runs of the twin it may well be above "
    "all that they show."
)
AUC = Metric(
    name="auc",
    family="detection",
    title="Area under the ROC curve",
    unit="",
    better="higher",
    formula=r"\frac{1}{N_0 N_1} \sum_{i=1}^{N_0} \sum_{j=1}^{N_1} \left( [ s_j > s_i ] + \frac{1}{2} [ s_j = s_i ] \right)",
    words="How often a detector's statistic is higher in a manoeuvre than without one: 1 where a threshold parts the two, 0.5 "
    "for one that tells nothing. Scan: all steps of all runs, by the mode in force. It blames a statistic that rises late, or "
    f"falls late after a manoeuvre, as cumulative sums do. {MANOEUVRE} It needs no threshold.",
    reference=EGAN,
    fn=scores,
    statistic=roc.area,
    exact=area,
)
PAUC = Metric(
    name="pauc",
    family="detection",
    title="Partial area under the ROC curve",
    unit="",
    better="higher",
    formula=r"\frac{1}{2} \left( 1 + \frac{ A_{0.1} - 0.1^2 / 2 }{ 0.1 - 0.1^2 / 2 } \right), \quad "
    r"A_{0.1} = \int_0^{0.1} P_D \left( P_{FA} \right) d P_{FA}",
    words="Area under the part of the ROC curve with a false-alarm rate of up to 0.1, where a detector would be used, brought "
    "to the scale of the whole area: 1 at best, 0.5 for one that tells nothing, 0.474 at least. Scan and manoeuvre as in the "
    "whole area; the false-alarm rate of the latter is that of the stretch before the manoeuvre.",
    reference="D. K. McClish, Analyzing a portion of the ROC curve, Medical Decision Making 9(3), 1989, 190-195",
    fn=scores,
    statistic=index,
    exact=partial_area,
)
DETECTION_RATE = Metric(
    name="detection-rate",
    family="detection",
    title="Manoeuvres detected at a false-alarm level of 0.1",
    unit="",
    better="higher",
    formula=r"\frac{ \left| \left\{ r : \max_{k < k_r} s_k \leq h < \max_{k_r \leq k < k_r + n_r} s_k \right\} \right| }"
    r"{ \left| \left\{ r : \max_{k < k_r} s_k \leq h \right\} \right| }",
    words="Share of runs that raise an alarm in their first manoeuvre, of those that raised none before it. "
    f"{THRESHOLD}{CHANCE}",
    reference="S. M. Kay, Fundamentals of Statistical Signal Processing, volume II: Detection Theory, 1998, chapter 3; the "
    "threshold: S. S. Wilks, Determination of sample sizes for setting tolerance limits, Annals of Mathematical Statistics "
    "12(1), 1941, 91-96",
    fn=detected,
    statistic=at_level,
    exact=rate,
    ranked=False,
)
DETECTION_DELAY = Metric(
    name="detection-delay",
    family="detection",
    title="Delay of detection at a false-alarm level of 0.1",
    unit="s",
    better="lower",
    formula=r"\frac{1}{R} \sum_{r=1}^{R} \min \left( t \left( \min \left\{ k \geq k_r : s_k > h \right\} \right), "
    r"t \left( k_r + n_r \right) \right) - t \left( k_r \right)",
    words="Mean time from the first step of a run's first manoeuvre to the alarm, over runs that raised none before: 0 for an "
    "alarm at that first step. A manoeuvre that is missed counts with its whole duration, so where all last as long this is "
    f"the restricted mean of Kaplan and Meier. {THRESHOLD}{CHANCE}",
    reference="M. Basseville, I. V. Nikiforov, Detection of Abrupt Changes, 1993, section 4.4; E. L. Kaplan, P. Meier, Journal "
    "of the American Statistical Association 53(282), 1958, 457-481",
    fn=delay,
    statistic=at_level,
    exact=duration,
    ranked=False,
)
METRICS = (AUC, PAUC, DETECTION_RATE, DETECTION_DELAY)
