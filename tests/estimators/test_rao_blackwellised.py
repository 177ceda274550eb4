"""The Rao-Blackwellised filter against enumeration, the Kalman filter and a grid; what it accepts.

Divided by the exact likelihood, the filter's likelihood times its weighted first and second moments has the exact moments
as its mean, for any number of particles (Del Moral, 2004, theorem 7.4.2). Tests of whole estimates use that: they have no
bias to allow for.
"""

import dataclasses
import itertools

import numpy as np
import pytest
from scipy import stats

from cases import CASES
from estimators.bootstrap import Bootstrap
from estimators.kalman import Kalman
from estimators.rao_blackwellised import RaoBlackwellised
from suite import pointwise
from suite.case import draw
from suite.estimator import LOST, StepError
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian, Independent, StudentT
from suite.particles import BLOCK
from suite.random import Streams
from tests.oracles import from_west, generators, random_linear, range_bearing

CORRELATED = np.array([[0.5, 0.3], [0.3, 0.6]])


@dataclasses.dataclass(frozen=True)
class Steps:
    """A step down, none, or a step up, on the integers."""

    probabilities: tuple[float, ...] = (0.3, 0.5, 0.2)

    @property
    def mean(self):
        return np.array([self.probabilities[2] - self.probabilities[0]])

    @property
    def cov(self):
        return np.array([[self.probabilities[2] + self.probabilities[0]]]) - self.mean**2

    def sample(self, rng, shape):
        return np.searchsorted(np.cumsum(self.probabilities)[:-1], rng.random((1, *shape)), side="right") - 1.0

    def marginal(self, rows):
        assert rows == (0,)
        return self


def turn(u, k):
    """A, b of z' = A z + b."""
    return 0.9 * np.array([[np.cos(u), np.sin(u)], [-np.sin(u), np.cos(u)]]), np.array([u, 0.2 * k])


def look(u):
    """C, c of y = C z + c."""
    return np.array([[1.0, 0.5 * u], [0.3 * u, 1.0]]), np.array([u, -1.0])


def walk():
    """State (u, z0, z1): u a random walk on the integers from zero, that turns z and weights what is seen of it."""

    def mean(x, k):
        u, a, b = x
        c, s = 0.9 * np.cos(u), 0.9 * np.sin(u)
        return np.stack([u, c * a + s * b + u, c * b - s * a + 0.2 * k])

    return StateSpaceModel(
        Gaussian([0.0, 1.0, -1.0], np.pad(CORRELATED, ((1, 0), (1, 0)))),
        AdditiveTransition(mean, Independent((Steps(), Gaussian([0.1, -0.2], 0.4 * CORRELATED)))),
        AdditiveSensor(
            lambda x, k: np.stack([x[1] + 0.5 * x[0] * x[2] + x[0], 0.3 * x[0] * x[1] + x[2] - 1.0]),
            Gaussian([0.3, 0.0], 2 * CORRELATED),
        ),
        linear=(1, 2),
    )


WALK_Y = np.array([[0.5, -1.0], [np.nan, 1.5], [np.nan, np.nan], [-0.5, np.nan], [1.5, 0.5]])


def enumerated():
    """Exact log-likelihoods [T], means [T, 3] and covariances [T, 3, 3] of the walk: a Kalman filter for each history of u."""
    paths = [(1.0, 0, np.array([1.0, -1.0]), CORRELATED)]
    before, exact = 0.0, []
    for k, y in enumerate(WALK_Y, start=1):
        seen, grown = ~np.isnan(y), []
        for (weight, u, m, P), (step, p) in itertools.product(paths, zip((-1, 0, 1), Steps().probabilities, strict=True)):
            A, b = turn(u, k)
            C, c = look(u + step)
            m1, P1 = A @ m + b + [0.1, -0.2], A @ P @ A.T + 0.4 * CORRELATED
            S = (C @ P1 @ C.T + 2 * CORRELATED)[np.ix_(seen, seen)]
            K, e = P1 @ C[seen].T @ np.linalg.inv(S), (y - C @ m1 - c - [0.3, 0.0])[seen]
            density = stats.multivariate_normal(cov=S).pdf(e) if seen.any() else 1.0
            grown.append((weight * p * density, u + step, m1 + K @ e, P1 - K @ C[seen] @ P1))
        paths = grown
        share = np.array([w for w, *_ in paths])
        state = np.array([[u, *m] for _, u, m, _ in paths])
        cov = np.average([np.pad(P, ((1, 0), (1, 0))) for *_, P in paths], axis=0, weights=share)
        mean = np.average(state, axis=0, weights=share)
        exact.append((np.log(share.sum()) - before, mean, cov + np.cov(state.T, aweights=share, ddof=0)))
        before = np.log(share.sum())
    return tuple(np.array(part) for part in zip(*exact, strict=True))


