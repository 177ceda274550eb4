"""Bearings only of a target that turns now and then, from an observer that moves (Radosavljevic and Stankovic)."""

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from suite.case import GIVEN_TRACK, Case, Divergence, Equation, StateBlock, Truth, measure
from suite.jump import JumpModel, Modes
from suite.linalg import Array
from suite.model import AdditiveSensor, AdditiveTransition, Affine, Function, StateSpaceModel
from suite.noise import Gaussian
from suite.published import Experiment, Published
from suite.random import Generators

FAMILY = "manoeuvre-detection"
STEPS = 40
SLOWEST = 1e-6  # km/s; the turn rate takes a target to be at least that fast
TURNS = (range(11, 21), range(31, 41))  # the scans of a manoeuvre
SIGMA_A = 1.6e-6  # km/s², standard deviation of the acceleration over a scan
KNOT = 1.852 / 3600  # km/s
TRANSITION = np.array([[0.9, 0.1], [0.1, 0.9]])
INITIAL = np.array([0.95, 0.05])
DEGREE = np.pi / 180
LEGS = ((0, 140.0), (13, 140.0), (17, 20.0), (31, 20.0), (35, 155.0), (40, 155.0))
"""Course of the observer in degrees at some scans; in between it is linear in time."""


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A set-up: T in s, ranges in km, speeds in km/s, angles in degrees, the acceleration of a turn in km/s².

    sigma is that of a bearing; range_std, speed_std, course_std and course_guess are what the prior knows at scan 0.
    """

    T: float
    range: float
    bearing: float = 80.0
    speed: float
    course: float = -140.0
    observer: float
    acceleration: float
    sigma: float
    range_std: float
    speed_std: float
    course_std: float
    course_guess: float


NAVAL = Scene(
    T=60.0, range=5.0, speed=4 * KNOT, observer=5 * KNOT, acceleration=1.08e-5, sigma=1.5,
    range_std=0.1, speed_std=0.1 * KNOT, course_std=3.0, course_guess=-140.0,
)  # fmt: skip
NAVAL_LOOSE = replace(NAVAL, range_std=2.0, speed_std=2 * KNOT, course_std=180 / np.sqrt(12), course_guess=80.0 + 180.0)
AIRCRAFT_LOOSE = Scene(
    T=1.5, range=8.0, speed=0.2, observer=0.25, acceleration=0.03, sigma=0.5,
    range_std=3.2, speed_std=0.1, course_std=180 / np.sqrt(12), course_guess=80.0 + 180.0,
)  # fmt: skip


Turns = tuple[range, ...]
Start = Callable[[Scene, Generators], Array]


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
    """A scan of a turn at constant speed, whose rate is the acceleration over the speed, counter-clockwise (eq. 3)."""
    px, vx, py, vy = x
    rate = scene.acceleration / np.sqrt(np.maximum(vx * vx + vy * vy, SLOWEST**2))
    s, c = np.sin(rate * scene.T), np.cos(rate * scene.T)
    east, north = (vx * s - vy * (1 - c)) / rate, (vx * (1 - c) + vy * s) / rate
    return np.stack([px + east, vx * c - vy * s, py + north, vx * s + vy * c])


def motion(scene: Scene) -> tuple[Function, Function]:
    """Straight flight, and a turn."""
    return Affine(np.kron(np.eye(2), [[1.0, scene.T], [0.0, 1.0]])), functools.partial(turned, scene)


def model(scene: Scene) -> JumpModel:
    """Constant velocity and turn, seen by bearing from the moving observer."""
    own = observer(scene)

    def bearing(x: Array, k: int) -> Array:
        return np.stack([np.arctan2(x[0] - own[0, k], x[2] - own[1, k])])

    T = scene.T
    gain, noise = np.kron(np.eye(2), [[T * T / 2], [T]]), Gaussian.diagonal([SIGMA_A**2] * 2)
    sensor = AdditiveSensor(bearing, Gaussian.diagonal([(scene.sigma * DEGREE) ** 2]), angles=(0,))
    modes = tuple(StateSpaceModel(prior(scene), AdditiveTransition(mean, noise, gain), sensor) for mean in motion(scene))
    return JumpModel(modes, TRANSITION, INITIAL, names=("straight", "turn"))


def stated_start(scene: Scene) -> Array:
    """The state [4] at scan 0 that the scene names."""
    place, velocity = scene.range * heading(scene.bearing), scene.speed * heading(scene.course)
    return np.stack([place[0], velocity[0], place[1], velocity[1]])


def path(scene: Scene, turns: Turns, x: Array) -> tuple[Array, Modes]:
    """States [K, 4, R] at scans 1 to K of targets that start at x[4, R] and have no process noise, and their modes [K]."""
    in_force = np.array([int(any(k in scans for scans in turns)) for k in range(1, STEPS + 1)])
    motions, states = motion(scene), []
    for k, mode in enumerate(in_force, start=1):
        x = motions[mode](x, k)
        states.append(x)
    return np.stack(states), in_force


def drawn(scene: Scene, rng: Generators) -> Array:
    """Starts [4, R] drawn from the prior."""
    return prior(scene).sample(rng, (rng.runs,))


def fixed(scene: Scene, rng: Generators) -> Array:
    """The stated start in all runs [4, R]."""
    return np.repeat(stated_start(scene)[:, None], rng.runs, axis=1)


def sailed(scene: Scene, turns: Turns, start: Start, rng: Generators) -> Truth:
    """The target's way through its turns from its start in each run, and what the observer measures."""
    x, modes = path(scene, turns, start(scene, rng))
    return Truth(x, measure(model(scene).modes[0].sensor, x, rng), np.repeat(modes[:, None], rng.runs, axis=1))


