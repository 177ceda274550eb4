"""A target whose acceleration comes and goes at given times: the linear example of several models of the EKF/UKF toolbox."""

import functools

import numpy as np
from scipy.linalg import block_diag

from suite.case import FROM_ANOTHER, Case, Divergence, Equation, StateBlock, Truth, measure
from suite.jump import JumpModel, Model
from suite.kinematics import polynomial
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian
from suite.published import Experiment, Published
from suite.random import Generators

# State (x, y, vx, vy, ax, ay); the toolbox gives no unit of length.
DT = 0.1  # s, time between measurements
STEPS = 200
Q_VELOCITY, Q_ACCELERATION = 0.01, 1.0  # spectral densities of the noise in the acceleration, and in its derivative
VARIANCE = 0.1  # of a measured coordinate
START = np.array([0.0, 0.0, 0.0, -1.0, 0.0, 0.0])
START_VARIANCE, START_ACCELERATION = 0.1, 0.5  # of places and velocities, and of accelerations where there are any
TRANSITION = np.array([[0.98, 0.02], [0.02, 0.98]])
INITIAL = np.array([0.9, 0.1])
MODES = np.zeros(STEPS, np.intp)
MODES[50:70] = MODES[120:150] = 1  # the transitions to the steps 51-70 and 121-150

TIMES = (DT,) * STEPS
SENSOR = AdditiveSensor(Affine(np.eye(2, 6)), Gaussian.diagonal([VARIANCE] * 2))


def steady() -> AdditiveTransition:
    """Nearly constant velocity; the acceleration is zero after every step."""
    free = polynomial(TIMES, (Q_VELOCITY,) * 2, 1)
    assert isinstance(free.mean, Affine)
    padded = block_diag(free.mean.matrix(1), np.zeros((2, 2)))
    return AdditiveTransition(Affine(padded), free.noise_at(1), gain=np.eye(6, 4))


def accelerated() -> AdditiveTransition:
    """Nearly constant acceleration."""
    free = polynomial(TIMES, (Q_ACCELERATION,) * 2, 2)
    assert isinstance(free.mean, Affine)
    return AdditiveTransition(Affine(free.mean.matrix(1)), free.noise_at(1))


def mode(motion: AdditiveTransition, acceleration: float) -> StateSpaceModel:
    """One model, whose accelerations have this variance at first."""
    variances = [START_VARIANCE] * 4 + [acceleration] * 2
    return StateSpaceModel(Gaussian(START, np.diag(variances)), motion, SENSOR, linear=(2, 3, 4, 5))


ALONE = mode(accelerated(), START_ACCELERATION)
SWITCHING = JumpModel((mode(steady(), 0.0), ALONE), TRANSITION, INITIAL, names=("constant velocity", "acceleration"))


def flown(model: Model, rng: Generators) -> Truth:
    """A flight by the given modes with their noises, measured; the modes where the model has several."""
    x, states = np.repeat(START[:, None], rng.runs, axis=1), []
    for k, in_force in enumerate(MODES, start=1):
        x = SWITCHING.modes[in_force].dynamics.sample(rng, x, k)
        states.append(x)
    trajectory = np.stack(states)
    modes = np.repeat(MODES[:, None], rng.runs, axis=1) if isinstance(model, JumpModel) else None
    return Truth(trajectory, measure(SENSOR, trajectory, rng), modes)


