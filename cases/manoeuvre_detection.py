"""Bearings only of a target that turns now and then, from an observer that moves (Radosavljevic and Stankovic)."""

import functools
from dataclasses import dataclass

import numpy as np

from suite.case import Case, Divergence, Equation, StateBlock, Truth, measure
from suite.jump import JumpModel
from suite.linalg import Array
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian
from suite.random import Generators

STEPS = 40
TURNS = (range(11, 21), range(31, 41))  # the scans of a manoeuvre
SIGMA_A = 1.6e-6  # km/s², standard deviation of the acceleration over a scan
KNOT = 1.852 / 3600  # km/s
TRANSITION = np.array([[0.9, 0.1], [0.1, 0.9]])
INITIAL = np.array([0.95, 0.05])
DEGREE = np.pi / 180
LEGS = ((0, 140.0), (13, 140.0), (17, 20.0), (31, 20.0), (35, 155.0), (40, 155.0))
"""Course of the observer in degrees at some scans; in between it is linear in time."""


@dataclass(frozen=True)
class Scene:
    """A set-up: T in s, ranges in km, speeds in km/s, angles in degrees, the acceleration of a manoeuvre in km/s²."""

    T: float
    range: float
    bearing: float
    speed: float
    course: float
    observer: float
    acceleration: float
    sigma: float
    range_std: float
    speed_std: float
    course_std: float
    course_guess: float


NAVAL = Scene(60.0, 5.0, 80.0, 4 * KNOT, -140.0, 5 * KNOT, 1.08e-5, 1.5, 0.1, 0.1 * KNOT, 3.0, -140.0)
NAVAL_LOOSE = Scene(60.0, 5.0, 80.0, 4 * KNOT, -140.0, 5 * KNOT, 1.08e-5, 1.5, 2.0, 2 * KNOT, 180 / np.sqrt(12), 80.0 + 180.0)
AIRCRAFT_LOOSE = Scene(1.5, 8.0, 80.0, 0.2, -140.0, 0.25, 0.03, 0.5, 3.2, 0.1, 180 / np.sqrt(12), 80.0 + 180.0)


def heading(degrees: Array | float) -> Array:
    """Unit vectors [2, ...], east and north, of courses counted from north."""
    return np.stack([np.sin(np.multiply(degrees, DEGREE)), np.cos(np.multiply(degrees, DEGREE))])


def observer(scene: Scene) -> Array:
    """Positions [2, K + 1] of the observer at scans 0 to K, by integration along its course."""
    fine = 1000
    scans = (np.arange(STEPS * fine) + 0.5) / fine
    course = np.interp(scans, [k for k, _ in LEGS], [c for _, c in LEGS])
    moves = scene.observer * scene.T * heading(course).reshape(2, STEPS, fine).mean(-1)
    return np.concat([np.zeros((2, 1)), np.cumsum(moves, axis=1)], axis=1)


def scattered(length: float, length_std: float, angle: float, angle_std: float) -> tuple[Array, Array]:
    """Mean [2] and covariance [2, 2] of a vector, east and north, of uncertain length and uncertain course in degrees."""
    shrink, square = np.exp(-0.5 * (angle_std * DEGREE) ** 2), length**2 + length_std**2
    mean = length * shrink * heading(angle)
    double = shrink**4 * heading(2 * angle)
    second = square / 2 * np.array([[1 - double[1], double[0]], [double[0], 1 + double[1]]])
    return mean, second - np.outer(mean, mean)


def prior(scene: Scene) -> Gaussian:
    """Law of the state (x, vx, y, vy) at scan 0, by the moments of range, bearing, speed and course."""
    place, place_cov = scattered(scene.range, scene.range_std, scene.bearing, scene.sigma)
    velocity, velocity_cov = scattered(scene.speed, scene.speed_std, scene.course_guess, scene.course_std)
    mean, cov = np.empty(4), np.zeros((4, 4))
    mean[[0, 2]], mean[[1, 3]] = place, velocity
    cov[np.ix_([0, 2], [0, 2])], cov[np.ix_([1, 3], [1, 3])] = place_cov, velocity_cov
    return Gaussian(mean, cov)


def turned(scene: Scene, x: Array, k: int) -> Array:
    """A scan of a turn at constant speed, whose rate is the acceleration over the speed, counter-clockwise."""
    px, vx, py, vy = x
    rate = scene.acceleration / np.sqrt(vx * vx + vy * vy)
    s, c = np.sin(rate * scene.T), np.cos(rate * scene.T)
    east, north = (vx * s - vy * (1 - c)) / rate, (vx * (1 - c) + vy * s) / rate
    return np.stack([px + east, vx * c - vy * s, py + north, vx * s + vy * c])


def model(scene: Scene) -> JumpModel:
    """Constant velocity and turn, seen by bearing from the moving observer."""
    own = observer(scene)

    def bearing(x: Array, k: int) -> Array:
        return np.stack([np.arctan2(x[0] - own[0, k], x[2] - own[1, k])])

    T = scene.T
    straight = Affine(np.kron(np.eye(2), [[1.0, T], [0.0, 1.0]]))
    gain, noise = np.kron(np.eye(2), [[T * T / 2], [T]]), Gaussian.diagonal([SIGMA_A**2] * 2)
    sensor = AdditiveSensor(bearing, Gaussian.diagonal([(scene.sigma * DEGREE) ** 2]), angles=(0,))
    motions = (straight, functools.partial(turned, scene))
    modes = tuple(StateSpaceModel(prior(scene), AdditiveTransition(motion, noise, gain), sensor) for motion in motions)
    return JumpModel(modes, TRANSITION, INITIAL, names=("straight", "turn"))


