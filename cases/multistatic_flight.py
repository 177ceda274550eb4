"""Multistatic radar (Benko and Kulmon) on synthetic flights: straight legs, turns and climbs; circles; draws of the model.

State, sensor and model as in `multistatic_radar`.
"""

import functools
from collections.abc import Sequence

import numpy as np

from cases.multistatic_radar import EXPERIMENT, OUTAGES_SAID, along, assumed, fly, scenario, with_outages
from suite.case import FROM_MODEL, Case, Truth, draw
from suite.kinematics import sinc
from suite.linalg import Array
from suite.model import StateSpaceModel
from suite.published import Experiment, Published
from suite.random import Generators

SPEED = 55.0  # m/s over the ground
START, HEADING = (-24_000.0, -8_000.0, 500.0), np.radians(15.0)  # m; counter-clockwise from the x axis
DEGREE = np.pi / 180
LEGS = (  # seconds, turn rate in degrees/s, counter-clockwise, climb in m/s
    (300, 0.0, 0.0),
    (60, 0.0, 1.5),
    (140, 0.0, 0.0),
    (30, 3.0, 0.0),
    (250, 0.0, 0.0),
    (40, -2.5, 0.0),
    (60, 0.0, -1.5),
    (120, 0.0, 0.0),
    (60, 1.5, 0.0),
    (132, 0.0, 0.0),
)
CENTRE, CENTRE_HEADING = (-3_000.0, -2_000.0, 500.0), 0.3  # m, rad
CURVATURES = (0.0, 0.001, 0.002, 0.003, 0.005, 0.008)  # 1/m
CIRCLE_STEPS, MATCHED_STEPS = 300, 120


def flown(place: Sequence[float], heading: float, legs: Sequence[tuple[int, float, float]]) -> Array:
    """States [T + 1, 6] at whole seconds of legs of (seconds, turn rate in rad/s, climb in m/s), at constant ground speed.

    Every second is flown exactly, along an arc; its vertical speed is that of its end. The initial one is 0.
    """
    seconds = [leg[0] for leg in legs]
    rate, climb = (np.repeat([leg[i] for leg in legs], seconds) for i in (1, 2))
    course = heading + np.concat([[0.0], np.cumsum(rate)])
    chord, middle = SPEED * sinc(rate / 2), course[:-1] + rate / 2
    moves = np.stack([chord * np.cos(middle), chord * np.sin(middle), climb], axis=1)
    position = place + np.concat([np.zeros((1, 3)), np.cumsum(moves, axis=0)])
    velocity = [SPEED * np.cos(course), SPEED * np.sin(course), np.concat([[0.0], climb])]
    return np.concat([position, np.stack(velocity, axis=1)], axis=1)


def journey(climbing: bool) -> Array:
    """States [T + 1, 6] of the flight through the quadrilateral, with its climbs or all at 500 m."""
    return flown(START, HEADING, [(seconds, rate * DEGREE, climb * climbing) for seconds, rate, climb in LEGS])


def circle(curvature: float) -> Array:
    """States [T + 1, 6] of a level flight of constant curvature (1/m) near the centre."""
    return flown(CENTRE, CENTRE_HEADING, [(CIRCLE_STEPS, SPEED * curvature, 0.0)])


def wander(model: StateSpaceModel, steps: int, rng: Generators) -> Truth:
    """Truth drawn from the model; nothing is measured during the outages."""
    return with_outages(draw(model, steps, rng))


TABLE_1 = tuple(
    Published(
        estimator,
        f"{which} {what} error, {where} the quadrilateral",
        value,
        unit,
        "Table 1",
        "another flight and site, real measurements",
        f"{which}-error",
        f"{what}, {where} quadrilateral",
        1,
    )
    for estimator, where, values in (
        ("sir", "inside", (79.56, 162.05, 10.33, 64.23)),
        ("auxiliary", "inside", (79.14, 166.38, 10.33, 65.07)),
        ("regularized", "inside", (87.66, 196.36, 10.17, 63.95)),
        ("sir", "outside", (236.83, 720.52, 14.26, 109.67)),
        ("auxiliary", "outside", (245.83, 817.49, 12.45, 113.21)),
        ("regularized", "outside", (273.17, 1018.21, 13.64, 111.95)),
    )
    for (which, what, unit), value in zip(
        (("mean", "position", "m"), ("maximum", "position", "m"), ("mean", "velocity", "m/s"), ("maximum", "velocity", "m/s")),
        values,
        strict=True,
    )
)


def claim(estimator: str, quantity: str, where: str, words: str, block: str, unit: str = "m", runs: int = 1) -> Published:
    """A claim without a number, which the mean error of a block bears on."""
    return Published(estimator, quantity, None, unit, where, f"Claimed: {words}.", "mean-error", block, runs)


