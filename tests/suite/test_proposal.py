"""Proposals: weights against densities by brute force, draws against the optimal proposal, likelihoods by quadrature."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy import integrate, stats

from estimators import ESTIMATORS
from suite.estimator import StepError
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian, StudentT
from suite.proposal import accepts, from_transition, linearise, linearised
from tests.estimators.references import PARTICLE_FILTERS
from tests.oracles import generators, quadrature_of_transition, wavy_model

proposals = pytest.mark.parametrize("propose", [from_transition, linearised], ids=lambda p: p.__name__)


def covariance(rng, d):
    root = rng.standard_normal((d, d + 2))
    return root @ root.T / d


def random_model(seed, n, m, angles=()):
    """A random model, nonlinear in the transition and the sensor, with correlated noises; the noise depends on the time."""
    rng = np.random.default_rng(seed)
    A, B, H, C = (rng.standard_normal(shape) for shape in ((n, n), (n, n), (m, n), (m, n)))
    Q, R, stiff = covariance(rng, n), covariance(rng, m), 2.0 if angles else 0.0

    def drift(x, k):
        return np.stack([sum(A[i, j] * x[j] + 0.3 * np.sin(B[i, j] * x[j]) for j in range(n)) + 0.1 * k for i in range(n)])

    def look(x, k):
        rows = [sum(H[i, j] * x[j] + 0.5 * np.tanh(C[i, j] * x[j]) for j in range(n)) - 0.1 * k for i in range(m)]
        for i in angles:  # a bearing that jumps from pi to -pi near most particles
            rows[i] = np.atan2(rows[i], -stiff + 0.1 * x[0])
        return np.stack(rows)

    return StateSpaceModel(
        Gaussian(np.zeros(n), np.eye(n)),
        AdditiveTransition(drift, lambda k: Gaussian.noise(Q * k)),
        AdditiveSensor(look, Gaussian.noise(R), angles=angles),
    )


def differences(function, x):
    """Jacobian [m, n] at the point x[n], by central differences of fourth order."""
    step, unit = 1e-3, np.eye(len(x))
    return np.stack([
        (8 * (function(x + step * u) - function(x - step * u)) - (function(x + 2 * step * u) - function(x - 2 * step * u)))
        / (12 * step) for u in unit
    ], axis=1)  # fmt: skip


@dataclass(frozen=True)
class Point:
    """One particle's densities, by the textbook: with inverses, determinants and the rows that were observed."""

    model: StateSpaceModel
    origin: np.ndarray
    y: np.ndarray
    k: int

    @property
    def psi(self):
        return self.model.dynamics.mean(self.origin[:, None], self.k)[:, 0]

    def residual(self, x):
        sensor = self.model.sensor
        e = self.y - sensor.mean(x[:, None], self.k)[:, 0]
        for i in sensor.angles:
            e[i] = np.angle(np.exp(1j * e[i]))
        return e

    def optimal(self):
        """Mean and covariance of the posterior under the sensor that is linear about Psi."""
        rows, Q = np.isfinite(self.y), self.model.dynamics.noise_cov(self.k)
        H = differences(lambda x: self.model.sensor.mean(x[:, None], self.k)[:, 0], self.psi)[rows]
        R = self.model.sensor.noise.cov[np.ix_(rows, rows)]
        K = Q @ H.T @ np.linalg.inv(H @ Q @ H.T + R)
        return self.psi + K @ self.residual(self.psi)[rows], Q - K @ H @ Q

    def log_weight(self, x):
        """log p(y | x) + log N(x; Psi, Q) - log q(x)."""
        rows = np.isfinite(self.y)
        R = self.model.sensor.noise.cov[np.ix_(rows, rows)]
        mean, cov = self.optimal()
        loglik = stats.multivariate_normal(np.zeros(rows.sum()), R).logpdf(self.residual(x)[rows]) if rows.any() else 0.0
        step = stats.multivariate_normal(self.psi, self.model.dynamics.noise_cov(self.k)).logpdf(x)
        return loglik + step - stats.multivariate_normal(mean, (cov + cov.T) / 2).logpdf(x)