def scores(estimate, exact):
    """Likelihoods and moments of many runs of one problem against the exact ones, in standard errors."""
    loglik, mean, cov = exact
    ratio = np.exp(np.cumsum(estimate.loglik - loglik[:, None], axis=0))
    off = estimate.mean - mean[..., None]
    second = estimate.cov + off[:, :, None] * off[:, None]
    found = []
    for draws, expected in ((ratio, 1.0), (ratio[:, None] * off, 0.0), (ratio[:, None, None] * second, cov)):
        error = draws.std(-1, ddof=1) / np.sqrt(draws.shape[-1])
        found.append(((draws.mean(-1) - expected) / (error + 1e-10)).ravel())
    return np.concatenate(found)


def repeated(y, runs):
    """One run's measurements [T, m] in many runs: these differ by the filter's random numbers alone."""
    return np.repeat(y[:, :, None], runs, axis=2)


def exactly(model, y):
    """Log-likelihoods, means and covariances of the Kalman filter for one run's y[T, m]."""
    found = Kalman().run(model, y[:, :, None])
    return found.loglik[..., 0], found.mean[..., 0], found.cov[..., 0]


# In what follows, `scores` is held to 5.5 standard errors over 1500 runs and more; for at most 75 figures a false alarm has
# probability below 5e-6.


@pytest.mark.parametrize("threshold", [0.0, 0.5, 1.0])
def test_moments_and_likelihood_of_an_enumerable_model(threshold):
    estimate = RaoBlackwellised(particles=30, threshold=threshold).run(walk(), repeated(WALK_Y, 3000), 1)
    assert (estimate.ancestors.mean(1) < 29).any() == (threshold > 0)
    assert np.abs(scores(estimate, enumerated())).max() < 5.5


def test_error_falls_as_one_over_the_root_of_particles():
    # The logarithm of a root mean square over 400 runs has a standard deviation of at most about 0.04, the slope over four
    # points log 4 apart one of 0.013; the band is six of these: a false alarm has probability below 1e-8.
    _, exact, _ = enumerated()
    counts = [50, 200, 800, 3200]
    errors = []
    for count in counts:
        estimate = RaoBlackwellised(particles=count, threshold=1.0).run(walk(), repeated(WALK_Y[:2], 400), 2)
        errors.append(np.sqrt(((estimate.mean[1] - exact[1][:, None]) ** 2).mean()))
    assert -0.58 < np.polyfit(np.log(counts), np.log(errors), 1)[0] < -0.42


@pytest.mark.parametrize(
    ("linear", "rank", "dirac"),
    [((2, 0), 4, False), ((1, 3), 4, True), ((3,), 4, False), ((0, 1, 2), 4, False), ((0, 2), 1, False), ((1, 0), 1, True)],
    ids=str,
)
def test_linear_models_with_correlated_noises_agree_with_the_kalman_filter(linear, rank, dirac):
    """Everything drives everything, also through noise of rank 1, also from a known state."""
    problem = random_linear(6, 4, 2, rank, dirac)
    y = problem.simulate(steps=4, runs=1, seed=8)[1][:, :, 0]
    y[1, 0] = y[2] = np.nan
    model = dataclasses.replace(problem.model, linear=linear)
    estimate = RaoBlackwellised(particles=60).run(model, repeated(y, 2000), 3)
    ratio = np.exp((estimate.loglik - exactly(model, y)[0][:, None]).sum(0))
    assert ratio.std() < 5
    assert np.abs(scores(estimate, exactly(model, y))).max() < 5.5


