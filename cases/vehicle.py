"""A land vehicle of known throttle and steering, whose position is disturbed and whose position and speed are measured."""

import functools

import numpy as np

from suite.case import Case, Divergence, Equation, StateBlock, draw
from suite.linalg import Array
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian
from suite.published import Experiment, Published

# Symbols as in the paper, but for its state (x⁽ˡ⁾, x⁽ⁿ⁾, x⁽ᵛ⁾, x⁽ᶿ⁾), here (e, n, v, θ): east and north in m, speed in m/s and
# heading in rad, from east towards north.
T = 0.5  # s, sampling period; not stated
P = 100_000.0  # W, peak power of the engine
A, CD = 1.0, 0.3  # m², 1: frontal area and drag coefficient; A CD v² is a force in N, as printed
M = 1250.0  # kg
L = 2.5  # m, wheelbase
SLOWEST = 0.5  # m/s; the engine's force P u / v takes a vehicle to be at least that fast
TIME, TOUR = 100.0, 300.0  # s; the latter with all manoeuvres
START = (0.0, 0.0, 5.0, 0.0)
KNOWN = np.zeros((4, 4))  # covariance of a known start

SPEEDS = ((0, 20, 45, 60, 100, 120, 200, 212, 260, 272, 300), (5, 25, 25, 5, 5, 20, 20, 25, 25, 15, 15))  # s, m/s
HEADINGS = ((0, 100, 106, 200, 206, 275, 290, 300), (0, 0, np.pi / 2, np.pi / 2, np.pi, np.pi, 2 * np.pi, 2 * np.pi))  # s, rad


def speed(t: float) -> float:
    """Speed in m/s that the driver keeps to at t seconds, linear between its corners."""
    return float(np.interp(t, *SPEEDS))


def heading(t: float) -> float:
    """Heading in rad that the driver keeps to at t seconds, linear between its corners."""
    return float(np.interp(t, *HEADINGS))


@functools.cache
def throttle(T: float, k: int) -> float:
    """Throttle u_a between steps k - 1 and k that takes a vehicle from the driver's speed at the one to that at the other."""
    v = speed((k - 1) * T)
    return (M * (speed(k * T) - v) / T + A * CD * v**2) * v / P


@functools.cache
def steering(T: float, k: int) -> float:
    """Steering angle u_ψ in rad between steps k - 1 and k that turns a vehicle of the driver's speed by the driver's turn."""
    before = (k - 1) * T
    return float(np.arctan(L * (heading(k * T) - heading(before)) / (T * speed(before))))


def drive(T: float, x: Array, k: int) -> Array:
    """State after T seconds of throttle and steering (eq. 4)."""
    e, n, v, th = x
    force = P * throttle(T, k) / np.maximum(v, SLOWEST) - A * CD * v * v
    turn = T * np.tan(steering(T, k)) / L * v
    return np.stack([e + T * v * np.cos(th), n + T * v * np.sin(th), v + T * force / M, th + turn])


def model(T: float, process: float, measurement: float, spread: Array) -> StateSpaceModel:
    """The paper's model with variances of w (m²/s²) and v (m², m², m²/s²) and the covariance of the start."""
    return StateSpaceModel(
        prior=Gaussian(np.array(START), spread),
        dynamics=AdditiveTransition(functools.partial(drive, T), Gaussian.diagonal([process] * 2), gain=T * np.eye(4, 2)),
        sensor=AdditiveSensor(Affine(np.eye(3, 4)), Gaussian.diagonal([measurement] * 3)),
        linear=(0, 1),
    )


# Scenario: the printed levels σ_w and σ_v, and the printed η of the particle filter and of the unscented Kalman filter.
SCENARIOS = {1: (5.0, 10.0, 1.0929, 4.9375), 2: (10.0, 15.0, 1.3458, 5.3851), 3: (15.0, 20.0, 1.6726, 10.3337)}
PARTICLES = "sir[particles=300]"
EXPERIMENT = Experiment(100, (PARTICLES, "sir[particles=300,threshold=0.1]", "ukf"))

VARIANCES = (
    "The noise levels of Table 1, called standard deviations and written σ, are read as variances. They cannot be standard "
    "deviations: from a known start the error is proportional to the noise, so that doubling both levels doubles η, and η "
    "grows with either; then η of (15, 20) would exceed η of (10, 20), twice that of (5, 10), whatever T and K are. Printed "
    "are 1.6726 and 1.0929."
)
KNOWN_START = (
    "The start is known: the paper finds that estimates of the speed coincide with the truth, and calls this the effect "
    "of no process noise. It is (0, 0, 5 m/s, 0)."
)


def published(scenario: int) -> tuple[Published, ...]:
    """What the paper prints of a scenario, and what it claims by figures; those are of scenario 2."""
    *_, particle, unscented = SCENARIOS[scenario]
    where = f"Table 1, scenario {scenario}"
    printed = (
        Published(
            PARTICLES, "η", particle, "mixed", where, "the threshold θ is not stated",
            metric="eta", block="state", runs=EXPERIMENT.runs,
        ),
        Published(
            "ukf", "η", unscented, "mixed", where,
            "a filter told of this model has the optimum, about 1.07, 1.40 and 1.65 in the three scenarios; the printed "
            "figures need one that is told of another noise, start or input",
            metric="eta", block="state", runs=EXPERIMENT.runs,
        ),
    )  # fmt: skip
    if scenario != 2:
        return printed
    return (
        *printed,
        Published(
            PARTICLES, "mean error at every step, against that of the UKF", None, "mixed", "Figs 7 to 9, section 4",
            "said to be smaller, of the whole state and of either coordinate; which scenario is not said",
            metric="eta", block="state", runs=EXPERIMENT.runs,
        ),
        Published(
            PARTICLES, "error of the speed", None, "m/s", "Fig. 6, section 4",
            "estimates are said to coincide with the truth", metric="rmse", block="speed", runs=1,
        ),
    )  # fmt: skip