def sailed(scene: Scene, turns: tuple[range, ...], rng: Generators) -> Truth:
    """The target's one way through its turns, without noise, and what the observer measures in each run."""
    modes = model(scene).modes
    place, velocity = scene.range * heading(scene.bearing), scene.speed * heading(scene.course)
    x, states, in_force = np.stack([place[0], velocity[0], place[1], velocity[1]])[:, None], [], []
    for k in range(1, STEPS + 1):
        turning = any(k in scans for scans in turns)
        x = modes[turning].dynamics.mean(x, k)  # type: ignore[attr-defined]
        states.append(x)
        in_force.append(int(turning))
    trajectory = np.repeat(np.stack(states), rng.runs, axis=2)
    return Truth(trajectory, measure(modes[0].sensor, trajectory, rng), np.repeat(np.array(in_force)[:, None], rng.runs, 1))


def case(name: str, scene: Scene, words: str, turns: tuple[range, ...], guess: str) -> Case:
    """A set-up with the turns that really happen; `guess` says what the prior knows."""
    happens = "turns in scans 11 to 20 and 31 to 40" if turns else "never turns: what alarms there are, are false"
    return Case(
        name=f"manoeuvre-detection/{name}",
        title=f"Bearings only, {words}",
        summary=f"A moving observer measures the bearing of a target that {happens}. Filters know that it may turn, and "
        "detectors are to say when it does.",
        steps=STEPS,
        interval=scene.T,
        state=("x", "vx", "y", "vy"),
        blocks=(StateBlock("position", (0, 2), "km"), StateBlock("velocity", (1, 3), "km/s")),
        divergence=Divergence("position", limit=0.5 * scene.range, steps=5),
        reference="Radosavljevic, Stankovic, Manoeuvre detection by a particle filter (in Serbian)",
        equations=(
            Equation("Straight flight, on both axes", r"x_k = x_{k-1} + T \dot x_{k-1} + \frac{T^2}{2} w_k, \quad "
                     r"\dot x_k = \dot x_{k-1} + T w_k"),
            Equation(
                "Turn, its velocity rotated by ωT",
                r"x_k = x_{k-1} + \dot x_{k-1} \frac{\sin \omega T}{\omega} - \dot y_{k-1} \frac{1 - \cos \omega T}{\omega}, "
                r"\quad \omega = \frac{a_m}{\sqrt{\dot x_{k-1}^2 + \dot y_{k-1}^2}}",
            ),
            Equation(
                "Bearing from the observer at o", r"z_k = \mathrm{atan2}(x_k - o_{x,k}, y_k - o_{y,k}) + v_k, \quad "
                r"v_k \sim N(0, \sigma_\theta^2)"
            ),
        ),
        assumptions=(
            "Stated in the paper: 40 scans, turns in scans 11 to 20 and 31 to 40 (its printed ranges overlap), accelerations "
            f"of {SIGMA_A:g} km/s². Its interval of 1.5 s does not fit that naval number (2 mm a scan).",
            f"Chosen here, after Arulampalam, Ristic, Gordon and Mansell (2004) where the paper is silent: T = {scene.T:g} s, "
            f"a target at {scene.range:g} km, bearing {scene.bearing:g}°, {scene.speed:.4g} km/s, course {scene.course:g}°; an "
            f"observer of {scene.observer:.4g} km/s on course 140°, 20° and 155°, turning in scans 13 to 17 and 31 to 35; "
            f"σ_θ = {scene.sigma:g}°, a_m = {scene.acceleration:g} km/s²; P = (0.9, 0.1; 0.1, 0.9), initially (0.95, 0.05).",
            f"The prior has the moments of {guess}, about the target's true bearing; scan 0 itself is not measured.",
            "The target has no process noise and sails one and the same way in all runs; the turn is counter-clockwise seen "
            "with x to the east and y to the north.",
            f"A run has diverged when its position is off by more than {0.5 * scene.range:g} km for 5 scans on end.",
        ),
        plane=(0, 2),
        model=model(scene),
        generate=functools.partial(sailed, scene, turns),
    )  # fmt: skip


def knowledge(scene: Scene) -> str:
    """What the prior of a scene knows, in words."""
    return (
        f"range {scene.range:g} ± {scene.range_std:g} km, bearing ± {scene.sigma:g}°, speed {scene.speed:.4g} ± "
        f"{scene.speed_std:.4g} km/s and course {scene.course_guess:g}° ± {scene.course_std:.3g}°"
    )


CASES = tuple(
    case(f"{name}{'' if turns else '-straight'}", scene, f"{words}{'' if turns else ', no turn'}", turns, knowledge(scene))
    for name, scene, words in (
        ("naval", NAVAL, "ships"),
        ("naval-loose", NAVAL_LOOSE, "ships, little known at first"),
        ("aircraft-loose", AIRCRAFT_LOOSE, "aircraft, little known at first"),
    )
    for turns in (TURNS, ())
)