def naval(scene: Scene) -> tuple[str, ...]:
    """Where the numbers of a naval scene come from."""
    place, velocity = 1e3 * scene.T**2 / 2 * SIGMA_A, 1e6 * scene.T * SIGMA_A
    return (
        f"T = {scene.T:g} s stands in place of the paper's 1.5 s. The paper's σ_a is, as far as recalled, that of the naval "
        "example of S. Arulampalam, B. Ristic, N. Gordon, T. Mansell, EURASIP Journal on Applied Signal Processing 2004(15), "
        f"2351-2365, whose scans are a minute apart: there it is worth {place:.1f} m and {velocity:.0f} mm/s a scan, in 1.5 s "
        "only 2 mm and 2 mm/s.",
        f"Recalled from that example and not checked against its text: a target at {scene.range:g} km, of "
        f"{scene.speed / KNOT:g} kn on course {scene.course:g}°; an observer of {scene.observer / KNOT:g} kn on courses 140°, "
        f"20° and 155°, linear in time from scan 13 to 17 and from 31 to 35; σ_θ = {scene.sigma:g}°; "
        f"a_m = {1e5 * scene.acceleration:g}e-5 km/s². The example's own turn, and its three modes with "
        "their probabilities, are not used.",
        f"Chosen here: the target's bearing of {scene.bearing:g}° at scan 0; the probabilities of the modes.",
    )


def aircraft(scene: Scene) -> tuple[str, ...]:
    """Where the numbers of an aircraft scene come from."""
    return (
        f"T = {scene.T:g} s is the paper's. With it σ_a is next to no process noise, 2 mm and 2 mm/s a scan; it is "
        "kept as printed.",
        f"Chosen here, from no paper: a target at {scene.range:g} km, bearing {scene.bearing:g}°, of {scene.speed:g} km/s on "
        f"course {scene.course:g}°; an observer of {scene.observer:g} km/s on courses 140°, 20° and 155°, linear in time from "
        f"scan 13 to 17 and from 31 to 35; σ_θ = {scene.sigma:g}°; a_m = {scene.acceleration:g} km/s²; the probabilities of "
        f"the modes; the prior, with the proportions of `{FAMILY}/naval-loose` in range, speed and course.",
    )