VELOCITY = Equation(
    "Constant velocity: the acceleration is zero",
    r"\begin{pmatrix} r_k \\ v_k \end{pmatrix} = \begin{pmatrix} I & \Delta t\, I \\ 0 & I \end{pmatrix} \begin{pmatrix} "
    r"r_{k-1} \\ v_{k-1} \end{pmatrix} + w_k, \quad w_k \sim N\left(0, q_1 \begin{pmatrix} \Delta t^3/3 & \Delta t^2/2 \\ "
    r"\Delta t^2/2 & \Delta t \end{pmatrix} \otimes I \right), \quad q_1 = 0.01",
)
ACCELERATION = Equation(
    "Constant acceleration",
    r"x_k = \begin{pmatrix} I & \Delta t\, I & \frac{\Delta t^2}{2} I \\ 0 & I & \Delta t\, I \\ 0 & 0 & I \end{pmatrix} "
    r"x_{k-1} + w_k, \quad w_k \sim N\left(0, q_2 \begin{pmatrix} \Delta t^5/20 & \Delta t^4/8 & \Delta t^3/6 \\ "
    r"\Delta t^4/8 & \Delta t^3/3 & \Delta t^2/2 \\ \Delta t^3/6 & \Delta t^2/2 & \Delta t \end{pmatrix} \otimes I \right), "
    r"\quad q_2 = 1",
)
MARKOV = Equation("Modes", r"P = \begin{pmatrix} 0.98 & 0.02 \\ 0.02 & 0.98 \end{pmatrix}, \quad \mu_0 = (0.9, 0.1)")
POSITION = Equation("Measurement", r"z_k = r_k + e_k, \quad e_k \sim N(0, 0.1\, I)")
PER_AXIS = "mean square error of a coordinate"
RUNS = 1000


def case(
    name: str,
    title: str,
    summary: str,
    model: Model,
    equations: tuple[Equation, ...],
    assumptions: tuple[str, ...],
    published: tuple[Published, ...],
) -> Case:
    """The flight, for filters of these models."""
    return Case(
        name=name,
        title=title,
        summary=summary,
        steps=STEPS,
        interval=DT,
        state=("x", "y", "vx", "vy", "ax", "ay"),
        blocks=(
            StateBlock("position", (0, 1), ""),
            StateBlock("velocity", (2, 3), ""),
            StateBlock("acceleration", (4, 5), ""),
        ),
        # A filter that knows of no acceleration errs by half in the mean square, and by 2 for a while.
        divergence=Divergence("position", limit=5.0, steps=10),
        reference="J. Hartikainen, A. Solin, S. Särkkä, Optimal filtering with Kalman filters and smoothers, manual of the "
        "EKF/UKF toolbox, Aalto University, 2011, interacting multiple models, tracking a target with simple manoeuvres",
        equations=equations,
        assumptions=(
            "The parameters were read in the toolbox's program. The target starts at (0, 0) with the velocity (0, -1), is "
            "accelerated in the transitions to the steps 51 to 70 and 121 to 150, and has the noise of the model in force. An "
            "acceleration starts at zero and ends at once.",
            "Not read, and chosen here: filters start at the true state with variances of 0.1 for places and velocities and "
            "0.5 for accelerations. With 0.1 for the latter the errors change by less than 1 %.",
            *assumptions,
            "A run has diverged when its position is off by more than 5 for 10 steps (1 s) on end.",
        ),
        published=published,
        experiment=Experiment(RUNS, tuple(p.estimator for p in published)),
        plane=(0, 1),
        model=model,
        generate=functools.partial(flown, model),
        origin=FROM_ANOTHER,
    )


CASES = (
    case(
        "switching-acceleration",
        "Acceleration that comes and goes",
        "The position of a target is measured that flies at a nearly constant velocity and is accelerated twice for a few "
        "seconds. Both models are linear and Gaussian; filters know how they follow each other, not when.",
        SWITCHING,
        (VELOCITY, ACCELERATION, MARKOV, POSITION),
        (
            "The toolbox's model of constant velocity has four components. Here it has accelerations that are zero after every "
            "step, so that both modes share a state; of these zeros covariances hold the spread about the mean, in the toolbox "
            "they do not, which changes the errors by less than 0.2 %.",
        ),
        tuple(
            Published(label, PER_AXIS, value, "", "the example's table of errors", note, "mse", "position", RUNS)
            for label, value, note in (("kalman", 0.1554, "told of constant velocity alone"), ("imm-ekf", 0.0229, ""))
        ),
    ),
    case(
        "switching-acceleration/single-model",
        "Acceleration that comes and goes, one model",
        "The same target, for filters that take it to be accelerated all the time: linear and Gaussian, right when it "
        "manoeuvres, and more careful than need be when it does not.",
        ALONE,
        (ACCELERATION, POSITION),
        (),
        (
            Published(
                "kalman",
                PER_AXIS,
                0.0317,
                "",
                "the example's table of errors",
                "told of acceleration alone",
                "mse",
                "position",
                RUNS,
            ),
        ),
    ),
)
