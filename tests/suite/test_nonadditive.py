"""Noise inside functions: against additive noise, analytic moments, and an augmented filter written out by hand."""

import dataclasses

import numpy as np
import pytest

from estimators.bootstrap import Bootstrap
from estimators.ckf import Cubature
from estimators.ekf import Extended
from estimators.ghkf import GaussHermite
from estimators.iterated_ekf import IteratedExtended
from estimators.ukf import Unscented
from suite.case import draw
from suite.gaussian import GaussianBelief, predict, update
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.moment_rules import gauss_hermite, taylor, unscented
from suite.noise import Gaussian, StudentT
from suite.nonadditive import NonadditiveSensor, NonadditiveTransition
from suite.proposal import has_likelihood
from tests.oracles import from_west, generators, random_linear, range_bearing


def bend(x, k):
    return np.stack([x[0] + 0.1 * np.sin(x[1]), 0.9 * x[1] + 0.2 * np.cos(x[0] + 0.1 * k)])


def look(x, k):
    return np.stack([x[0] * x[0] + x[1], np.exp(0.2 * x[1])])


GAIN = np.array([[1.0, 0.2], [0.5, 1.0]])
CURVED = StateSpaceModel(
    Gaussian([1.0, -0.5], [[0.5, 0.1], [0.1, 0.3]]),
    AdditiveTransition(bend, Gaussian([0.3, 0.0], [[0.2, 0.05], [0.05, 0.1]]), gain=GAIN),
    AdditiveSensor(look, Gaussian([0.1, -0.2], [[0.5, 0.1], [0.1, 0.4]])),
)


def plain(matrix, x):
    """A matrix times x, as sums that can be differentiated."""
    return np.stack([sum(entry * part for entry, part in zip(row, x, strict=True)) for row in matrix.tolist()])


def plainly(mean):
    """The same function, and if it is affine so that it can be differentiated."""
    if not isinstance(mean, Affine):
        return mean
    offset = np.zeros(len(mean.matrix(1))) if mean.offset is None else mean.offset
    return lambda x, k: plain(mean.matrix(k), x) + offset.reshape(-1, *(1,) * (x.ndim - 1))


def wrapped(model, density=None):
    """The same model, its noises inside its functions."""
    dynamics, sensor = model.dynamics, model.sensor
    moved, seen = plainly(dynamics.mean), plainly(sensor.mean)
    gain = np.eye(model.n) if dynamics.gain is None else dynamics.gain
    return StateSpaceModel(
        model.prior,
        NonadditiveTransition(lambda x, w, k: moved(x, k) + plain(gain, w), dynamics.noise),
        NonadditiveSensor(lambda x, v, k: seen(x, k) + v, sensor.noise, model.m, sensor.angles, density),
    )


def with_gaps(y):
    y = y.copy()
    y[np.random.default_rng(0).random(y.shape) < 0.3] = np.nan
    y[3] = np.nan
    return y


def same(a, b, tolerance=1e-10):
    assert a.ok.all()
    assert b.ok.all()
    for name in ("mean", "cov", "loglik", "innovation"):
        expected = getattr(b, name)
        size = np.nanmax(np.abs(expected))
        np.testing.assert_allclose(getattr(a, name), expected, rtol=tolerance, atol=tolerance * size)


@pytest.mark.parametrize("gaps", [False, True], ids=["complete", "gaps"])
@pytest.mark.parametrize("filter", [Extended(), IteratedExtended(), GaussHermite(), GaussHermite(order=4)], ids=repr)
def test_noise_that_happens_to_be_added_changes_nothing(filter, gaps):
    y = draw(CURVED, 20, generators(3, "curved")).y
    y = with_gaps(y) if gaps else y
    same(filter.run(wrapped(CURVED), y), filter.run(CURVED, y))


@pytest.mark.parametrize("gaps", [False, True], ids=["complete", "gaps"])
@pytest.mark.parametrize(("alpha", "beta"), [(1.0, 2.0), (1.0, 0.0), (0.5, 1.0)])
def test_sigma_points_of_added_noise_reach_further(alpha, beta, gaps):
    """Two more dimensions take the points as far as kappa = 2 does; the moments are then the same. With (1, 0): cubature."""
    y = draw(CURVED, 20, generators(3, "curved")).y
    y = with_gaps(y) if gaps else y
    inside = Cubature() if (alpha, beta) == (1.0, 0.0) else Unscented(alpha, beta)
    same(inside.run(wrapped(CURVED), y), Unscented(alpha, beta, kappa=2.0).run(CURVED, y), 1e-9)


