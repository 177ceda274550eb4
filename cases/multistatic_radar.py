"""Multistatic radar (Benko and Kulmon): bistatic range and range-rate of two transmitters and two receivers.

State (x, y, z, vx, vy, vz), local east-north-up coordinates in m and m/s. Here the geometry, the model and a recorded flight;
synthetic flights are in `multistatic_flight`.
"""

import functools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas
import pymap3d
from numpy.typing import NDArray

from suite.case import GIVEN_TRACK, Case, Divergence, Equation, Region, StateBlock, Truth, measure
from suite.linalg import Array
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian
from suite.published import Experiment, Published
from suite.random import Generators

# Symbols as in the paper.
DT = 1.0  # s
STEPS = 1192
Q = (700.0, 700.0, 1.0, 70.0, 70.0, 1e-6)  # m², (m/s)², a step
R = (400.0, 400.0, 400.0, 400.0, 4.0, 4.0, 4.0, 4.0)  # m², (m/s)²
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
QUADRILATERAL = Region("quadrilateral", tuple(SITES[name][:2] for name in ("Rx1", "Tx1", "Rx2", "Tx2")))
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


def observed() -> NDArray[np.bool_]:
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


SENSOR = AdditiveSensor(bistatic, Gaussian.diagonal(R), jacobian_of_mean=bistatic_slope)


def along(track: Array, rng: Generators) -> Truth:
    """The states track[T + 1, 6] in every run, measured with fresh noise at every step but the initial one."""
    x = np.repeat(track[1:, :, None], rng.runs, axis=2)
    return Truth(x, measure(SENSOR, x, rng))


def with_outages(truth: Truth) -> Truth:
    """The same, but nothing is measured during the outages."""
    return Truth(truth.x, np.where(observed()[: len(truth.y), :, None], truth.y, np.nan))


def fly(track: Array, rng: Generators) -> Truth:
    """The states track[T + 1, 6] in every run, measured with fresh noise except during the outages."""
    return with_outages(along(track, rng))


def assumed(start: Array, vertical: float = Q[5]) -> StateSpaceModel:
    """What filters assume from start[6] on: nearly constant velocity, with Q but for its last entry, of vertical speed."""
    motion = np.kron([[1.0, DT], [0.0, 1.0]], np.eye(3))
    variances = (*Q[:5], vertical)
    return StateSpaceModel(
        prior=Gaussian(start, np.diag(variances)),
        dynamics=AdditiveTransition(Affine(motion), Gaussian.diagonal(variances)),
        sensor=SENSOR,
        linear=(3, 4, 5),  # given the position, range-rate is linear in velocity
    )


PAPER = "M. Benko, P. Kulmon, Aplikácia časticových filtrov na merania multistatického radaru (in Slovak)"
STATED = (
    "Stated in the paper: motion and Q; measurements and R, of which those that are missing drop out; the start x(0) from GPS "
    "and the first noise from N(0, Q), which is the prior N(x(0), Q) here; 1192 instants; the posterior mean as the estimate."
)
TYPOS = (
    "Corrected: the measurement's function goes from Rⁿ × Rᵐ, not Rᵐ × Rᵐ, to Rᵐ; E(f(x|Y)) means the mean of the posterior. A "
    "Q that suits all time steps would grow with Δt; it is kept as printed. Chosen here: Δt = 1 s, which the paper leaves open."
)
OUTAGES_SAID = (
    "Outages: all pairs at steps 101-115 and 901-920, the pairs of Tx2 at 421-480, those of Tx1 at 1001-1060. The paper says "
    "only that a transmitter failed at times. No clutter; the paper removed it beforehand."
)
EXPERIMENT = Experiment(20, ("sir", "auxiliary", "regularized", "sis", "progressive", "ekf", "ukf"))
"""What the paper ran, on one flight and once as it seems; here 20 times, so that there is an interval over runs."""


