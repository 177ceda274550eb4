"""A plug-in file with a case and two estimators, small enough for many runs in a test."""

import functools
from dataclasses import dataclass

import numpy as np

from suite.case import Case, Divergence, StateBlock, draw
from suite.estimator import Estimate
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian
from suite.parameters import parameter
from suite.random import Streams

STEPS = 20

MODEL = StateSpaceModel(
    prior=Gaussian([0.0, 1.0], np.eye(2)),
    dynamics=AdditiveTransition(Affine([[1.0, 1.0], [0.0, 1.0]]), Gaussian.noise(0.1 * np.eye(2))),
    sensor=AdditiveSensor(Affine([[1.0, 0.0]]), Gaussian.noise([[1.0]])),
)


@dataclass(frozen=True)
class Smoothed:
    """Exponential smoothing, as a frozen dataclass with parameters."""

    gain: float = parameter(0.5, "weight of a new measurement", above=0, high=1)
    jitter: float = parameter(0.0, "standard deviation of noise added to the estimate", low=0)
    name = "smoothed"
    reference = "none"

    def accepts(self, model):
        return None if model.m == 1 else "it takes one measurement component"

    def run(self, model, y, seed=0):
        rng = Streams.of(seed).batch(0, y.shape[2])
        level = np.zeros(y.shape[2])
        mean = np.zeros((len(y), model.n, y.shape[2]))
        for k, now in enumerate(y[:, 0]):
            level = level + self.gain * (now - level)
            mean[k, 0] = level + self.jitter * rng.standard_normal((1, y.shape[2]))[0]
        cov = np.broadcast_to(np.eye(model.n)[None, :, :, None], (len(y), model.n, model.n, y.shape[2]))
        return Estimate(mean, cov.copy(), loglik=mean[:, 0].copy())


class Last:
    """The last measurement, as a plain class without parameters."""

    name = "last"
    reference = "none"

    def accepts(self, model):
        return None if model.m == 1 else "it takes one measurement component"

    def run(self, model, y, seed=0):
        mean = np.zeros((len(y), model.n, y.shape[2]))
        mean[:, 0] = y[:, 0]
        y[:] = 0.0  # what an estimator does to its measurements is no concern of the others
        cov = np.broadcast_to(np.eye(model.n)[None, :, :, None], (len(y), model.n, model.n, y.shape[2]))
        return Estimate(mean, cov.copy())


def tiny(name, generate=None):
    """A case of that name; `generate` in the place of draws from the model."""
    return Case(
        name=name,
        title="Two states",
        summary="A small linear problem.",
        steps=STEPS,
        interval=1.0,
        state=("x", "v"),
        blocks=(StateBlock("position", (0,), "m"),),
        divergence=Divergence("position", limit=50.0, steps=5),
        reference="none",
        model=MODEL,
        generate=generate or functools.partial(draw, MODEL, STEPS),
    )


CASES = (tiny("tiny"),)
ESTIMATORS = (Last(), Smoothed())