@pytest.mark.parametrize("filter", [Extended(), IteratedExtended(), GaussHermite(), Unscented(), Cubature()], ids=repr)
@pytest.mark.parametrize("shape", [(3, 2, 1), (2, 1, 2), (2, 3, 1)], ids=str)
def test_all_filters_agree_on_linear_models(filter, shape):
    """Where both functions are affine every rule is exact, whatever it is given beside the state."""
    model = random_linear(30 + sum(shape), *shape).model
    y = with_gaps(draw(model, 10, generators(3, "linear")).y)
    same(filter.run(wrapped(model), y), filter.run(model, y), 1e-9)


def test_noise_may_depend_on_time_and_have_heavy_tails():
    noise = lambda k: StudentT(np.diag([0.1, 0.2]) * k, 5.0)  # noqa: E731
    model = dataclasses.replace(CURVED, dynamics=AdditiveTransition(bend, noise, GAIN))
    y = draw(model, 6, generators(3, "tails")).y
    same(GaussHermite().run(wrapped(model), y), GaussHermite().run(model, y))


# y = x (1 + v) with x ~ N(m, P) and v ~ N(0, r): mean m, covariance with x of P, variance P + r m² + r P. A rule without a
# point off the axes of (x, v) cannot see the last term: the expansion has no second order, the unscented points no product.
M, P, R = 1.7, 0.6, 0.09
MULTIPLIED = NonadditiveSensor(lambda x, v, k: x * (1 + v), Gaussian.diagonal([R]), dim=1)
VARIANCES = [
    (gauss_hermite(2), P + R * M**2 + R * P),
    (gauss_hermite(5), P + R * M**2 + R * P),
    (unscented(1.0, 2.0, 0.0), P + R * M**2),
    (unscented(0.1, 2.0, 1.0), P + R * M**2),
    (taylor, P + R * M**2),
]


@pytest.mark.parametrize(("rule", "variance"), VARIANCES)
def test_moments_of_multiplied_noise(rule, variance):
    belief = GaussianBelief(np.array([[M]]), np.array([[[np.sqrt(P)]]]))
    found = update(rule, belief, MULTIPLIED, np.array([[3.0]]), 1)
    e = 3.0 - M
    np.testing.assert_allclose(found.mean[0, 0], M + P / variance * e, rtol=1e-10)
    np.testing.assert_allclose(found.cov[0, 0, 0], P - P**2 / variance, rtol=1e-10)
    np.testing.assert_allclose(found.loglik[0], -0.5 * (e**2 / variance + np.log(2 * np.pi * variance)), rtol=1e-10)
    np.testing.assert_allclose(found.innovation[0, 0], e / np.sqrt(variance), rtol=1e-10)
    moved = predict(rule, belief, NonadditiveTransition(MULTIPLIED.function, MULTIPLIED.noise), 1)
    np.testing.assert_allclose(moved.mean[0, 0], M, rtol=1e-10)
    np.testing.assert_allclose(moved.cov[0, 0, 0], variance, rtol=1e-10)


def swing(x, w, k):
    return np.stack([x[0] + 0.1 * x[1] * (1 + w[0]), 0.9 * x[1] - 0.5 * np.sin(x[0]) * np.exp(0.3 * w[0]) + 0.1 * k])


def glance(x, v, k):
    return np.stack([np.sin(x[0]) * (1 + v[0]) + v[1], x[1] + x[0] * v[0] * v[1], np.exp(0.2 * x[0] + v[1])])


SWING = StateSpaceModel(
    Gaussian([0.3, -0.5], [[0.5, 0.1], [0.1, 0.3]]),
    NonadditiveTransition(swing, Gaussian([0.1], [[0.2]])),
    NonadditiveSensor(glance, Gaussian([0.0, 0.2], [[0.3, 0.05], [0.05, 0.1]]), dim=3),
)


def augmented_unscented(mean, cov, noise, function, alpha, beta, kappa):
    """Mean, covariance, and covariance with the state, by the textbook's sigma points of state and noise stacked."""
    n, size = len(mean), len(mean) + len(noise.mean)
    whole = np.zeros((size, size))
    whole[:n, :n], whole[n:, n:] = cov, noise.cov
    lam = alpha**2 * (size + kappa) - size
    root, centre = np.linalg.cholesky((size + lam) * whole), np.concatenate([mean, noise.mean])
    points = np.column_stack([centre, centre[:, None] + root, centre[:, None] - root])
    wm = np.full(2 * size + 1, 0.5 / (size + lam))
    wc = wm.copy()
    wm[0], wc[0] = lam / (size + lam), lam / (size + lam) + 1 - alpha**2 + beta
    values = function(points[:n], points[n:])
    value = values @ wm
    away = values - value[:, None]
    return value, away * wc @ away.T, (points[:n] - mean[:, None]) * wc @ away.T


