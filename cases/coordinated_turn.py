"""An aircraft that turns at a rate which nobody knows, seen by a radar: the example of the cubature Kalman filter."""

import functools

import numpy as np

from suite.case import Case, Divergence, Equation, StateBlock, draw
from suite.kinematics import sinc
from suite.linalg import Array
from suite.model import AdditiveSensor, AdditiveTransition, StateSpaceModel
from suite.noise import Gaussian

# Symbols as in the paper. State (x, vx, y, vy, omega) in m, m/s, m, m/s, rad/s.
T = 1.0  # s, time between measurements
Q1 = 0.1  # m²/s³, spectral density of the acceleration
Q2 = 1.75e-4  # rad²/s³, spectral density of the turn rate's random walk
SIGMA_R = 10.0  # m
SIGMA_THETA = np.sqrt(10) * 1e-3  # rad
START = np.array([1000.0, 300.0, 1000.0, 0.0, -np.deg2rad(3.0)])
START_VARIANCES = (100.0, 10.0, 100.0, 10.0, 1e-4)
STEPS = 100

AXIS_NOISE = Q1 * np.array([[T**3 / 3, T**2 / 2], [T**2 / 2, T]])


def turn(s: Array, k: int) -> Array:
    """State after T seconds of a turn at the constant rate omega, counter-clockwise where it is positive.

    A chord of length |v| T sinc(omega T / 2) that points half the angle further than the velocity did.
    """
    x, vx, y, vy, omega = s
    half = 0.5 * T * omega
    chord = T * sinc(half)
    ahead, aside = chord * np.cos(half), chord * np.sin(half)
    c, d = np.cos(T * omega), np.sin(T * omega)
    return np.stack([x + ahead * vx - aside * vy, c * vx - d * vy, y + aside * vx + ahead * vy, d * vx + c * vy, omega])


def radar(s: Array, k: int) -> Array:
    """Range in m and bearing in rad, counted from the x axis, from a radar at the origin."""
    x, _, y, _, _ = s
    return np.stack([np.sqrt(x * x + y * y), np.atan2(y, x)])


def process_noise() -> Gaussian:
    """The law of what disturbs the state over a step."""
    cov = np.zeros((5, 5))
    cov[:2, :2] = cov[2:4, 2:4] = AXIS_NOISE
    cov[4, 4] = Q2 * T
    return Gaussian.noise(cov)


MODEL = StateSpaceModel(
    prior=Gaussian(START, np.diag(START_VARIANCES)),
    dynamics=AdditiveTransition(turn, process_noise()),
    sensor=AdditiveSensor(radar, Gaussian.diagonal([SIGMA_R**2, SIGMA_THETA**2]), angles=(1,)),
)

CASES = (
    Case(
        name="coordinated-turn",
        title="A turn at an unknown rate",
        summary="An air-traffic-control radar measures range and bearing of an aircraft at 300 m/s that turns. Its turn rate "
        "is part of the state and wanders, so that the motion is nonlinear in what has to be estimated.",
        steps=STEPS,
        interval=T,
        state=("x", "vx", "y", "vy", "omega"),
        blocks=(
            StateBlock("position", (0, 2), "m"),
            StateBlock("velocity", (1, 3), "m/s"),
            StateBlock("turn rate", (4,), "rad/s"),
        ),
        # A measurement is good to 10 m in range and 3 m across for each kilometre: some tens of metres.
        divergence=Divergence("position", limit=500.0, steps=5),
        reference="I. Arasaratnam, S. Haykin, Cubature Kalman filters, IEEE Transactions on Automatic Control 54(6), 2009, "
        "1254-1269, section VI",
        equations=(
            Equation(
                "Motion",
                r"x_k = \begin{pmatrix} 1 & \frac{\sin \Omega T}{\Omega} & 0 & -\frac{1 - \cos \Omega T}{\Omega} & 0 \\ "
                r"0 & \cos \Omega T & 0 & -\sin \Omega T & 0 \\ "
                r"0 & \frac{1 - \cos \Omega T}{\Omega} & 1 & \frac{\sin \Omega T}{\Omega} & 0 \\ "
                r"0 & \sin \Omega T & 0 & \cos \Omega T & 0 \\ 0 & 0 & 0 & 0 & 1 \end{pmatrix} x_{k-1} + v_{k-1}",
            ),
            Equation(
                "Process noise",
                r"v_k \sim N(0, \mathrm{diag}(q_1 M, q_1 M, q_2 T)), \quad "
                r"M = \begin{pmatrix} T^3/3 & T^2/2 \\ T^2/2 & T \end{pmatrix}, \quad "
                r"q_1 = 0.1\ \mathrm{m^2/s^3}, \quad q_2 = 1.75 \cdot 10^{-4}\ \mathrm{rad^2/s^3}",
            ),
            Equation(
                "Radar",
                r"z_k = \begin{pmatrix} \sqrt{x_k^2 + y_k^2} \\ \mathrm{atan2}(y_k, x_k) \end{pmatrix} + w_k, \quad "
                r"w_k \sim N(0, \mathrm{diag}(\sigma_r^2, \sigma_\theta^2)), \quad \sigma_r = 10\ \mathrm{m}, "
                r"\quad \sigma_\theta = \sqrt{10}\ \mathrm{mrad}",
            ),
        ),
        assumptions=(
            "The parameters agree with two public programs of the example; P0 and the noise of the radar are recalled besides "
            "and were not read in the paper itself.",
            "In the paper the truth starts at x0 = (1000 m, 300 m/s, 1000 m, 0, -3°/s) and each run's filter at a draw from "
            "N(x0, P0), P0 = diag(100, 10, 100, 10, 1e-4). Here the filter starts at x0 and the truth at the draw: the same "
            "error, and filters that are told the law of what happens.",
            "The truth is drawn with the model's process noise. Its q2 lets the turn rate wander by 7.6°/s in 100 s, more than "
            "the turn itself, so that no two flights are alike and some pass close to the radar.",
            "The paper shows curves over 250 runs: no published figure belongs to it.",
            "A run has diverged when its position is off by more than 500 m for 5 steps on end.",
        ),
        plane=(0, 2),
        landmarks=(("radar", 0.0, 0.0),),
        model=MODEL,
        generate=functools.partial(draw, MODEL, STEPS),
    ),
)
