"""Multistatic radar (Benko and Kulmon): bistatic range and range-rate of two transmitters and two receivers.

State (x, y, z, vx, vy, vz), local east-north-up coordinates in m and m/s.
"""

import functools
from pathlib import Path

import numpy as np
import pandas
import pymap3d

from suite.case import GIVEN_TRACK, Case, Divergence, Equation, StateBlock, Truth, measure
from suite.linalg import Array
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian
from suite.published import Published
from suite.random import Generators

DT = 1.0  # s
STEPS = 1192
SITES = {
    "Rx1": (-10_000.0, -10_000.0, 20.0),
    "Rx2": (10_000.0, 10_000.0, 30.0),
    "Tx1": (-10_000.0, 10_000.0, 60.0),
    "Tx2": (10_000.0, -10_000.0, 40.0),
}
SITE_AXES = np.array(list(SITES.values())).T
NAMES = tuple(SITES)
PAIRS = (("Rx1", "Tx1"), ("Rx1", "Tx2"), ("Rx2", "Tx1"), ("Rx2", "Tx2"))
RECEIVER = [NAMES.index(rx) for rx, _ in PAIRS]
TRANSMITTER = [NAMES.index(tx) for _, tx in PAIRS]
SIGMA_RANGE, SIGMA_RATE = 20.0, 2.0  # m, m/s
OUTAGES = (  # first and last step, pairs without measurement
    (101, 115, PAIRS),
    (421, 480, tuple(p for p in PAIRS if p[1] == "Tx2")),
    (901, 920, PAIRS),
    (1001, 1060, tuple(p for p in PAIRS if p[1] == "Tx1")),
)
FLIGHT = Path(__file__).parent / "data" / "phlab_20170320_10.csv"


def bistatic(x: Array, k: int) -> Array:
    """Bistatic ranges (m) of the four pairs, then their range-rates (m/s), for x[6, ...]: [8, ...]."""
    sites = SITE_AXES.reshape(3, -1, *(1,) * (x.ndim - 1))
    east, north, up = x[0] - sites[0], x[1] - sites[1], x[2] - sites[2]
    distance = np.sqrt(east * east + north * north + up * up)
    rate = (east * x[3] + north * x[4] + up * x[5]) / distance
    return np.concat([distance[RECEIVER] + distance[TRANSMITTER], rate[RECEIVER] + rate[TRANSMITTER]])


def bistatic_slope(x: Array, k: int) -> Array:
    """Derivative [8, 6, ...] of `bistatic`: each site adds its unit vector u, and (v - (u v) u) / distance."""
    sites = SITE_AXES.reshape(3, -1, *(1,) * (x.ndim - 1))
    away, v = x[:3, None] - sites, x[3:, None]
    distance = np.sqrt(away[0] * away[0] + away[1] * away[1] + away[2] * away[2])
    away /= distance
    rate = away[0] * v[0] + away[1] * v[1] + away[2] * v[2]
    turn = (v - rate * away) / distance
    slope = np.zeros((2 * len(PAIRS), *x.shape))
    slope[: len(PAIRS), :3] = slope[len(PAIRS) :, 3:] = np.swapaxes(away[:, RECEIVER] + away[:, TRANSMITTER], 0, 1)
    slope[len(PAIRS) :, :3] = np.swapaxes(turn[:, RECEIVER] + turn[:, TRANSMITTER], 0, 1)
    return slope


def observed() -> Array:
    """Which measurement components are there at each step: booleans [T, 8]."""
    there = np.ones((STEPS, 2, len(PAIRS)), bool)
    for first, last, pairs in OUTAGES:
        for pair in pairs:
            there[first - 1 : last, :, PAIRS.index(pair)] = False
    return there.reshape(STEPS, -1)


@functools.cache
def flight() -> Array:
    """States of the recorded flight [T + 1, 6], from the initial one; rounded to 1 mm and 1 mm/s on any machine."""
    track = pandas.read_csv(FLIGHT)
    latitude, longitude, height = track.lat_deg, track.lon_deg, track.alt_gnss_ft * 0.3048
    east, north, up = pymap3d.geodetic2enu(
        latitude.to_numpy(), longitude.to_numpy(), height.to_numpy(), latitude.median(), longitude.median(), 0.0
    )
    position = np.round(np.stack([east, north, up], axis=1), 3)
    return np.concatenate([position, np.round(np.gradient(position, DT, axis=0), 3)], axis=1)


SENSOR = AdditiveSensor(
    bistatic,
    Gaussian.diagonal([SIGMA_RANGE**2] * len(PAIRS) + [SIGMA_RATE**2] * len(PAIRS)),
    jacobian_of_mean=bistatic_slope,
)


def fly(rng: Generators) -> Truth:
    """The recorded flight in every run, measured with fresh noise; nothing is measured during the outages."""
    x = np.repeat(flight()[1:, :, None], rng.runs, axis=2)
    y = measure(SENSOR, x, rng)
    return Truth(x, np.where(observed()[:, :, None], y, np.nan))


def assumed(vertical: float) -> StateSpaceModel:
    """What the filters assume: nearly constant velocity, with the given variance of vertical speed a step, m²/s²."""
    motion = np.kron([[1.0, DT], [0.0, 1.0]], np.eye(3))
    variances = (700.0, 700.0, 1.0, 70.0, 70.0, vertical)  # m², (m/s)², a step
    return StateSpaceModel(
        prior=Gaussian(flight()[0], np.diag(variances)),
        dynamics=AdditiveTransition(Affine(motion), Gaussian.diagonal(variances)),
        sensor=SENSOR,
        linear=(3, 4, 5),  # given the position, range-rate is linear in velocity
    )