DRAWN = (
    "The prior's deviations in range, speed and course are chosen here. The target starts from a draw of the prior in each "
    "run, so that filters, all told one model, begin with the errors that it says. This replaces one start in all runs and a "
    "prior about its measured bearing, which would be another model in each run."
)
RECALLED = "The prior's deviations in range, speed and course are recalled from that example too."
FIXED = (
    "The target starts at the stated state in all runs. The prior is about its true range, bearing and speed, but about the "
    "course towards the observer."
)
CORRECTED = (
    "A target slower than 1 mm/s turns as one of that speed: at rest ω divides by zero.",
    "Corrected in the model: arctan(x/y) is taken over the four quadrants, as atan2(x, y). The state is listed as (x, y, ẋ, ẏ) "
    "but has the order (x, ẋ, y, ẏ) in eq. 3, and here; ẋ and ẏ, called accelerations, are velocities; w_k in eq. 3, called an "
    "angular acceleration, is the turn rate ω. G, called the matrix of the measurement noise and not printed, is that of an "
    "acceleration which is constant over a scan. h x(k) in eq. 4 is h[x(k)], p(y|x) in eq. 7 p(z|x). The paper's state is "
    "relative to the observer, here it is the target's own: by eq. 2 the same model.",
    "Corrected in the statistic: the values given for eq. 12, log t1 = 0 and log t2 = λ, are swapped: 0 is the lower "
    "threshold, at which no manoeuvre is accepted, λ the upper one. z_i in eq. 13 is z_k. Eq. 14, called the generalised "
    "likelihood ratio, is the marginalised one. The product in eq. 15 is a sum. Eq. 16 is a ratio of sums of point masses, "
    "which is not defined: `pf-cusum` sums in its place the log-ratios of the predictive likelihoods that its particles in a "
    "turn and those in straight flight give. Eq. 17, for the error of velocity, prints positions, and M for the count of runs.",
)
CLAIMS = tuple(
    Published("pf-cusum", f"{quantity}, against that of IMM", None, unit, where, note, metric, block, runs=100)
    for quantity, unit, where, note, metric, block in (
        ("ROC of the detection", "", "Fig. 3, section V", "said to be better; what is counted is not said", "", ""),
        ("delay of the detection", "s", "abstract in English", "onsets are said to be found very quickly", "", ""),
        ("RMSE of the velocity", "km/s", "Fig. 4, section V", "said to jump more sharply in turns", "rmse", "velocity"),
    )
)
EXPERIMENT = Experiment(100, ("imm-ekf", "multiple-model-pf", "imm-cusum", "pf-cusum", "pf-sprt"))


