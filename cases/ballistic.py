"""Re-entry of a ballistic target with random ballistic coefficient, seen by a radar's range and elevation."""

import functools
from dataclasses import dataclass

import numpy as np

from suite.case import Case, Divergence, Equation, StateBlock, draw
from suite.linalg import Array
from suite.model import AdditiveSensor, AdditiveTransition, StateSpaceModel
from suite.noise import Gaussian
from suite.published import Experiment, Published

# Symbols as in the paper. State s = (x, ẋ, y, ẏ, β) in m, m/s, m, m/s, kg m⁻¹ s⁻².
DELTA = 2.0  # s, Δ, time between measurements
G = 9.8  # m/s², g
STEPS = 50


def air_density(y: Array) -> Array:
    """Density of the air, kg/m³, at a height of y metres: an exponential below 9144 m and another above (eq. 7)."""
    low = y < 9144.0
    return np.where(low, 1.227, 1.754) * np.exp(np.where(low, -1.093e-4, -1.49e-4) * y)


def fall(s: Array, k: int) -> Array:
    """State after DELTA seconds of constant acceleration by drag and gravity (eqs 3, 4, 6, 14)."""
    x, vx, y, vy, beta = s
    drag = (-0.5 * G) / beta * air_density(y) * np.sqrt(vx * vx + vy * vy)
    ax, ay = drag * vx, drag * vy - G
    half = DELTA**2 / 2
    return np.stack([x + DELTA * vx + half * ax, vx + DELTA * ax, y + DELTA * vy + half * ay, vy + DELTA * ay, beta])


def radar(s: Array, k: int) -> Array:
    """Range in m and elevation in rad, from a radar at the origin (eq. 8)."""
    x, _, y, _, _ = s
    return np.stack([np.sqrt(x * x + y * y), np.atan2(y, x)])


@dataclass(frozen=True, kw_only=True)
class Setting:
    """Standard deviations: σ_r in m and σ_ε in rad of range and elevation, σ_v in m/s of both components of the first velocity.

    sigma_beta in kg m⁻¹ s⁻², that of the first ballistic coefficient; q in m²/s³ and q_beta (q̃) in kg² m⁻² s⁻⁵, spectral
    densities of the white acceleration and of the coefficient's random walk.
    """

    sigma_r: float
    sigma_v: float
    sigma_e: float = 0.017
    sigma_beta: float = 2500.0
    q: float = 5.0
    q_beta: float = 5.0


def model(setting: Setting) -> StateSpaceModel:
    """The paper's model."""
    speed, heading = 2290.0, np.deg2rad(190.0)
    process = np.zeros((5, 5))
    process[:2, :2] = process[2:4, 2:4] = setting.q * np.array([[DELTA**3 / 3, DELTA**2 / 2], [DELTA**2 / 2, DELTA]])
    process[4, 4] = setting.q_beta * DELTA
    return StateSpaceModel(
        prior=Gaussian(
            np.array([232e3, speed * np.cos(heading), 88e3, speed * np.sin(heading), 40e3]),
            np.diag([1000.0, setting.sigma_v, 1000.0, setting.sigma_v, setting.sigma_beta]) ** 2,
        ),
        dynamics=AdditiveTransition(fall, Gaussian.noise(process)),
        sensor=AdditiveSensor(radar, Gaussian.diagonal([setting.sigma_r**2, setting.sigma_e**2]), angles=(1,)),
    )


STATED = (
    "Stated in the paper: every parameter; N_p = 8000 particles, 50 steps and 100 runs.",
    "The paper says in its text that ISIR resamples, and then moves its particles once, below 0.6 N_p effective ones; its "
    "Table II resamples and moves at every step. The first is `isir`, the second `isir[threshold=1.0]`. Both draw indices as "
    "(21) does, multinomially; so does the bootstrap filter, at every step: its weights leave out those of the step before.",
    "The paper takes the expectations in its bound over the 100 trajectories that are also filtered.",
)
ISIR = "isir[particles=8000]"
BOOTSTRAP = "bootstrap[particles=8000,resampling=multinomial]"
EXPERIMENT = Experiment(100, (ISIR, "isir[particles=8000,threshold=1.0]", BOOTSTRAP))


def against_bound(estimator: str, where: str, words: str) -> Published:
    """What the paper says of a curve of errors beside the curve of the bound."""
    quantity = "RMS error of x and of y at each step, against the Cramér-Rao bound"
    return Published(estimator, quantity, None, "m", where, words, metric="rmse", block="position", runs=EXPERIMENT.runs)


CONVERGED = Published(
    ISIR,
    "share of runs that do not converge",
    0.0,
    "",
    "section IV",
    "what convergence is, is not said",
    metric="divergence",
    block="runs",
    runs=EXPERIMENT.runs,
)