@pytest.mark.parametrize("k", [1, 4])
@pytest.mark.parametrize(
    ("n", "m", "angles"), [(1, 1, ()), (2, 1, ()), (3, 2, ()), (2, 4, ()), (5, 3, ()), (2, 2, (1,)), (4, 3, (0, 2))], ids=str
)
def test_weights_are_target_over_proposal(n, m, angles, k):
    rng, model = np.random.default_rng(1), random_model(10 * n + m, n, m, angles)
    runs, count = 4, 5
    origins = rng.standard_normal((n, runs, count))
    truth = model.dynamics.sample(generators(runs, "truth"), origins[..., 0], k)
    y = model.sensor.sample(generators(runs, "seen"), truth, k)
    y[rng.random(y.shape) < 0.3] = np.nan
    y[:, 0], y[:, 1] = 0.5, np.nan  # all seen in the first run, nothing in the second
    draws, fit, evidence = linearised(model, origins, y, k, generators(runs, n, m))
    assert draws.shape == origins.shape
    assert fit.shape == evidence.shape == (runs, count)
    far = draws + rng.standard_normal(draws.shape)
    far_fit = linearise(model, origins, y, k).fit(far)
    for r in range(runs):
        for i in range(count):
            point = Point(model, origins[:, r, i], y[:, r], k)
            expected = point.log_weight(draws[:, r, i])
            np.testing.assert_allclose(fit[r, i] + evidence[r, i], expected, rtol=1e-8, atol=1e-8)
            np.testing.assert_allclose(far_fit[r, i] + evidence[r, i], point.log_weight(far[:, r, i]), rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(fit[1], 0, atol=1e-12)
    np.testing.assert_allclose(evidence[1], 0, atol=1e-12)


def scores(draws, mean, cov):
    """How many standard errors the draws[n, N] are from normal ones with this mean and covariance, in each moment."""
    centred, count, variance = draws - mean[:, None], draws.shape[1], np.diag(cov)
    spread = (np.outer(variance, variance) + cov**2) / count
    second = np.matmul(centred, centred.T) / count - cov
    first = centred.mean(1) / np.sqrt(variance / count)
    return np.abs(np.concatenate([first, (second / np.sqrt(spread)).ravel()])).max()


@pytest.mark.parametrize(("n", "m", "angles"), [(1, 1, ()), (3, 2, ()), (2, 3, ()), (3, 2, (1,))], ids=str)
@pytest.mark.parametrize("missing", [False, True], ids=["seen", "missing"])
def test_draws_are_normal_with_the_moments_of_the_proposal(n, m, angles, missing):
    # 6 standard errors, at most 12 figures each: a false alarm has probability below 3e-8.
    model = random_model(7 * n + m, n, m, angles)
    origin = np.random.default_rng(2).standard_normal((n, 1))
    y = model.sensor.sample(generators(1, "y"), model.dynamics.mean(origin, 2), 2)
    if missing:
        y[-1] = np.nan
    draws, _, _ = linearised(model, np.repeat(origin[..., None], 100_000, axis=2), y, 2, generators(1, "draws", n, m))
    mean, cov = Point(model, origin[:, 0], y[:, 0], 2).optimal()
    assert scores(draws[:, 0], mean, cov) < 6
    white = np.linalg.solve(np.linalg.cholesky(cov), draws[:, 0] - mean[:, None])
    assert stats.kstest(white[-1], stats.norm.cdf).pvalue > 1e-9


@pytest.mark.parametrize("gain", [None, np.array([[0.5, 0.0], [1.0, 0.3], [0.0, -2.0]])], ids=["full", "singular"])
def test_a_linear_sensor_makes_the_proposal_optimal(gain):
    """The weights do not depend on the draws: each is p(y | x_{k-1}), in closed form."""
    rng = np.random.default_rng(5)
    noise, R, H = covariance(rng, 3 if gain is None else 2), covariance(rng, 2), rng.standard_normal((2, 3))
    model = random_model(1, 3, 2)
    model = replace(
        model,
        dynamics=AdditiveTransition(model.dynamics.mean, Gaussian.noise(noise), gain=gain),
        sensor=AdditiveSensor(Affine(H, np.array([0.5, -1.0])), Gaussian.noise(R)),
    )
    origins, y = rng.standard_normal((3, 2, 300)), rng.standard_normal((2, 2))
    draws, fit, evidence = linearised(model, origins, y, 1, generators(2, "linear"))
    np.testing.assert_allclose(fit, 0, atol=1e-9)
    psi, Q = model.dynamics.mean(origins, 1), model.dynamics.noise_cov(1)
    law = stats.multivariate_normal(np.zeros(2), H @ Q @ H.T + R)
    for r in range(2):
        error = y[:, r, None] - (H @ psi[:, r] + np.array([[0.5], [-1.0]]))
        np.testing.assert_allclose(evidence[r], law.logpdf(error.T), rtol=1e-9)
        np.testing.assert_allclose(linearise(model, origins, y, 1).fit(10 * draws)[r], 0, atol=1e-9)


def test_singular_process_noise_keeps_the_draws_on_their_plane():
    gain = np.array([[0.5], [1.0], [-2.0]])
    model = random_model(3, 3, 2)
    model = replace(model, dynamics=AdditiveTransition(model.dynamics.mean, Gaussian.noise([[0.4]]), gain=gain))
    origins, y = np.random.default_rng(0).standard_normal((3, 2, 50)), np.zeros((2, 2))
    draws, _, _ = linearised(model, origins, y, 1, generators(2, "plane"))
    moved = draws - model.dynamics.mean(origins, 1)
    np.testing.assert_allclose(moved, gain[:, :, None] * moved[:1] / 0.5, atol=1e-12)
    assert moved.std() > 0.01


@proposals
@pytest.mark.parametrize("gain", [None, np.array([[0.5], [1.0], [-0.7]])], ids=["scalar", "singular"])
def test_the_mean_weight_is_the_likelihood_of_the_parent(propose, gain):
    """E[exp(fit + evidence)] = p(y | x_{k-1}), by quadrature over the scalar noise."""
    # 5.5 standard errors of 200 000 draws, 3 runs: a false alarm has probability below 2e-7.
    model = wavy_model(gain)
    origins, y = np.full((model.n, 3, 1), 1.0), np.array([[0.2, -0.5, 2.5]])
    exact = quadrature_of_transition(model, origins[:, 0, 0], y[0], 1).likelihood
    draws, fit, evidence = propose(model, np.repeat(origins, 200_000, axis=2), y, 1, generators(3, "mean weight"))
    weight = np.exp(fit + evidence)
    assert (np.abs(weight.mean(1) - exact) < 5.5 * weight.std(1) / np.sqrt(200_000)).all()
    assert (weight.std(1) < 5 * exact).all()
    # The weighted draws have the moments of p(x_k | x_{k-1}, y_k) too, in the first component.
    share = weight / weight.sum(1, keepdims=True)
    posterior = quadrature_of_transition(model, origins[:, 0, 0], y[0], 1)
    error = draws[0] - posterior.mean[:, None]
    assert (np.abs((share * error).sum(1)) < 5.5 * np.sqrt((share**2 * error**2).sum(1))).all()


def test_the_quadrature_is_right_where_the_answer_is_known():
    model = wavy_model(None)
    likelihood = quadrature_of_transition(model, np.array([1.0]), np.array([0.2, 2.5]), 1).likelihood
    psi = float(model.dynamics.mean(np.array([[1.0]]), 1)[0, 0])

    def integrand(x, z):
        mean = float(model.sensor.mean(np.array([[x]]), 1)[0, 0])
        q, r = model.dynamics.noise_cov(1)[0, 0], model.sensor.noise.cov[0, 0]
        return stats.norm.pdf(x, psi, np.sqrt(q)) * stats.norm.pdf(z, mean, np.sqrt(r))

    for z, found in zip((0.2, 2.5), likelihood, strict=True):
        exact, _ = integrate.quad(integrand, psi - 12, psi + 12, args=(z,), epsabs=0, epsrel=1e-9, limit=500)
        assert found == pytest.approx(exact, rel=1e-7)


def test_draws_from_the_transition_fit_as_they_are_likely():
    model = random_model(4, 3, 2, (1,))
    origins, y = np.random.default_rng(0).standard_normal((3, 2, 20)), np.array([[0.3, np.nan], [3.1, -3.0]])
    draws, fit, evidence = from_transition(model, origins, y, 2, generators(2, "blind"))
    np.testing.assert_array_equal(draws, model.dynamics.sample(generators(2, "blind"), origins, 2))
    np.testing.assert_array_equal(evidence, np.zeros((2, 20)))
    for r in range(2):
        for i in range(20):
            rows = np.isfinite(y[:, r])
            error = Point(model, origins[:, r, i], y[:, r], 2).residual(draws[:, r, i])[rows]
            law = stats.multivariate_normal(np.zeros(rows.sum()), model.sensor.noise.cov[np.ix_(rows, rows)])
            np.testing.assert_allclose(fit[r, i], law.logpdf(error), rtol=1e-10)


@proposals
def test_a_run_has_the_same_bits_alone(propose):
    """Also beside runs with other outages, and one that is lost."""
    model = random_model(4, 3, 2, (1,))
    origins, y = np.random.default_rng(0).standard_normal((3, 5, 20)), np.random.default_rng(1).standard_normal((2, 5))
    y[0, 1] = y[1, 2] = y[0, 3] = y[1, 3] = np.nan
    origins[:, 4] = np.nan
    with np.errstate(invalid="ignore"):
        whole, rng = propose(model, origins, y, 2, generators(5, "bits")), generators(5, "bits")
    for r in range(4):
        alone = propose(model, origins[:, r : r + 1], y[:, r : r + 1], 2, rng.of([r]))
        for a, b in zip(alone, whole, strict=True):
            np.testing.assert_array_equal(a[..., 0, :], b[..., r, :])
    assert np.isnan(whole[1][4]).all()


def test_a_particle_is_not_disturbed_by_its_neighbours():
    model = random_model(4, 3, 2)
    origins, y = np.random.default_rng(0).standard_normal((3, 2, 20)), np.zeros((2, 2))
    good = linearised(model, origins, y, 1, generators(2, "neighbour"))
    spoilt = origins.copy()
    spoilt[:, 1, 7] = np.nan
    with np.errstate(invalid="ignore"):
        found = linearised(model, spoilt, y, 1, generators(2, "neighbour"))
    for a, b in zip(found, good, strict=True):
        differ = np.argwhere((np.atleast_3d(a) != np.atleast_3d(b)).reshape(-1, 2, 20).any(0))
        np.testing.assert_array_equal(differ, [[1, 7]])


def test_accepts_additive_gaussian_noises_of_mean_zero():
    model = random_model(1, 2, 2)
    dynamics, sensor = model.dynamics, model.sensor
    heavy, biased = StudentT(np.eye(2), 4.0), Gaussian(np.array([0.0, 0.1]), np.eye(2))
    assert accepts(model) is None
    assert accepts(replace(model, sensor=replace(sensor, angles=(1,)))) is None
    assert accepts(replace(model, dynamics=replace(dynamics, noise=Gaussian.noise([[1.0]]), gain=np.ones((2, 1))))) is None
    for noise in (heavy, biased, lambda k: heavy):
        assert accepts(replace(model, dynamics=replace(dynamics, noise=noise))) == (
            "its process noise is not Gaussian with mean zero"
        )
    for noise in (heavy, biased):
        assert accepts(replace(model, sensor=replace(sensor, noise=noise))) == (
            "its measurement noise is not Gaussian with mean zero"
        )

    class Other:
        dim = 2

    assert accepts(replace(model, dynamics=Other())) == "its process noise is not additive"
    assert accepts(replace(model, sensor=Other())) == "its measurement noise is not additive"


@pytest.mark.parametrize("later", [Gaussian([5.0], [[1.0]]), StudentT([[1.0]], 4.0)], ids=["mean", "tails"])
@pytest.mark.parametrize("name", ["guided", "isir", "progressive"])
def test_noise_that_is_another_from_the_second_step_on_is_named(name, later):
    dynamics = AdditiveTransition(Affine(np.eye(1)), lambda k: Gaussian.noise([[1.0]]) if k == 1 else later)
    model = StateSpaceModel(Gaussian.noise([[1.0]]), dynamics, AdditiveSensor(Affine(np.eye(1)), Gaussian.noise([[1.0]])))
    with pytest.raises(StepError, match="step 2: ValueError: the process noise of this step is not Gaussian with mean zero"):
        ESTIMATORS[name].run(model, np.zeros((3, 1, 2)), 1)


@pytest.mark.parametrize(
    ("look", "words"),
    [
        (lambda x, k: np.log1p(x * x), "no derivative is known for numpy.log1p"),
        (lambda x, k: x.sum(0)[None], "no derivative is known for the method sum of an array"),
        (lambda x, k: np.array([x[0]]), "no derivative is known where an array is filled by hand"),
    ],
    ids=["ufunc", "method", "array"],
)
def test_a_sensor_that_cannot_be_differentiated_is_refused(look, words):
    model = StateSpaceModel(
        Gaussian.noise([[1.0]]),
        AdditiveTransition(Affine(np.eye(1)), Gaussian.noise([[1.0]])),
        AdditiveSensor(look, Gaussian.noise([[1.0]])),
    )
    assert words in accepts(model)
    assert ESTIMATORS["bootstrap"].accepts(model) is None


@pytest.mark.parametrize("name", PARTICLE_FILTERS)
def test_measurements_without_a_likelihood_are_refused(name):
    model = StateSpaceModel(
        Gaussian.noise(np.eye(2)),
        AdditiveTransition(Affine(np.eye(2)), Gaussian.noise(np.eye(2))),
        AdditiveSensor(Affine(np.eye(2)), Gaussian.noise([[1.0, 1.0], [1.0, 1.0]])),
        linear=(1,),
    )
    assert "singular" in ESTIMATORS[name].accepts(model)
