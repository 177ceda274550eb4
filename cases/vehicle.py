"""A land vehicle of known throttle and steering, whose position is disturbed and whose position and speed are measured."""

import functools

import numpy as np

from suite.case import Case, Divergence, Equation, StateBlock, draw
from suite.linalg import Array
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian
from suite.published import Published

# Symbols as in the paper. State x = (e, n, v, θ): east and north in m, speed in m/s, heading in rad from east towards north.
T = 0.5  # s, sampling period
P = 100_000.0  # W, peak power of the engine
A, CD = 1.0, 0.3  # m², 1: frontal area and drag coefficient; A CD v² is a force in N, as printed
M = 1250.0  # kg
L = 2.5  # m, wheelbase
SLOWEST = 0.5  # m/s; the engine's force P u / v takes a vehicle to be at least that fast
STEPS, TOUR = 200, 600  # 100 s, and 300 s with all manoeuvres
START = (0.0, 0.0, 5.0, 0.0)

SPEEDS = ((0, 20, 45, 60, 100, 120, 200, 212, 260, 272, 300), (5, 25, 25, 5, 5, 20, 20, 25, 25, 15, 15))  # s, m/s
HEADINGS = ((0, 100, 106, 200, 206, 275, 290, 300), (0, 0, np.pi / 2, np.pi / 2, np.pi, np.pi, 2 * np.pi, 2 * np.pi))  # s, rad


def speed(k: int) -> float:
    """Speed in m/s that the driver keeps to at step k, linear between its corners."""
    return float(np.interp(k * T, *SPEEDS))


def heading(k: int) -> float:
    """Heading in rad that the driver keeps to at step k, linear between its corners."""
    return float(np.interp(k * T, *HEADINGS))


@functools.cache
def throttle(k: int) -> float:
    """Throttle u_a between steps k - 1 and k that takes a vehicle from speed(k - 1) to speed(k)."""
    v = speed(k - 1)
    return (M * (speed(k) - v) / T + A * CD * v**2) * v / P


@functools.cache
def steering(k: int) -> float:
    """Steering angle u_ψ in rad between steps k - 1 and k that turns a vehicle of the driver's speed by the driver's turn."""
    return float(np.arctan(L * (heading(k) - heading(k - 1)) / (T * speed(k - 1))))


def drive(x: Array, k: int) -> Array:
    """State after T seconds of throttle and steering (eq. 4)."""
    e, n, v, th = x
    force = P * throttle(k) / np.maximum(v, SLOWEST) - A * CD * v * v
    return np.stack([e + T * v * np.cos(th), n + T * v * np.sin(th), v + T * force / M, th + T * np.tan(steering(k)) / L * v])


def model(process: float, measurement: float, spread: Array) -> StateSpaceModel:
    """The paper's model with variances of w (m²/s²) and v (m², m², m²/s²) and the covariance of the start."""
    return StateSpaceModel(
        prior=Gaussian(np.array(START), spread),
        dynamics=AdditiveTransition(drive, Gaussian.diagonal([process] * 2), gain=T * np.eye(4, 2)),
        sensor=AdditiveSensor(Affine(np.eye(3, 4)), Gaussian.diagonal([measurement] * 3)),
        linear=(0, 1),
    )


# Scenario: variances of w and v, and the printed η of the particle filter and of the unscented Kalman filter.
SCENARIOS = {1: (5.0, 10.0, 1.0929, 4.9375), 2: (10.0, 15.0, 1.3458, 5.3851), 3: (15.0, 20.0, 1.6726, 10.3337)}

READING = (
    "The noise levels of Table 1, called standard deviations and written σ, are read as variances. They cannot be standard "
    "deviations: from a known start the error is proportional to the noise, so that doubling both levels doubles η, and η "
    "grows with either; then η of (15, 20) would exceed η of (10, 20), twice that of (5, 10), whatever T and K are. Printed "
    "are 1.6726 and 1.0929."
)


