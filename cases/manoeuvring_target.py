"""A target that flies straight and turns, by its bearings or its positions: examples of the EKF/UKF toolbox."""

import functools
from collections.abc import Mapping

import numpy as np
from scipy.linalg import block_diag

from suite.case import GIVEN_TRACK, Case, Divergence, Equation, StateBlock, Truth, measure
from suite.jump import JumpModel, Model
from suite.kinematics import coordinated_turn, polynomial
from suite.linalg import Array
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian
from suite.published import Experiment, Published
from suite.random import Generators

# State (x, y, vx, vy, omega), omega in rad/s, counter-clockwise; the toolbox gives no unit of length.
DT = 0.1  # s, time between measurements
STEPS = 200
TURNS = {1.0: range(41, 91), -1.0: range(111, 161)}  # the steps k whose transition turns, by their rate in rad/s
SENSORS = np.array([[-0.5, 3.5], [-0.5, -3.5], [7.0, -3.5], [7.0, 3.5]])
SD = 0.1  # rad, standard deviation of a bearing
VARIANCE = 0.05  # of a measured coordinate
Q_STRAIGHT = 0.01  # spectral density of the acceleration on each axis, where another model turns
Q_ALONE = 0.05  # the same of the one model that is told to filters of a single model
Q_OMEGA = 0.15  # rad²/s³, spectral density of the turn rate in a turn
TRANSITION = np.array([[0.9, 0.1], [0.1, 0.9]])
INITIAL = np.array([0.95, 0.05])

TIMES = (DT,) * STEPS
TURNING = AdditiveTransition(
    coordinated_turn(TIMES, (0.0, 0.0), Q_OMEGA).mean, Gaussian.diagonal([Q_OMEGA * DT]), gain=np.eye(5)[:, 4:]
)


def straight(q: float) -> AdditiveTransition:
    """Nearly constant velocity of the state (x, y, vx, vy)."""
    free = polynomial(TIMES, (q, q), 1)
    assert isinstance(free.mean, Affine)
    return AdditiveTransition(Affine(free.mean.matrix(1)), free.noise_at(1))


def without_turn(motion: AdditiveTransition) -> AdditiveTransition:
    """The same with a fifth component, the turn rate, that is zero after every step."""
    assert isinstance(motion.mean, Affine)
    return AdditiveTransition(
        Affine(block_diag(motion.mean.matrix(1), np.zeros((1, 1)))), motion.noise_at(1), gain=np.eye(5, 4)
    )


def bearings(x: Array, k: int) -> Array:
    """Bearings of the target from the sensors in radians, counted from the x axis."""
    return np.stack([np.atan2(x[1] - north, x[0] - east) for east, north in SENSORS])


BEARINGS = AdditiveSensor(bearings, Gaussian.diagonal([SD**2] * len(SENSORS)), angles=(0, 1, 2, 3))


def position(n: int) -> AdditiveSensor:
    """A sensor of both coordinates, for a state of n components."""
    return AdditiveSensor(Affine(np.eye(2, n)), Gaussian.diagonal([VARIANCE] * 2))


def switching(sensor: AdditiveSensor) -> JumpModel:
    """Straight flight and turns; only a target in a turn has a turn rate."""
    start = np.array([0.0, 0.0, 1.0, 0.0, 0.0])
    modes = tuple(
        StateSpaceModel(Gaussian(start, np.diag([0.1, 0.1, 0.1, 0.1, variance])), motion, sensor, linear=(2, 3))
        for motion, variance in ((without_turn(straight(Q_STRAIGHT)), 0.0), (TURNING, 1.0))
    )
    return JumpModel(modes, TRANSITION, INITIAL, names=("straight", "turn"))


def alone(sensor: AdditiveSensor) -> StateSpaceModel:
    """Straight flight alone, with more noise, started in a wrong direction."""
    prior = Gaussian(np.array([0.0, 0.0, 0.0, -1.0]), np.diag([1.1, 1.1, 0.1, 0.1]))
    return StateSpaceModel(prior, straight(Q_ALONE), sensor, linear=(2, 3))


