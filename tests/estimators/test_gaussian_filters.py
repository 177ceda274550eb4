"""All Gaussian filters: against the Kalman filter and the joint Gaussian, and what each refuses."""

import dataclasses
import inspect

import numpy as np
import pytest

from cases import CASES
from estimators.ckf import Cubature
from estimators.ekf import Extended
from estimators.ghkf import LIMIT, GaussHermite
from estimators.iterated_ekf import IteratedExtended
from estimators.kalman import Kalman
from estimators.ukf import Unscented
from suite import particles
from suite.errors import BadInput
from suite.estimator import LOST, StepError
from suite.gaussian_filter import GaussianFilter
from suite.model import AdditiveSensor, AdditiveTransition, StateSpaceModel
from suite.noise import Gaussian, StudentT
from suite.nonadditive import NonadditiveSensor, NonadditiveTransition
from tests.estimators.references import from_both_sides, near, same_filter, with_outages
from tests.oracles import (
    filterpy_kalman,
    joint_loglik,
    joint_posterior,
    random_linear,
)

FILTERS = (
    Kalman(), Extended(), IteratedExtended(), Unscented(), Unscented(alpha=1e-2), Cubature(), GaussHermite(), GaussHermite(2),
)  # fmt: skip
CURVED = tuple(f for f in FILTERS if not isinstance(f, Kalman))
SHAPES = [(1, 1, 1), (2, 1, 1), (3, 2, 1), (4, 2, 2), (5, 3, 2), (4, 4, 4), (2, 3, 1), (6, 2, 3)]
"""State, measurement and process noise dimensions; where the last is below the first, the noise is singular."""
every_filter = pytest.mark.parametrize("filter", FILTERS, ids=repr)
curved_filter = pytest.mark.parametrize("filter", CURVED, ids=repr)


@every_filter
@pytest.mark.parametrize("missing", [False, True], ids=["complete", "missing"])
@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_equals_the_kalman_filter_of_filterpy_on_linear_models(filter, shape, missing):
    problem = random_linear(sum(shape), *shape)
    _, y = problem.simulate(steps=8, runs=2, seed=1)
    y = with_outages(y) if missing else y
    found = filter.run(problem.model, y)
    assert found.ok.all()
    for r in range(2):
        mean, cov, loglik = filterpy_kalman(problem, y[:, :, r])
        near(found.mean[:, :, r], mean)
        near(found.cov[..., r], cov)
        near(found.loglik[:, r], loglik)


@every_filter
@pytest.mark.parametrize("missing", [False, True], ids=["complete", "missing"])
@pytest.mark.parametrize("shape", SHAPES[:6], ids=str)
def test_equals_the_joint_gaussian_from_a_known_state(filter, shape, missing):
    problem = random_linear(100 + sum(shape), *shape, dirac=True)
    _, y = problem.simulate(steps=5, runs=2, seed=2)
    y = with_outages(y) if missing else y
    found = filter.run(problem.model, y)
    for r in range(2):
        np.testing.assert_allclose(found.loglik[:, r].sum(), joint_loglik(problem, y[:, :, r]), rtol=1e-9)
        mean, cov = joint_posterior(problem, y[:, :, r])
        near(found.mean[-1, :, r], mean)
        near(found.cov[-1, :, :, r], cov)


@every_filter
def test_a_sensor_without_noise_measures_exactly(filter):
    problem = dataclasses.replace(random_linear(9, 3, 2, 3), R=np.diag([1.0, 0.0]))
    _, y = problem.simulate(steps=5, runs=2, seed=3)
    found = filter.run(problem.model, y)
    same_filter(found, Kalman().run(problem.model, y), 1e-8)
    seen = np.einsum("i,tir->tr", problem.H[1], found.mean) + problem.h[1] + problem.v[1]
    np.testing.assert_allclose(seen, y[:, 1], rtol=1e-9)
    np.testing.assert_allclose(np.einsum("i,tijr,j->tr", problem.H[1], found.cov, problem.H[1]), 0.0, atol=1e-9)


@curved_filter
def test_bearings_wrap(filter):
    truth, a, b = from_both_sides(filter)
    same_filter(a, b, 1e-7)
    # A range error of 5 m and a bearing error of 20 m across: nowhere near the kilometres of a bearing gone wrong.
    assert np.abs(a.mean - truth.x)[:, [0, 2]].max() < 100