def journey(name: str, title: str, scenario: int, steps: int, spread: Array, words: str, *assumptions: str) -> Case:
    """A drive of so many steps under the noises of a scenario, from a start of the given covariance."""
    process, measurement, particle, unscented = SCENARIOS[scenario]
    chosen = model(process, measurement, spread)
    known = not spread.any()
    return Case(
        name=name,
        title=title,
        summary=f"A car drives about; throttle and steering are known, wind and road push its position at random. {words}",
        steps=steps,
        interval=T,
        state=("e", "n", "v", "theta"),
        blocks=(StateBlock("position", (0, 1), "m"), StateBlock("speed", (2,), "m/s"), StateBlock("heading", (3,), "rad")),
        # The exact filter's position error has standard deviations of 2.4 to 3.7 m in the plane when the start is known.
        divergence=Divergence("position", limit=20.0, steps=10),
        reference="H. A. Velozo, F. das Chagas Souza, Rastreamento de trajetória de veículo terrestre não linear estocástico "
        "multivariável utilizando filtro de partículas (in Portuguese)",
        equations=(
            Equation(
                "Motion",
                r"x_k = \begin{pmatrix} e + T v \cos\theta \\ n + T v \sin\theta \\ "
                r"v + \frac{T}{M} \left( \frac{P u^{(a)}}{v} - A C_d v^2 \right) \\ "
                r"\theta + \frac{T}{L} v \tan u^{(\psi)} \end{pmatrix}_{k-1} + T \begin{pmatrix} I_2 \\ 0 \end{pmatrix} w_k",
            ),
            Equation("Measurement", r"z_k = (e, n, v)_k + v_k"),
            Equation(
                "Noises",
                rf"w_k \sim N(0, {process:g}\, I_2)\ \mathrm{{m^2/s^2}}, \quad v_k \sim N(0, {measurement:g}\, I_3), "
                r"\quad T = 0.5\ \mathrm{s}",
            ),
            Equation(
                "Parameters",
                r"P = 10^5\ \mathrm{W}, \quad A = 1\ \mathrm{m^2}, \quad C_d = 0.3, \quad M = 1250\ \mathrm{kg}, "
                r"\quad L = 2.5\ \mathrm{m}",
            ),
        ),
        assumptions=(
            "Stated in the paper: the equations, P, A, Cd, M, L, noise on the position alone and entering through the gain "
            "T, the three noise levels; 300 particles and systematic resampling; the error measure η.",
            READING,
            f"Not stated: the sampling period, T = 0.5 s here, with which the printed figures of the particle filter agree "
            f"to 5 percent; the number of steps, {steps} here; and the inputs.",
            "Inputs are functions of the step, by inversion of a drive made up after the example that the constants are "
            "those of (The MathWorks, State Estimation Using Time-Varying Kalman Filter): speed 5, 25 (20 s), 25 (45), "
            "5 (60), 5 (100), 20 (120), 20 (200), 25 (212), 25 (260), 15 m/s (272 to 300 s); headings east, from 100 to 106 s "
            "to north, 200 to 206 s to west, 275 to 290 s over south to east; all linear in between.",
            "The engine's force is that at 0.5 m/s where a vehicle is slower: at rest equation (4) divides by zero. Heading "
            "is counted on and not wrapped.",
            "Corrected: the left side of (4) has a fifth entry too many, and θ where the state's heading is meant; the "
            "steering is u_φ in (1), u_ψ in (4), and v is speed and noise; (19) lacks the square of the weights; (25) and "
            "(26) are the measurement noise. Drag is A Cd v² without half the air's density, as printed.",
            "η is a mean of norms and no root mean square error; it adds m, m/s and rad as they stand.",
            "A run has diverged when its position is more than 20 m off for 10 steps on end.",
            *assumptions,
        ),
        published=(
            Published("sir", "η", particle, "mixed", f"Table 1, scenario {scenario}", "300 particles, threshold not stated"),
            Published(
                "ukf",
                "η",
                unscented,
                "mixed",
                f"Table 1, scenario {scenario}",
                "a filter told of this model has the optimum, about 1.07, 1.40 and 1.65 in the three scenarios; the printed "
                "figures need one that is told of another noise, start or input",
            ),
        )
        if known
        else (),
        plane=(0, 1),
        model=chosen,
        generate=functools.partial(draw, chosen, steps),
    )


def from_known_start(scenario: int) -> Case:
    """A scenario of Table 1."""
    return journey(
        f"vehicle/{scenario}",
        f"Land vehicle, scenario {scenario}",
        scenario,
        STEPS,
        np.zeros((4, 4)),
        "The start is known, and so, without noise on them, are speed and heading ever after: what is left to estimate is "
        "two coordinates under additive noise, and a Kalman filter for each of them is exact. Nothing is nonlinear here but "
        "what is known.",
        "The start is known: the paper finds that estimates of the speed coincide with the truth, and calls this the effect "
        "of no process noise. It is (0, 0, 5 m/s, 0).",
        "The first 100 s lead straight on, to the east. Inputs do not matter here: the errors of an exact filter do not depend "
        "on them.",
    )


CASES = (
    *(from_known_start(scenario) for scenario in SCENARIOS),
    journey(
        "vehicle/uncertain",
        "Land vehicle, uncertain start, all manoeuvres",
        1,
        TOUR,
        np.diag([10.0, 10.0, 0.25, 0.01]),
        "The start is uncertain in all components. Speed and heading have no noise of their own and are to be found as "
        "constants are: a particle filter that resamples loses the variety of its first particles for good.",
        "The start is N((0, 0, 5 m/s, 0), diag(10 m², 10 m², 0.25 m²/s², 0.01 rad²)), for truth and filters, and the drive "
        "lasts 300 s, since the first 100 s lead straight on. This is not the paper's: its scenario 1 otherwise.",
    ),
)