CLAIMED = (
    claim("sis", "mean horizontal error", "section 3", "it does not catch even the trajectory's shape", "horizontal position"),
    claim("progressive", "mean horizontal error", "section 3", "as little as SIS", "horizontal position"),
    claim("ekf", "mean horizontal error", "section 4", "strong nonlinearity is critical for it", "horizontal position"),
    claim("ukf", "mean horizontal error", "section 4", "motion unlike the model is critical for it", "horizontal position"),
    claim(
        "sir[particles=100000]",
        "mean position error with more particles, inside the quadrilateral",
        "section 4",
        "no other than with 1000",
        "position, inside quadrilateral",
    ),
    claim(
        "sir[particles=100000]",
        "mean position error with more particles, outside the quadrilateral",
        "section 4",
        "larger than with 1000; tests reject that y, z and vx are the same",
        "position, outside quadrilateral",
    ),
    claim(
        "sir",
        "mean error of height, inside the quadrilateral",
        "section 3",
        "all filters have trouble with z",
        "height, inside quadrilateral",
    ),
    claim(
        "sir",
        "mean horizontal error, outside the quadrilateral",
        "section 3",
        "all filters have trouble with y",
        "horizontal position, outside quadrilateral",
    ),
    claim(
        "auxiliary",
        "mean position error, rank of the filters",
        "section 3",
        "the smallest, and SIR's the largest; in Table 1 the regularized filter's is",
        "position",
    ),
    Published("sir", "bias while some pairs are out", None, "m", "section 4", "Claimed: none that is significant.", runs=1),
)
FIGURE_8 = (
    claim(
        "sir",
        "mean position error, against curvature",
        "figure 8 and section 4",
        "it depends on the curvature, of which 0.005 per metre is about the limit for a real aircraft",
        "position",
        runs=0,
    ),
    claim(
        "regularized",
        "mean position error, rank of the filters",
        "figure 8 and section 4",
        "the smallest, as its particles stay diverse",
        "position",
        runs=0,
    ),
    claim("sir", "mean velocity error", "section 3", "no correlation with the acceleration", "velocity", "m/s", runs=0),
)


def synthetic(
    name: str, title: str, climbing: bool, words: str, published: tuple[Published, ...], experiment: Experiment
) -> Case:
    """The flight through the quadrilateral."""
    track = journey(climbing)
    return scenario(
        name,
        title,
        "A light aircraft flies at 55 m/s into a multistatic radar's quadrilateral of transmitters and receivers, turns, and "
        "leaves it again. Bistatic range and range-rate of four pairs are measured, with outages. The filters assume nearly "
        f"constant velocity; the truth is not drawn from that model. {words}",
        track,
        functools.partial(fly, track),
        (
            f"Chosen here: the flight. It starts at (-24, -8, 0.5) km on a course of 15° from the x axis, at {SPEED:g} m/s "
            "over the ground (the paper's Cessna 172 cruises at about 60). It turns at 3°/s for 30 s from step 500, at -2.5°/s "
            "for 40 s from 780, at 1.5°/s for 60 s from 1000, along exact arcs. It is inside the quadrilateral at steps 264 to "
            "710, 447 in all.",
            words,
            OUTAGES_SAID,
            "The paper does not say how many particles its table had, nor when its filters resample. Where it varies the "
            "number it is 1000 or 100000: here 1000 for the table. Filters resample when less than half are effective.",
        ),
        published=published,
        experiment=experiment,
    )


def curved(curvature: float) -> Case:
    """A circle of the sweep over curvatures."""
    track, rate = circle(curvature), SPEED * curvature
    return scenario(
        f"curvature-{curvature:g}",
        f"Multistatic radar, level flight of curvature {curvature:g}/m",
        "A target flies level and at constant speed, along a circle or straight on, near the centre of a multistatic radar. "
        "The filters assume nearly constant velocity: the sharper it turns, the less that is so.",
        track,
        functools.partial(along, track),
        (
            f"Chosen here: {SPEED:g} m/s, 300 s, from (-3, -2, 0.5) km on a course of 0.3 rad from the x axis, to the left. "
            "The paper states the plane z = 500 m and that the acceleration is constant, but no speed, place or duration.",
            f"A curvature of {curvature:g}/m is a turn of {rate / DEGREE:.3g}°/s with {rate * SPEED:.3g} m/s² of acceleration. "
            + (
                "The straight flight leaves the quadrilateral after 247 s."
                if curvature == 0
                else "The flight stays inside the quadrilateral."
            ),
            "No outages.",
        ),
        published=FIGURE_8 if curvature == 0.005 else (),
        experiment=Experiment(100, ("sir", "auxiliary", "regularized", "ekf", "ukf")),
    )


def matched() -> Case:
    """Flights drawn from the model."""
    track = circle(0.0)[: MATCHED_STEPS + 1]
    return scenario(
        "synthetic-matched",
        "Multistatic radar, flights drawn from the model",
        "A target flies through a multistatic radar's quadrilateral of transmitters and receivers; its acceleration is that of "
        "the model which the filters are told. Bistatic range and range-rate of four pairs are measured, with an outage.",
        track,
        functools.partial(wander, assumed(track[0]), MATCHED_STEPS),
        (
            "Not in the paper: its motion drawn from its model, so that the Cramér-Rao bound is one.",
            "Chosen here: 120 s, from (-3, -2, 0.5) km at 55 m/s on a course of 0.3 rad at first. Nothing in the model holds "
            "the target back: over the 1192 s its speed would go astray by 289 m/s and its place by 199 km on each axis, one "
            "standard deviation. In 120 s these are 92 m/s and 6.4 km, and 11 m in height: it stays above ground, and inside "
            "the quadrilateral in 96 % of the steps.",
            "The outage is the first of the flight's: all pairs at steps 101-115.",
        ),
        origin=FROM_MODEL,
        experiment=None,
    )


CASES = (
    synthetic(
        "synthetic",
        "Multistatic radar, synthetic flight",
        True,
        "It climbs by 90 m from step 300 to 360, at 1.5 m/s, and sinks back from step 820 to 880, which the paper's Q all but "
        "forbids.",
        (*TABLE_1, *CLAIMED),
        Experiment(EXPERIMENT.runs, (*EXPERIMENT.estimators, "sir[particles=100000]")),
    ),
    synthetic(
        "synthetic-level",
        "Multistatic radar, synthetic flight, level",
        False,
        "It stays at 500 m: what the climbs of `multistatic-radar/synthetic` cost is seen by comparison.",
        (),
        EXPERIMENT,
    ),
    matched(),
    *(curved(curvature) for curvature in CURVATURES),
)
