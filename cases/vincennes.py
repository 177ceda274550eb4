"""A car in town: recorded GPS fixes, held against the recorded trajectory of an inertial reference.

State (x, y, vx, vy), local east and north coordinates in m and m/s.
"""

import functools
from pathlib import Path

import numpy as np
import pandas
import pymap3d

from suite.case import RECORDED, Case, Divergence, Equation, StateBlock, Truth
from suite.linalg import Array
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian
from suite.random import Generators

T = 1.0  # s, between fixes
FIRST, LAST = 47231, 47700  # s of the day, GPS time
STEPS = LAST - FIRST
LEAP_SECONDS = 18.0  # GPS time less UTC in 2019
THURSDAY = 4 * 86400.0  # s of the week
LONGEST = 3.0  # s, between two rows of the reference that are joined by a line
SIGMA = 2.4  # m, of a fix on each axis
INTENSITY = 0.15  # m²/s³, of the acceleration on each axis
SPEED = 7.0  # m/s, standard deviation of the unknown velocity at first, on each axis
FIXES = Path(__file__).parent / "data" / "vincennes_fixes.csv"
REFERENCE = Path(__file__).parent / "data" / "vincennes_reference.csv"


def lambert93(easting: Array, northing: Array) -> tuple[Array, Array]:
    """Latitude and longitude in degrees (RGF93) of Lambert-93 coordinates in m (Snyder, 1987, eqs 15-1 to 15-11)."""
    axis, flattening = 6_378_137.0, 1 / 298.257222101
    e = np.sqrt(flattening * (2 - flattening))

    def isometric(latitude: float) -> float:
        return float(np.atanh(np.sin(latitude)) - e * np.atanh(e * np.sin(latitude)))

    def parallel(latitude: float) -> float:
        return float(np.cos(latitude) / np.sqrt(1 - (e * np.sin(latitude)) ** 2))

    south, origin, north = np.radians([44.0, 46.5, 49.0])
    cone = np.log(parallel(south) / parallel(north)) / (isometric(north) - isometric(south))
    radius = axis * parallel(south) / cone * np.exp(cone * isometric(south))
    east, down = easting - 700_000, radius * np.exp(-cone * isometric(origin)) - (northing - 6_600_000)
    height = -np.log(np.sqrt(east * east + down * down) / radius) / cone
    sine = np.tanh(height)
    for _ in range(10):  # each leaves 1/150 of the error
        sine = np.tanh(height + e * np.atanh(e * sine))
    return np.degrees(np.asin(sine)), 3 + np.degrees(np.atan2(east, down) / cone)


@functools.cache
def drive() -> tuple[Array, Array]:
    """Recorded fixes [T + 1, 2] and states [T + 1, 4] at each second, NaN where there are none; rounded to 1 mm and 1 mm/s."""
    fixes, reference = pandas.read_csv(FIXES), pandas.read_csv(REFERENCE)
    origin = fixes.lat_deg.median(), fixes.lon_deg.median()

    def local(latitude: Array, longitude: Array) -> Array:
        east, north, _ = pymap3d.geodetic2enu(latitude, longitude, 0.0, *origin, 0.0)
        return np.round(np.stack([east, north], axis=1), 3)

    seconds = np.arange(FIRST, LAST + 1)
    fixed = np.full((len(seconds), 2), np.nan)
    fixed[np.rint(fixes.t_gps_s).astype(int) - FIRST] = local(fixes.lat_deg.to_numpy(), fixes.lon_deg.to_numpy())
    known = local(*lambert93(reference.easting_m.to_numpy(), reference.northing_m.to_numpy()))
    clock = reference.t_utc_s.to_numpy() - THURSDAY + LEAP_SECONDS
    place = np.stack([np.interp(seconds, clock, axis) for axis in known.T], axis=1)
    after = np.searchsorted(clock, seconds)
    place[clock[after] - clock[after - 1] > LONGEST] = np.nan
    return fixed, np.round(np.concatenate([place, np.gradient(place, T, axis=0)], axis=1), 3)


def driven(rng: Generators) -> Truth:
    """The one recorded drive and its fixes in every run; nothing is drawn."""
    fixed, x = drive()
    return Truth(np.repeat(x[1:, :, None], rng.runs, axis=2), np.repeat(fixed[1:, :, None], rng.runs, axis=2))