@curved_filter
def test_a_run_without_hope_is_lost_alone(filter):
    case = CASES["ballistic/1"]
    y = case.simulate(4, seed=1).y[:12].copy()
    y[10, 0, 2] = np.inf
    found = filter.run(case.model, y)
    assert list(found.status) == ["ok", "ok", LOST, "ok"]
    assert found.reason[2].startswith("step 11: ")
    np.testing.assert_array_equal(found.mean[:, :, [0, 1, 3]], filter.run(case.model, y[:, :, [0, 1, 3]]).mean)


@curved_filter
def test_functions_of_the_time_index_are_given_the_step(filter):
    """The first transition leads to k = 1, where the first measurement is."""
    model = StateSpaceModel(
        Gaussian([0.0], [[1.0]]),
        AdditiveTransition(lambda x, k: 0.5 * x + 10.0 * k, Gaussian.diagonal([1.0])),
        AdditiveSensor(lambda x, k: x * 3.0**k, Gaussian.diagonal([1.0])),
    )
    found = filter.run(model, np.array([[[33.0]], [[np.nan]]]))
    mean, var, slope = 10.0, 1.25, 3.0
    gain = var * slope / (slope**2 * var + 1)
    near(found.mean[0, 0, 0], mean + gain * 3.0)
    near(found.mean[1, 0, 0], 0.5 * (mean + gain * 3.0) + 20.0)


def test_kalman_filter_refuses_noise_that_stops_being_gaussian():
    model = random_linear(1, 2, 1, 2).model
    changing = lambda k: Gaussian.diagonal([1.0, 1.0]) if k < 3 else StudentT(np.eye(2), 4.0)  # noqa: E731
    other = dataclasses.replace(model, dynamics=AdditiveTransition(model.dynamics.mean, changing))
    assert Kalman().accepts(other) is None
    with pytest.raises(StepError, match=r"step 3: .*not Gaussian, as that of the first"):
        Kalman().run(other, np.zeros((4, 1, 2)))
    assert Unscented().run(other, np.zeros((4, 1, 2))).ok.all()


@pytest.mark.parametrize("filter", [Unscented(), Cubature(), GaussHermite()], ids=repr)
def test_sigma_points_need_no_derivative(filter):
    model = dataclasses.replace(
        random_linear(1, 2, 2, 2).model, sensor=AdditiveSensor(lambda x, k: np.cbrt(x), Gaussian.diagonal([1.0, 1.0]))
    )
    assert filter.accepts(model) is None
    for taylor in (Extended(), IteratedExtended()):
        assert "sensor cannot be differentiated" in taylor.accepts(model)


def test_gauss_hermite_refuses_too_many_points():
    two = random_linear(1, 2, 1, 2).model
    moved = NonadditiveTransition(lambda x, w, k: x + w, Gaussian.diagonal([1.0, 1.0]))
    seen = NonadditiveSensor(lambda x, v, k: x[:1] + v, Gaussian.diagonal([1.0]), dim=1)
    inside = StateSpaceModel(two.prior, moved, seen)
    assert LIMIT == 100_000
    assert GaussHermite(100).accepts(two) is None
    assert GaussHermite(17).accepts(inside) is None  # 17**4 = 83521
    assert GaussHermite(18).accepts(inside) == "its rule needs 104976 points, more than 100000; set a lower order"
    assert GaussHermite(3).accepts(CASES["multistatic-radar/phlab"].model) is None
    assert "1000000 points" in GaussHermite(10).accepts(CASES["multistatic-radar/phlab"].model)
    assert GaussHermite(18).accepts(StateSpaceModel(two.prior, two.dynamics, seen)) is None
    with pytest.raises(BadInput, match="at least 2"):
        GaussHermite(1)


def test_gauss_hermite_takes_runs_by_groups_that_fit_the_cache():
    model = random_linear(1, 2, 1, 2).model
    assert GaussHermite(100).runs_at_once(model) == particles.runs_at_once(10_000)
    assert GaussHermite(2).runs_at_once(model) == particles.runs_at_once(4)


def test_the_base_gives_no_rule():
    assert inspect.isabstract(GaussianFilter)