@functools.cache
def track() -> Array:
    """States [T, 5] of the target, without any noise."""
    rates = np.zeros(STEPS)
    for rate, steps in TURNS.items():
        rates[np.array(steps) - 1] = rate
    x, states = np.array([0.0, 0.0, 1.0, 0.0, 0.0]), []
    for rate in rates:
        x = TURNING.mean(np.array([*x[:4], rate]), 1)
        states.append(x)
    return np.stack(states)


def flown(model: Model, rng: Generators) -> Truth:
    """The track in every run, with its modes where the model has several, measured with fresh noise."""
    x = np.repeat(track()[:, : model.n, None], rng.runs, axis=2)
    if isinstance(model, StateSpaceModel):
        return Truth(x, measure(model.sensor, x, rng))
    turns = np.repeat(track()[:, 4:] != 0, rng.runs, axis=1).astype(np.intp)
    return Truth(x, measure(model.nominal_mode.sensor, x, rng), turns)


STRAIGHT = Equation(
    "Straight flight",
    r"x_k = \begin{pmatrix} I & \Delta t\, I \\ 0 & I \end{pmatrix} x_{k-1} + w_k, \quad w_k \sim N\left(0, "
    r"q \begin{pmatrix} \Delta t^3/3 & \Delta t^2/2 \\ \Delta t^2/2 & \Delta t \end{pmatrix} \otimes I \right)",
)
LANDMARKS = tuple((f"sensor {i}", east, north) for i, (east, north) in enumerate(SENSORS.tolist(), start=1))
TURN = (
    Equation(
        "Turn",
        r"x_k = \begin{pmatrix} 1 & 0 & \frac{\sin \omega \Delta t}{\omega} & \frac{\cos \omega \Delta t - 1}{\omega} \\ "
        r"0 & 1 & \frac{1 - \cos \omega \Delta t}{\omega} & \frac{\sin \omega \Delta t}{\omega} \\ "
        r"0 & 0 & \cos \omega \Delta t & -\sin \omega \Delta t \\ 0 & 0 & \sin \omega \Delta t & \cos \omega \Delta t "
        r"\end{pmatrix} x_{k-1}, \quad \omega_k = \omega_{k-1} + u_k, \quad u_k \sim N(0, 0.15\, \Delta t)",
    ),
    Equation(
        "Modes and noise of straight flight",
        r"P = \begin{pmatrix} 0.9 & 0.1 \\ 0.1 & 0.9 \end{pmatrix}, \quad \mu_0 = (0.95, 0.05), \quad q = 0.01",
    ),
)
BEARING = Equation(
    "Bearing from sensor i",
    r"\theta_k^i = \mathrm{atan2}(y_k - s_y^i, x_k - s_x^i) + r_k^i, \quad r_k^i \sim N(0, \sigma^2), "
    r"\quad \sigma = 0.1\ \mathrm{rad}",
)
POSITION = Equation("Position", r"z_k = (x_k, y_k)^T + r_k, \quad r_k \sim N(0, 0.05\, I)")

READ = (
    "The parameters were read in the toolbox's programs. The target starts at (0, 0) with the velocity (1, 0), has no noise, "
    "and turns by 1 rad/s in the transitions to the steps 41 to 90 and by -1 rad/s in those to 111 to 160. The turn "
    "rate of its state is that of the transition just made, that of the model is for the next.",
    "A run has diverged when its position is off by more than 2 for 10 steps (1 s) on end.",
)
SENSOR_2 = "The manual misprints the place of the second sensor; that of the program is taken."
SWITCHES = (
    "The toolbox's model of straight flight has four components and no turn rate. Here it has a fifth that is zero after every "
    "step, so that both modes share a state.",
    "The toolbox's IMM mixes the turn rate that the first model lacks as a zero in the mean and leaves it out of the "
    "covariance. Here covariances hold the spread of the means in all components, as the source of the IMM has it. So a "
    "target that may have begun to turn has a turn rate less certain than the toolbox's, and IMM filters err less.",
    "The program's mode probabilities are (0.95, 0.05) at first; the manual prints (0.9, 0.1).",
)
ALONE = ("Filters start at N((0, 0, 0, -1), diag(1.1, 1.1, 0.1, 0.1)): with a velocity wrong by more than four deviations.",)
MIXING = "with the toolbox's mixing"
PER_AXIS = "mean square error of a coordinate"
RUNS = 100


