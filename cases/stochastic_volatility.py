"""The stochastic volatility model: a state that scales the noise of what is seen, and moves its mean nowhere."""

import functools

import numpy as np

from suite.case import Case, Divergence, Equation, StateBlock, draw
from suite.linalg import Array
from suite.model import AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian
from suite.nonadditive import NonadditiveSensor

MU = 2.0 * np.log(0.5992)  # mean of the log-variance
RHO = 0.9702  # what a step leaves of its distance from the mean
SIGMA = 0.178  # standard deviation of what a step adds
STATIONARY = SIGMA**2 / (1.0 - RHO**2)
STEPS = 200


def returned(x: Array, v: Array, k: int) -> Array:
    """A return of variance exp(x), from a standard normal number v."""
    return np.exp(0.5 * x) * v


def density(z: Array, x: Array, k: int) -> Array:
    """Log-density of the returns z[1, R] given the states x[1, R, ...]: [R, ...]; zero where nothing was observed."""
    seen, state = z[0].reshape(-1, *(1,) * (x.ndim - 2)), x[0]
    fit = -0.5 * (np.log(2.0 * np.pi) + state + seen * seen * np.exp(-state))
    return np.where(np.isnan(seen), 0.0, fit)


MODEL = StateSpaceModel(
    prior=Gaussian([MU], [[STATIONARY]]),
    dynamics=AdditiveTransition(Affine([[RHO]], np.array([MU * (1.0 - RHO)])), Gaussian.noise([[SIGMA**2]])),
    sensor=NonadditiveSensor(returned, Gaussian.noise([[1.0]]), dim=1, density=density),
)

CASES = (
    Case(
        name="stochastic-volatility",
        title="Stochastic volatility",
        summary="Daily returns have the mean zero and a variance whose logarithm wanders. A return says something of the "
        "state by its size alone; it is not correlated with the state, so that filters that are linear in the measurement "
        "learn nothing.",
        steps=STEPS,
        interval=1.0,
        state=("x",),
        blocks=(StateBlock("log-variance", (0,), ""),),
        # Without any measurement the standard deviation is 0.73.
        divergence=Divergence("log-variance", limit=3.0, steps=5),
        reference="M. K. Pitt, N. Shephard, Filtering via simulation: auxiliary particle filters, Journal of the American "
        "Statistical Association 94(446), 1999, 590-599",
        equations=(
            Equation(
                "Log-variance",
                r"x_k = \mu + \rho (x_{k-1} - \mu) + \sigma w_k, \quad w_k \sim N(0, 1), \quad \mu = 2 \ln 0.5992, \quad "
                r"\rho = 0.9702, \quad \sigma = 0.178",
            ),
            Equation("Return", r"y_k = e^{x_k / 2} v_k, \quad v_k \sim N(0, 1)"),
        ),
        assumptions=(
            "The parameters were read in public programs of the model, not in the reference itself. The prior is the "
            "stationary law N(μ, σ² / (1 - ρ²)), and a day counts as a second.",
            "The number of steps, 200, is chosen here. No published figure belongs to it.",
            "A run has diverged when it is off by more than 3, four deviations of the stationary law, for 5 steps on end.",
        ),
        model=MODEL,
        generate=functools.partial(draw, MODEL, STEPS),
    ),
)