def scenario(
    name: str,
    title: str,
    summary: str,
    track: Array,
    generate: Callable[[Generators], Truth],
    assumptions: tuple[str, ...],
    *,
    vertical: float = Q[5],
    origin: str = GIVEN_TRACK,
    reference: str = PAPER,
    published: tuple[Published, ...] = (),
    experiment: Experiment | None = EXPERIMENT,
    data: tuple[Path, ...] = (),
) -> Case:
    """A case of the family: filters start from track[0] of track[T + 1, 6], with the `vertical` of `assumed`."""
    exponent = r"10^{-6}" if vertical == 1e-6 else f"{vertical:g}"
    return Case(
        name=f"multistatic-radar/{name}",
        title=title,
        summary=summary,
        steps=len(track) - 1,
        interval=DT,
        state=("x", "y", "z", "vx", "vy", "vz"),
        blocks=(
            StateBlock("horizontal position", (0, 1), "m"),
            StateBlock("height", (2,), "m"),
            StateBlock("position", (0, 1, 2), "m"),
            StateBlock("horizontal velocity", (3, 4), "m/s"),
            StateBlock("vertical velocity", (5,), "m/s"),
            StateBlock("velocity", (3, 4, 5), "m/s"),
        ),
        divergence=Divergence("horizontal position", limit=1000.0, steps=10),
        reference=reference,
        equations=(
            Equation(
                "Nearly constant velocity",
                r"\begin{pmatrix} r_k \\ v_k \end{pmatrix} = \begin{pmatrix} I & \Delta t\, I \\ 0 & I \end{pmatrix} "
                r"\begin{pmatrix} r_{k-1} \\ v_{k-1} \end{pmatrix} + u_{k-1}, \quad \Delta t = 1\ \mathrm{s}",
            ),
            Equation("Process noise", rf"u_k \sim N(0, Q), \quad Q = \mathrm{{diag}}(700, 700, 1, 70, 70, {exponent})"),
            Equation(
                "Bistatic range of receiver i and transmitter j",
                r"r_{B,ij} = \| r - r_{Rx_i} \| + \| r - r_{Tx_j} \| + w_r, \quad w_r \sim N(0, 400\ \mathrm{m^2})",
            ),
            Equation(
                "Bistatic range-rate",
                r"v_{B,ij} = \left( \frac{r - r_{Rx_i}}{\| r - r_{Rx_i} \|} + \frac{r - r_{Tx_j}}{\| r - r_{Tx_j} \|} "
                r"\right)^\top v + w_v, \quad w_v \sim N(0, 4\ \mathrm{m^2/s^2})",
            ),
        ),
        assumptions=(
            STATED,
            TYPOS,
            "Sites and flight of the paper are unpublished. Here the sites are the corners of a square of 20 km, 20 to 60 m "
            "high, in the printed order Rx1, Tx1, Rx2, Tx2, around the origin: an invention, not tuned to the paper's figures.",
            *assumptions,
            "The paper tells inside and outside of the quadrilateral apart by the estimate, here it is done by the truth, so "
            "that all filters are judged on the same steps.",
            "Nothing keeps a particle above the ground, and the radar hardly tells it from its mirror image below the sites. "
            "At a site itself a range-rate is 0/0 and left undefined.",
            "A run has diverged when it is more than 1 km off horizontally for 10 steps on end.",
        ),
        published=published,
        plane=(0, 1),
        landmarks=tuple((site, east, north) for site, (east, north, _) in SITES.items()),
        regions=(QUADRILATERAL,),
        model=assumed(track[0], vertical),
        generate=generate,
        origin=origin,
        experiment=experiment,
        data=data,
    )


def recorded_flight(name: str, title: str, vertical: float, words: str, assumption: str) -> Case:
    """A case on the recorded flight; `vertical` is the variance of vertical speed that the filters assume."""
    return scenario(
        name,
        title,
        "Twenty minutes of a real flight, with climbs and turns, are measured by a simulated multistatic radar: "
        "bistatic range and range-rate of four transmitter-receiver pairs, with outages. The filters assume nearly "
        "constant velocity; the truth is not drawn from that model. " + words,
        flight(),
        functools.partial(fly, flight()),
        (
            "The flight is another one (PH-LAB, 20 March 2017): of all stretches of 1192 s, the paper's number of instants, "
            "the one with the most time in turns, about its median position. Velocity is the central difference of the "
            "recorded position.",
            assumption,
            OUTAGES_SAID,
        ),
        vertical=vertical,
        reference=f"{PAPER}; flight: J. Sun, openap, PH-LAB flight test data of 20 March 2017",
        data=(FLIGHT,),
    )


CASES = (
    recorded_flight(
        "phlab",
        "Multistatic radar, recorded flight of a Cessna Citation",
        Q[5],
        "The process noise is the paper's, which all but forbids a change of vertical speed.",
        "The vertical entries of the paper's Q (1 m² and 1e-6 m²/s²) suit level flight; this aircraft climbs and sinks at up "
        "to 21 m/s, so every filter must lag in height. `multistatic-radar/phlab-climb` shows what that costs.",
    ),
    recorded_flight(
        "phlab-climb",
        "Multistatic radar, recorded flight, filters told that it climbs",
        1.0,
        "The process noise allows for climbs, other than the paper's.",
        "The process noise is the paper's but for vertical speed: 1 m²/s² a step instead of 1e-6, the size of this aircraft's "
        "recorded changes of vertical speed (0.9 m/s from one second to the next, root mean square).",
    ),
)
