"""Re-entry of a vehicle with an unknown ballistic coefficient, in the plane: the example of the unscented Kalman filter."""

import functools
from dataclasses import replace

import numpy as np

from suite.case import FROM_ANOTHER, Case, Divergence, Equation, StateBlock, draw
from suite.linalg import Array
from suite.model import AdditiveSensor, AdditiveTransition, StateSpaceModel
from suite.noise import Gaussian
from suite.published import Experiment, Published

# Symbols as in the reference. State (x, y, vx, vy, x5) in km, km, km/s, km/s and no unit.
DT = 0.1  # s, time between measurements, and of Euler's rule
BETA0 = -0.59783  # 1/km, ballistic coefficient for x5 = 0
H0 = 13.406  # km, height over which the density of the air falls by e
GM = 3.9860e5  # km³/s²
R0 = 6374.0  # km, radius of the earth
VELOCITY_NOISE = 2.4064e-5  # km²/s², variance of what a step adds to a component of the velocity
X5_NOISE = 1e-6  # variance of what a step adds to x5, as the filters believe
SIGMA_R = 1e-3  # km
SIGMA_THETA = 0.17e-3  # rad
START = (6500.4, 349.14, -1.8093, -6.7967)  # km, km, km/s, km/s
TRUE_X5 = 0.6932
STEPS = 2000


def fall(s: Array, k: int) -> Array:
    """State after a step of Euler's rule, under drag and gravity."""
    x, y, vx, vy, x5 = s
    r, v = np.sqrt(x * x + y * y), np.sqrt(vx * vx + vy * vy)
    drag = BETA0 * np.exp(x5 + (R0 - r) / H0) * v
    gravity = -GM / (r * r * r)
    ax, ay = drag * vx + gravity * x, drag * vy + gravity * y
    return np.stack([x + DT * vx, y + DT * vy, vx + DT * ax, vy + DT * ay, x5])


def slopes(s: Array, k: int) -> Array:
    """Derivative [5, 5, ...] of `fall`."""
    x, y, vx, vy, x5 = s
    r, v = np.sqrt(x * x + y * y), np.sqrt(vx * vx + vy * vy)
    drag = BETA0 * np.exp(x5 + (R0 - r) / H0) * v
    gravity = -GM / (r * r * r)
    found = np.zeros((5, *s.shape))
    found[range(5), range(5)] = 1.0
    found[0, 2] = found[1, 3] = DT
    for row, place, speed in ((2, x, vx), (3, y, vy)):
        by_distance = -drag * speed / H0 - 3.0 * gravity * place / r
        found[row, 0], found[row, 1] = DT * by_distance * x / r, DT * by_distance * y / r
        found[row, row - 2] += DT * gravity
        found[row, 2], found[row, 3] = DT * drag * speed * vx / (v * v), DT * drag * speed * vy / (v * v)
        found[row, row] += 1.0 + DT * drag
        found[row, 4] = DT * drag * speed
    return found


def radar(s: Array, k: int) -> Array:
    """Range in km and bearing in rad, from a radar on the ground at (R0, 0)."""
    east, north = s[0] - R0, s[1]
    return np.stack([np.sqrt(east * east + north * north), np.atan2(north, east)])


def process_noise(x5: float) -> Gaussian:
    """The law of what a step adds to the velocity, and to x5 with the variance given."""
    return Gaussian.diagonal([VELOCITY_NOISE, VELOCITY_NOISE, x5])


TO_VELOCITY_AND_X5 = np.eye(5)[:, 2:]

