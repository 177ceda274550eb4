"""Bearings only from a fixed point: the example with which the bootstrap filter was introduced."""

import functools
from dataclasses import replace

import numpy as np

from suite.case import FROM_ANOTHER, Case, Divergence, Equation, StateBlock, draw
from suite.linalg import Array
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian

# Symbols as in the paper, which gives no units. State (x, vx, y, vy).
ROOT_Q = 0.001  # standard deviation of the acceleration over a step
ROOT_R = 0.005  # rad, standard deviation of a bearing
START = np.array([-0.05, 0.001, 0.7, -0.055])
EXPECTED = np.array([0.0, 0.0, 0.4, -0.05])
SPREAD = np.array([0.5, 0.005, 0.3, 0.01])
STEPS = 24

MOTION = Affine(np.kron(np.eye(2), [[1.0, 1.0], [0.0, 1.0]]))
GAIN = np.kron(np.eye(2), [[0.5], [1.0]])


def bearing(x: Array, k: int) -> Array:
    """Bearing of the target from the origin in radians, counted from the x axis."""
    return np.stack([np.atan2(x[2], x[0])])


MODEL = StateSpaceModel(
    prior=Gaussian(EXPECTED, np.diag(SPREAD**2)),
    dynamics=AdditiveTransition(MOTION, Gaussian.diagonal([ROOT_Q**2, ROOT_Q**2]), gain=GAIN),
    sensor=AdditiveSensor(bearing, Gaussian.diagonal([ROOT_R**2]), angles=(0,)),
    linear=(1, 3),
)
FROM_START = replace(MODEL, prior=Gaussian(START, np.zeros((4, 4))))

CASES = (
    Case(
        name="bearings-only",
        title="Bearings only from a fixed point",
        summary="A target passes a fixed observer, who measures bearings alone. How far away the target is shows only in how "
        "the bearing changes as it passes; until then the posterior is a long and curved wedge, which no Gaussian fits.",
        steps=STEPS,
        interval=1.0,
        state=("x", "vx", "y", "vy"),
        blocks=(StateBlock("position", (0, 2), ""), StateBlock("velocity", (1, 3), "")),
        # The prior's own standard deviation in the plane is 0.58.
        divergence=Divergence("position", limit=1.0, steps=5),
        reference="N. J. Gordon, D. J. Salmond, A. F. M. Smith, Novel approach to nonlinear/non-Gaussian Bayesian state "
        "estimation, IEE Proceedings F 140(2), 1993, 107-113, section 5.2",
        equations=(
            Equation(
                "Motion, on both axes",
                r"\begin{pmatrix} x_{k+1} \\ \dot x_{k+1} \end{pmatrix} = \begin{pmatrix} 1 & 1 \\ 0 & 1 \end{pmatrix} "
                r"\begin{pmatrix} x_k \\ \dot x_k \end{pmatrix} + \begin{pmatrix} 1/2 \\ 1 \end{pmatrix} w_k, "
                r"\quad w_k \sim N(0, q), \quad \sqrt{q} = 0.001",
            ),
            Equation(
                "Bearing",
                r"z_k = \mathrm{atan2}(y_k, x_k) + v_k, \quad v_k \sim N(0, r), \quad \sqrt{r} = 0.005\ \mathrm{rad}",
            ),
        ),
        assumptions=(
            "The parameters are those of T. Bailey's public program of the example, not read in the paper itself; the paper "
            "gives no units.",
            "Filters start from N(m0, P0), with m0 = (0, 0, 0.4, -0.05) and standard deviations 0.5, 0.005, 0.3 and 0.01. The "
            "truth of every run starts at (-0.05, 0.001, 0.7, -0.055) and moves on with process noise; the paper shows one "
            "such run, here every run draws its own.",
            "The paper shows plots, with 4000 samples: no published figure belongs to it.",
            "A run has diverged when its position is off by more than 1, nearly twice the prior's standard deviation in the "
            "plane, for 5 steps on end.",
        ),
        plane=(0, 2),
        landmarks=(("observer", 0.0, 0.0),),
        model=MODEL,
        generate=functools.partial(draw, FROM_START, STEPS),
        origin=FROM_ANOTHER,
    ),
)
