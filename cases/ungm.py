"""The univariate nonstationary growth model: a scalar state whose sign the measurement does not show."""

import functools

import numpy as np

from suite.case import Case, Divergence, Equation, Published, StateBlock, draw
from suite.linalg import Array
from suite.model import AdditiveSensor, AdditiveTransition, StateSpaceModel
from suite.noise import Gaussian

STEPS = 100


def grow(x: Array, k: int) -> Array:
    """The state's expected successor (Arulampalam et al., 2002, eq. 75)."""
    return 0.5 * x + 25.0 * x / (1.0 + x * x) + 8.0 * np.cos(1.2 * k)


def square(x: Array, k: int) -> Array:
    """The measurement without its noise (eq. 76)."""
    return x * x / 20.0


MODEL = StateSpaceModel(
    prior=Gaussian([0.0], [[5.0]]),
    dynamics=AdditiveTransition(grow, Gaussian.noise([[10.0]])),
    sensor=AdditiveSensor(square, Gaussian.noise([[1.0]])),
)

CASES = (
    Case(
        name="ungm",
        title="Univariate nonstationary growth model",
        summary="The classic scalar problem: strongly nonlinear motion, and a measurement that grows with the square of the "
        "state, so that the posterior often has two peaks. Filters that keep a mean and a variance alone fail here.",
        steps=STEPS,
        interval=1.0,
        state=("x",),
        blocks=(StateBlock("state", (0,), ""),),
        # The state stays within about 25 of zero: this is the wrong sign, for many steps on end.
        divergence=Divergence("state", limit=20.0, steps=5),
        reference="M. S. Arulampalam, S. Maskell, N. Gordon, T. Clapp, A tutorial on particle filters for online "
        "nonlinear/non-Gaussian Bayesian tracking, IEEE Transactions on Signal Processing 50(2), 2002, 174-188, section VI",
        equations=(
            Equation(
                "Growth",
                r"x_k = \frac{x_{k-1}}{2} + \frac{25 x_{k-1}}{1 + x_{k-1}^2} + 8 \cos(1.2 k) + v_{k-1}, "
                r"\quad v_k \sim N(0, 10)",
            ),
            Equation("Measurement", r"z_k = \frac{x_k^2}{20} + n_k, \quad n_k \sim N(0, 1)"),
        ),
        assumptions=(
            "The initial law N(0, 5) and the number of steps, 100, are those common in the literature; the tutorial does not "
            "state how many runs its table averages, nor how the error is averaged over steps and runs.",
            "A run has diverged when it is off by more than 20 for 5 steps on end.",
        ),
        published=tuple(
            Published(method, "root mean square error of the state", value, "", "section VI, table of errors", note)
            for method, value, note in (
                ("extended Kalman filter", 23.19, ""),
                ("approximate grid filter", 6.09, "50 cells"),
                ("sir", 5.54, "50 particles"),
                ("auxiliary", 5.35, "50 particles"),
                ("regularized", 5.55, "50 particles"),
            )
        ),
        model=MODEL,
        generate=functools.partial(draw, MODEL, STEPS),
    ),
)