MODEL = StateSpaceModel(
    prior=Gaussian([*drive()[0][0], 0.0, 0.0], np.diag([SIGMA, SIGMA, SPEED, SPEED]) ** 2),
    dynamics=AdditiveTransition(
        Affine(np.kron([[1.0, T], [0.0, 1.0]], np.eye(2))),
        Gaussian.noise(INTENSITY * np.kron([[T**3 / 3, T**2 / 2], [T**2 / 2, T]], np.eye(2))),
    ),
    sensor=AdditiveSensor(Affine(np.eye(2, 4)), Gaussian.diagonal([SIGMA**2] * 2)),
    linear=(2, 3),
)

CASES = (
    Case(
        name="vehicle/vincennes",
        title="A car in town, recorded GPS fixes",
        summary="A car drives through Vincennes for eight minutes. The measurements are its recorded stand-alone GPS fixes, "
        "once a second, and the truth is the trajectory of an inertial reference: neither the heavy tails of the fixes among "
        "houses nor the motion was chosen by anybody. Filters assume nearly constant velocity and Gaussian fixes.",
        steps=STEPS,
        interval=T,
        state=("x", "y", "vx", "vy"),
        blocks=(StateBlock("position", (0, 1), "m"), StateBlock("velocity", (2, 3), "m/s")),
        divergence=Divergence("position", limit=50.0, steps=10),
        reference="IGN, drive through Vincennes on 12 September 2019, as distributed with tracklib, "
        "https://github.com/umrlastig/tracklib",
        equations=(
            Equation(
                "Nearly constant velocity",
                r"\begin{pmatrix} r_k \\ v_k \end{pmatrix} = \begin{pmatrix} I & T I \\ 0 & I \end{pmatrix} "
                r"\begin{pmatrix} r_{k-1} \\ v_{k-1} \end{pmatrix} + w_k, \quad T = 1\ \mathrm{s}",
            ),
            Equation(
                "Process noise: white acceleration",
                r"w_k \sim N\left(0,\; q \begin{pmatrix} T^3/3 & T^2/2 \\ T^2/2 & T \end{pmatrix} \otimes I \right), \quad "
                rf"q = {INTENSITY:g}\ \mathrm{{m^2/s^3}}",
            ),
            Equation("Fix", rf"y_k = r_k + e_k, \quad e_k \sim N(0, \sigma^2 I), \quad \sigma = {SIGMA:g}\ \mathrm{{m}}"),
        ),
        assumptions=(
            "All runs are the same recorded drive: filters that draw no random numbers give the same estimate in every run, "
            "and the intervals of the others tell of their own random numbers alone, not of other drives.",
            "The truth is the reference, joined by lines between its rows (every 3 to 6 m of way), with its velocity by "
            "central differences over 2 s. In four gaps of 4 to 23 s, in which the car moved 3 to 6 m, it is unknown: 60 steps "
            "of 469 in position and 68 in velocity do not count. GPS time is UTC + 18 s.",
            "Not corrected: the reference is the camera's place, not the antenna's, and in RGF93, from which GPS had moved by "
            "about 0.7 m in 2019. The mean error of the fixes is 0.7 m east and -2.1 m north.",
            "Measured on the fixes: scaled median absolute deviation 1.6 m east, 3.1 m north and 2.4 m of both together, which "
            "filters are told; their standard deviations are 3.3 m and 4.4 m, the largest error is 29 m, and errors of "
            "successive fixes are correlated by 0.6 and 0.8, which filters are not told.",
            f"The process noise is the mean square change of the reference's velocity over one second, {INTENSITY:g} m²/s² an "
            "axis. Nothing was chosen by what filters make of it.",
            "The prior knows the first fix, with the deviation of a fix, and of the velocity only that it is that of a car in "
            f"town: {SPEED:g} m/s on each axis. Five fixes of the 470 are missing.",
            "A run has diverged when it is more than 50 m off for 10 s on end.",
        ),
        plane=(0, 1),
        model=MODEL,
        generate=driven,
        origin=RECORDED,
        data=(FIXES, REFERENCE),
    ),
)