def re_entry(
    name: str,
    title: str,
    words: str,
    setting: Setting,
    assumptions: tuple[str, ...],
    published: tuple[Published, ...] = (),
    limit: float = 5000.0,
) -> Case:
    """A case of the paper's model; a run whose position is off by more than `limit` metres has diverged."""
    chosen = model(setting)
    return Case(
        name=name,
        title=title,
        summary="A target re-enters the atmosphere at 2290 m/s, 10 degrees below the horizontal; drag, through an unknown and "
        "slowly varying ballistic coefficient, slows it down in the last seconds. A radar measures range and elevation "
        f"every two seconds. The truth is drawn from the model that the filters are told.{words}",
        steps=STEPS,
        interval=DELTA,
        state=("x", "vx", "y", "vy", "beta"),
        blocks=(
            StateBlock("position", (0, 2), "m"),
            StateBlock("velocity", (1, 3), "m/s"),
            StateBlock("ballistic coefficient", (4,), "kg/(m s²)"),
        ),
        divergence=Divergence("position", limit=limit, steps=5),
        reference="A. Pavlov, M. G. S. Bruno, Filtro de partículas aperfeiçoado para rastreamento de alvos com coeficiente "
        "balístico variável (in Portuguese)",
        equations=(
            Equation(
                "Motion",
                r"s_{k+1} = \Phi s_k + G \left( f(s_k) + \begin{pmatrix} 0 \\ -g \end{pmatrix} \right) + w_k, "
                r"\quad w_k \sim N(0, \mathrm{diag}(q B, q B, \tilde q \Delta))",
            ),
            Equation(
                "Drag",
                r"f(s) = -\frac{g}{2 \beta} \rho(y) \sqrt{\dot x^2 + \dot y^2} \begin{pmatrix} \dot x \\ \dot y \end{pmatrix}, "
                r"\quad \rho(y) = c_1 e^{-c_2 y}",
            ),
            Equation(
                "Process noise of an axis",
                r"B = \begin{pmatrix} \Delta^3/3 & \Delta^2/2 \\ \Delta^2/2 & \Delta \end{pmatrix}, "
                rf"\quad q = {setting.q:g}, \quad \tilde q = {setting.q_beta:g}, \quad \Delta = 2\ \mathrm{{s}}",
            ),
            Equation(
                "Radar",
                r"z_k = \begin{pmatrix} \sqrt{x_k^2 + y_k^2} \\ \arctan(y_k / x_k) \end{pmatrix} + v_k, "
                r"\quad v_k \sim N(0, \mathrm{diag}(\sigma_r^2, \sigma_\epsilon^2)), "
                rf"\quad \sigma_r = {setting.sigma_r:g}\ \mathrm{{m}}, "
                rf"\quad \sigma_\epsilon = {setting.sigma_e:g}\ \mathrm{{rad}}",
            ),
        ),
        assumptions=(
            *assumptions,
            "The prior of filters and truth is N(m0, Σ0), with m0 = (232 km, 2290 cos 190° m/s, 88 km, 2290 sin 190° m/s, "
            f"40000 kg/(m s²)) and standard deviations 1000 m, {setting.sigma_v:g} m/s, {setting.sigma_beta:g} kg/(m s²).",
            "Corrected: (2) gives the ballistic coefficient's noise the variance q̃, (5) q̃Δ: (5) is used. (16) lacks the "
            "column of the ballistic coefficient, which is zero. The paper adds π to arctan where the elevation is not within "
            "0 and π/2; here it is taken over the four quadrants, as atan2.",
            "There is no ground, and nothing keeps the ballistic coefficient positive; both stay as printed. Below height zero "
            "the air goes on growing denser by (7). Drag with a negative coefficient pushes forward: in the dense air such "
            "a particle runs away within a few steps and has no weight left. At rest there is no drag, but its slope is 0/0, "
            "and a filter that linearises there loses the run.",
            "The paper does not say when a filter has diverged; here a run has when its position is more than "
            f"{limit / 1000:g} km off for 5 steps.",
        ),
        published=published,
        experiment=EXPERIMENT if published else None,
        plane=(0, 2),
        landmarks=(("radar", 0.0, 0.0),),
        model=chosen,
        generate=functools.partial(draw, chosen, STEPS),
    )


CASES = (
    # The bound on the position error falls from about 980 m at the first step to 165 m at the last.
    re_entry(
        "ballistic/1",
        "Ballistic re-entry, the milder scenario",
        "",
        Setting(sigma_r=100.0, sigma_v=20.0),
        STATED,
        (
            against_bound(
                ISIR, "Fig. 1, section IV", "said to follow the bound and to come near it in the last stages of the flight"
            ),
        ),
    ),
    re_entry(
        "ballistic/2",
        "Ballistic re-entry, the paper's second scenario",
        " Range and initial velocity are known less well than in the first scenario.",
        Setting(sigma_r=150.0, sigma_v=50.0),
        STATED,
        (
            against_bound(
                ISIR, "Fig. 2, section IV", "said to follow the bound, and to be slightly worse than in the first scenario"
            ),
            CONVERGED,
            against_bound(
                BOOTSTRAP,
                "Fig. 2, section IV",
                "said to diverge as the target enters the denser air, about step 40, and to lose the last part of the flight",
            ),
        ),
    ),
    # The process noise of the paper moves a particle by 4 m a step, and its radar is good to 100 m: the optimal proposal is all
    # but the transition, and a look at the measurement first gains little. Here particles move by 23 m and the range is good
    # to 2 m, so that of those moved blindly few fit. And over the breadth of the elevation's error the shell of that range
    # bends by far more than 2 m: the posterior is no ellipse, and linear in no one point.
    re_entry(
        "ballistic/hard",
        "Ballistic re-entry, agile target, radar of sharp range and blunt elevation",
        " Harder than the paper's scenarios: accelerations of about 1 g disturb the target, the radar is good to 2 m in range "
        "but to 0.2 rad only in elevation. The posterior is a thin bent shell: a filter that linearises at one point is too "
        "sure of itself, and few particles that move without a look at the measurement fit it.",
        Setting(sigma_r=2.0, sigma_v=50.0, sigma_e=0.2, q=200.0),
        (
            "Not the paper's, but made here to part its filters: its second scenario, but for a range good to 2 m instead of "
            "150, an elevation good to 0.2 rad instead of 0.017, and q = 200 m²/s³ instead of 5. In the paper's scenarios the "
            "noise of a step is far below that of the radar, and the linearised optimal proposal is all but the transition.",
            "In some four runs of a thousand the last states are below the ground.",
        ),
        limit=10_000.0,
    ),
)