def test_constant_velocity_with_sampled_positions_agrees_with_the_kalman_filter():
    model = CASES["linear-gaussian"].model
    y = draw(model, 5, generators(1, "velocity")).y[:, :, 0]
    estimate = RaoBlackwellised(particles=100).run(model, repeated(y, 2000), 4)
    assert np.abs(scores(estimate, exactly(model, y))).max() < 5.5


def test_a_curved_model_that_is_linear_in_one_component_agrees_with_a_grid():
    """z drives u through a slope that depends on u, their noises are correlated, and y is the product of both."""
    cov = np.array([[0.6, 0.25], [0.25, 0.5]])

    def mean(x, k):
        u, z = x
        return np.stack([u / (1 + u * u) + np.cos(u) * z, np.sin(u) + 0.7 * z])

    model = StateSpaceModel(
        Gaussian([0.5, 0.0], [[0.6, 0.2], [0.2, 0.7]]),
        AdditiveTransition(mean, Gaussian.noise(cov)),
        AdditiveSensor(lambda x, k: np.stack([x[0] * x[1]]), Gaussian.noise([[0.8]])),
        linear=(1,),
    )
    y = np.array([0.5, np.nan, -1.0])
    axis = np.linspace(-7.2, 7.2, 37)  # 0.6 standard deviations apart: the sum is exact to far below 1e-6
    at = np.stack(np.meshgrid(axis, axis, indexing="ij")).reshape(2, -1)
    kernel = stats.multivariate_normal(cov=cov).pdf(np.moveaxis(at[:, :, None] - mean(at, 1)[:, None], 0, -1))
    density, exact = stats.multivariate_normal(model.prior.mean, model.prior.cov).pdf(at.T), []
    for z in y:
        density = kernel @ (density / density.sum()) * (axis[1] - axis[0]) ** 2
        density = density if np.isnan(z) else density * stats.norm.pdf(z, at[0] * at[1], np.sqrt(0.8))
        exact.append((np.log(density.sum()), np.average(at, axis=1, weights=density), np.cov(at, aweights=density, ddof=0)))
    estimate = RaoBlackwellised(particles=100).run(model, repeated(y[:, None], 1500), 5)
    assert np.abs(scores(estimate, tuple(np.array(part) for part in zip(*exact, strict=True)))).max() < 5.5


def test_with_all_components_linear_every_particle_is_the_kalman_filter():
    problem = random_linear(7, 3, 2, 2)
    y = problem.simulate(steps=20, runs=3, seed=1)[1]
    y[4:6], y[8, 0] = np.nan, np.nan
    exact = Kalman().run(problem.model, y)
    estimate = RaoBlackwellised(particles=3).run(dataclasses.replace(problem.model, linear=(1, 0, 2)), y, 1)
    for part in ("mean", "cov", "loglik"):
        np.testing.assert_allclose(getattr(estimate, part), getattr(exact, part), rtol=1e-10, atol=1e-10, err_msg=part)
    np.testing.assert_allclose(estimate.ess, 3, rtol=1e-12)


