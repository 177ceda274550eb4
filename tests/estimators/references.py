"""What the tests of particle filters share: models whose posterior is known, and exactly unbiased figures to compare."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from estimators import ESTIMATORS
from suite import parameters
from suite.case import Truth, draw
from suite.estimator import Estimate, told
from suite.jump import Model
from suite.jump_filter import JumpFilter
from suite.linalg import Array
from suite.model import AdditiveSensor, AdditiveTransition, StateSpaceModel
from suite.noise import Gaussian
from tests.oracles import Linear, from_west, generators, range_bearing

PARTICLE_FILTERS = [
    name
    for name, estimator in ESTIMATORS.items()
    if "particles" in parameters.fields(estimator) and not isinstance(estimator, JumpFilter)
]
"""Those of a single model."""
BIASED = ("regularized", "uniform-resampling")
"""Those that change the law of their particles on purpose; their own tests hold them against the law that results."""

PLANE = Linear(
    A=np.array([[1.0, 1.0], [0.0, 0.9]]), a=np.array([0.2, -0.1]),
    G=np.eye(2), w=np.array([0.1, 0.3]), Q=np.array([[0.5, 0.2], [0.2, 0.4]]),
    H=np.array([[1.0, 0.5]]), h=np.array([-1.0]), v=np.array([0.4]), R=np.array([[2.0]]),
    m0=np.array([1.0, 0.0]), P0=np.array([[1.0, -0.3], [-0.3, 0.5]]),
)  # fmt: skip
"""A linear model whose measurements say about as much as its prediction, so that weights are uneven but not wild."""

PAIR = dataclasses.replace(
    PLANE, w=np.zeros(2), H=np.array([[1.0, 0.5], [0.0, 1.0]]), h=np.array([-1.0, 0.5]), v=np.zeros(2),
    R=np.array([[2.0, 0.3], [0.3, 1.5]]),
)  # fmt: skip
"""The same with noises of mean zero, which some proposals ask for, and two correlated sensors, one of which may fail."""

PUSHED = dataclasses.replace(PAIR, G=np.array([[0.5], [1.0]]), w=np.zeros(1), Q=np.array([[0.5]]))
"""The same with noise of rank one: the transition has no density over the whole state."""

SIDES = StateSpaceModel(
    Gaussian([0.5], [[4.0]]),
    AdditiveTransition(lambda x, k: 0.8 * x + 2 * np.sin(x) + 0.5 * np.cos(k), Gaussian.noise([[0.5]])),
    AdditiveSensor(lambda x, k: np.sqrt(1 + x * x), Gaussian.noise([[2.0]])),
)
"""A scalar model whose sensor does not see the sign: two modes. Its noise is wider than the transition's, so that weights
have a variance also in filters that divide by the likelihood of a prediction."""


def without_gain(p: Linear) -> StateSpaceModel:
    """A linear model whose gain is the identity, without naming it: its transition then has a density."""
    model = p.model
    assert isinstance(model.dynamics, AdditiveTransition)
    return dataclasses.replace(model, dynamics=dataclasses.replace(model.dynamics, gain=None))


def takers(model: Model, *, biased: bool = True) -> list[str]:
    """The particle filters that can run on a model; those named in BIASED as well, or not."""
    names = [name for name in PARTICLE_FILTERS if biased or name not in BIASED]
    return [name for name in names if ESTIMATORS[name].accepts(told(ESTIMATORS[name], model)) is None]


def repeated(y: Array, runs: int) -> Array:
    """One run's measurements y[T, m, 1] in many runs: these differ by the filter's random numbers alone."""
    return np.repeat(y[:, :, :1], runs, axis=2)


def with_particles(name: str, count: int) -> Any:
    """The estimator of that name, which may hold settings in brackets, with so many particles."""
    return dataclasses.replace(ESTIMATORS[name], particles=count)


def unbiased(estimate: Estimate, mean: Array, cov: Array, loglik: Array) -> Array:
    """Standard scores [T, figures] of figures whose expectation is zero at any number of particles.

    With Z the likelihood of y_1..y_k, Z' its estimate and g' that of the posterior mean of a function, E[Z' g'] = Z g (Del
    Moral, 2004, theorem 7.4.2). So Z'/Z - 1, Z'/Z (mean' - mean) and Z'/Z (second moment' - cov), moments about the exact
    mean[T, n], average to zero over runs of the same measurements, without the bias of order 1/N that mean' itself has.
    """
    ratio = np.exp(np.cumsum(estimate.loglik - loglik[:, None], axis=0))
    error = estimate.mean - mean[:, :, None]
    second = estimate.cov + error[:, :, None] * error[:, None] - cov[..., None]
    rows, columns = np.tril_indices(mean.shape[1])
    figures = np.concatenate([(ratio - 1)[:, None], ratio[:, None] * error, ratio[:, None] * second[:, rows, columns]], axis=1)
    return scores(figures, 0.0)


def scores(sample: Array, expected: Array | float) -> Array:
    """The mean of sample[..., R] over runs, less what is expected, in standard errors; an exact zero is no deviation."""
    error = sample.std(-1, ddof=1) / np.sqrt(sample.shape[-1])
    return np.asarray((sample.mean(-1) - expected) / np.maximum(error, 1e-12))


Between = Callable[[Array, Array, Array], Array]


def on_a_grid(grid: Array, model: StateSpaceModel, y: Array, between: Between | None = None) -> tuple[Array, Array, Array]:
    """Means, variances and log-likelihoods [T, R] of a scalar model with Gaussian noises, for many runs y[T, 1, R] at once.

    grid[G] is even; by the rectangle rule, as in `grid_filter`. between(predicted, likelihood, posterior), arrays [G, R],
    is the density that a filter goes on from where that is not the posterior.
    """
    dynamics, sensor, step = model.dynamics, model.sensor, grid[1] - grid[0]
    assert isinstance(dynamics, AdditiveTransition)
    assert isinstance(sensor, AdditiveSensor)
    start = np.repeat(normal(grid - model.prior.mean, model.prior.cov[0, 0])[:, None], y.shape[2], axis=1)
    found = []
    for k, z in enumerate(y[:, 0], start=1):
        ahead = dynamics.mean(grid[None], k)[0]
        predicted = normal(grid[:, None] - ahead, dynamics.noise_cov(k)[0, 0]) @ start * step
        likelihood = normal(z - sensor.mean(grid[None], k)[0][:, None], sensor.noise.cov[0, 0])
        likelihood = np.where(np.isnan(z), 1.0, likelihood)
        evidence = (predicted * likelihood).sum(0) * step
        density = predicted * likelihood / evidence
        mean = grid @ density * step
        found.append((mean, (grid**2) @ density * step - mean**2, np.log(evidence)))
        start = between(predicted, likelihood, density) if between else density
    means, variances, logliks = (np.stack(part) for part in zip(*found, strict=True))
    return means, variances, logliks


def normal(e: Array, variance: float) -> Array:
    """Density of a centred normal number at e."""
    return np.asarray(np.exp(-0.5 * e * e / variance) / np.sqrt(2 * np.pi * variance))


def from_both_sides(estimator: Any) -> tuple[Truth, Estimate, Estimate]:
    """A target whose bearing jumps from pi to -pi, and what an estimator says of it from bearings with the jump and without.

    Where angles are counted from must not matter: from east the bearing jumps, from west it passes through zero.
    """
    east = range_bearing()
    truth = draw(east, 25, generators(4, "wrap"))
    assert (truth.y[:, 1] > 3).any(axis=0).all()
    assert (truth.y[:, 1] < -3).any(axis=0).all()
    return truth, estimator.run(east, truth.y), estimator.run(range_bearing(west=True), from_west(truth.y))


def near(actual: Array, expected: Array, tolerance: float = 1e-9) -> None:
    """Assert that arrays agree relative to each number or, where these are small, to the largest."""
    np.testing.assert_allclose(actual, expected, rtol=tolerance, atol=tolerance * np.abs(expected).max())


def same_filter(a: Estimate, b: Estimate, tolerance: float = 1e-9) -> None:
    """Assert that two Gaussian filters say the same: mean, covariance, log-likelihood and innovation."""
    assert a.ok.all()
    assert b.ok.all()
    for name in ("mean", "cov", "loglik"):
        near(getattr(a, name), getattr(b, name), tolerance)
    np.testing.assert_allclose(a.innovation, b.innovation, rtol=tolerance, atol=tolerance)


def with_outages(y: Array) -> Array:
    """Some components missing in some runs at some steps, one whole step, and a run almost for good."""
    y = y.copy()
    y[np.random.default_rng(0).random(y.shape) < 0.3] = np.nan
    y[3] = np.nan
    y[2:, :, 0] = np.nan
    return y
