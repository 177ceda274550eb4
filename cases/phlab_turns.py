"""Manoeuvre detection on a recorded flight: when it turned is known from its recorded roll angle.

State (x, y, vx, vy), local east and north coordinates in m and m/s.
"""

import functools

import numpy as np
import pandas

from cases.multistatic_radar import DT, FLIGHT, STEPS, flight
from suite.case import GIVEN_TRACK, Case, Divergence, Equation, StateBlock, Truth, measure
from suite.jump import JumpModel, Modes
from suite.linalg import Array
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian
from suite.random import Generators

ROLL = 15.0  # degrees, beyond which the aircraft turns
RATE = 3.0  # degrees/s, of a turn
STRAIGHT, TURN = 0.39, 1.7  # m²/s³, intensity of the acceleration on each axis
SIGMA = 30.0  # m, of a fix on each axis
PRIOR = (100.0, 100.0, 10.0, 10.0)  # m and m/s, standard deviations at first
MODES = ("straight", "left turn", "right turn")
TRANSITION = np.array([[0.99, 0.005, 0.005], [0.03, 0.97, 0.0], [0.03, 0.0, 0.97]])
INITIAL = np.array([0.98, 0.01, 0.01])


@functools.cache
def modes() -> Modes:
    """Mode in force at each instant [T + 1], by the roll angle: 0 straight, 1 left turn, 2 right turn."""
    roll = pandas.read_csv(FLIGHT).roll_deg.to_numpy()
    return np.where(roll < -ROLL, 1, np.where(roll > ROLL, 2, 0))


@functools.cache
def states() -> Array:
    """Horizontal states [T + 1, 4] of the recorded flight."""
    return flight()[:, [0, 1, 3, 4]]


def turning(rate: float) -> Array:
    """A second's coordinated turn [4, 4] at `rate` in rad/s, counter-clockwise seen from above; straight flight at 0."""
    angle = rate * DT
    along, across = DT * np.sinc(angle / np.pi), DT * np.sinc(angle / 2 / np.pi) * np.sin(angle / 2)
    s, c = np.sin(angle), np.cos(angle)
    return np.array([[1.0, 0.0, along, -across], [0.0, 1.0, across, along], [0.0, 0.0, c, -s], [0.0, 0.0, s, c]])


SENSOR = AdditiveSensor(Affine(np.eye(2, 4)), Gaussian.diagonal([SIGMA**2] * 2))


def flying(rate: float, intensity: float) -> StateSpaceModel:
    """The model of a mode: a turn at `rate` in degrees/s, disturbed by white acceleration."""
    return StateSpaceModel(
        prior=Gaussian(states()[0], np.diag(PRIOR) ** 2),
        dynamics=AdditiveTransition(
            Affine(turning(np.radians(rate))),
            Gaussian.noise(intensity * np.kron([[DT**3 / 3, DT**2 / 2], [DT**2 / 2, DT]], np.eye(2))),
        ),
        sensor=SENSOR,
        linear=(2, 3),
    )


MODEL = JumpModel(
    (flying(0.0, STRAIGHT), flying(RATE, TURN), flying(-RATE, TURN)), transition=TRANSITION, initial=INITIAL, names=MODES
)


def flown(rng: Generators) -> Truth:
    """The recorded flight and its modes in every run, measured with fresh noise."""
    x = np.repeat(states()[1:, :, None], rng.runs, axis=2)
    return Truth(x, measure(SENSOR, x, rng), np.repeat(modes()[1:, None], rng.runs, axis=1))


CASES = (
    Case(
        name="manoeuvre-detection/phlab",
        title="Turns of a recorded flight of a Cessna Citation",
        summary="Twenty minutes of a real flight with nine turns to the right or left, of 24° to a full circle; its horizontal "
        "position is measured once a second by a simulated sensor. When it turned is known from the recorded roll angle, "
        "which nobody measures here: detectors are to tell it from the fixes. Filters of several modes know straight flight "
        "and turns of 3°/s to either side; real turns have other rates, and change them.",
        steps=STEPS,
        interval=DT,
        state=("x", "y", "vx", "vy"),
        blocks=(StateBlock("position", (0, 1), "m"), StateBlock("velocity", (2, 3), "m/s")),
        divergence=Divergence("position", limit=500.0, steps=10),
        reference="flight: J. Sun, openap, PH-LAB flight test data of 20 March 2017; modes: X. R. Li, V. P. Jilkov, Survey of "
        "maneuvering target tracking, part I: dynamic models, IEEE Transactions on Aerospace and Electronic Systems 39(4), "
        "2003, 1333-1364",
        equations=(
            Equation(
                "Turn at a known rate; straight flight where it is 0",
                r"\begin{pmatrix} r_k \\ v_k \end{pmatrix} = \begin{pmatrix} I & \int_0^T R(\omega s)\, ds \\ 0 & R(\omega T) "
                r"\end{pmatrix} \begin{pmatrix} r_{k-1} \\ v_{k-1} \end{pmatrix} + w_k, \quad R(a) = \begin{pmatrix} \cos a & "
                r"-\sin a \\ \sin a & \cos a \end{pmatrix}, \quad T = 1\ \mathrm{s}",
            ),
            Equation(
                "Process noise: white acceleration",
                r"w_k \sim N\left(0,\; q_r \begin{pmatrix} T^3/3 & T^2/2 \\ T^2/2 & T \end{pmatrix} \otimes I \right)",
            ),
            Equation(
                "Modes: straight, left, right",
                rf"\omega = 0,\ {RATE:g}°/\mathrm{{s}},\ -{RATE:g}°/\mathrm{{s}}, \quad q = {STRAIGHT:g},\ {TURN:g},\ "
                rf"{TURN:g}\ \mathrm{{m^2/s^3}}, \quad P = \begin{{pmatrix}} 0.99 & 0.005 & 0.005 \\ 0.03 & 0.97 & 0 \\ "
                r"0.03 & 0 & 0.97 \end{pmatrix}",
            ),
            Equation("Fix", rf"y_k = r_k + e_k, \quad e_k \sim N(0, \sigma^2 I), \quad \sigma = {SIGMA:g}\ \mathrm{{m}}"),
        ),
        assumptions=(
            "The flight is the stretch of `multistatic-radar/phlab`, seen from above: real are the motion and the roll angle, "
            "simulated are the fixes. Velocity is the central difference of the recorded position.",
            f"A step is a turn when the roll angle is beyond {ROLL:g}° to that side, straight flight otherwise. No minimum "
            "duration was needed: every turn so found lasts 9 s or more, the shortest straight flights between turns 4 s and "
            "5 s. Rolling in and out, and gentle turns within 15°, count as straight; the course changes by up to 46° in the "
            "longest of these, 496 s.",
            "The rate of a turn is the median of the recorded rates in turns, 3.0°/s; 90 % lie between 1.7 and 4.7°/s.",
            "The process noise of a mode is the mean square, on each axis, of the recorded change of velocity over one second "
            f"beyond what the mode says, in the seconds so labelled: {STRAIGHT:g} in straight flight, {TURN:g} in turns.",
            "The chain of modes leaves straight flight and turns as often as the labels do, 9 times in 858 s and 9 times in "
            "334 s; initially (0.98, 0.01, 0.01). None of these was chosen by what filters make of it.",
            "The prior is centred at the recorded initial state, with deviations of 100 m and 10 m/s on each axis.",
            "A run has diverged when its position is off by more than 500 m for 10 s on end.",
        ),
        plane=(0, 1),
        model=MODEL,
        generate=flown,
        origin=GIVEN_TRACK,
        data=(FLIGHT,),
    ),
)
