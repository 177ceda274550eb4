"""Constant velocity in the plane with position measurements: linear and Gaussian, the Kalman filter is exact."""

import functools

import numpy as np

from suite.case import Case, Divergence, Equation, StateBlock, draw
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian

T = 1.0  # s, time between measurements
ACCELERATION = 0.5  # m²/s³, spectral density of the white acceleration
SIGMA = 10.0  # m, standard deviation of a measured coordinate
STEPS = 100

# State (x, vx, y, vy); each axis is an integrated Wiener process sampled every T.
AXIS = np.array([[1.0, T], [0.0, 1.0]])
AXIS_NOISE = ACCELERATION * np.array([[T**3 / 3, T**2 / 2], [T**2 / 2, T]])
BOTH = np.eye(2)

MODEL = StateSpaceModel(
    prior=Gaussian([0.0, 10.0, 0.0, -5.0], np.diag([50.0, 5.0, 50.0, 5.0]) ** 2),
    dynamics=AdditiveTransition(Affine(np.kron(BOTH, AXIS)), Gaussian.noise(np.kron(BOTH, AXIS_NOISE))),
    sensor=AdditiveSensor(Affine(np.kron(BOTH, [[1.0, 0.0]])), Gaussian.diagonal([SIGMA**2, SIGMA**2])),
    linear=(1, 3),
)

CASES = (
    Case(
        name="linear-gaussian",
        title="Constant velocity in the plane",
        summary="A target moves at nearly constant velocity; both coordinates of its position are measured. "
        "The model is linear and Gaussian and the truth is drawn from it, so the Kalman filter is exact: "
        "no filter can have a smaller mean square error, and the others show what they lose.",
        steps=STEPS,
        interval=T,
        state=("x", "vx", "y", "vy"),
        blocks=(StateBlock("position", (0, 2), "m"), StateBlock("velocity", (1, 3), "m/s")),
        # The exact filter's position error has a standard deviation of about 8 m in the plane (see the tests).
        divergence=Divergence("position", limit=40.0, steps=10),
        reference="Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, "
        "Wiley, 2001, section 6.2",
        equations=(
            Equation(
                "State and motion, one block for each axis",
                r"\begin{pmatrix} x_k \\ \dot x_k \end{pmatrix} = \begin{pmatrix} 1 & T \\ 0 & 1 \end{pmatrix} "
                r"\begin{pmatrix} x_{k-1} \\ \dot x_{k-1} \end{pmatrix} + w_k, \quad w_k \sim N(0, Q)",
            ),
            Equation(
                "Process noise",
                r"Q = q \begin{pmatrix} T^3/3 & T^2/2 \\ T^2/2 & T \end{pmatrix}, \quad q = 0.5\ \mathrm{m^2/s^3}",
            ),
            Equation(
                "Measurements",
                r"z_k = \begin{pmatrix} x_k \\ y_k \end{pmatrix} + v_k, \quad v_k \sim N(0, \sigma^2 I), "
                r"\quad \sigma = 10\ \mathrm{m}",
            ),
        ),
        assumptions=(
            "A textbook problem with parameters chosen here: no published figure belongs to it.",
            "The prior is N(m0, P0) with m0 = (0 m, 10 m/s, 0 m, -5 m/s) and standard deviations 50 m and 5 m/s.",
        ),
        plane=(0, 2),
        model=MODEL,
        generate=functools.partial(draw, MODEL, STEPS),
    ),
)
