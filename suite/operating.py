"""Operating points of detectors: what they do at thresholds that are set on runs without manoeuvres."""

from collections.abc import Collection, Iterable, Sequence

import numpy as np
import pandas
from scipy.special import betaincinv, gammaincinv

from suite import roc
from suite.errors import BadInput
from suite.linalg import Array
from suite.metrics import Evidence
from suite.results import CaseResults
from suite.statistics import bounded, means, proportion

LEVELS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
"""Usual false-alarm levels: probabilities of an alarm in a manoeuvre-free run."""
CELL = ("case", "twin", "seed", "estimator")
POINT = ("level", "threshold", *(
    f"{name}{end}" for name in ("false_alarm", "run_length", "detection", "delay") for end in ("", "_low", "_high")
), "runs", "calm_runs")  # fmt: skip
NOTHING = (np.nan, np.nan, np.nan)


def table(cases: Iterable[CaseResults], estimators: Collection[str], levels: Sequence[float] = ()) -> pandas.DataFrame:
    """The operating points of all stored cells that have a statistic and manoeuvres. Raises BadInput where none has."""
    found = []
    for case in cases:
        for label, cell in case.cells.items():
            evidence = cell.evidence if label in estimators else None
            if evidence and roc.onsets(case.card, evidence.truth, evidence.estimate):
                points = operating_points(evidence, levels)
                found.append(points.assign(case=case.card.name, twin=case.card.calm, seed=case.seed, estimator=label))
    if not sum(map(len, found)):
        raise BadInput(
            "of what is stored and chosen nothing has both a decision statistic and manoeuvres; run detectors on such a case "
            "and on its twin, as `filterbench run -e imm-ekf pf-cusum -c manoeuvre-detection/naval "
            "manoeuvre-detection/naval-straight`"
        )
    return pandas.concat(found, ignore_index=True)[[*CELL, *POINT]]


def operating_points(e: Evidence, levels: Sequence[float] = ()) -> pandas.DataFrame:
    """What a detector does at the thresholds of false-alarm levels: a row a level, with 95 % intervals at that threshold.

    threshold: alarms are above it. false_alarm: probability that a further manoeuvre-free run raises one. run_length: mean
    time in s to one, the time flown by the number of alarms, with the interval of alarms that come at a constant rate.
    detection: share of first manoeuvres detected, and delay in s, see `roc.Onsets.delay`, both among the `runs` without an
    alarm before. Where no run of a twin is stored, thresholds are set on the steps before manoeuvres; false_alarm is then the
    probability of an alarm there, detection the share of all first manoeuvres, which are points of the curve, and run_length
    and delay are NaN. Without levels the usual ones are taken, as far as there are runs enough. Raises BadInput where there
    is no statistic or no manoeuvre, and for levels that need more runs.
    """
    first = roc.onsets(e.case, e.truth, e.estimate)
    if first is None:
        raise BadInput(f"{e.case.name}: no manoeuvre, or no statistic to detect it by; choose a detector and another case")
    used = e.estimate.ok & ~np.isnan(first.before)
    quiet = roc.peaks(e.calm)
    peaks = quiet if len(quiet) else np.sort(first.before[used])[::-1]
    rows = []
    for level in levels or [level for level in LEVELS if roc.place(level, len(peaks))]:
        place = roc.place(level, len(peaks))
        if not place:
            need = int(np.ceil(1 / level - 1e-9)) - 1
            words = f"{need} runs without manoeuvres, there are {len(peaks)}; run more, or name a higher level"
            raise BadInput(f"{e.case.name}: a false-alarm level of {level:g} needs {words}")
        threshold = peaks[place - 1 : place]
        above = int((peaks > threshold).sum())  # peaks at the threshold itself are no alarms
        tied = above + 1 < place
        low, high = betaincinv(above + 1, len(peaks) - above, roc.TAILS)
        false_alarm = ((above + 1) / (len(peaks) + 1), 0.0 if tied else low, high)
        if len(quiet):
            caught = first.detected(threshold)[0, used]
            counted = ~np.isnan(caught)
            delay, lasting = first.delay(threshold)[:, used], first.lasts[:, used].sum(0)
            times = NOTHING if tied else _run_length(e, threshold[0]), _delay(delay[:, counted], lasting.max(initial=0.0))
        else:
            caught = first.risen[-1, used] > threshold
            counted, times = np.ones(len(caught), bool), (NOTHING, NOTHING)
        count, runs = int(caught[counted].sum()), int(counted.sum())
        detection = (count / runs if runs else np.nan, *proportion(count, runs))
        rows.append((level, threshold[0], *false_alarm, *times[0], *detection, *times[1], runs, len(quiet)))
    return pandas.DataFrame(rows, columns=list(POINT))


def _run_length(e: Evidence, threshold: float) -> tuple[float, float, float]:
    """Time flown without manoeuvres, up to the first alarm in a run, by the number of alarms. Runs reach the threshold itself.

    The alarms are as many as the level says, chance is in the time: until a threshold that is lowered has so many alarms at a
    constant rate, it is gamma in units of the run length.
    """
    assert e.calm is not None
    assert e.calm.statistic is not None
    reached = np.logical_or.accumulate(e.calm.statistic[roc.SETTLED - 1 :, e.calm.ok] >= threshold)
    flying = np.vstack([np.ones(reached.shape[1], bool), ~reached[:-1]]).sum(1)
    flown, alarms = flying @ np.diff(e.case.time)[roc.SETTLED - 2 :], reached[-1].sum()
    low, high = flown / gammaincinv(alarms, roc.TAILS[::-1])
    return float(flown / alarms), float(low), float(high)


def _delay(delay: Array, longest: float) -> tuple[float, float, float]:
    """Mean of delays [1, R], none beyond the longest manoeuvre, with its interval."""
    if not delay.size:
        return NOTHING
    sample = means(delay / longest)
    low, high = bounded(sample)
    return float(sample.value[0]) * longest, low * longest, high * longest
