"""The Gaussian filter's prediction, update and merging, against plain formulas on covariances."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from suite.gaussian import GaussianBelief, accepts, additive, arguments, differentiable, merged, predict, prior, update
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.moment_rules import affine, cubature, gauss_hermite, taylor, unscented
from suite.noise import Gaussian, Independent, StudentT
from suite.nonadditive import NonadditiveSensor, NonadditiveTransition
from tests.oracles import random_linear

RULES = {
    "affine": affine, "taylor": taylor, "cubature": cubature(), "gauss-hermite": gauss_hermite(3),
    "unscented": unscented(1.0, 2.0, 0.0), "narrow": unscented(1e-2, 2.0, 0.0),
}  # fmt: skip
every_rule = pytest.mark.parametrize("rule", RULES.values(), ids=RULES)


def beliefs(runs=3, n=3, seed=0, rank=None):
    """Beliefs whose factors are not triangular."""
    rng = np.random.default_rng(seed)
    return GaussianBelief(rng.standard_normal((runs, n)), rng.standard_normal((runs, n, rank or n)) @ np.eye(rank or n, n))


def near(actual, expected, tolerance=1e-10):
    np.testing.assert_allclose(actual, expected, rtol=tolerance, atol=tolerance * np.abs(expected).max(initial=1.0))


@every_rule
@pytest.mark.parametrize("rank", [1, 3])
@pytest.mark.parametrize("q", [1, 3])
def test_prediction_through_an_affine_function(rule, rank, q):
    problem, start = random_linear(3, 3, 2, q), beliefs(rank=rank)
    found = predict(rule, start, problem.model.dynamics, 1)
    near(found.mean, start.mean @ problem.A.T + problem.a + problem.G @ problem.w)
    near(found.cov, problem.A @ start.cov @ problem.A.T + problem.G @ problem.Q @ problem.G.T)
    assert found.loglik is None
    assert found.innovation is None


@every_rule
@pytest.mark.parametrize("rank", [1, 3])
@pytest.mark.parametrize("rows", [(0, 1), (1,), (0,), ()], ids=str)
def test_update_by_an_affine_sensor(rule, rank, rows):
    """By the covariance form: S = H P H' + R, K = P H' inv(S), of those components that were observed."""
    problem, start, rows = random_linear(4, 3, 2, 3), beliefs(rank=rank), list(rows)
    y = np.full((2, 3), np.nan)
    y[rows] = np.random.default_rng(4).standard_normal((len(rows), 3))
    found = update(rule, start, problem.model.sensor, y, 1)
    for r in range(3):
        H, P = problem.H[rows], start.cov[r]
        S = H @ P @ H.T + problem.R[np.ix_(rows, rows)]
        e = y[rows, r] - H @ start.mean[r] - (problem.h + problem.v)[rows]
        K = np.linalg.solve(S, H @ P).T
        near(found.mean[r], start.mean[r] + K @ e)
        near(found.cov[r], P - K @ S @ K.T)
        near(found.loglik[r], stats.multivariate_normal(np.zeros(len(rows)), S).logpdf(e) if rows else 0.0)
        near(found.innovation[rows, r], np.linalg.solve(np.linalg.cholesky(S), e) if rows else np.zeros(0))
    assert np.isnan(found.innovation[[i for i in range(2) if i not in rows]]).all()


def test_outages_may_differ_from_run_to_run():
    problem, start = random_linear(5, 3, 2, 3), beliefs(runs=4)
    y = np.random.default_rng(5).standard_normal((2, 4))
    y[0, 1] = y[1, 2] = y[0, 3] = y[1, 3] = np.nan
    whole = update(affine, start, problem.model.sensor, y, 1)
    for r in range(4):
        alone = update(
            affine, GaussianBelief(start.mean[r : r + 1], start.root[r : r + 1]), problem.model.sensor, y[:, r : r + 1], 1
        )
        np.testing.assert_array_equal(alone.mean[0], whole.mean[r])
        near(alone.cov[0], whole.cov[r], 1e-14)
        near(alone.loglik[0], whole.loglik[r], 1e-14)


def test_an_exact_measurement_leaves_no_variance():
    sensor = AdditiveSensor(Affine([[1.0, 1.0]]), Gaussian.noise([[0.0]]))
    found = update(affine, beliefs(n=2), sensor, np.array([[1.0, 2.0, 3.0]]), 1)
    near(found.mean.sum(1), [1.0, 2.0, 3.0])
    near(found.cov.sum((1, 2)), np.zeros(3), 1e-14)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e308])
@pytest.mark.parametrize("where", [(0, 0), (1, 0), (2, 1)], ids=str)
def test_a_bad_factor_harms_its_own_run(bad, where):
    problem, clean = random_linear(3, 3, 2, 3), beliefs()
    y = np.random.default_rng(4).standard_normal((2, 3))
    root = clean.root.copy()
    root[1] = np.eye(3)
    root[1][where] = bad
    with np.errstate(all="ignore"):
        found = update(affine, GaussianBelief(clean.mean, root), problem.model.sensor, y, 1)
        sound = np.isfinite(found.mean).all(1) & np.isfinite(found.cov).all((1, 2))
    assert sound[[0, 2]].all()
    assert np.isfinite(bad) or not sound[1]
    expected = update(affine, clean, problem.model.sensor, y, 1)
    for r in (0, 2):
        np.testing.assert_array_equal(found.mean[r], expected.mean[r])
        np.testing.assert_array_equal(found.cov[r], expected.cov[r])


def test_a_measurement_without_a_density_costs_its_own_run():
    sensor = AdditiveSensor(Affine([[1.0, 0.0]]), Gaussian.noise([[0.0]]))
    belief = GaussianBelief(np.zeros((2, 2)), np.stack([np.eye(2), np.diag([0.0, 1.0])]))
    with np.errstate(all="ignore"):
        found = update(affine, belief, sensor, np.array([[1.0, 1.0]]), 1)
    assert np.isfinite(found.mean[0]).all()
    assert not np.isfinite(found.mean[1]).all()


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.integers(1, 4), st.integers(1, 4), st.integers(1, 3), st.booleans(), st.integers(0, 2**32 - 1))
def test_merged_moments_are_those_of_the_mixture(modes, n, runs, certain, seed):
    rng = np.random.default_rng(seed)
    weights = np.eye(modes)[np.zeros(runs, int)] if certain else rng.dirichlet(np.ones(modes), runs)
    means, roots = 100 * rng.standard_normal((modes, runs, n)), rng.standard_normal((modes, runs, n, n))
    found = merged(weights, means, roots)
    for r in range(runs):
        mean = sum(w * m for w, m in zip(weights[r], means[:, r], strict=True))
        second = sum(w * (a @ a.T + np.outer(m, m)) for w, m, a in zip(weights[r], means[:, r], roots[:, r], strict=True))
        near(found.mean[r], mean, 1e-12)
        near(found.cov[r], second - np.outer(mean, mean), 1e-9)


def test_a_lost_component_without_weight_does_not_count():
    rng = np.random.default_rng(8)
    weights, means, roots = np.array([[0.4, 0.0, 0.6]] * 2), rng.standard_normal((3, 2, 2)), rng.standard_normal((3, 2, 2, 2))
    expected = merged(weights[:, [0, 2]], means[[0, 2]], roots[[0, 2]])
    means[1], roots[1] = np.nan, np.inf
    found = merged(weights, means, roots)
    near(found.mean, expected.mean, 1e-15)
    near(found.cov, expected.cov, 1e-15)
    weights[0] = np.nan
    assert np.isnan(merged(weights, means, roots).cov[0]).all()


def test_prior_is_the_models_once_a_run():
    model = random_linear(3, 3, 2, 3).model
    belief = prior(model, 4)
    for r in range(4):
        np.testing.assert_array_equal(belief.mean[r], model.prior.mean)
        near(belief.cov[r], model.prior.cov, 1e-15)
    belief.mean[0] = 7
    assert not (model.prior.mean == 7).any()


def test_readout_is_components_first():
    belief = beliefs()
    readout = belief.read()
    np.testing.assert_array_equal(readout.mean[:, 1], belief.mean[1])
    np.testing.assert_array_equal(readout.cov[..., 1], belief.cov[1])


def test_noises_count_by_their_moments():
    model, start = random_linear(6, 3, 2, 2).model, beliefs()
    heavy = Independent((StudentT([[2.0]], 5.0), Gaussian([0.5], [[1.0]])))
    alike = Gaussian([0.0, 0.5], np.diag([2.0 * 5 / 3, 1.0]))
    y = np.array([[0.3, np.nan, 1.0], [0.1, 0.2, np.nan]])
    a, b = (update(taylor, start, AdditiveSensor(model.sensor.mean, noise), y, 1) for noise in (heavy, alike))
    near(a.mean, b.mean, 1e-14)
    near(a.cov, b.cov, 1e-14)
    a, b = (predict(taylor, start, dataclasses.replace(model.dynamics, noise=noise), 1) for noise in (heavy, alike))
    near(a.mean, b.mean, 1e-14)
    near(a.cov, b.cov, 1e-14)


class Law:
    dim = 2


def test_laws_that_are_no_function_of_a_noise_are_refused_and_named():
    model = random_linear(1, 3, 2, 2).model
    inside = NonadditiveTransition(lambda x, w, k: x * (1 + w), Gaussian.diagonal([1.0] * 3))
    seen = NonadditiveSensor(lambda x, v, k: x[:2] * v, Gaussian.diagonal([1.0] * 2), dim=2)
    for known in (model, dataclasses.replace(model, dynamics=inside), dataclasses.replace(model, sensor=seen)):
        assert accepts(known) is None
        assert differentiable(known) is None
    assert additive(model) is None
    assert additive(dataclasses.replace(model, dynamics=inside)) == "its process noise is not additive"
    assert additive(dataclasses.replace(model, sensor=seen)) == "its measurement noise is not additive"
    for refuses in (accepts, differentiable):
        assert "transition is not" in refuses(dataclasses.replace(model, dynamics=Law()))
        assert "measurement is not" in refuses(dataclasses.replace(model, sensor=Law()))
    with pytest.raises(TypeError, match="predict through Law"):
        predict(taylor, beliefs(), Law(), 1)
    with pytest.raises(TypeError, match="update by Law"):
        update(taylor, beliefs(), Law(), np.zeros((2, 3)), 1)


def test_functions_without_a_derivative_are_refused_and_named():
    model = random_linear(1, 3, 2, 2).model
    odd = AdditiveTransition(lambda x, k: np.cbrt(x), Gaussian.diagonal([1.0] * 3))
    seen = NonadditiveSensor(lambda x, v, k: np.cbrt(x[:2]) * v, Gaussian.diagonal([1.0] * 2), dim=2)
    assert "transition cannot be differentiated: TypeError" in differentiable(dataclasses.replace(model, dynamics=odd))
    assert "sensor cannot be differentiated: TypeError" in differentiable(dataclasses.replace(model, sensor=seen))
    assert accepts(dataclasses.replace(model, dynamics=odd)) is None


def test_a_rule_is_given_the_state_and_a_noise_inside_a_function():
    model = random_linear(1, 3, 2, 2).model
    moved = NonadditiveTransition(lambda x, w, k: x * w[0], Gaussian.diagonal([1.0] * 2))
    seen = NonadditiveSensor(lambda x, v, k: x[:2] * v[:2], Gaussian.diagonal([1.0] * 4), dim=2)
    assert arguments(model) == 3
    assert arguments(StateSpaceModel(model.prior, moved, model.sensor)) == 5
    assert arguments(StateSpaceModel(model.prior, moved, seen)) == 7
