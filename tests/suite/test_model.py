"""State-space models: missing data, wrapped angles, checks of shapes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from suite.model import (
    AdditiveSensor,
    AdditiveTransition,
    Affine,
    StateSpaceModel,
    is_linear_gaussian,
    outage_patterns,
    wrap,
)
from suite.noise import Gamma, Gaussian, GaussianMixture, StudentT
from tests.oracles import generators

R = np.array([[2.0, 0.6, -0.3], [0.6, 1.0, 0.2], [-0.3, 0.2, 0.5]])
H = np.array([[1.0, 0.0], [0.5, -1.0], [0.0, 2.0]])
PATTERNS = np.array([[1, 1, 1], [1, 0, 1], [0, 0, 1], [0, 0, 0], [1, 0, 1], [0, 1, 1], [1, 0, 0]], bool).T
"""Which of three components are observed in each of seven runs."""


def measured(seed=0):
    rng = np.random.default_rng(seed)
    return np.where(PATTERNS, rng.standard_normal(PATTERNS.shape), np.nan)


@pytest.mark.parametrize("rest", [(), (5,), (2, 4)], ids=str)
def test_missing_components_leave_the_marginal_density(rest):
    sensor = AdditiveSensor(Affine(H), Gaussian([0.1, -0.2, 0.3], R))
    z, x = measured(), np.random.default_rng(1).standard_normal((2, 7, *rest))
    found = sensor.logpdf(z, x, 1)
    assert found.shape == (7, *rest)
    expected = np.zeros_like(found)
    for r in range(7):
        rows = np.flatnonzero(PATTERNS[:, r])
        for at in np.ndindex(*rest):
            if len(rows):
                mean = (H @ x[(slice(None), r, *at)] + [0.1, -0.2, 0.3])[rows]
                law = stats.multivariate_normal(mean, R[np.ix_(rows, rows)])
                expected[(r, *at)] = law.logpdf(z[rows, r])
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-12)
    assert (found[3] == 0).all()


@pytest.mark.parametrize(
    "noise",
    [StudentT(R, 4.0), GaussianMixture((0.4, 0.6), (Gaussian.noise(R), Gaussian.diagonal([9.0, 9.0, 9.0])))],
    ids=["student", "mixture"],
)
def test_missing_components_with_other_noises(noise):
    sensor = AdditiveSensor(Affine(H), noise)
    z, x = measured(), np.random.default_rng(1).standard_normal((2, 7, 6))
    found = sensor.logpdf(z, x, 1)
    for r in range(7):
        rows = tuple(np.flatnonzero(PATTERNS[:, r]).tolist())
        e = z[:, r, None] - H @ x[:, r]
        expected = noise.marginal(rows).logpdf(e[list(rows)]) if rows else np.zeros(6)
        np.testing.assert_allclose(found[r], expected, rtol=1e-12)


def test_a_run_gives_the_same_bits_whatever_its_neighbours_miss():
    sensor = AdditiveSensor(Affine(H), Gaussian.noise(R))
    z, x = measured(), np.random.default_rng(1).standard_normal((2, 7, 9))
    together = sensor.logpdf(z, x, 1)
    for r in range(7):
        np.testing.assert_array_equal(sensor.logpdf(z[:, r : r + 1], x[:, r : r + 1], 1)[0], together[r])


def test_outage_patterns_cover_every_run_once():
    groups = list(outage_patterns(measured()))
    assert sorted(r for _, runs in groups for r in runs) == list(range(7))
    assert len(groups) == len({rows for rows, _ in groups}) == 6
    for rows, runs in groups:
        for r in runs:
            assert rows == tuple(np.flatnonzero(PATTERNS[:, r]))


@settings(max_examples=300, deadline=None, derandomize=True)
@given(st.floats(-1e4, 1e4))
def test_wrap(angle):
    wrapped = float(wrap(np.array(angle)))
    assert -np.pi <= wrapped <= np.pi  # the ends differ by one rounding step only
    turns = (angle - wrapped) / (2 * np.pi)
    assert abs(turns - round(turns)) < 1e-11


def test_wrap_keeps_pi_and_turns_minus_pi():
    np.testing.assert_array_equal(wrap(np.array([np.pi, -np.pi, 0.0, 3 * np.pi, -3 * np.pi])), [np.pi, np.pi, 0, np.pi, np.pi])
    inside = np.linspace(-3.1415, 3.1415, 101)
    np.testing.assert_allclose(wrap(inside), inside, atol=1e-15)
    assert np.isnan(wrap(np.array(np.nan)))


def test_angles_wrap_in_residuals_samples_and_densities():
    sensor = AdditiveSensor(lambda x, k: np.stack([x[0], x[0]]), Gaussian.diagonal([0.01, 0.01]), angles=(1,))
    z, expected = np.array([[3.0], [3.0]]), np.array([[-3.0], [-3.0]])
    np.testing.assert_allclose(sensor.residual(z, expected), [[6.0], [6.0 - 2 * np.pi]])
    np.testing.assert_array_equal(z, 3.0)
    x = np.full((1, 50, 20), np.pi)
    y = sensor.sample(generators(50, "angles"), x, 1)
    assert (y[0] > np.pi).any()
    assert (np.abs(y[1]) <= np.pi).all()
    assert (y[1] > 3).any()
    assert (y[1] < -3).any()
    plain = AdditiveSensor(sensor.mean, sensor.noise).sample(generators(50, "angles"), x, 1)
    np.testing.assert_array_equal(y[0], plain[0])
    np.testing.assert_allclose(np.exp(1j * y[1]), np.exp(1j * plain[1]), atol=1e-14)
    one = AdditiveSensor(lambda x, k: x[:1], Gaussian.diagonal([0.04]), angles=(0,))
    density = one.logpdf(np.array([[np.pi - 0.05]]), np.array([[-np.pi + 0.1]]), 1)
    np.testing.assert_allclose(density, stats.norm.logpdf(0.15, 0, 0.2))


def test_measurements_follow_the_sensor():
    """The sample and the density are two views of one law: z-scores of samples are standard normal."""
    # 4000 samples of 3 components: 5 sigma of mean and covariance, 9 figures, false alarm below 1e-5.
    sensor = AdditiveSensor(Affine(H, np.array([1.0, 2.0, 3.0])), Gaussian([0.5, 0.0, -0.5], R))
    x = np.tile(np.array([1.0, -1.0])[:, None, None], (1, 40, 100))
    y = sensor.sample(generators(40, "follow"), x, 1).reshape(3, -1)
    e = y - (H @ [1.0, -1.0] + [1.5, 2.0, 2.5])[:, None]
    assert (np.abs(e.mean(1)) < 5 * np.sqrt(np.diag(R) / 4000)).all()
    assert (np.abs(e @ e.T / 4000 - R) < 5 * np.sqrt((np.outer(np.diag(R), np.diag(R)) + R**2) / 4000)).all()


def test_transition_moments_density_and_samples():
    A, gain = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[0.5], [1.0]])
    noise = Gaussian([0.2], [[4.0]])
    law = AdditiveTransition(Affine(A), noise, gain)
    np.testing.assert_allclose(law.noise_mean(1), [0.1, 0.2])
    np.testing.assert_allclose(law.noise_cov(1), 4 * gain @ gain.T)
    x = np.random.default_rng(0).standard_normal((2, 3, 4))
    step = law.sample(generators(3, "transition"), x, 1) - np.einsum("ij,jrn->irn", A, x)
    np.testing.assert_allclose(step[0], 0.5 * step[1], atol=1e-12)
    w = noise.sample(generators(3, "transition"), (3, 4))
    np.testing.assert_allclose(step[1], w[0], atol=1e-12)
    with pytest.raises(ValueError, match="gain"):
        law.logpdf(x, x, 1)
    full = AdditiveTransition(Affine(A), lambda k: Gaussian.diagonal([1.0 * k, 2.0 * k]))
    z = np.random.default_rng(1).standard_normal((2, 3, 4))
    expected = stats.multivariate_normal([0, 0], np.diag([3.0, 6.0])).logpdf((z - np.einsum("ij,jrn->irn", A, x)).T).T
    np.testing.assert_allclose(full.logpdf(z, x, 3), expected)
    np.testing.assert_allclose(full.noise_cov(3), np.diag([3.0, 6.0]))


def test_affine():
    fixed, moving = Affine(H, np.array([1.0, 2.0, 3.0])), Affine(lambda k: k * H)
    x = np.random.default_rng(0).standard_normal((2, 4, 5))
    np.testing.assert_allclose(fixed(x, 1), np.einsum("ij,jrn->irn", H, x) + np.array([1.0, 2.0, 3.0])[:, None, None])
    np.testing.assert_allclose(moving(x, 3), 3 * np.einsum("ij,jrn->irn", H, x))
    np.testing.assert_allclose(fixed(x[:, 0, 0], 1), H @ x[:, 0, 0] + [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(moving.matrix(2), 2 * H)


def test_jacobians_analytic_affine_and_derived():
    x = np.random.default_rng(0).uniform(0.5, 2, (2, 3, 4))
    affine = AdditiveSensor(Affine(H), Gaussian.noise(R)).jacobian(x, 1)
    assert affine.shape == (3, 2, 3, 4)
    np.testing.assert_array_equal(affine[..., 2, 3], H)
    curve = lambda x, k: np.stack([x[0] * x[1], np.sin(x[0]) * k, x[1] ** 3])  # noqa: E731
    slope = lambda x, k: np.stack(  # noqa: E731
        [np.stack([x[1], x[0]]), np.stack([np.cos(x[0]) * k, 0 * x[0]]), np.stack([0 * x[0], 3 * x[1] ** 2])]
    )
    derived = AdditiveSensor(curve, Gaussian.noise(R)).jacobian(x, 2)
    np.testing.assert_allclose(derived, slope(x, 2), rtol=1e-14)
    marked = AdditiveSensor(curve, Gaussian.noise(R), jacobian_of_mean=lambda x, k: np.full((3, 2, *x.shape[1:]), 7.0))
    assert (marked.jacobian(x, 1) == 7).all()


PRIOR = Gaussian(np.zeros(2), np.eye(2))
MOTION = AdditiveTransition(Affine(np.eye(2)), Gaussian.noise(np.eye(2)))
SENSOR = AdditiveSensor(Affine(H), Gaussian.noise(R))


def test_an_affine_function_inside_another_is_differentiated():
    x = np.random.default_rng(3).uniform(0.5, 2, (2, 3, 4))
    inner = Affine(H, np.array([1.0, 2.0, 3.0]))
    found = AdditiveSensor(lambda x, k: np.sin(inner(x, k)), Gaussian.noise(R)).jacobian(x, 1)
    np.testing.assert_allclose(found, np.cos(inner(x, 1))[:, None] * H[:, :, None, None], rtol=1e-13)


def curved(kind):
    """Functions of (a, b) that are not affine in b: in one component, for other values of a, or in both together."""
    extra = {
        "square": lambda a, b: b * b,
        "tiny square": lambda a, b: 1e-3 * b * b,
        "only away from the mean of a": lambda a, b: a * b * b,
        "kink": lambda a, b: np.maximum(b, 0.1),
    }[kind]
    return lambda x, k: np.stack([1e3 * np.sin(x[0]) * x[1], x[0] ** 2 + extra(x[0], x[1])])


@pytest.mark.parametrize("kind", ["square", "tiny square", "only away from the mean of a", "kink"])
def test_components_declared_linear_must_be(kind):
    sensor = AdditiveSensor(curved(kind), Gaussian.noise(np.eye(2)))
    motion = AdditiveTransition(curved(kind), Gaussian.noise(np.eye(2)))
    with pytest.raises(ValueError, match=r"StateSpaceModel\.linear is \(1,\), where AdditiveTransition\.mean is not affine"):
        StateSpaceModel(PRIOR, motion, SENSOR, linear=(1,))
    with pytest.raises(ValueError, match=r"AdditiveSensor\.mean is not affine"):
        StateSpaceModel(PRIOR, MOTION, sensor, linear=(1,))
    assert StateSpaceModel(PRIOR, motion, sensor).linear == ()
    product = AdditiveSensor(lambda x, k: np.stack([x[0] * x[1]]), Gaussian.noise([[1.0]]))
    assert StateSpaceModel(PRIOR, MOTION, product, linear=(0,)).linear == (0,)
    with pytest.raises(ValueError, match=r"AdditiveSensor\.mean is not affine"):
        StateSpaceModel(PRIOR, MOTION, product, linear=(0, 1))


@pytest.mark.parametrize("spread", [0.0, 1e-3, 1e4])
def test_what_is_linear_given_the_rest_may_be_declared(spread):
    """Also where the rest has a function that is undefined in places, or an angle that wraps."""
    prior = Gaussian([1e5, -30.0], spread**2 * np.eye(2))
    motion = AdditiveTransition(lambda x, k: np.stack([np.sqrt(x[0]) * x[1], x[1] + 1e6 * np.sin(x[0])]), MOTION.noise)
    turning = AdditiveSensor(lambda x, k: wrap(np.stack([3 * x[1] + x[0]])), Gaussian.noise([[1.0]]), angles=(0,))
    assert StateSpaceModel(prior, motion, turning, linear=(1,)).linear == (1,)


@pytest.mark.parametrize("linear", [(2,), (-1,), (0, 0), (1.0,), 1])
def test_linear_components_are_distinct_components_of_the_state(linear):
    with pytest.raises(ValueError, match=r"^StateSpaceModel\.linear must be distinct indices of 2 components"):
        StateSpaceModel(PRIOR, MOTION, SENSOR, linear=linear)


def test_dimensions_and_kind():
    model = StateSpaceModel(PRIOR, MOTION, SENSOR)
    assert (model.n, model.m) == (2, 3)
    assert is_linear_gaussian(model)
    gamma = AdditiveSensor(Affine(H), Gamma(np.ones(3), np.ones(3)))
    assert not is_linear_gaussian(StateSpaceModel(PRIOR, MOTION, gamma))
