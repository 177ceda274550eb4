"""Bearings from three fixed stations of a target that flies straight and turns (Liu, Song and Huang)."""

import functools

import numpy as np

from suite.case import GIVEN_TRACK, Case, Divergence, Equation, StateBlock, Truth, measure
from suite.jump import JumpModel
from suite.linalg import Array
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian
from suite.published import Experiment, Published
from suite.random import Generators

# Symbols as in the paper: X = (x, y, vx, vy), F, G, T, ω; its transition probabilities p, first ones u(0), covariance P(0).
T = 1.0  # s, time between measurements
OMEGA = 0.1  # rad/s, ω, turn rate
STATIONS = np.array([[0.0, 0.0], [20.0, 0.0], [10.0, 20.0]])  # km
START = np.array([3.0, 6.0, 0.15, 0.05])  # km, km, km/s, km/s
START_STD = np.array([0.02, 0.02, 0.01, 0.01])  # km, km, km/s, km/s
SIGMA_A = 0.01  # km/s², standard deviation of the acceleration over a step
STEPS = 100
TURNS = {1: range(31, 51), 2: range(71, 91)}  # the steps k whose transition turns, by mode
TRANSITION = np.array([[0.9, 0.05, 0.05], [0.2, 0.795, 0.005], [0.2, 0.005, 0.795]])
INITIAL = np.array([0.9, 0.05, 0.05])

STRAIGHT = np.eye(4) + T * np.eye(4, k=2)
GAIN = np.vstack([T * T / 2 * np.eye(2), T * np.eye(2)])


def turn(rate: float) -> Array:
    """Transition matrix of a turn, counter-clockwise where the rate is positive (the paper's F, with its signs put right)."""
    s, c = np.sin(rate * T), np.cos(rate * T)
    return np.array([[1, 0, s / rate, (c - 1) / rate], [0, 1, (1 - c) / rate, s / rate], [0, 0, c, -s], [0, 0, s, c]])


MATRICES = (STRAIGHT, turn(OMEGA), turn(-OMEGA))
MODES = np.zeros(STEPS, np.intp)
for mode, steps in TURNS.items():
    MODES[np.array(steps) - 1] = mode


def bearings(x: Array, k: int) -> Array:
    """Bearings of the target from the stations, counted from the y axis towards the x axis, in radians."""
    return np.stack([np.arctan2(x[0] - east, x[1] - north) for east, north in STATIONS])


def moving(matrix: Array, sigma: float) -> StateSpaceModel:
    """One mode: motion by a matrix, accelerations N(0, sigma_a²) on both axes, bearings good to sigma radians."""
    return StateSpaceModel(
        prior=Gaussian(START, np.diag(START_STD**2)),
        dynamics=AdditiveTransition(Affine(matrix), Gaussian.diagonal([SIGMA_A**2] * 2), gain=GAIN),
        sensor=AdditiveSensor(bearings, Gaussian.diagonal([sigma**2] * len(STATIONS)), angles=(0, 1, 2)),
        linear=(2, 3),
    )


def model(sigma: float) -> JumpModel:
    """The three modes with bearings good to sigma radians."""
    names = ("straight", "left turn", "right turn")
    return JumpModel(tuple(moving(matrix, sigma) for matrix in MATRICES), TRANSITION, INITIAL, names=names)


def flown(sigma: float, rng: Generators) -> Truth:
    """The stated manoeuvres without any process noise, from a start drawn from the prior; and what the stations measure."""
    known = model(sigma).modes[0]
    x, states = known.prior.sample(rng, (rng.runs,)), []
    for mode in MODES:
        x = Affine(MATRICES[mode])(x, 1)
        states.append(x)
    trajectory = np.stack(states)
    return Truth(trajectory, measure(known.sensor, trajectory, rng), np.repeat(MODES[:, None], rng.runs, axis=1))


