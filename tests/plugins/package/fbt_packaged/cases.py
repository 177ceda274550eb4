"""A random walk, measured."""

import functools

from suite.case import Case, Divergence, StateBlock, draw
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian

MODEL = StateSpaceModel(
    prior=Gaussian([0.0], [[1.0]]),
    dynamics=AdditiveTransition(Affine([[1.0]]), Gaussian.noise([[0.1]])),
    sensor=AdditiveSensor(Affine([[1.0]]), Gaussian.noise([[1.0]])),
)

CASES = (
    Case(
        name="packaged-case",
        title="A random walk",
        summary="One state, measured.",
        steps=10,
        interval=1.0,
        state=("x",),
        blocks=(StateBlock("position", (0,), "m"),),
        divergence=Divergence("position", limit=50.0, steps=5),
        reference="none",
        model=MODEL,
        generate=functools.partial(draw, MODEL, 10),
    ),
)
