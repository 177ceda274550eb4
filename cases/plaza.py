"""Ranges to four radio beacons, one at a time, recorded on a robot that drove on a plaza (Djugash, Hamner and Roth).

State (x, y, vx, vy) in m and m/s.
"""

import functools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas

from suite.case import RECORDED, Case, Divergence, Equation, StateBlock, Truth
from suite.kinematics import polynomial
from suite.linalg import Array
from suite.model import AdditiveSensor, StateSpaceModel
from suite.noise import Gaussian
from suite.random import Generators

BEACONS = (0, 1, 5, 6)  # their numbers in the recordings
SCALE, SIGMA_SCALED = 1.07, 0.54  # range over distance, and deviation in m from that, both on the first drive
HALF = 0.5  # s, half the time over which velocities are differences
PRIOR = (2.0, 2.0, 1.0, 1.0)  # m and m/s, standard deviations at first
DATA = Path(__file__).parent / "data"


@dataclass(frozen=True)
class Drive:
    """A recorded drive: its files, where the beacons stood (m), by number, and what was measured on it (m, m²/s³)."""

    name: str
    beacons: tuple[tuple[float, float], ...]
    sigma: float
    intensity: float

    @property
    def ranges(self) -> Path:
        """File of the ranges."""
        return DATA / f"{self.name}_ranges.csv"

    @property
    def track(self) -> Path:
        """File of the positions."""
        return DATA / f"{self.name}_track.csv"


SLOW = Drive(
    "plaza1", ((-46.623234, 11.025549), (11.036124, -6.958689), (-17.664893, 59.009181), (22.053129, 23.848482)), 1.3, 0.024
)
FAST = Drive(
    "plaza2", ((-33.620537, 26.967797), (-68.926537, 18.377797), (1.709463, -5.812203), (-37.580537, 69.227797)), 1.8, 0.28
)


@functools.cache
def recorded(drive: Drive) -> tuple[Array, Array, Array]:
    """Times [T + 1] of the ranges, from that of x_0 on, ranges [T + 1, 4], NaN but for the one, and states [T + 1, 4]."""
    ranges, track = pandas.read_csv(drive.ranges), pandas.read_csv(drive.track)
    t, clock = ranges.t_s.to_numpy(), track.t_s.to_numpy()
    y = np.full((len(t), len(BEACONS)), np.nan)
    y[np.arange(len(t)), np.searchsorted(BEACONS, ranges.beacon)] = ranges.range_m

    def place(at: Array) -> Array:
        return np.stack([np.interp(at, clock, axis) for axis in (track.x_m, track.y_m)], axis=1)

    before, after = np.maximum(t - HALF, clock[0]), np.minimum(t + HALF, clock[-1])
    velocity = (place(after) - place(before)) / (after - before)[:, None]
    return t, y, np.round(np.concatenate([place(t), velocity], axis=1), 3)


def driven(drive: Drive, rng: Generators) -> Truth:
    """The one recorded drive and its ranges in every run; nothing is drawn."""
    _, y, x = recorded(drive)
    return Truth(np.repeat(x[1:, :, None], rng.runs, axis=2), np.repeat(y[1:, :, None], rng.runs, axis=2))


def assumed(drive: Drive, scale: float, sigma: float) -> StateSpaceModel:
    """What filters assume: nearly constant velocity, ranges of `scale` times the distance with deviation `sigma` in m."""
    t, _, x = recorded(drive)
    sites = np.array(drive.beacons).T

    def distance(x: Array, k: int) -> Array:
        at = sites.reshape(2, -1, *(1,) * (x.ndim - 1))
        east, north = x[0] - at[0], x[1] - at[1]
        return scale * np.sqrt(east * east + north * north)

    return StateSpaceModel(
        prior=Gaussian(x[0], np.diag(PRIOR) ** 2),
        dynamics=polynomial(np.diff(t).tolist(), [drive.intensity] * 2, order=1),
        sensor=AdditiveSensor(distance, Gaussian.diagonal([sigma**2] * len(BEACONS))),
        linear=(2, 3),
    )


