"""A target on a line that flies straight or manoeuvres: linear and Gaussian given the modes, few enough steps to list them."""

import functools

import numpy as np

from suite.case import Case, Divergence, Equation, StateBlock, draw
from suite.jump import JumpModel
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian

T = 1.0  # s, time between measurements
STRAIGHT, MANOEUVRE = 0.2, 5.0  # m/s², standard deviation of the acceleration over a step
SIGMA = 2.0  # m, standard deviation of a measured position
STEPS = 12
TRANSITION = np.array([[0.9, 0.1], [0.3, 0.7]])
INITIAL = np.array([0.9, 0.1])


def moving(sigma: float) -> StateSpaceModel:
    """State (x, vx), whose acceleration is constant over a step and N(0, sigma²)."""
    return StateSpaceModel(
        prior=Gaussian([0.0, 10.0], np.diag([5.0, 2.0]) ** 2),
        dynamics=AdditiveTransition(
            Affine([[1.0, T], [0.0, 1.0]]), Gaussian.diagonal([sigma**2]), gain=np.array([[T * T / 2], [T]])
        ),
        sensor=AdditiveSensor(Affine([[1.0, 0.0]]), Gaussian.diagonal([SIGMA**2])),
        linear=(1,),
    )


MODEL = JumpModel(
    (moving(STRAIGHT), moving(MANOEUVRE)), transition=TRANSITION, initial=INITIAL, names=("straight", "manoeuvre")
)

CASES = (
    Case(
        name="jump-linear",
        title="Straight flight and manoeuvres on a line",
        summary="A target on a line flies nearly straight or manoeuvres, by a Markov chain that nobody sees; its position is "
        "measured. Given the modes the model is linear and Gaussian, and twelve steps have 4096 sequences of modes: the "
        "optimal estimate is a sum over them, and filters that know the modes can be held against it.",
        steps=STEPS,
        interval=T,
        state=("x", "vx"),
        blocks=(StateBlock("position", (0,), "m"), StateBlock("velocity", (1,), "m/s")),
        # The optimal filter's position error has a standard deviation of about 1.6 m (see the tests).
        divergence=Divergence("position", limit=12.0, steps=3),
        reference="G. A. Ackerson, K. S. Fu, On state estimation in switching environments, IEEE Transactions on Automatic "
        "Control 15(1), 1970, 10-17",
        equations=(
            Equation(
                "Motion in mode r",
                r"\begin{pmatrix} x_k \\ \dot x_k \end{pmatrix} = \begin{pmatrix} 1 & T \\ 0 & 1 \end{pmatrix} "
                r"\begin{pmatrix} x_{k-1} \\ \dot x_{k-1} \end{pmatrix} + \begin{pmatrix} T^2/2 \\ T \end{pmatrix} a_k, "
                r"\quad a_k \sim N(0, \sigma_{r_k}^2)",
            ),
            Equation(
                "Modes",
                r"P(r_k = j \mid r_{k-1} = i) = \begin{pmatrix} 0.9 & 0.1 \\ 0.3 & 0.7 \end{pmatrix}_{ij}, \quad "
                r"\sigma_1 = 0.2,\ \sigma_2 = 5\ \mathrm{m/s^2}",
            ),
            Equation("Measurement", r"z_k = x_k + v_k, \quad v_k \sim N(0, \sigma^2), \quad \sigma = 2\ \mathrm{m}"),
        ),
        assumptions=(
            "The model is the reference's, with parameters chosen here: no published figure belongs to it.",
            "The prior is N(m0, P0) with m0 = (0 m, 10 m/s) and standard deviations 5 m and 2 m/s, the law of the first mode "
            "(0.9, 0.1).",
            "A run has diverged when its position is off by more than 12 m for 3 steps on end.",
        ),
        model=MODEL,
        generate=functools.partial(draw, MODEL, STEPS),
    ),
)