def case(name: str, sigma: float, words: str) -> Case:
    """The case with bearings good to sigma radians."""
    return Case(
        name=name,
        title=f"Bearings from three stations, {words}",
        summary="Three fixed stations measure the bearing of an aircraft that flies straight, turns left, flies straight, "
        "turns right. Filters know the three kinds of motion and how they follow each other, not when.",
        steps=STEPS,
        interval=T,
        state=("x", "y", "vx", "vy"),
        blocks=(StateBlock("position", (0, 1), "km"), StateBlock("velocity", (2, 3), "km/s")),
        divergence=Divergence("position", limit=1.0, steps=5),
        reference="W. Liu, W. Song, Z. Huang, Improved interacting multiple model particle filter for passive multi-sensor "
        "(in Chinese), Ship Science and Technology 39(3), 2017, 145-149",
        equations=(
            Equation(
                "Turn of rate ω; straight flight is its limit for ω = 0",
                r"x_k = \begin{pmatrix} 1 & 0 & \frac{\sin \omega T}{\omega} & \frac{\cos \omega T - 1}{\omega} \\ "
                r"0 & 1 & \frac{1 - \cos \omega T}{\omega} & \frac{\sin \omega T}{\omega} \\ 0 & 0 & \cos \omega T & "
                r"-\sin \omega T \\ 0 & 0 & \sin \omega T & \cos \omega T \end{pmatrix} x_{k-1} + G w_k",
            ),
            Equation(
                "Bearing from station i", r"z_i = \mathrm{atan2}(x - x_i, y - y_i) + v_i, \quad v_i \sim N(0, \sigma_\theta^2)"
            ),
            Equation(
                "Modes: straight flight, left turn, right turn",
                r"P(r_k = j \mid r_{k-1} = i) = \begin{pmatrix} 0.9 & 0.05 & 0.05 \\ 0.2 & 0.795 & 0.005 \\ "
                r"0.2 & 0.005 & 0.795 \end{pmatrix}_{ij}",
            ),
            Equation("Accelerations", r"w_k \sim N(0, \sigma_a^2 I), \quad \sigma_a = 0.01\ \mathrm{km/s^2}"),
        ),
        assumptions=(
            "Stated in the paper: straight flight and turns at a constant rate; three modes, their transition probabilities p "
            "and first probabilities u(0) = (0.9, 0.05, 0.05); bearings counted from the y axis; P(0) = 1e-6 diag(400, 400, "
            "100, 100); a variance of the state noise of 100 m/s² in all modes; of its filter N_s = nN particles kept with "
            "0.8 < n < 1; the mean μ and the deviation σ of the RMSE of J runs, of each coordinate.",
            "Read so here: P(0) in km² and km²/s², that is 20 m and 10 m/s; the variance as (10 m/s²)², that is (0.01 km/s²)²; "
            "the three modes as straight flight, a turn to the left and one to the right.",
            "Chosen here: T = 1 s, ω = 0.1 rad/s, stations at (0, 0), (20, 0) and (10, 20) km, bearings good to "
            f"{1000 * sigma:g} mrad, a start at (3, 6) km with (150, 50) m/s, 100 steps, of which 31 to 50 turn left and 71 to "
            "90 right; N, n and J. The paper may state them: the copy at hand lacks paragraphs, that on the simulation and "
            "step 4 of the uniform resampling among them.",
            "Corrected in the paper's model: the entry (cos ωT)/ω of the turn is (cos ωT - 1)/ω; G, printed transposed for "
            "straight flight and without the rows of the velocities for turns, is (T²/2, 0; 0, T²/2; T, 0; 0, T) in all modes; "
            "the arc tangent of a quotient is taken over the four quadrants; (2) prints h_k(x_k) for the measurement of step "
            "k + 1.",
            "Corrected in the paper's filter: (9) repeats (8) in place of the mixing probabilities; the sums up to N_s in (8), "
            "(10), (11) and (19), and that up to N in (16), are over the three modes; the covariance on the left of (11) is "
            "that of mode l1; predicted particles, printed k-1/k-1, are k/k-1; a particle filter goes on at step 3, not 2.",
            "Chosen here: the flight has no process noise, and starts from a draw of the prior. That is the same as one flight "
            "with a filter's start drawn about its own, up to the bend of the bearings.",
            "At a station itself a bearing has no slope, and a filter that linearises there loses the run; the flight keeps "
            "more than 2 km off.",
            "A run has diverged when its position is off by more than 1 km for 5 steps on end.",
        ),
        published=(
            Published(
                "imm-aupf",
                "RMSE of x and of y, against that of IMM-PF",
                None,
                "km",
                "Figs 6 and 7, section 5",
                "said to be more accurate; which numbers of particles and runs is not known",
                metric="run-rmse",
                block="position",
            ),
        ),
        experiment=Experiment(100, ("imm-pf", "imm-aupf")),
        plane=(0, 1),
        landmarks=tuple((f"station {i + 1}", float(x), float(y)) for i, (x, y) in enumerate(STATIONS)),
        model=model(sigma),
        generate=functools.partial(flown, sigma),
        origin=GIVEN_TRACK,
    )


CASES = (
    case("passive-multisensor", 2e-3, "2 mrad"),
    case("passive-multisensor/5mrad", 5e-3, "5 mrad"),
)