def case(
    name: str,
    title: str,
    summary: str,
    model: Model,
    equations: tuple[Equation, ...],
    assumptions: tuple[str, ...],
    where: str,
    figures: Mapping[str, tuple[float, str]],
) -> Case:
    """The track, seen in one of two ways, for filters of one or two modes; figures, printed values and notes by estimator."""
    blocks = (StateBlock("position", (0, 1), ""), StateBlock("velocity", (2, 3), ""), StateBlock("turn rate", (4,), "rad/s"))
    return Case(
        name=name,
        title=title,
        summary=summary,
        steps=STEPS,
        interval=DT,
        state=("x", "y", "vx", "vy", "omega")[: model.n],
        blocks=tuple(block for block in blocks if block.components[-1] < model.n),
        # Filters of a single model have a root mean square error of 0.35.
        divergence=Divergence("position", limit=2.0, steps=10),
        reference="J. Hartikainen, A. Solin, S. Särkkä, Optimal filtering with Kalman filters and smoothers, manual of the "
        f"EKF/UKF toolbox, Aalto University, 2011, {where}",
        equations=equations,
        assumptions=assumptions,
        published=tuple(
            Published(label, PER_AXIS, value, "", f"{where}, table of errors", note, "mse", "position")
            for label, (value, note) in figures.items()
        ),
        experiment=Experiment(RUNS, tuple(figures)),
        plane=(0, 1),
        landmarks=LANDMARKS if BEARING in equations else (),
        model=model,
        generate=functools.partial(flown, model),
        origin=GIVEN_TRACK,
    )


CASES = (
    case(
        "manoeuvring-target",
        "Bearings of a target that turns twice",
        "Four sensors at fixed places measure bearings, good to 6° only, of a target that flies straight, turns left by 286°, "
        "flies straight and turns right by 286°. Filters know straight flight, turns at a rate that has to be found, and how "
        "one follows the other, not when.",
        switching(BEARINGS),
        (STRAIGHT, *TURN, BEARING),
        (*READ, SENSOR_2, *SWITCHES),
        "bearings only tracking of a manoeuvring target",
        {"imm-ekf": (0.0544, MIXING), "imm-ukf": (0.0441, f"points with alpha = 1, beta = 0, kappa = 3 - n; {MIXING}")},
    ),
    case(
        "manoeuvring-target/single-model",
        "Bearings of a target that turns twice, one model",
        "The same target and sensors, for filters of a single model: straight flight with more noise, started with a wrong "
        "velocity. What filters that know of turns gain is to be held against these.",
        alone(BEARINGS),
        (STRAIGHT, BEARING),
        (*READ, SENSOR_2, *ALONE),
        "bearings only tracking of a manoeuvring target",
        {"ekf": (0.0606, ""), "ukf": (0.0609, "points with alpha = 1, beta = 0, kappa = 3 - n")},
    ),
    case(
        "manoeuvring-target/positions",
        "Positions of a target that turns twice",
        "The same target, whose two coordinates are measured: of all functions only a turn at an unknown rate is not linear.",
        switching(position(5)),
        (STRAIGHT, *TURN, POSITION),
        (*READ, *SWITCHES),
        "the same target measured by its position",
        {"imm-ekf": (0.0179, MIXING), "imm-ukf": (0.0155, f"points with alpha = 1, beta = 0, kappa = 3 - n; {MIXING}")},
    ),
    case(
        "manoeuvring-target/positions-single-model",
        "Positions of a target that turns twice, one model",
        "The same target and its measured coordinates, for filters of a single model: linear and Gaussian, and wrong in turns.",
        alone(position(4)),
        (STRAIGHT, POSITION),
        (*READ, *ALONE, "Model and start are those of the bearings' single model: the figure's own were not read."),
        "the same target measured by its position",
        {"kalman": (0.0253, "")},
    ),
)
