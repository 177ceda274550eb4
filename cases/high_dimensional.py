"""Many independent components, linear and Gaussian: what the number of dimensions alone does to a filter."""

import functools

import numpy as np

from suite.case import Case, Divergence, Equation, StateBlock, draw
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian

A = 0.5  # what a step leaves of each component
STATIONARY = 1 / (1 - A * A)  # variance of a component that nobody measures
STEPS = 10  # an error falls to a quarter in a step: half of them are a steady state


def model(d: int) -> StateSpaceModel:
    """d copies of one scalar problem."""
    one = np.eye(d)
    return StateSpaceModel(
        prior=Gaussian.noise(STATIONARY * one),
        dynamics=AdditiveTransition(Affine(A * one), Gaussian.noise(one)),
        sensor=AdditiveSensor(Affine(one), Gaussian.noise(one)),
    )


def case(d: int) -> Case:
    """The case in d dimensions."""
    chosen = model(d)
    return Case(
        name=f"high-dimensional/{d}",
        title=f"{d} independent components",
        summary=f"The same scalar problem, linear and Gaussian, {d} times over and all at once. The Kalman filter is exact and "
        "does not notice; a particle has to be right in all components at once, and the number of particles that it takes "
        "grows exponentially with that of the components.",
        steps=STEPS,
        interval=1.0,
        state=tuple(f"x{i}" for i in range(1, d + 1)),
        blocks=(StateBlock("state", tuple(range(d)), ""),),
        # A filter that never looks errs by sqrt(4d/3); the exact one by sqrt(0.53 d).
        divergence=Divergence("state", limit=float(1.5 * np.sqrt(STATIONARY * d)), steps=5),
        reference="C. Snyder, T. Bengtsson, P. Bickel, J. Anderson, Obstacles to high-dimensional particle filtering, Monthly "
        "Weather Review 136(12), 2008, 4629-4640",
        equations=(
            Equation("Motion", rf"x_k = \frac{{1}}{{2}} x_{{k-1}} + w_k, \quad w_k \sim N(0, I_{{{d}}})"),
            Equation("Measurement", rf"y_k = x_k + v_k, \quad v_k \sim N(0, I_{{{d}}})"),
            Equation(
                "Variance of a component, exact",
                r"p_\infty = \frac{p^-}{p^- + 1} = 0.53113, \quad (p^-)^2 - \frac{1}{4} p^- - 1 = 0",
            ),
        ),
        assumptions=(
            "The reference looks at a single step, with I for both covariances; the motion, and 10 steps, are chosen here: no "
            "published figure belongs to it.",
            "The prior is the stationary law N(0, 4/3 I).",
            "A run has diverged when its error is half as large again as without any measurement, for 5 steps on end.",
        ),
        model=chosen,
        generate=functools.partial(draw, chosen, STEPS),
    )


CASES = tuple(case(d) for d in (5, 10, 20, 50))
