"""Lorenz's chaotic system of three variables, measured now and then: the small classic of data assimilation."""

import functools

import numpy as np

from suite.case import Case, Divergence, Equation, StateBlock, draw
from suite.linalg import Array
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian
from suite.published import Experiment, Published
from suite.runge_kutta import step, step_with_slopes, unit_deviations

SIGMA, RHO, BETA = 10.0, 28.0, 8.0 / 3.0
DT = 0.01  # a step of the Runge-Kutta rule
SUBSTEPS = 25  # of them between measurements
START = np.array([1.509, -1.531, 25.46])
VARIANCE = 2.0  # of a measured component, and of a component of the start
STEPS = 200


def velocity(s: Array) -> Array:
    """Lorenz's equations (Lorenz, 1963, eqs 25-27)."""
    x, y, z = s
    found = np.empty_like(s)  # a hundred of these are needed between two measurements: to stack them takes twice as long
    found[0] = SIGMA * (y - x)
    found[1] = x * (RHO - z) - y
    found[2] = x * y - BETA * z
    return found


def flow(s: Array, k: int) -> Array:
    """State at the next measurement, by the classic Runge-Kutta rule of fourth order."""
    for _ in range(SUBSTEPS):
        s = step(velocity, s, DT)
    return s


def slopes(s: Array, k: int) -> Array:
    """Derivative [3, 3, ...] of `flow`."""
    whole = unit_deviations(s)
    for _ in range(SUBSTEPS):
        s, whole = step_with_slopes(velocity, stretched, s, whole, DT)
    return whole


def stretched(s: Array, d: Array) -> Array:
    """How fast deviations d[3, 3, ...] grow at states s[3, ...]: the Jacobian of `velocity` times them."""
    x, y, z = s
    dx, dy, dz = d
    found = np.empty_like(d)
    found[0] = SIGMA * (dy - dx)
    found[1] = (RHO - z) * dx - dy - x * dz
    found[2] = y * dx + x * dy - BETA * dz
    return found


MODEL = StateSpaceModel(
    prior=Gaussian(START, VARIANCE * np.eye(3)),
    dynamics=AdditiveTransition(flow, Gaussian.noise(np.zeros((3, 3))), jacobian_of_mean=slopes),
    sensor=AdditiveSensor(Affine(np.eye(3)), Gaussian.diagonal([VARIANCE] * 3)),
)

CASES = (
    Case(
        name="lorenz",
        title="Lorenz's system of three variables",
        summary="A chaotic system without any noise of its own: what is known of its start is lost after a few measurements, "
        "and each of the later ones has to hold an estimate that would grow wrong by itself. Filters whose particles only get "
        "fewer lose it, and so do those that become too sure.",
        steps=STEPS,
        interval=SUBSTEPS * DT,
        state=("x", "y", "z"),
        blocks=(StateBlock("state", (0, 1, 2), ""),),
        # Two states of the attractor picked at random are about 20 apart.
        divergence=Divergence("state", limit=10.0, steps=5),
        reference="P. Sakov, D. S. Oliver, L. Bertino, An iterative EnKF for strongly nonlinear systems, Monthly Weather "
        "Review 140(6), 2012, 1988-2004; as set up in P. N. Raanes et al., DAPPER, mods/Lorenz63/sakov2012",
        equations=(
            Equation(
                "Motion",
                r"\dot x = \sigma (y - x), \quad \dot y = x (\rho - z) - y, \quad \dot z = x y - \beta z, \quad "
                r"\sigma = 10,\ \rho = 28,\ \beta = 8/3",
            ),
            Equation("Measurement, every 0.25", r"z_k = (x, y, z)_k^T + v_k, \quad v_k \sim N(0, 2 I)"),
        ),
        assumptions=(
            "The set-up was read in DAPPER: Runge-Kutta steps of 0.01, a measurement of all components after every 25, a start "
            "at N((1.509, -1.531, 25.46), 2 I), no noise in the model.",
            "There 1000 measurements are taken in a single run and errors count from time 16 on, after the first 64. Here a "
            "run has 200, for the sake of time, and all of them count: the published figures are as of five such runs.",
            "Time has no unit; the case calls it a second.",
            "A run has diverged when it is off by more than 10 for 5 steps on end: it follows another orbit of the attractor.",
        ),
        published=tuple(
            Published(
                method,
                "mean over time of the root mean square over components",
                value,
                "",
                "DAPPER, sakov2012",
                note,
                "eta",
                "state",
                5,
            )
            for method, value, note in (
                ("regularized[particles=100]", 0.38, "100 particles, jittered (reg 2.4) where duplicates arise"),
                ("regularized[particles=800]", 0.28, "800 particles, jittered (reg 0.9)"),
                ("regularized[particles=4000]", 0.27, "4000 particles, jittered (reg 0.7)"),
                ("ensemble Kalman filter, square root", 0.60, "10 members, inflation 1.02, random rotation"),
                ("extended Kalman filter, inflated", 0.92, "inflation 180 per unit of time"),
                ("climatology", 7.6, "the mean of the attractor"),
            )
        ),
        experiment=Experiment(20, tuple(f"regularized[particles={n}]" for n in (100, 800, 4000))),
        plane=(0, 2),
        model=MODEL,
        generate=functools.partial(draw, MODEL, STEPS),
    ),
)
