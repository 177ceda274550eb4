"""The unscented filters, ours and filterpy's: each against the Kalman filter, and one against the other."""

import dataclasses

import numpy as np
import pytest

from cases import CASES
from cases.multistatic_radar import flight
from estimators.kalman import Kalman
from estimators.peers.filterpy import FilterpyUnscented
from estimators.ukf import Unscented
from suite.case import draw
from suite.estimator import LOST
from suite.model import AdditiveSensor, AdditiveTransition, StateSpaceModel
from suite.noise import Gaussian, StudentT
from suite.nonadditive import NonadditiveSensor, NonadditiveTransition
from tests.estimators.references import from_both_sides
from tests.oracles import generators, random_linear

BOTH = pytest.mark.parametrize("make", [Unscented, FilterpyUnscented], ids=["ours", "filterpy"])
SHAPES = [(1, 1, 1), (2, 1, 1), (3, 2, 1), (4, 2, 2), (4, 4, 4), (6, 2, 3)]
SPREADS = [{}, {"alpha": 0.5, "beta": 0.0}, {"alpha": 0.3, "beta": 2.0, "kappa": 1.5}]


def near(actual, expected, tolerance=1e-8):
    np.testing.assert_allclose(actual, expected, rtol=tolerance, atol=tolerance * np.abs(expected).max())


def same(a, b):
    assert a.ok.all()
    assert b.ok.all()
    for name in ("mean", "cov", "loglik"):
        near(getattr(a, name), getattr(b, name))


def with_outages(y):
    y = y.copy()
    y[np.random.default_rng(0).random(y.shape) < 0.3] = np.nan
    y[3] = np.nan
    return y


@BOTH
@pytest.mark.parametrize("missing", [False, True], ids=["complete", "missing"])
@pytest.mark.parametrize("spread", SPREADS, ids=str)
@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_equals_the_kalman_filter_on_linear_models(make, shape, spread, missing):
    problem = random_linear(sum(shape), *shape)
    _, y = problem.simulate(steps=10, runs=3, seed=1)
    y = with_outages(y) if missing else y
    same(make(**spread).run(problem.model, y), Kalman().run(problem.model, y))


@pytest.mark.parametrize("shape", [(3, 2, 1), (4, 2, 2), (4, 2, 1)], ids=str)
def test_equals_the_kalman_filter_from_a_known_state(shape):
    problem = random_linear(20 + sum(shape), *shape, dirac=True)
    _, y = problem.simulate(steps=10, runs=3, seed=1)
    same(Unscented().run(problem.model, y), Kalman().run(problem.model, y))


def test_filterpy_cannot_start_from_a_known_state():
    problem = random_linear(1, 3, 2, 2, dirac=True)
    assert "singular" in FilterpyUnscented().accepts(problem.model)


@pytest.mark.parametrize("start", [0, 85, 400])
@pytest.mark.parametrize("name", ["multistatic-radar/phlab", "multistatic-radar/phlab-climb"])
def test_equals_filterpy_on_the_radar_with_its_outages(name, start):
    # From step 85 the total outage of steps 101-115 is crossed, from 400 the loss of one transmitter at 421.
    case = CASES[name]
    model = dataclasses.replace(case.model, prior=Gaussian(flight()[start], case.model.prior.cov))
    y = case.simulate(2, seed=3).y[start : start + 50]
    assert np.isnan(y).any() == (start > 0)
    same(Unscented().run(model, y), FilterpyUnscented().run(model, y))


@pytest.mark.parametrize("spread", SPREADS, ids=str)
def test_equals_filterpy_on_a_curved_model_with_correlated_noise(spread):
    def bend(x, k):
        return np.stack([x[0] + 0.1 * np.sin(x[1]), 0.9 * x[1] + 0.2 * np.cos(x[0] + 0.1 * k)])

    def look(x, k):
        return np.stack([x[0] * x[0] + x[1], np.exp(0.2 * x[1]), x[0] * x[1]])

    model = StateSpaceModel(
        Gaussian([1.0, -0.5], [[0.5, 0.1], [0.1, 0.3]]),
        AdditiveTransition(bend, Gaussian([0.3], [[0.2]]), gain=np.array([[1.0], [0.5]])),
        AdditiveSensor(look, Gaussian([0.1, 0.0, -0.2], [[0.5, 0.1, 0.0], [0.1, 0.4, 0.1], [0.0, 0.1, 0.6]])),
    )
    y = with_outages(draw(model, 20, generators(3, "curved")).y)
    same(Unscented(**spread).run(model, y), FilterpyUnscented(**spread).run(model, y))


