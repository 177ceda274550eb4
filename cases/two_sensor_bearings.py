"""Bearings from two sensors of a target that turns three times: an example of the EKF/UKF toolbox."""

import numpy as np

from suite.case import FROM_ANOTHER, Case, Divergence, Equation, StateBlock, Truth, measure
from suite.kinematics import coordinated_turn, polynomial
from suite.linalg import Array
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian
from suite.published import Experiment, Published
from suite.random import Generators

# State (x, y, vx, vy); the toolbox gives no unit of length.
DT = 0.01  # s, time between measurements
STEPS = 500
SENSORS = np.array([[-1.0, -2.0], [1.0, 1.0]])
SD = 0.05  # rad, standard deviation of a bearing
Q = 0.1  # spectral density of the acceleration on each axis
START = np.array([0.0, 0.0, 1.0, 0.0])
TURNS = (range(50, 101), range(200, 251), range(350, 401))  # the steps k whose transition turns, by a right angle together
RATE = np.pi / 2 / 51 / DT  # rad/s, clockwise
RATE_SD = 0.01  # rad/s, what a step's rate differs from it by

TIMES = (DT,) * STEPS
TURNING = coordinated_turn(TIMES, (0.0, 0.0), 0.0).mean


def motion() -> AdditiveTransition:
    """Nearly constant velocity."""
    free = polynomial(TIMES, (Q, Q), 1)
    assert isinstance(free.mean, Affine)
    return AdditiveTransition(Affine(free.mean.matrix(1)), free.noise_at(1))


def bearings(x: Array, k: int) -> Array:
    """Bearings of the target from the sensors in radians, counted from the x axis."""
    return np.stack([np.atan2(x[1] - north, x[0] - east) for east, north in SENSORS])


MODEL = StateSpaceModel(
    prior=Gaussian.diagonal([4.0] * 4),
    dynamics=motion(),
    sensor=AdditiveSensor(bearings, Gaussian.diagonal([SD**2] * len(SENSORS)), angles=(0, 1)),
    linear=(2, 3),
)


def flown(rng: Generators) -> Truth:
    """The track with the rates of its turns drawn anew, measured."""
    drawn = iter(rng.standard_normal((sum(map(len, TURNS)), rng.runs)))
    x, straight, states = np.repeat(START[:, None], rng.runs, axis=1), np.zeros(rng.runs), []
    for k in range(1, STEPS + 1):
        turns = any(k in turn for turn in TURNS)
        rate = -(RATE + RATE_SD * next(drawn)) if turns else straight
        x = TURNING(np.concat([x, rate[None]]), k)[:4]
        states.append(x)
    trajectory = np.stack(states)
    return Truth(trajectory, measure(MODEL.sensor, trajectory, rng))


CASES = (
    Case(
        name="two-sensor-bearings",
        title="Bearings from two sensors",
        summary="Two sensors close by measure the bearings of a target a hundred times a second. It flies straight and turns "
        "to the right by 90°, three times; filters take it to fly straight under a white acceleration, and hardly know where "
        "it starts.",
        steps=STEPS,
        interval=DT,
        state=("x", "y", "vx", "vy"),
        blocks=(StateBlock("position", (0, 1), ""), StateBlock("velocity", (2, 3), "")),
        # The prior's standard deviation in the plane is 2.8; the target stays within 2 of its start.
        divergence=Divergence("position", limit=1.0, steps=50),
        reference="J. Hartikainen, A. Solin, S. Särkkä, Optimal filtering with Kalman filters and smoothers, manual of the "
        "EKF/UKF toolbox, Aalto University, 2011, bearings only tracking",
        equations=(
            Equation(
                "Motion, as filters take it",
                r"x_k = \begin{pmatrix} I & \Delta t\, I \\ 0 & I \end{pmatrix} x_{k-1} + w_k, \quad w_k \sim N\left(0, q "
                r"\begin{pmatrix} \Delta t^3/3 & \Delta t^2/2 \\ \Delta t^2/2 & \Delta t \end{pmatrix} \otimes I \right), "
                r"\quad q = 0.1",
            ),
            Equation(
                "Motion, as it is",
                r"\dot v = a_k \begin{pmatrix} 0 & 1 \\ -1 & 0 \end{pmatrix} v, \quad a_k \sim N\left(\frac{\pi}{2 \cdot 51\, "
                r"\Delta t}, 0.01^2\right) \text{ in turns, else } 0",
            ),
            Equation(
                "Bearing from sensor i",
                r"\theta_k^i = \mathrm{atan2}(y_k - s_y^i, x_k - s_x^i) + r_k^i, \quad r_k^i \sim N(0, \sigma^2), "
                r"\quad \sigma = 0.05\ \mathrm{rad}",
            ),
        ),
        assumptions=(
            "The parameters were read in the toolbox's program: the target starts at (0, 0) with the velocity (1, 0) and turns "
            "in the transitions to the steps 50 to 100, 200 to 250 and 350 to 400; filters start at N(0, 4 I).",
            "A turn is exact over a step of 0.01 s. Its rate differs from step to step by 0.01 rad/s, or 0.3 %: the tracks of "
            "all runs are nearly one.",
            "Differences of bearings wrap to (-π, π]. Sigma points of the first steps lie on all sides of a sensor, and where "
            "their bearings are averaged as plain numbers the unscented filter errs by 0.121 and not by 0.109.",
            "A run has diverged when its position is off by more than 1 for 50 steps (half a second) on end.",
        ),
        published=tuple(
            Published(label, quantity, value, "", "bearings only tracking, table of errors", note, "run-rmse", "position", runs)
            for label, quantity, value, note, runs in (
                ("ekf", "root mean square error of the position of a run, mean over 1000 runs", 0.114, "", 1000),
                ("ekf", "root mean square error of the position of a run, mean over 100 runs", 0.106, "", 100),
                ("ukf", "root mean square error of the position of a run", 0.113, "points with kappa = -1", 0),
                ("ckf", "root mean square error of the position of a run", 0.108, "", 0),
            )
        ),
        experiment=Experiment(1000, ("ekf", "ukf", "ckf")),
        plane=(0, 1),
        landmarks=tuple((f"sensor {i}", east, north) for i, (east, north) in enumerate(SENSORS.tolist(), start=1)),
        model=MODEL,
        generate=flown,
        origin=FROM_ANOTHER,
    ),
)