@pytest.mark.parametrize("spread", [(1.0, 2.0, 0.0), (0.5, 0.0, 1.0)], ids=str)
def test_equals_an_augmented_unscented_filter_written_out(spread):
    """Which draws its points anew after the prediction, and leaves out the rows that were not measured."""
    y = with_gaps(draw(SWING, 8, generators(2, "swing")).y)
    found = Unscented(*spread).run(SWING, y)
    for r in range(2):
        mean, cov = SWING.prior.mean, SWING.prior.cov
        for k in range(1, 9):
            mean, cov, _ = augmented_unscented(mean, cov, SWING.dynamics.noise, lambda x, w, k=k: swing(x, w, k), *spread)
            rows = np.flatnonzero(~np.isnan(y[k - 1, :, r]))
            if len(rows):
                value, S, C = augmented_unscented(
                    mean, cov, SWING.sensor.noise, lambda x, v, k=k, rows=rows: glance(x, v, k)[rows], *spread
                )
                K = np.linalg.solve(S, C.T).T
                mean, cov = mean + K @ (y[k - 1, rows, r] - value), cov - K @ S @ K.T
            np.testing.assert_allclose(found.mean[k - 1, :, r], mean, rtol=1e-9, atol=1e-10)
            np.testing.assert_allclose(found.cov[k - 1, :, :, r], cov, rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("filter", [Extended(), IteratedExtended(), GaussHermite(), Unscented(), Cubature()], ids=repr)
def test_bearings_wrap(filter):
    """Where angles are counted from must not matter: only one of the two sees a jump from pi to -pi."""
    east, west = wrapped(range_bearing()), wrapped(range_bearing(west=True))
    y = draw(east, 25, generators(4, "wrap")).y
    assert (np.abs(y[:, 1]) <= np.pi).all()
    assert (y[:, 1] > 3).any(axis=0).all()
    assert (y[:, 1] < -3).any(axis=0).all()
    same(filter.run(east, y), filter.run(west, from_west(y)), 1e-8)


def test_draws_are_the_function_of_state_and_noise():
    """The same numbers that the additive law adds, wrapped where they are angles."""
    model = range_bearing()
    x = np.random.default_rng(1).standard_normal((4, 3, 5)) + model.prior.mean[:, None, None] * [[[-1.0]]]
    for law, inside in ((model.dynamics, wrapped(model).dynamics), (model.sensor, wrapped(model).sensor)):
        drawn = inside.sample(generators(3, "draws"), x, 2)
        np.testing.assert_allclose(drawn, law.sample(generators(3, "draws"), x, 2), rtol=1e-12)
    scaled = SWING.dynamics.sample(generators(3, "scaled"), x[:2], 2)
    noise = SWING.dynamics.noise.sample(generators(3, "scaled"), (3, 5))
    np.testing.assert_array_equal(scaled, swing(x[:2], noise, 2))


def test_particle_filters_weigh_by_the_density_given():
    def density(z, x, k):
        return CURVED.sensor.logpdf(z, x, k)

    y = with_gaps(draw(CURVED, 8, generators(2, "density")).y)
    model = wrapped(CURVED, density)
    assert has_likelihood(model) is None
    assert Bootstrap(particles=200).accepts(model) is None
    found, expected = (Bootstrap(particles=200).run(each, y, 5) for each in (model, CURVED))
    np.testing.assert_allclose(found.loglik, expected.loglik, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.mean, expected.mean, rtol=1e-9, atol=1e-9)


def test_particle_filters_refuse_a_sensor_without_a_density():
    model = wrapped(CURVED)
    assert "no density unless one is given" in has_likelihood(model)
    assert "no likelihood" in Bootstrap().accepts(model)
    at = np.zeros((2, 1))
    for law in (model.dynamics, model.sensor):
        with pytest.raises(ValueError, match="no density unless one is given"):
            law.logpdf(at, at, 1)
    given = dataclasses.replace(model.dynamics, density=lambda z, x, k: k + (z - x).sum(0))
    assert given.logpdf(at + 2, at, 3) == 7