def case(name: str, drive: Drive, scale: float, words: str, told: str) -> Case:
    """A case on a recorded drive, whose filters are told ranges of `scale` times the distance; `told` says why."""
    t, _, _ = recorded(drive)
    sigma = drive.sigma if scale == 1 else SIGMA_SCALED
    law = "d_i" if scale == 1 else rf"{scale:g}\, d_i"
    return Case(
        name=f"ranging/{name}",
        title=f"Ranges to four beacons, {words}",
        summary=f"A robot drives on a plaza for {t[-1] - t[0]:.0f} s. The measurements are its recorded radio ranges to four "
        "beacons, one beacon at a time; the truth is its recorded position by GPS and inertial navigation. The ranges are "
        "too long by 7 % of the distance, those to all beacons alike. " + told,
        steps=len(t) - 1,
        interval=round(float(t[-1] - t[0]) / (len(t) - 1), 3),
        state=("x", "y", "vx", "vy"),
        blocks=(StateBlock("position", (0, 1), "m"), StateBlock("velocity", (2, 3), "m/s")),
        divergence=Divergence("position", limit=20.0, steps=20),
        reference="J. Djugash, B. Hamner, S. Roth, Navigating with ranging radios: five data sets with ground truth, "
        "Journal of Field Robotics 26(9), 2009, 689-695; the recordings as distributed with GTSAM",
        equations=(
            Equation(
                "Nearly constant velocity, over the time between two ranges",
                r"\begin{pmatrix} r_k \\ v_k \end{pmatrix} = \begin{pmatrix} I & \Delta_k I \\ 0 & I \end{pmatrix} "
                r"\begin{pmatrix} r_{k-1} \\ v_{k-1} \end{pmatrix} + w_k, \quad \Delta_k = t_k - t_{k-1}",
            ),
            Equation(
                "Process noise: white acceleration",
                r"w_k \sim N\left(0,\; q \begin{pmatrix} \Delta_k^3/3 & \Delta_k^2/2 \\ \Delta_k^2/2 & \Delta_k \end{pmatrix} "
                rf"\otimes I \right), \quad q = {drive.intensity:g}\ \mathrm{{m^2/s^3}}",
            ),
            Equation(
                "Range to the one beacon i of step k",
                rf"y_k = {law} + e_k, \quad d_i = \| r_k - b_i \|, \quad e_k \sim N(0, \sigma^2), \quad "
                rf"\sigma = {sigma:g}\ \mathrm{{m}}",
            ),
        ),
        assumptions=(
            "All runs are the same recorded drive: filters that draw no random numbers give the same estimate in every run, "
            "and the intervals of the others tell of their own random numbers alone, not of other drives.",
            f"Each range is a step, at its own time; steps are {np.diff(t).min():.2g} s to {np.diff(t).max():.2g} s long.",
            "The truth is the recorded position, 5 or 10 times a second, joined by lines, with its velocity by differences "
            "over 1 s. The recorded odometry is left out: it is no independent sensor, its turns are those of the truth.",
            "Measured on the two drives: the errors of the ranges have medians of 3.0 m and 2.8 m, and scaled median absolute "
            f"deviations of {SLOW.sigma:g} m and {FAST.sigma:g} m, nearly all of which is distance: about 1.07 times the "
            "distance they are white, with deviations of 0.54 m and 0.56 m and no heavy tails.",
            "The process noise is the mean square change of the recorded velocity over one second on each axis. Nothing was "
            "chosen by what filters make of it.",
            "The prior is centred at the recorded state at the first range, with deviations of 2 m and 1 m/s on each axis.",
            "A run has diverged when it is more than 20 m off for 20 steps on end.",
        ),
        plane=(0, 1),
        landmarks=tuple((f"beacon {b}", east, north) for b, (east, north) in zip(BEACONS, drive.beacons, strict=True)),
        model=assumed(drive, scale, sigma),
        generate=functools.partial(driven, drive),
        origin=RECORDED,
        times=tuple(np.round(t[1:] - t[0], 4).tolist()),
        data=(drive.ranges, drive.track),
    )


NOT_TOLD = "Filters are told how far the ranges scatter, and nothing of their bias, as it is with a sensor nobody calibrated."
TOLD = "Filters are told so, as it was measured on the other drive, `ranging/plaza`."
CASES = (
    case("plaza", SLOW, 1.0, "a robot at walking pace", NOT_TOLD),
    case("plaza-2", FAST, 1.0, "a faster robot", NOT_TOLD),
    case("plaza-2-calibrated", FAST, SCALE, "a faster robot, calibrated beacons", TOLD),
)