MODEL = StateSpaceModel(
    prior=Gaussian([*START, 0.0], np.diag([1e-6, 1e-6, 1e-6, 1e-6, 1.0])),
    dynamics=AdditiveTransition(fall, process_noise(X5_NOISE), gain=TO_VELOCITY_AND_X5, jacobian_of_mean=slopes),
    sensor=AdditiveSensor(radar, Gaussian.diagonal([SIGMA_R**2, SIGMA_THETA**2]), angles=(1,)),
)
REALITY = replace(
    MODEL,
    prior=Gaussian([*START, TRUE_X5], np.diag([1e-6, 1e-6, 1e-6, 1e-6, 0.0])),
    dynamics=AdditiveTransition(fall, process_noise(0.0), gain=TO_VELOCITY_AND_X5, jacobian_of_mean=slopes),
)

FILTERS = ("ekf", "ukf", "ckf")

CASES = (
    Case(
        name="re-entry",
        title="Re-entry in the plane",
        summary="A vehicle enters the atmosphere at 7 km/s; a radar on the ground measures range and bearing ten times a "
        "second. Drag depends exponentially on a parameter that filters hardly know, and which shows only once the air is "
        "dense enough.",
        steps=STEPS,
        interval=DT,
        state=("x", "y", "vx", "vy", "x5"),
        blocks=(
            StateBlock("position", (0, 1), "km"),
            StateBlock("velocity", (2, 3), "km/s"),
            StateBlock("ballistic parameter", (4,), ""),
        ),
        # One measurement is good to 63 m across at the first step, where the vehicle is 371 km away.
        divergence=Divergence("position", limit=0.5, steps=50),
        reference="S. J. Julier, J. K. Uhlmann, Unscented filtering and nonlinear estimation, Proceedings of the IEEE 92(3), "
        "2004, 401-422; as discretised in J. Hartikainen, A. Solin, S. Särkkä, "
        "Optimal filtering with Kalman filters and smoothers, manual of the EKF/UKF toolbox, Aalto University, 2011",
        equations=(
            Equation(
                "Motion",
                r"\dot x_1 = x_3, \quad \dot x_2 = x_4, \quad \dot x_3 = D x_3 + G x_1 + v_1, \quad "
                r"\dot x_4 = D x_4 + G x_2 + v_2, \quad \dot x_5 = v_3",
            ),
            Equation(
                "Drag and gravity",
                r"D = \beta_0 e^{x_5} e^{(R_0 - R)/H_0} V, \quad G = -\frac{G m_0}{R^3}, \quad R = \sqrt{x_1^2 + x_2^2}, "
                r"\quad V = \sqrt{x_3^2 + x_4^2}",
            ),
            Equation(
                "Radar",
                r"z_k = \begin{pmatrix} \sqrt{(x_1 - R_0)^2 + x_2^2} \\ \mathrm{atan2}(x_2, x_1 - R_0) \end{pmatrix} + w_k, "
                r"\quad w_k \sim N(0, \mathrm{diag}(1\ \mathrm{m}^2, 0.17^2\ \mathrm{mrad}^2))",
            ),
        ),
        assumptions=(
            "All is as in the toolbox's program, which was read: Euler's rule with steps of 0.1 s, a measurement at each of "
            "the 2000; noise of variance 2.4064e-5 km²/s² a step on both velocities.",
            "The truth starts at N(m0, P0) with standard deviations of 1 m and 1 m/s and has x5 = 0.6932 exactly, without "
            "noise. Filters start with x5 = 0 and a variance of 1, and believe that a step adds 1e-6 to it.",
            "The noise of the radar is the toolbox's: 1 m and 0.17 mrad.",
            "A run has diverged when its position is off by more than 500 m for 50 steps (5 s) on end.",
        ),
        published=tuple(
            Published(method, "root mean square error of the position, the mean over runs of each run's", 0.0084, "km",
                      "manual of the EKF/UKF toolbox, re-entry vehicle tracking, errors", "", "run-rmse", "position", 100)
            for method in FILTERS
        ),
        experiment=Experiment(100, FILTERS),
        plane=(0, 1),
        landmarks=(("radar", R0, 0.0),),
        model=MODEL,
        generate=functools.partial(draw, REALITY, STEPS),
        origin=FROM_ANOTHER,
    ),
)  # fmt: skip