def test_with_a_known_path_every_particle_is_the_kalman_filter():
    """u counts 0, 1, 2, ...: then z has a Kalman filter with matrices that are known in advance."""
    A, C = (lambda k: turn(k - 1.0, 0)[0]), (lambda k: look(float(k))[0])
    known = StateSpaceModel(
        Gaussian([1.0, -1.0], CORRELATED),
        AdditiveTransition(Affine(A), Gaussian.noise(0.3 * CORRELATED)),
        AdditiveSensor(Affine(C), Gaussian.noise(CORRELATED)),
    )

    def mean(x, k):
        a, u, b = x
        c, s = 0.9 * np.cos(u), 0.9 * np.sin(u)
        return np.stack([c * a + s * b, u + 1, c * b - s * a])

    among = np.ix_([0, 2], [0, 2])
    prior, noise = np.zeros((3, 3)), np.zeros((3, 3))
    prior[among], noise[among] = CORRELATED, 0.3 * CORRELATED
    counting = StateSpaceModel(
        Gaussian([1.0, 0.0, -1.0], prior),
        AdditiveTransition(mean, Gaussian.noise(noise)),
        AdditiveSensor(lambda x, k: np.stack([x[0] + 0.5 * x[1] * x[2], 0.3 * x[1] * x[0] + x[2]]), Gaussian.noise(CORRELATED)),
        linear=(0, 2),
    )
    y = draw(known, 15, generators(3, "known")).y
    y[3, 1], y[7] = np.nan, np.nan
    exact, estimate = Kalman().run(known, y), RaoBlackwellised(particles=5).run(counting, y, 1)
    np.testing.assert_allclose(estimate.mean[:, [0, 2]], exact.mean, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(estimate.cov[:, [[0], [2]], [0, 2]], exact.cov, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(estimate.loglik, exact.loglik, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(estimate.mean[:, 1], np.arange(1, 16)[:, None] * np.ones(3), rtol=1e-12)


def test_integrating_out_what_is_seen_sharply_takes_most_of_the_variance():
    """Mean square error of the mean, and variance of the likelihood ratio, over 500 runs of 100 particles each way."""
    # Both are about a tenth or less of the bootstrap's; a ratio of two variances of 500 draws is off by a factor of 2 with
    # probability far below 1e-8, also for tails twice as heavy as normal ones.
    model = StateSpaceModel(
        Gaussian([0.0, 0.0], np.diag([1.0, 4.0])),
        AdditiveTransition(Affine([[1.0, 0.5], [0.0, 0.9]]), Gaussian.diagonal([0.2, 1.0])),
        AdditiveSensor(Affine(np.eye(2)), Gaussian.diagonal([1.0, 0.04])),
        linear=(1,),
    )
    y = draw(model, 5, generators(1, "variance")).y[:, :, 0]
    loglik, mean, _ = exactly(model, y)
    errors, variances = [], []
    for estimator in (RaoBlackwellised(particles=100, threshold=1.0), Bootstrap(particles=100)):
        estimate = estimator.run(model, repeated(y, 500), 6)
        errors.append(((estimate.mean - mean[..., None]) ** 2).mean())
        variances.append(np.exp((estimate.loglik - loglik[:, None]).sum(0)).var())
    assert errors[0] < 0.3 * errors[1]
    assert variances[0] < 0.3 * variances[1]


def test_bearings_wrap():
    east, west = (dataclasses.replace(range_bearing(side), linear=(1, 3)) for side in (False, True))
    truth = draw(east, 25, generators(4, "wrap"))
    a = RaoBlackwellised(particles=500).run(east, truth.y, 3)
    b = RaoBlackwellised(particles=500).run(west, from_west(truth.y), 3)
    np.testing.assert_allclose(a.mean, b.mean, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(a.loglik, b.loglik, rtol=1e-7)
    assert np.abs(a.mean - truth.x)[:, [0, 2]].max() < 100


@pytest.mark.parametrize("bad", [1e200, -1e200, np.inf])
@pytest.mark.parametrize("name", ["linear-gaussian", "multistatic-radar/phlab"])
def test_an_impossible_measurement_loses_that_run_alone(name, bad):
    case = CASES[name]
    y = case.simulate(4).y[:15].copy()
    clean = RaoBlackwellised(particles=50).run(case.model, y, 1)
    y[10, 0, 2] = bad
    estimate = RaoBlackwellised(particles=50).run(case.model, y, 1)
    assert list(estimate.status) == ["ok", "ok", LOST, "ok"]
    assert estimate.reason[2] == "step 11: the measurement has zero likelihood"
    for part in ("mean", "cov", "loglik", "ess", "ancestors"):
        a, b = getattr(estimate, part), getattr(clean, part)
        np.testing.assert_array_equal(a[..., [0, 1, 3]], b[..., [0, 1, 3]])
        np.testing.assert_array_equal(a[:10, ..., 2], b[:10, ..., 2])
        assert np.isnan(a[10:, ..., 2]).all()


def test_a_lost_run_among_heavy_tailed_noise_is_lost_alone():
    """State (h, g, z): z drives g, g drives h, and h has heavy tails; a lost run has NaN in all three."""
    model = StateSpaceModel(
        Gaussian(np.zeros(3), np.eye(3)),
        AdditiveTransition(
            lambda x, k: np.stack([np.sin(x[0] * x[1]), x[1] + x[2], 0.9 * x[2]]),
            Independent((StudentT([[1.0]], 4.0), Gaussian.noise(CORRELATED))),
        ),
        AdditiveSensor(lambda x, k: np.stack([x[0] + x[2]]), Gaussian.noise([[1.0]])),
        linear=(2,),
    )
    y = draw(model, 8, generators(3, "heavy")).y
    clean = RaoBlackwellised(particles=50).run(model, y, 1)
    y[2, 0, 1] = np.inf
    estimate = RaoBlackwellised(particles=50).run(model, y, 1)
    assert list(estimate.status) == ["ok", LOST, "ok"]
    np.testing.assert_array_equal(estimate.mean[..., [0, 2]], clean.mean[..., [0, 2]])


def test_a_component_with_heavy_tails_that_turns_out_to_depend_on_a_linear_one_is_an_error():
    model = StateSpaceModel(
        Gaussian(np.zeros(2), np.eye(2)),
        AdditiveTransition(
            lambda x, k: np.stack([x[0] * x[1], x[1]]), Independent((StudentT([[1.0]], 4.0), Gaussian.noise([[1.0]])))
        ),
        AdditiveSensor(lambda x, k: x[:1], Gaussian.noise([[1.0]])),
        linear=(1,),
    )
    assert RaoBlackwellised().accepts(model) is None  # at the prior mean there is nothing to see
    with pytest.raises(StepError, match=r"step 1: .* must not depend on linear ones"):
        RaoBlackwellised(particles=5).run(model, np.zeros((2, 1, 1)), 1)


@pytest.mark.parametrize("count", [BLOCK // 2 - 1, BLOCK + 5])
def test_groups_of_runs_do_not_show(count):
    y = repeated(WALK_Y, 3)
    y[1, 1, 0] = y[4, 0, 1] = np.nan
    estimator = RaoBlackwellised(particles=count)
    together = estimator.run(walk(), y, Streams(("groups",)))
    for r in range(3):
        alone = estimator.run(walk(), y[:, :, r : r + 1], Streams(("groups",), r))
        for part in ("mean", "cov", "loglik", "ess", "ancestors"):
            np.testing.assert_array_equal(getattr(together, part)[..., r], getattr(alone, part)[..., 0])


def test_elimination_is_the_start_of_a_cholesky_factor_and_a_schur_complement():
    root = np.random.default_rng(0).standard_normal((5, 5, 2, 3))
    cov = np.einsum("ij...,kj...->ik...", root, root)
    found = cov.copy()
    pointwise.eliminate(found, 3)
    for at in np.ndindex(2, 3):
        one, P = found[(..., *at)], cov[(..., *at)]
        np.testing.assert_allclose(np.tril(one)[:, :3], np.linalg.cholesky(P)[:, :3], rtol=1e-9)
        rest = P[3:, 3:] - P[3:, :3] @ np.linalg.solve(P[:3, :3], P[:3, 3:])
        np.testing.assert_allclose(np.tril(one[3:, 3:]), np.tril(rest), rtol=1e-7, atol=1e-9)


def test_elimination_of_a_singular_covariance():
    """Where a component is known given those before it, it tells nothing more of those behind it."""
    root = np.random.default_rng(1).standard_normal((4, 2))
    root[1] = 3 * root[0]
    singular = (root @ root.T)[..., None]
    broken = np.full_like(singular, np.nan)
    found = np.concatenate([singular, broken], axis=-1)
    with np.errstate(invalid="ignore"):
        pointwise.eliminate(found, 2)
    assert (found[1:, 1, 0] == 0).all()
    rest = root[2:] - np.outer(root[2:] @ root[0], root[0]) / (root[0] @ root[0])
    np.testing.assert_allclose(np.tril(found[2:, 2:, 0]), np.tril(rest @ rest.T), atol=1e-12)
    assert np.isnan(found[..., 1][np.tril_indices(4)]).all()


def changed(dynamics=None, sensor=None, linear=None):
    """The walk with other parts."""
    new = {"dynamics": dynamics, "sensor": sensor, "linear": linear}
    return dataclasses.replace(walk(), **{name: part for name, part in new.items() if part is not None})


STILL = Affine(np.eye(3))
DRIVEN = Affine(np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]))
NOISE = Independent((Steps(), Gaussian.noise(CORRELATED)))


class Other:
    """A law that is no sum of a mean and a noise."""

    dim = 2


@pytest.mark.parametrize(
    ("model", "reason"),
    [
        (walk(), None),
        (changed(linear=()), "no component of its state is declared conditionally linear"),
        (changed(dynamics=Other()), "its process noise is not additive"),
        (changed(sensor=Other()), "its measurement noise is not additive"),
        (changed(sensor=AdditiveSensor(walk().sensor.mean, StudentT(np.eye(2), 3.0))), "its measurement noise is not Gaussian"),
        (
            changed(sensor=AdditiveSensor(walk().sensor.mean, Gaussian.noise(np.ones((2, 2))))),
            "the covariance of its measurement noise is singular",
        ),
        (
            changed(dynamics=AdditiveTransition(STILL, NOISE, gain=np.eye(3))),
            "its process noise enters through a gain and is not Gaussian",
        ),
        (changed(dynamics=AdditiveTransition(STILL, Gaussian.diagonal([1, 1]), gain=np.eye(3)[:, :2])), None),
        (
            changed(dynamics=AdditiveTransition(STILL, NOISE), linear=(0,)),
            "the process noise of its linear components is not Gaussian",
        ),
        (
            changed(dynamics=AdditiveTransition(STILL, StudentT(np.eye(3), 3.0))),
            "the process noise of its linear components is not Gaussian",
        ),
        (
            changed(dynamics=AdditiveTransition(DRIVEN, NOISE)),
            "its linear components drive one whose process noise is not Gaussian",
        ),
        (changed(dynamics=AdditiveTransition(DRIVEN, Gaussian.noise(np.eye(3)))), None),
    ],
)
def test_what_it_accepts(model, reason):
    assert RaoBlackwellised().accepts(model) == reason


def test_a_particle_of_weight_zero_costs_nothing():
    """A sensor that is no number for negative u leaves the linear part of such a particle without one, too."""

    def look(x, k):
        return np.stack([np.sqrt(x[0]) * x[1], x[0]])

    model = StateSpaceModel(
        Gaussian([1.0, 2.0], np.eye(2)),
        AdditiveTransition(Affine(np.eye(2)), Gaussian.diagonal([0.3, 0.1])),
        AdditiveSensor(look, Gaussian.diagonal([0.1, 0.5])),
        linear=(1,),
    )
    assert RaoBlackwellised().run(model, np.tile([[1.9], [1.1]], (4, 1, 2)), 1).ok.all()


@pytest.mark.parametrize("variance", [1e-6, 1e6])
def test_many_measurements_neither_overflow_nor_vanish(variance):
    sensor = AdditiveSensor(Affine(np.ones((60, 2))), Gaussian.diagonal([variance] * 60))
    dynamics = AdditiveTransition(Affine(np.eye(2)), Gaussian.diagonal([0.1, 0.1]))
    model = StateSpaceModel(Gaussian.noise(np.eye(2)), dynamics, sensor, linear=(0, 1))
    y = np.zeros((2, 60, 1))
    exact = Kalman().run(model, y)
    np.testing.assert_allclose(RaoBlackwellised(particles=3).run(model, y).loglik, exact.loglik, rtol=1e-6)
