"""What the paper of `cases/vehicle.py` leaves open, swept: the sampling period, the horizon, the reading of the noise levels.

A plug-in, for `filterbench run --plugin cases/sweeps/vehicle.py -c 'sweep:vehicle:*' -e 'sir[particles=300]' ukf`.
"""

from dataclasses import replace

import numpy as np

from cases.vehicle import KNOWN_START, SCENARIOS, TIME, TOUR, VARIANCES, journey
from suite.case import FROM_ANOTHER, Case
from suite.model import AdditiveSensor, AdditiveTransition, StateSpaceModel
from suite.noise import Gaussian
from suite.published import Experiment

PERIODS = (0.1, 0.2, 0.35, 0.5, 0.7, 1.0, 2.0)  # s; those that divide neither horizon end it within a step
HORIZONS = (TIME, TOUR)  # s
UNSCENTED = "ukf[alpha=0.001]"
READINGS = {  # exponent that makes a variance of a printed level, and the assumption
    "variances": (1, VARIANCES),
    "deviations": (
        2,
        "The noise levels of Table 1 are read as standard deviations, as the paper calls them. Its three figures of the "
        "particle filter cannot all come out so from a known start.",
    ),
}


def swept(reading: str, scenario: int, period: float, time: float) -> Case:
    """A scenario with a sampling period and a horizon in seconds and a reading of the noise levels."""
    power, words = READINGS[reading]
    return journey(
        f"sweep:vehicle:{scenario}:{reading}:T{period:g}:{time:g}s",
        f"Land vehicle, scenario {scenario}, {reading}, T = {period:g} s, {time:g} s",
        "One of a sweep over what the paper leaves open.",
        scenario,
        words,
        KNOWN_START,
        T=period,
        time=time,
        power=power,
    )


def mistuned(scenario: int, period: float, time: float) -> Case:
    """A scenario whose filters are told covariances of one everywhere, and of the start, instead of its own."""
    paper = journey(
        f"sweep:vehicle:{scenario}:mistuned:T{period:g}:{time:g}s",
        f"Land vehicle, scenario {scenario}, filters told another model, T = {period:g} s, {time:g} s",
        "Filters are told the motion and the inputs, but all covariances are identities, as MATLAB's unscentedKalmanFilter has "
        "them where none are given.",
        scenario,
        VARIANCES,
        KNOWN_START,
        "Filters are told of process noise I on all four states, of measurement noise I and of a start with covariance I, in "
        "the units of the state; α = 0.001, too, is MATLAB's. This is a guess at how the printed figures of the unscented "
        "filter may have come about. Particle filters lose runs: told a variance of 1 where "
        "the measurement noise has 10 to 20, no particle of theirs explains some of the measurements.",
        T=period,
        time=time,
    )
    known = paper.model
    assert isinstance(known, StateSpaceModel)
    assert isinstance(known.dynamics, AdditiveTransition)
    assert isinstance(known.sensor, AdditiveSensor)
    told = StateSpaceModel(
        prior=Gaussian(known.prior.mean, np.eye(4)),
        dynamics=AdditiveTransition(known.dynamics.mean, Gaussian.diagonal([1.0] * 4)),
        sensor=AdditiveSensor(known.sensor.mean, Gaussian.diagonal([1.0] * 3)),
    )
    printed = next(figure for figure in paper.published if figure.estimator == "ukf")
    return replace(
        paper,
        model=told,
        origin=FROM_ANOTHER,
        published=(replace(printed, estimator=UNSCENTED, note="what the filter is told is not said"),),
        experiment=Experiment(printed.runs, (UNSCENTED,)),
    )


GRID = [(scenario, period, time) for time in HORIZONS for period in PERIODS for scenario in SCENARIOS]

CASES = (
    *(swept(reading, *point) for reading in READINGS for point in GRID),
    *(mistuned(*point) for point in GRID),
)