def journey(
    name: str,
    title: str,
    words: str,
    scenario: int,
    *assumptions: str,
    T: float = T,
    time: float = TIME,
    power: int = 1,
    spread: Array = KNOWN,
) -> Case:
    """A drive of `time` seconds under the noises of a scenario, from a start of the given covariance.

    power: which makes a variance of a printed level, 1 or 2.
    """
    process, measurement = (level**power for level in SCENARIOS[scenario][:2])
    steps, chosen, known = round(time / T), model(T, process, measurement, spread), not spread.any()
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
                r"\theta + \frac{T}{L} v \tan u^{(\psi)} \end{pmatrix}_{k-1} + B w_k, "
                r"\quad B = T \begin{pmatrix} I_2 \\ 0 \end{pmatrix}",
            ),
            Equation("Measurement", r"z_k = (e, n, v)_k + v_k"),
            Equation(
                "Noises",
                rf"w_k \sim N(0, {process:g}\, I_2)\ \mathrm{{m^2/s^2}}, \quad v_k \sim N(0, {measurement:g}\, I_3), "
                rf"\quad T = {T:g}\ \mathrm{{s}}",
            ),
            Equation(
                "Parameters",
                r"P = 10^5\ \mathrm{W}, \quad A = 1\ \mathrm{m^2}, \quad C_d = 0.3, \quad M = 1250\ \mathrm{kg}, "
                r"\quad L = 2.5\ \mathrm{m}",
            ),
        ),
        assumptions=(
            "Stated in the paper: the equations, P, A, C_d, M, L; process noise on the position alone, through the gain B = "
            "T (I, 0); means of zero of both noises, Σ_w = σ_w² I, Σ_v = σ_v² I and three pairs of levels σ_w, σ_v; N_p = 300 "
            "particles, drawn from the transition, and systematic resampling below θ N_p effective ones; N_MC = 100 runs; the "
            "error measures ε_k, ε_α,k and η.",
            f"Not stated: the sampling period, T = {T:g} s here; the number of steps N_k, {steps} here; the inputs u_a and "
            "u_ψ; the start and its covariance; the resampling threshold θ; all that the unscented filter is told.",
            "Inputs are functions of the time, by inversion of a drive made up after the example that the constants are "
            "those of (The MathWorks, State Estimation Using Time-Varying Kalman Filter): speed 5, 25 (20 s), 25 (45), "
            "5 (60), 5 (100), 20 (120), 20 (200), 25 (212), 25 (260), 15 m/s (272 to 300 s); headings east, from 100 to 106 s "
            "to north, 200 to 206 s to west, 275 to 290 s over south to east; all linear in between.",
            "The engine's force is that at 0.5 m/s where a vehicle is slower, or rolls backwards: at rest equation (4) divides "
            "by zero. Drag -A C_d v² is as printed: it does not turn round with the vehicle. Heading is counted on and not "
            "wrapped.",
            "Corrected: the left side of (4) has a fifth entry too many, and θ where the state's heading is meant; the "
            "steering is u_φ in (1), u_ψ in (4), the number of steps N_T in (3), N_k in (29), the unnormalised weight "
            "w_k in (17), w_{k|k-1} in (18), and v is speed and noise; (19) lacks the square of the weights; (25) and "
            "(26) are of the measurement noise. The text speaks of speeds to the north and to the east; the state has speed "
            "and heading. Drag is A C_d v² without half the air's density, as printed.",
            "ε and η are called RMSE, but (28) and (29) are means of norms, (30) of absolute errors; the first two add m, m/s "
            "and rad as they stand.",
            "A run has diverged when its position is more than 20 m off for 10 steps on end.",
            *assumptions,
        ),
        published=published(scenario) if known else (),
        experiment=EXPERIMENT if known else None,
        plane=(0, 1),
        model=chosen,
        generate=functools.partial(draw, chosen, steps),
    )


CASES = (
    *(
        journey(
            f"vehicle/{scenario}",
            f"Land vehicle, scenario {scenario}",
            "The start is known, and so, without noise on them, are speed and heading ever after: what is left to estimate is "
            "two coordinates under additive noise, and a Kalman filter for each of them is exact. Nothing is nonlinear here "
            "but what is known.",
            scenario,
            VARIANCES,
            "With T = 0.5 s the printed figures of the particle filter agree to 5 percent; `cases/sweeps/vehicle.py` has "
            "other periods, horizons and the other reading.",
            KNOWN_START,
            "The first 100 s lead straight on, to the east. Inputs do not matter here: the errors of an exact filter do not "
            "depend on them.",
        )
        for scenario in SCENARIOS
    ),
    journey(
        "vehicle/uncertain",
        "Land vehicle, uncertain start, all manoeuvres",
        "The start is uncertain in all components. Speed and heading have no noise of their own and are to be found as "
        "constants are: a particle filter that resamples loses the variety of its first particles for good.",
        1,
        VARIANCES,
        "The start is N((0, 0, 5 m/s, 0), diag(10 m², 10 m², 0.25 m²/s², 0.01 rad²)), for truth and filters, and the drive "
        "lasts 300 s, since the first 100 s lead straight on. This is not the paper's: its scenario 1 otherwise.",
        time=TOUR,
        spread=np.diag([10.0, 10.0, 0.25, 0.01]),
    ),
)
