"""The auxiliary filter: both of its looks ahead, where they collapse, and where they mislead."""

from dataclasses import dataclass

import numpy as np
import pytest

from cases import CASES
from estimators.auxiliary import Auxiliary
from estimators.kalman import Kalman
from suite.case import draw
from suite.estimator import LOST
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian
from tests.estimators.references import PAIR, SIDES, on_a_grid, repeated, unbiased
from tests.oracles import filterpy_kalman, generators


@pytest.mark.parametrize("resampling", ["multinomial", "residual"])
@pytest.mark.parametrize("look", ["sample", "mean"])
def test_figures_are_unbiased_whatever_the_look(look, resampling):
    # 5 x 3 and 3 x 6 figures of 2000 runs in four tests, 6 standard errors: a false alarm has probability below 1e-6.
    estimator = Auxiliary(particles=40, look=look, resampling=resampling)
    y = draw(SIDES, 5, generators(1, "sides")).y
    mean, variance, loglik = on_a_grid(np.linspace(-25, 25, 1001), SIDES, y)
    found = unbiased(estimator.run(SIDES, repeated(y, 2000), 1), mean, variance[..., None], loglik[:, 0])
    worst = np.abs(found).max()
    assert worst < 6
    _, y = PAIR.simulate(steps=3, runs=1, seed=3)
    found = unbiased(estimator.run(PAIR.model, repeated(y, 2000), 1), *filterpy_kalman(PAIR, y[:, :, 0]))
    worst = np.abs(found).max()
    assert worst < 6


def test_a_sensor_sharper_than_the_transition_is_beyond_it():
    """A sampled look divides by a likelihood whose inverse has no mean: what is unbiased in theory falls short in practice."""
    model = CASES["ungm"].model
    y = draw(model, 4, generators(1, "growth")).y
    _, _, exact = on_a_grid(np.linspace(-60, 60, 1201), model, y)
    ratio = np.exp(Auxiliary(particles=100).run(model, repeated(y, 1500), 8).loglik.sum(0) - exact.sum())
    assert ratio.mean() < 1 - 8 * ratio.std() / np.sqrt(1500)


@dataclass(frozen=True)
class Window:
    """A sensor that says for certain whether the state is within `width` of y; above 1e3 it says no number."""

    width: float
    dim: int = 1

    def sample(self, rng, x, k):
        return x + self.width * (2 * rng.random(x.shape) - 1)

    def logpdf(self, z, x, k):
        z = z.reshape(1, -1, *(1,) * (x.ndim - 2))
        density = np.where(np.abs(z - x) <= self.width, -np.log(2 * self.width), -np.inf)
        return np.where(z > 1e3, np.nan, density)[0]


def windowed(width, noise):
    start = Gaussian([0.0], [[0.0]])
    return StateSpaceModel(start, AdditiveTransition(Affine([[1.0]]), Gaussian.noise([[noise]])), Window(width))


@pytest.mark.parametrize("look", ["sample", "mean"])
@pytest.mark.parametrize("bad", [30.0, 1e9], ids=["impossible", "no number"])
def test_a_first_look_that_finds_nothing_loses_that_run_alone(look, bad):
    y = np.zeros((6, 1, 3))
    clean = Auxiliary(particles=500, look=look).run(windowed(3.0, 1.0), y, 1)
    y[3, 0, 1] = bad
    estimate = Auxiliary(particles=500, look=look).run(windowed(3.0, 1.0), y, 1)
    assert clean.ok.all()
    assert list(estimate.status) == ["ok", LOST, "ok"]
    assert estimate.reason[1] == "step 4: the measurement has zero likelihood"
    np.testing.assert_array_equal(estimate.mean[..., [0, 2]], clean.mean[..., [0, 2]])
    np.testing.assert_array_equal(estimate.mean[:3], clean.mean[:3])
    assert np.isnan(estimate.loglik[3:, 1]).all()


def test_draws_that_miss_what_the_first_look_saw_lose_the_run():
    """From a known state the expected successor lies in a window so narrow that no draw does."""
    estimate = Auxiliary(particles=200, look="mean").run(windowed(1e-12, 1.0), np.zeros((2, 1, 3)), 1)
    assert list(estimate.status) == [LOST] * 3
    assert set(estimate.reason) == {"step 1: the measurement has zero likelihood"}


def test_only_additive_transitions_have_a_mean_to_look_at():
    @dataclass(frozen=True)
    class Jump:
        def sample(self, rng, x, k):
            return x + rng.standard_normal(x.shape)

        def logpdf(self, z, x, k):
            return -0.5 * ((z - x) ** 2).sum(0)

    model = StateSpaceModel(Gaussian([0.0], [[1.0]]), Jump(), Window(1.0))
    assert Auxiliary().accepts(model) is None
    assert Auxiliary(look="mean").accepts(model) == "its transition has no mean to look ahead to; set look=sample"
    assert Auxiliary(particles=50).run(model, np.zeros((3, 1, 2)), 1).ok.all()


@pytest.mark.parametrize("look", ["sample", "mean"])
def test_the_look_ahead_counts_the_mean_of_the_noise(look):
    """With noise that moves the state by 5, a look that forgot it would pick parents by how unlikely they are."""
    model = StateSpaceModel(
        Gaussian.noise([[1.0]]),
        AdditiveTransition(Affine([[1.0]]), Gaussian([5.0], [[1.0]])),
        AdditiveSensor(Affine([[1.0]]), Gaussian.noise([[1.0]])),
    )
    y = np.array([5.0, 10.0, 15.0])[:, None, None]
    exact = Kalman().run(model, y)
    estimate = Auxiliary(particles=20_000, look=look).run(model, y, 1)
    np.testing.assert_allclose(estimate.mean, exact.mean, atol=0.1)
    np.testing.assert_allclose(estimate.loglik, exact.loglik, atol=0.1)
