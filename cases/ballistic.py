"""Re-entry of a ballistic target with random ballistic coefficient, seen by a radar's range and elevation."""

import functools

import numpy as np

from suite.case import Case, Divergence, Equation, StateBlock, draw
from suite.linalg import Array
from suite.model import AdditiveSensor, AdditiveTransition, StateSpaceModel
from suite.noise import Gaussian

# Symbols as in the paper. State s = (x, vx, y, vy, beta) in m, m/s, m, m/s, kg m⁻¹ s⁻².
DELTA = 2.0  # s, time between measurements
G = 9.8  # m/s²
Q = 5.0  # m²/s³, spectral density of the white acceleration
Q_BETA = 5.0  # kg² m⁻² s⁻⁵, spectral density of the ballistic coefficient's random walk
SIGMA_ELEVATION = 0.017  # rad
STEPS = 50

AXIS_NOISE = Q * np.array([[DELTA**3 / 3, DELTA**2 / 2], [DELTA**2 / 2, DELTA]])


def air_density(y: Array) -> Array:
    """Density of the air, kg/m³, at a height of y metres: an exponential below 9144 m and another above."""
    low = y < 9144.0
    return np.where(low, 1.227, 1.754) * np.exp(np.where(low, -1.093e-4, -1.49e-4) * y)


def fall(s: Array, k: int) -> Array:
    """State after DELTA seconds of constant acceleration by drag and gravity (eqs 1-4)."""
    x, vx, y, vy, beta = s
    drag = (-0.5 * G) / beta * air_density(y) * np.sqrt(vx * vx + vy * vy)
    ax, ay = drag * vx, drag * vy - G
    half = DELTA**2 / 2
    return np.stack([x + DELTA * vx + half * ax, vx + DELTA * ax, y + DELTA * vy + half * ay, vy + DELTA * ay, beta])


def radar(s: Array, k: int) -> Array:
    """Range in m and elevation in rad, from a radar at the origin (eq. 6)."""
    x, _, y, _, _ = s
    return np.stack([np.sqrt(x * x + y * y), np.atan2(y, x)])


def model(sigma_r: float, sigma_v: float) -> StateSpaceModel:
    """The paper's model; sigma_r in m, and sigma_v in m/s for both components of the initial velocity."""
    speed, heading = 2290.0, np.deg2rad(190.0)
    process = np.zeros((5, 5))
    process[:2, :2] = process[2:4, 2:4] = AXIS_NOISE
    process[4, 4] = Q_BETA * DELTA
    return StateSpaceModel(
        prior=Gaussian(
            [232e3, speed * np.cos(heading), 88e3, speed * np.sin(heading), 40e3],
            np.diag([1000.0, sigma_v, 1000.0, sigma_v, 2500.0]) ** 2,
        ),
        dynamics=AdditiveTransition(fall, Gaussian.noise(process)),
        sensor=AdditiveSensor(radar, Gaussian.diagonal([sigma_r**2, SIGMA_ELEVATION**2]), angles=(1,)),
    )


def re_entry(name: str, title: str, sigma_r: float, sigma_v: float) -> Case:
    """A scenario of the paper: its noise in range (m) and the spread of the initial velocity (m/s)."""
    chosen = model(sigma_r, sigma_v)
    return Case(
        name=name,
        title=title,
        summary="A target re-enters the atmosphere at 2290 m/s, 10 degrees below the horizontal; drag, through an unknown and "
        "slowly varying ballistic coefficient, slows it down in the last seconds. A radar measures range and elevation "
        "every two seconds. The truth is drawn from the model that the filters are told.",
        steps=STEPS,
        interval=DELTA,
        state=("x", "vx", "y", "vy", "beta"),
        blocks=(
            StateBlock("position", (0, 2), "m"),
            StateBlock("velocity", (1, 3), "m/s"),
            StateBlock("ballistic coefficient", (4,), "kg/(m s²)"),
        ),
        # The bound on the position error falls from about 980 m at the first step to 165 m at the last.
        divergence=Divergence("position", limit=5000.0, steps=5),
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
                r"\quad q = \tilde q = 5, \quad \Delta = 2\ \mathrm{s}",
            ),
            Equation(
                "Radar",
                r"z_k = \begin{pmatrix} \sqrt{x_k^2 + y_k^2} \\ \arctan(y_k / x_k) \end{pmatrix} + v_k, "
                rf"\quad v_k \sim N(0, \mathrm{{diag}}({sigma_r:g}^2\ \mathrm{{m^2}}, 0.017^2\ \mathrm{{rad^2}}))",
            ),
        ),
        assumptions=(
            "Stated: every parameter; the prior of filters and truth is N(m0, P0), with m0 = (232 km, 2290 cos 190° m/s, "
            f"88 km, 2290 sin 190° m/s, 40000 kg/(m s²)) and standard deviations 1000 m, {sigma_v:g} m/s, 2500 kg/(m s²).",
            "Equation (2) gives the ballistic coefficient's noise the variance q̃, equation (5) q̃Δ: (5) is used. "
            "Either is 2 or 3 units a step against an initial 2500.",
            "The arc tangent is taken over the four quadrants. The ballistic coefficient is not kept positive: it starts "
            "16 standard deviations above zero.",
            "Nothing is said of divergence; here a run has diverged when its position is more than 5 km off for 5 steps.",
        ),
        plane=(0, 2),
        landmarks=(("radar", 0.0, 0.0),),
        model=chosen,
        generate=functools.partial(draw, chosen, STEPS),
    )


CASES = (re_entry("ballistic/1", "Ballistic re-entry, the milder scenario", 100.0, 20.0),)
