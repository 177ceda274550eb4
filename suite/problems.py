"""Small problems that every estimator is held against: between them they have what a model may bring along.

Affine and curved functions, angles that wrap, functions of time, gaps that differ from run to run, one component, process
noise that is singular, a prior that is a point, conditionally linear components, heavy tails, laws that are no sum of a
function and a noise, modes that change.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from suite.case import Case, Divergence, StateBlock, Truth, draw
from suite.jump import JumpModel, Model
from suite.linalg import Array
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian, StudentT
from suite.nonadditive import NonadditiveSensor, NonadditiveTransition
from suite.random import Generators

STEPS = 5


def _on_both_axes(block: list[list[float]]) -> Array:
    """A matrix for one axis of the plane, once for each axis."""
    return np.asarray(np.kron(np.eye(2), block), float)


# State (x, vx, y, vy): constant velocity in the plane, disturbed at random.
MOTION = Affine(_on_both_axes([[1.0, 1.0], [0.0, 1.0]]))
DISTURBANCE = Gaussian.noise(_on_both_axes([[1 / 3, 1 / 2], [1 / 2, 1.0]]))
POSITION = Affine(_on_both_axes([[1.0, 0.0]]))
PRIOR = Gaussian(np.array([-50.0, 0.0, 0.0, 2.0]), np.diag([5.0, 1.0, 5.0, 1.0]) ** 2)
FIX = AdditiveSensor(POSITION, Gaussian.noise([[4.0, 1.0], [1.0, 9.0]]))
LINEAR = StateSpaceModel(PRIOR, AdditiveTransition(MOTION, DISTURBANCE), FIX, linear=(1, 3))


def _bearing_and_range(x: Array, k: int) -> Array:
    px, _, py, _ = x
    return np.stack([np.atan2(py, px), np.sqrt(px * px + py * py)])


CURVED = StateSpaceModel(
    PRIOR,
    AdditiveTransition(MOTION, DISTURBANCE),
    AdditiveSensor(_bearing_and_range, Gaussian.diagonal([0.05**2, 4.0]), angles=(0,)),
    linear=(1, 3),
)


def _turned(x: Array, k: int) -> Array:
    px, vx, py, vy = x
    return np.stack([px + vx, 0.8 * vx - 0.6 * vy, py + vy, 0.6 * vx + 0.8 * vy])


def _swung(x: Array, w: Array, k: int) -> Array:
    angle, rate = x
    push, share = w
    return np.stack([angle + 0.1 * rate, (1 + share) * rate - 0.5 * np.sin(angle) + push])


def _scaled(x: Array, v: Array, k: int) -> Array:
    angle, rate = x
    return np.stack([np.sin(angle) * (1 + v[0]) + v[1], rate + angle * v[0] + 0.3 * v[1]])


def _growth(x: Array, k: int) -> Array:
    push: float = 8 * np.cos(1.2 * k)
    return 0.5 * x + 25 * x / (1 + x * x) + push


def _square(x: Array, k: int) -> Array:
    return x * x / 20


@dataclass(frozen=True)
class Spread:
    """The law N(slope x, (floor + share |x|)²) of one component given another: not additive, its noise depends on x."""

    slope: float
    floor: float
    share: float
    dim: int = 1

    def sample(self, rng: Generators, x: Array, k: int) -> Array:
        """Draws given x[1, R, ...]."""
        return self.slope * x + self._deviation(x) * rng.standard_normal(x.shape)

    def logpdf(self, z: Array, x: Array, k: int) -> Array:
        """Log-density at z[1, ...] given x[1, R, ...]: [R, ...]; zero where z is NaN."""
        deviation = self._deviation(x)[0]
        at = z[0].reshape(z[0].shape + (1,) * (x.ndim - z.ndim))
        white = (at - self.slope * x[0]) / deviation
        return np.where(np.isnan(at), 0.0, -0.5 * white * white - np.log(deviation) - 0.5 * np.log(2 * np.pi))

    def _deviation(self, x: Array) -> Array:
        return np.asarray(self.floor + self.share * np.abs(x))


def _with_gaps(rng: Generators) -> Truth:
    """Steps that nobody measured, components that some runs lack, a run that lacks all: no two runs alike."""
    truth = draw(LINEAR, STEPS, rng)
    y = truth.y.copy()
    y[1] = np.nan
    y[2:4, 0, 1::4] = np.nan
    y[3:5, 1, 2::4] = np.nan
    y[:, :, 3::4] = np.nan
    return Truth(truth.x, y)


def _problem(name: str, model: Model, words: str, generate: Callable[[Generators], Truth] | None = None) -> Case:
    components = tuple(range(model.n))
    return Case(
        name=f"check/{name}",
        title=words,
        summary=f"A small problem to check estimators on: {words}.",
        steps=STEPS,
        interval=1.0,
        state=tuple(f"x{i}" for i in components),
        blocks=(StateBlock("state", components, ""),),
        divergence=Divergence("state", limit=float("inf"), steps=STEPS),
        reference="none: made to check estimators",
        model=model,
        generate=generate or functools.partial(draw, model, STEPS),
    )


PROBLEMS = (
    _problem("linear", LINEAR, "constant velocity, both coordinates measured"),
    _problem(
        "angle",
        CURVED,
        "bearing and range, the bearing crossing from pi to -pi",
    ),
    _problem("gaps", LINEAR, "measurements missing in steps, components and whole runs", _with_gaps),
    _problem(
        "singular",
        StateSpaceModel(
            PRIOR, AdditiveTransition(MOTION, Gaussian.diagonal([1.0, 1.0]), gain=_on_both_axes([[0.5], [1.0]])), FIX, (1, 3)
        ),
        "process noise of lower rank than the state",
    ),
    _problem(
        "scalar",
        StateSpaceModel(
            Gaussian.diagonal([5.0]),
            AdditiveTransition(_growth, Gaussian.diagonal([10.0])),
            AdditiveSensor(_square, Gaussian.diagonal([1.0])),
        ),
        "one component, curved functions of the state and of time",
    ),
    _problem(
        "point",
        StateSpaceModel(Gaussian(PRIOR.mean, np.zeros((4, 4))), AdditiveTransition(MOTION, DISTURBANCE), FIX, (1, 3)),
        "a prior without any spread",
    ),
    _problem(
        "tails",
        StateSpaceModel(
            PRIOR,
            AdditiveTransition(MOTION, StudentT(DISTURBANCE.cov, dof=4.0)),
            AdditiveSensor(POSITION, StudentT(FIX.noise_at(1).cov, dof=3.0)),
        ),
        "Student t noises",
    ),
    _problem(
        "spread",
        StateSpaceModel(Gaussian.diagonal([1.0]), Spread(0.9, 0.5, 0.1), Spread(1.0, 0.2, 0.5)),
        "noises that depend on the state",
    ),
    _problem(
        "nonadditive",
        StateSpaceModel(
            Gaussian.diagonal([1.0, 0.5]),
            NonadditiveTransition(_swung, Gaussian.diagonal([0.1, 0.05])),
            NonadditiveSensor(_scaled, Gaussian.noise([[0.02, 0.01], [0.01, 0.04]]), dim=2),
        ),
        "noises inside the functions of motion and measurement",
    ),
    _problem(
        "jump",
        JumpModel(
            (LINEAR, replace(LINEAR, dynamics=AdditiveTransition(MOTION, Gaussian.noise(25 * DISTURBANCE.cov)))),
            np.array([[0.9, 0.1], [0.3, 0.7]]),
            np.array([0.8, 0.2]),
        ),
        "constant velocity that manoeuvres now and then",
    ),
    _problem(
        "modes",
        JumpModel(
            (CURVED, replace(CURVED, dynamics=AdditiveTransition(_turned, DISTURBANCE)), replace(CURVED, sensor=FIX)),
            np.array([[0.8, 0.1, 0.1], [0.2, 0.8, 0.0], [0.0, 1.0, 0.0]]),
            np.array([0.5, 0.0, 0.5]),
            nominal=1,
        ),
        "three modes that differ in motion and sensor, one that never stays",
    ),
)
