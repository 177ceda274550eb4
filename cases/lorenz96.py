"""Lorenz's system of 1996, a ring of components that push each other: the classic of data assimilation in many dimensions."""

import functools

import numpy as np

from suite.case import Case, Divergence, Equation, StateBlock, draw
from suite.linalg import Array
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian
from suite.published import Experiment, Published
from suite.runge_kutta import step, step_with_slopes, unit_deviations

F = 8.0  # forcing
DT = 0.05  # time between measurements, and of the Runge-Kutta rule
STEPS = {10: 200, 40: 60}  # by the number of components


def around(x: Array) -> tuple[Array, Array, Array]:
    """For each component the one after it on the ring, the one before it, and the second before it."""
    after, before, second = (np.concat([x[i:], x[:i]]) for i in (1, -1, -2))
    return after, before, second


def velocity(x: Array) -> Array:
    """Lorenz's equations of 1996 on a ring."""
    after, before, second = around(x)
    return (after - second) * before - x + F


def stretched(x: Array, d: Array) -> Array:
    """How fast deviations d[n, n, ...] grow at states x[n, ...]: the Jacobian of `velocity` times them."""
    (after, before, second), (d_after, d_before, d_second) = around(x[:, None]), around(d)
    return (d_after - d_second) * before + (after - second) * d_before - d


def flow(x: Array, k: int) -> Array:
    """State at the next measurement, by the classic Runge-Kutta rule of fourth order."""
    return step(velocity, x, DT)


def slopes(x: Array, k: int) -> Array:
    """Derivative [n, n, ...] of `flow`."""
    return step_with_slopes(velocity, stretched, x, unit_deviations(x), DT)[1]


def spun_up(d: int) -> Array:
    """A state [d] of the attractor: where the orbit is after 1000 steps that starts at rest with one component 0.01 higher."""
    x = np.full((d, 1), F)
    x[0] += 0.01
    for k in range(1000):
        x = flow(x, k)
    return x[:, 0]


def model(d: int, every: int, sigma: float) -> StateSpaceModel:
    """A ring of d components, one in `every` of which is measured with the standard deviation sigma."""
    seen = np.eye(d)[::every]
    return StateSpaceModel(
        prior=Gaussian(spun_up(d), np.eye(d)),
        dynamics=AdditiveTransition(flow, Gaussian.noise(np.zeros((d, d))), jacobian_of_mean=slopes),
        sensor=AdditiveSensor(Affine(seen), Gaussian.diagonal([sigma**2] * len(seen))),
    )


def case(
    d: int,
    every: int,
    sigma: float,
    title: str,
    measured: str,
    source: str,
    set_up: str,
    published: tuple[Published, ...],
    experiment: Experiment,
) -> Case:
    """The case of a ring of d components."""
    told = model(d, every, sigma)
    return Case(
        name=f"lorenz96/{d}",
        title=title,
        summary=f"A chaotic ring of {d} components without any noise of its own, {measured}. What is known of an orbit "
        "is lost in a few units of time: a filter that becomes too sure of itself loses it, and so do particles that only get "
        "fewer.",
        steps=STEPS[d],
        interval=DT,
        state=tuple(f"x{i}" for i in range(1, d + 1)),
        blocks=(StateBlock("state", tuple(range(d)), ""),),
        # A component of the attractor has a standard deviation of 3.6.
        divergence=Divergence("state", limit=float(3.6 * np.sqrt(d)), steps=10),
        reference=f"E. N. Lorenz, Predictability: a problem partly solved, Seminar on Predictability, ECMWF, 1996; {source}",
        equations=(
            Equation(
                f"Motion on a ring, i = 1..{d}",
                r"\dot x_i = (x_{i+1} - x_{i-2})\, x_{i-1} - x_i + F, \quad F = 8",
            ),
            Equation(
                "Measurement, every 0.05",
                r"z_k = H x_k + v_k, \quad v_k \sim N(0, \sigma^2 I), \quad \sigma = " + f"{sigma:g}",
            ),
        ),
        assumptions=(
            f"Read in DAPPER, {set_up}: F = 8, a step of 0.05, what is measured and how well.",
            f"DAPPER takes more measurements and does not score the first. Here a run has {STEPS[d]}, for the sake of time, "
            "and all of them count.",
            "Chosen here: each step is one of the Runge-Kutta rule of fourth order and is measured, and the model has no "
            "noise. The start is N(m0, I) about a state of the attractor, the one that an orbit reaches in 1000 steps from "
            "rest with the first component 0.01 higher.",
            "The published particle filters jitter duplicates by a width that was tuned for each number of particles; ours "
            "that comes closest draws all of them from a kernel whose width is the optimal one for a Gaussian.",
            "Time has no unit; the case calls it a second.",
            "A run has diverged when the norm of its error is above that of an estimate by the mean of the attractor, 3.6 "
            f"times the root of {d}, for 10 steps on end.",
        ),
        published=published,
        experiment=experiment,
        model=told,
        generate=functools.partial(draw, told, STEPS[d]),
    )


SCORE = "mean over time of the root mean square over components"


def figure(estimator: str, value: float, where: str, note: str = "", measured: bool = True) -> Published:
    """A score that DAPPER prints; `measured` where an estimator here stands for its own."""
    return Published(estimator, SCORE, value, "", f"DAPPER, {where}", note, *(("eta", "state") if measured else ()))


SAKOV, BOCQUET = "Lorenz96/sakov2008", "Lorenz96/bocquet2010"

CASES = (
    case(
        10, 2, 1.5, "Lorenz's ring of 10 components", "every other one of which is measured",
        "M. Bocquet, Ensemble Kalman filtering without the intrinsic need for inflation, Nonlinear Processes in Geophysics 18, "
        "2011, 735-750; as set up in P. N. Raanes et al., DAPPER, mods/Lorenz96/bocquet2010",
        BOCQUET,
        (
            *(
                figure(f"regularized[particles={count}]", value, BOCQUET, "duplicates jittered, width tuned")
                for count, value in ((50, 1.15), (100, 0.43), (800, 0.29))
            ),
            *(
                figure(f"particle filter, optimal proposal, {count} particles", value, BOCQUET, "width tuned", measured=False)
                for count, value in ((50, 0.75), (100, 0.44), (800, 0.28))
            ),
        ),
        Experiment(60, tuple(f"regularized[particles={count}]" for count in (50, 100, 800))),
    ),
    case(
        40, 1, 1.0, "Lorenz's ring of 40 components", "all of which are measured",
        "P. Sakov, P. R. Oke, A deterministic formulation of the ensemble Kalman filter, Tellus A 60(2), 2008, 361-371; as "
        "set up in P. N. Raanes et al., DAPPER, mods/Lorenz96/sakov2008",
        SAKOV,
        (
            figure("ensemble Kalman filter", 0.18, SAKOV, "24 members", measured=False),
            figure("ekf", 0.24, SAKOV, "covariance inflated; ours is not"),
            figure("regularized[particles=3000]", 0.26, SAKOV, "duplicates jittered: 0.26 to 0.41 for widths of 0.7 to 1.6"),
        ),
        Experiment(20, ("ekf", "regularized[particles=3000]")),
    ),
)  # fmt: skip