def test_moments_of_a_square_are_exact():
    # For x ~ N(m, s²), E[x² + v] = m² + s² for every spread, and Var = 4 m² s² + 2 s⁴ + r with alpha = 1, beta = 2 and
    # kappa = 0 in one dimension. The covariance with x is 2 m s². One update of the filter follows by hand.
    m, s2, r, z = 1.5, 0.49, 0.3, 3.0
    model = StateSpaceModel(
        Gaussian([m], [[s2]]),
        AdditiveTransition(lambda x, k: x, Gaussian.noise([[0.0]])),
        AdditiveSensor(lambda x, k: x * x, Gaussian.diagonal([r])),
    )
    estimate = Unscented().run(model, np.array([[[z]]]))
    mean, variance, cross = m**2 + s2, 4 * m**2 * s2 + 2 * s2**2 + r, 2 * m * s2
    near(estimate.mean[0, 0, 0], m + cross / variance * (z - mean), 1e-13)
    near(estimate.cov[0, 0, 0, 0], s2 - cross**2 / variance, 1e-13)
    near(estimate.loglik[0, 0], -0.5 * ((z - mean) ** 2 / variance + np.log(2 * np.pi * variance)), 1e-13)


@BOTH
def test_bearings_wrap(make):
    truth, a, b = from_both_sides(make())
    same(a, b)
    # A range error of 5 m and a bearing error of 20 m across: nowhere near the kilometres of a bearing gone wrong.
    assert np.abs(a.mean - truth.x)[:, [0, 2]].max() < 100


@pytest.mark.parametrize("part", ["dynamics", "sensor"])
def test_noise_inside_a_function_is_for_ours_alone(part):
    model = random_linear(1, 2, 1, 2).model
    inside = {
        "dynamics": NonadditiveTransition(lambda x, w, k: x * (1 + w), Gaussian.diagonal([1.0, 1.0])),
        "sensor": NonadditiveSensor(lambda x, v, k: x[:1] * v, Gaussian.diagonal([1.0]), dim=1),
    }
    other = dataclasses.replace(model, **{part: inside[part]})
    assert Unscented().accepts(model) is None
    assert FilterpyUnscented().accepts(model) is None
    assert Unscented().accepts(other) is None
    assert "noise is not additive" in FilterpyUnscented().accepts(other)


@BOTH
def test_refuses_laws_that_are_no_function_of_a_noise(make):
    model = random_linear(1, 2, 1, 2).model

    class Law:
        dim = 1

    words = {Unscented: "transition is not a function", FilterpyUnscented: "process noise is not additive"}
    assert words[make] in make().accepts(dataclasses.replace(model, dynamics=Law()))
    assert "measurement" in make().accepts(dataclasses.replace(model, sensor=Law()))


@BOTH
def test_takes_other_noises_by_their_moments(make):
    model = random_linear(2, 2, 1, 2).model
    heavy, alike = StudentT([[2.0]], 5.0), Gaussian.noise([[2.0 * 5 / 3]])
    y = draw(model, 8, generators(2, "moments")).y
    a, b = (make().run(dataclasses.replace(model, sensor=AdditiveSensor(model.sensor.mean, n)), y) for n in (heavy, alike))
    same(a, b)


def test_a_run_without_hope_is_lost_alone():
    case = CASES["multistatic-radar/phlab"]
    y = case.simulate(4).y[:20].copy()
    y[10, 0, 2] = np.inf
    estimate = Unscented().run(case.model, y)
    assert list(estimate.status) == ["ok", "ok", LOST, "ok"]
    assert estimate.reason[2] == "step 11: the state estimate is not finite"
    assert np.isfinite(estimate.mean[:10, :, 2]).all()
    assert np.isnan(estimate.mean[10:, :, 2]).all()
    others = Unscented().run(case.model, y[:, :, [0, 1, 3]])
    np.testing.assert_array_equal(estimate.mean[:, :, [0, 1, 3]], others.mean)


def test_filterpy_does_not_take_an_infinite_measurement_for_a_missing_one():
    model = random_linear(2, 2, 1, 2).model
    estimate = FilterpyUnscented().run(model, np.array([[[np.inf]]]))
    assert list(estimate.status) == [LOST]