TABLE_1 = tuple(
    Published(method, f"{which} {what} error, {where} the quadrilateral", value, unit, "Table 1", "another flight and site")
    for method, where, values in (
        ("SIR", "inside", (79.56, 162.05, 10.33, 64.23)),
        ("auxiliary", "inside", (79.14, 166.38, 10.33, 65.07)),
        ("regularized", "inside", (87.66, 196.36, 10.17, 63.95)),
        ("SIR", "outside", (236.83, 720.52, 14.26, 109.67)),
        ("auxiliary", "outside", (245.83, 817.49, 12.45, 113.21)),
        ("regularized", "outside", (273.17, 1018.21, 13.64, 111.95)),
    )
    for (which, what, unit), value in zip(
        (("mean", "position", "m"), ("maximum", "position", "m"), ("mean", "velocity", "m/s"), ("maximum", "velocity", "m/s")),
        values,
        strict=True,
    )
)


def recorded_flight(name: str, title: str, vertical: float, words: str, assumption: str) -> Case:
    """A case on the recorded flight; `vertical` is the variance of vertical speed that the filters assume."""
    exponent = r"10^{-6}" if vertical == 1e-6 else f"{vertical:g}"
    return Case(
        name=name,
        title=title,
        summary="Twenty minutes of a real flight, with climbs and turns, are measured by a simulated multistatic radar: "
        "bistatic range and range-rate of four transmitter-receiver pairs, with outages. The filters assume nearly "
        "constant velocity; the truth is not drawn from that model. " + words,
        steps=STEPS,
        interval=DT,
        state=("x", "y", "z", "vx", "vy", "vz"),
        blocks=(
            StateBlock("horizontal position", (0, 1), "m"),
            StateBlock("height", (2,), "m"),
            StateBlock("horizontal velocity", (3, 4), "m/s"),
            StateBlock("vertical velocity", (5,), "m/s"),
        ),
        divergence=Divergence("horizontal position", limit=1000.0, steps=10),
        reference="M. Benko, P. Kulmon, Aplikácia časticových filtrov na merania multistatického radaru (in Slovak); "
        "flight: J. Sun, openap, PH-LAB flight test data of 20 March 2017",
        equations=(
            Equation(
                "Nearly constant velocity",
                r"\begin{pmatrix} r_k \\ v_k \end{pmatrix} = \begin{pmatrix} I & \Delta t\, I \\ 0 & I \end{pmatrix} "
                r"\begin{pmatrix} r_{k-1} \\ v_{k-1} \end{pmatrix} + w_k, \quad \Delta t = 1\ \mathrm{s}",
            ),
            Equation("Process noise", rf"w_k \sim N(0, \mathrm{{diag}}(700, 700, 1, 70, 70, {exponent}))"),
            Equation(
                "Bistatic range of receiver i and transmitter j",
                r"\rho_{ij} = \| r - s_i \| + \| r - t_j \| + e_\rho, \quad e_\rho \sim N(0, 20^2\ \mathrm{m^2})",
            ),
            Equation(
                "Bistatic range-rate",
                r"\dot\rho_{ij} = \left( \frac{r - s_i}{\| r - s_i \|} + \frac{r - t_j}{\| r - t_j \|} \right) "
                r"\cdot v + e_v, \quad e_v \sim N(0, 2^2\ \mathrm{m^2/s^2})",
            ),
        ),
        assumptions=(
            "The paper's flight and sensor sites are unpublished. Here the sites are the corners of a square of 20 km around "
            "the median position of the flight, 20 to 60 m high, in the printed order Rx1, Tx1, Rx2, Tx2.",
            "The flight is another one (PH-LAB, 20 March 2017): of all stretches of 1192 s, the paper's number of instants, "
            "the one with the most time in turns. Velocity is the central difference of the recorded position.",
            assumption,
            "The prior is the recorded initial state with the process noise as its covariance, as in the paper.",
            "Outages: all pairs at steps 101-115 and 901-920, the pairs of Tx2 at 421-480, those of Tx1 at 1001-1060. "
            "No clutter; the paper removed it beforehand.",
            "A run has diverged when it is more than 1 km off horizontally for 10 steps on end.",
        ),
        published=TABLE_1,
        plane=(0, 1),
        landmarks=tuple((name, east, north) for name, (east, north, _) in SITES.items()),
        model=assumed(vertical),
        generate=fly,
        origin=GIVEN_TRACK,
        data=(FLIGHT,),
    )


CASES = (
    recorded_flight(
        "multistatic-radar/phlab",
        "Multistatic radar, recorded flight of a Cessna Citation",
        1e-6,
        "The process noise is the paper's, which all but forbids a change of vertical speed.",
        "The process noise is the paper's, once a step. Its vertical entries (1 m² and 1e-6 m²/s²) suit level flight; this "
        "aircraft climbs and sinks at up to 21 m/s, so every filter must lag in height. `multistatic-radar/phlab-climb` "
        "shows what that costs.",
    ),
    recorded_flight(
        "multistatic-radar/phlab-climb",
        "Multistatic radar, recorded flight, filters told that it climbs",
        1.0,
        "The process noise allows for climbs, other than the paper's.",
        "The process noise is the paper's but for vertical speed: 1 m²/s² a step instead of 1e-6, the size of this aircraft's "
        "recorded changes of vertical speed (0.9 m/s from one second to the next, root mean square).",
    ),
)