def case(name: str, scene: Scene, words: str, start: Start, sources: tuple[str, ...], turns: Turns) -> Case:
    """A set-up with the turns that really happen, or its twin without any."""
    happens = "turns in scans 11 to 20 and 31 to 40" if turns else "never turns: what alarms there are, are false"
    manoeuvres = (
        "The target turns in scans 11 to 20 and 31 to 40. The paper prints 1-10 and 20-30 for straight flight, 11-20 and 30-40 "
        f"for manoeuvres, which overlap in scans 20 and 30. The twin that never turns is `{FAMILY}/{name}-straight`."
        if turns
        else f"The target never turns. Not in the paper: this is the twin of `{FAMILY}/{name}`, which turns and is alike in "
        "all else but the draws: false alarms are counted here."
    )
    return Case(
        name=f"{FAMILY}/{name}" + ("" if turns else "-straight"),
        title=f"Bearings only, {words}" + ("" if turns else ", no turn"),
        summary=f"A moving observer measures the bearing of a target that {happens}. Filters know that it may turn, and "
        "detectors are to say when it does.",
        steps=STEPS,
        interval=scene.T,
        state=("x", "vx", "y", "vy"),
        blocks=(StateBlock("position", (0, 2), "km"), StateBlock("velocity", (1, 3), "km/s")),
        divergence=Divergence("position", limit=0.5 * scene.range, steps=5),
        calm=f"{FAMILY}/{name}-straight" if turns else "",
        reference="Z. Radosavljević, S. Stanković, Sekvencijalna metoda za detekciju manevra aviona (in Serbian)",
        equations=(
            Equation("Straight flight, on both axes", r"x_k = x_{k-1} + T \dot x_{k-1} + \frac{T^2}{2} w_k, \quad "
                     r"\dot x_k = \dot x_{k-1} + T w_k, \quad w_k \sim N(0, \sigma_a^2)"),
            Equation(
                "Turn, with the same noise added, its velocity rotated by ωT",
                r"\begin{pmatrix} x_k \\ y_k \end{pmatrix} = \begin{pmatrix} x_{k-1} \\ y_{k-1} \end{pmatrix} + "
                r"\frac{1}{\omega} \begin{pmatrix} \sin \omega T & \cos \omega T - 1 \\ 1 - \cos \omega T & \sin \omega T "
                r"\end{pmatrix} \begin{pmatrix} \dot x_{k-1} \\ \dot y_{k-1} \end{pmatrix}, \quad "
                r"\omega = \frac{a_m}{\sqrt{\dot x_{k-1}^2 + \dot y_{k-1}^2}}",
            ),
            Equation("Modes, straight and turn", r"P(r_k = j \mid r_{k-1} = i) = \begin{pmatrix} 0.9 & 0.1 \\ 0.1 & 0.9 "
                     r"\end{pmatrix}_{ij}, \quad P(r_0) = (0.95, 0.05)"),
            Equation(
                "Bearing from the observer at o", r"z_k = \mathrm{atan2}(x_k - o_{x,k}, y_k - o_{y,k}) + v_k, \quad "
                r"v_k \sim N(0, \sigma_\theta^2)"
            ),
        ),
        assumptions=(
            "Stated in the paper: bearings from an observer that moves; two modes, constant velocity and a turn of rate a_m "
            "over the speed; 40 scans, T = 1.5 s, σ_a = 1.6e-6 km/s²; a filter of N = 1000 particles, resampled below N/3 "
            "effective ones; 100 runs. Its text has no other number of the model; its figures were not at hand.",
            manoeuvres,
            f"The prior is Gaussian and has the moments of {knowledge(scene)}, normal and independent.",
            *sources,
            "Chosen here: the target has no process noise, scan 0 is not measured, and the turn of the model is "
            "counter-clockwise, seen with x to the east and y to the north.",
            *CORRECTED,
            f"A run has diverged when its position is off by more than {0.5 * scene.range:g} km, half the stated range of scan "
            "0, for 5 scans on end.",
        ),
        published=CLAIMS if turns else (),
        experiment=EXPERIMENT,
        plane=(0, 2),
        model=model(scene),
        generate=functools.partial(sailed, scene, turns, start),
        origin=GIVEN_TRACK,
    )  # fmt: skip


def knowledge(scene: Scene) -> str:
    """What the prior of a scene knows, in words."""
    return (
        f"range {scene.range:g} ± {scene.range_std:g} km, bearing {scene.bearing:g}° ± {scene.sigma:g}°, speed "
        f"{1e3 * scene.speed:.4g} ± {1e3 * scene.speed_std:.3g} m/s and course {scene.course_guess:g}° ± "
        f"{scene.course_std:.3g}°"
    )


CASES = tuple(
    case(name, scene, words, start, sources, turns)
    for name, scene, words, start, sources in (
        ("naval", NAVAL, "ships", drawn, (*naval(NAVAL), DRAWN)),
        ("naval-loose", NAVAL_LOOSE, "ships, little known at first", fixed, (*naval(NAVAL_LOOSE), RECALLED, FIXED)),
        ("aircraft-loose", AIRCRAFT_LOOSE, "aircraft, little known at first", fixed, (*aircraft(AIRCRAFT_LOOSE), FIXED)),
    )
    for turns in (TURNS, ())
)
