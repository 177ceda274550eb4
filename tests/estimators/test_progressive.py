"""The progressive-proposal filter: exact weights against brute force and quadrature, the optimal proposal on linear sensors."""

import numpy as np
import pytest
from scipy import stats

from cases import CASES
from estimators.bootstrap import Bootstrap
from estimators.kalman import Kalman
from estimators.progressive import Progressive
from suite import pointwise
from suite.errors import BadInput
from suite.estimator import LOST
from suite.flow import Control, Standard, propose
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian, StudentT
from suite.random import Streams
from tests.oracles import from_west, generators, grid_filter, random_linear, range_bearing

SENSORS = {
    "square": lambda x, k: x * x / 4,
    "wave": lambda x, k: x + np.sin(2 * x) / 3,
    "exponential": lambda x, k: np.exp(x / 2),
    "saturated": lambda x, k: 3 * np.atan2(x, 1 + 0 * x),
}


def scalar(sensor, q=1.3, r=0.4):
    """A random walk of one component, seen through a curved sensor."""
    return StateSpaceModel(
        Gaussian([0.0], [[1.0]]),
        AdditiveTransition(Affine([[1.0]]), Gaussian.diagonal([q * q])),
        AdditiveSensor(sensor, Gaussian.diagonal([r * r])),
    )


def proposed(model, parent, y, runs, count, control, *key):
    """Draws [n, R, N] and log-weights [R, N] of particles that share one parent[n] and y[m]."""
    x = np.broadcast_to(np.asarray(parent, float)[:, None, None], (model.n, runs, count)).copy()
    with np.errstate(all="ignore"):
        drawn, fit, evidence = propose(
            model, x, np.repeat(np.asarray(y, float)[:, None], runs, 1), 1, generators(runs, *key), control
        )
    return drawn, fit + evidence


def agrees(found, expected, sigmas=5.0):
    """Whether averages of independent runs found[R] are the expected number, within so many standard errors."""
    return abs(found.mean() - expected) < sigmas * found.std(ddof=1) / np.sqrt(len(found))


def test_the_volume_is_that_of_the_whole_map():
    def look(x, k):
        return np.stack([np.sqrt(x[0] ** 2 + x[1] ** 2), np.atan2(x[1], x[0]), x[2] * x[0] + 0.3 * x[1] * x[1]])

    rng = np.random.default_rng(1)
    root = rng.standard_normal((3, 3))
    sensor = AdditiveSensor(look, Gaussian.noise(root @ root.T), angles=(1,))
    predicted = rng.standard_normal((3, 2, 6)) + np.array([3, 2, 1.0])[:, None, None]
    y = rng.standard_normal((3, 2)) + np.array([3, 0.5, 4])[:, None]
    whiten = np.linalg.inv(np.linalg.cholesky(root @ root.T))[:2, :2]
    step = Standard(sensor, 1, (0, 1), rng.standard_normal((3, 3)), whiten, predicted, y)
    z = rng.standard_normal((3, 2, 6))
    for start, end in [(0, 0.03), (0, 0.3), (0.2, 0.5), (0.5, 1)]:
        start, end = np.array([[start], [start / 2]]), np.array([[end], [end]])

        def move(z, start=start, end=end):
            at = step.tangent(z)
            return pointwise.times(at.axes, at.flow(start, end))

        shifts = 1e-5 * np.eye(3)[:, :, None, None]
        jacobian = np.stack([(move(z + d) - move(z - d)) / 2e-5 for d in shifts], axis=1)
        sign, expected = np.linalg.slogdet(np.moveaxis(jacobian, (0, 1), (-2, -1)))
        with np.errstate(all="ignore"):
            found = step.log_volume(z, step.tangent(z), start, end)
        assert (sign > 0).sum() > 6
        np.testing.assert_array_equal(np.isnan(found), sign < 0)
        np.testing.assert_allclose(found[sign > 0], expected[sign > 0], atol=1e-6)


@pytest.mark.parametrize("gamma", [0.0, 0.3, 20.0])
@pytest.mark.parametrize("q", [4, 2])
def test_on_a_linear_sensor_it_is_the_optimal_proposal(q, gamma):
    p = random_linear(5, 4, 2, q)
    model = StateSpaceModel(
        p.model.prior,
        AdditiveTransition(Affine(p.A, p.a), Gaussian.noise(p.Q), gain=p.G),
        AdditiveSensor(Affine(p.H, p.h), Gaussian.noise(p.R)),
    )
    parent, y = np.arange(4.0), np.array([3.0, -1.0])
    runs, count = 40, 250
    drawn, logw = proposed(model, parent, y, runs, count, Control(gamma, 1e-3, 1e-3, 500), "linear")
    cov = p.G @ p.Q @ p.G.T
    center = p.A @ parent + p.a
    innovation = p.H @ cov @ p.H.T + p.R
    evidence = stats.multivariate_normal(p.H @ center + p.h, innovation).logpdf(y)
    np.testing.assert_allclose(logw, evidence, atol=1e-9)
    gain = np.linalg.solve(innovation, p.H @ cov).T
    mean, spread = center + gain @ (y - p.h - p.H @ center), cov - gain @ p.H @ cov
    for i in range(4):  # a false alarm in any of 14 figures has a probability below 1e-4, and the seed is fixed
        assert agrees(drawn[i].mean(1), mean[i])
        for j in range(i + 1):
            assert agrees(((drawn[i] - mean[i]) * (drawn[j] - mean[j])).mean(1), spread[i, j])


@pytest.mark.parametrize("gamma", [0.0, 0.3, 20.0])
@pytest.mark.parametrize("sensor", SENSORS)
def test_weights_average_to_the_evidence_and_give_the_posterior_mean(sensor, gamma):
    # 72 figures, band of 5 standard errors of 100 runs (Student): a false alarm has probability below 2e-4; seeds are fixed.
    model = scalar(SENSORS[sensor])
    for parent, y in [(1.0, 2.5), (1.0, 0.2), (-2.0, 1.5)]:
        x = np.linspace(parent - 14, parent + 14, 20_001)
        density = stats.norm.pdf(x, parent, 1.3) * stats.norm.pdf(y, SENSORS[sensor](x, 1), 0.4) * (x[1] - x[0])
        drawn, logw = proposed(model, [parent], [y], 100, 100, Control(gamma, 0.1, 1e-3, 50), sensor, int(10 * y))
        weight = np.exp(logw)
        assert agrees(weight.mean(1), density.sum())
        assert agrees((weight * (drawn[0] - parent)).mean(1), ((x - parent) * density).sum())


@pytest.mark.parametrize("gamma", [0.0, 2.0])
def test_weights_are_exact_in_the_plane_where_angles_wrap(gamma):
    # Two states seen by range and bearing beside the cut of the bearing; 6 figures, band of 5 standard errors of 100 runs.
    def look(x, k):
        return np.stack([np.sqrt(x[0] * x[0] + x[1] * x[1]), np.atan2(x[1], x[0])])

    cov = np.array([[1.0, 0.5], [0.5, 2.0]])
    sensor = AdditiveSensor(look, Gaussian.diagonal([0.2**2, 0.15**2]), angles=(1,))
    model = StateSpaceModel(Gaussian.noise(cov), AdditiveTransition(Affine(np.eye(2)), Gaussian.noise(cov)), sensor)
    parent, y = np.array([-5.0, 0.5]), np.array([5.5, -3.1])
    axis = np.linspace(-9, 9, 1201)
    grid = np.stack(np.meshgrid(axis, axis, indexing="ij"))
    distance, bearing = look(grid, 1)
    density = stats.multivariate_normal(parent, cov).pdf(np.moveaxis(grid, 0, -1)) * (axis[1] - axis[0]) ** 2
    density *= stats.norm.pdf(y[0], distance, 0.2) * stats.norm.pdf(np.angle(np.exp(1j * (y[1] - bearing))), 0, 0.15)
    drawn, logw = proposed(model, parent, y, 100, 100, Control(gamma, 0.1, 1e-3, 50), "plane")
    weight = np.exp(logw)
    assert agrees(weight.mean(1), density.sum())
    for i in range(2):
        assert agrees((weight * (drawn[i] - parent[i])).mean(1), ((grid[i] - parent[i]) * density).sum())
    assert (weight.sum(1) ** 2 / (weight**2).sum(1)).mean() > 70


@pytest.mark.parametrize("steps", [1, 2, 5, 50])
def test_a_step_that_folds_space_is_never_taken(steps):
    model = scalar(SENSORS["saturated"])
    assert np.isfinite(proposed(model, [1.0], [0.2], 4, 200, Control(0.0, 1e9, 1e-3, steps), "fold")[1]).all()


@pytest.mark.parametrize("steps", [1, 2, 5, 50])
def test_weights_hold_where_the_tries_run_out(steps):
    # Between two far modes the flow folds; wherever it stops the mean weight is p(y). 40 runs of 1000, band of 5 standard
    # errors (Student): a false alarm has probability below 2e-5 each.
    sensor = AdditiveSensor(lambda x, k: x * x / 20, Gaussian.noise([[0.1]]))
    model = StateSpaceModel(Gaussian.noise([[0.0]]), AdditiveTransition(Affine([[1.0]]), Gaussian.noise([[10.0]])), sensor)
    x = np.linspace(-30, 30, 60_001)
    exact = np.trapezoid(stats.norm.pdf(x, 0, np.sqrt(10)) * stats.norm.pdf(-0.5, x * x / 20, np.sqrt(0.1)), x)
    found = np.exp(Progressive(particles=1000, steps=steps).run(model, np.full((1, 1, 40), -0.5), 3).loglik[0]) / exact
    assert abs(found.mean() - 1) < 5 * found.std(ddof=1) / np.sqrt(40)


@pytest.mark.parametrize("gamma", [0.0, 1.0])
def test_it_agrees_with_a_grid_filter(gamma):
    # 3 steps x 3 figures, band of 5 standard errors of 24 runs (Student): a false alarm has probability below 2e-3; the
    # bias of means and variances is of order 1/N and below a tenth of the band.
    model = scalar(SENSORS["square"])
    y = np.array([1.0, 2.0, 0.5])
    grid = np.linspace(-15, 15, 1501)
    exact = grid_filter(grid, stats.norm.pdf(grid), lambda x, k: x, 1.3, lambda z, x: stats.norm.pdf(z, x * x / 4, 0.4), y)
    estimate = Progressive(particles=1000, gamma=gamma).run(model, np.repeat(y[:, None, None], 24, axis=2), 2)
    for found, expected in zip((estimate.mean[:, 0], estimate.cov[:, 0, 0], estimate.loglik), exact, strict=True):
        assert (np.abs(found.mean(-1) - expected) < 5 * found.std(-1, ddof=1) / np.sqrt(24)).all()


def test_it_agrees_with_the_kalman_filter_and_bridges_gaps():
    p = random_linear(9, 3, 2, 3)
    model = StateSpaceModel(
        p.model.prior,
        AdditiveTransition(Affine(p.A, p.a), Gaussian.noise(p.Q), gain=p.G),
        AdditiveSensor(Affine(p.H, p.h), Gaussian.noise(p.R)),
    )
    y = np.repeat(p.simulate(5, 1, seed=3)[1], 40, axis=2)
    y[1, 0] = np.nan
    y[2] = np.nan
    exact = Kalman().run(model, y[:, :, :1])
    estimate = Progressive(particles=300).run(model, y, 1)
    np.testing.assert_allclose(estimate.loglik[2], 0, atol=1e-12)
    for step in (0, 1, 3, 4):  # 4 x 4 figures, band of 5 standard errors of 40 runs; bias of order 1/N
        assert agrees(estimate.loglik[step], exact.loglik[step, 0])
        for i in range(3):
            assert agrees(estimate.mean[step, i], exact.mean[step, i, 0])


def test_it_uses_its_particles_better_than_the_bootstrap_filter_where_measurements_are_sharp():
    model = scalar(SENSORS["exponential"], r=0.02)
    y = np.exp(np.array([0.3, 0.6, 0.9, 0.5]) / 2)[:, None, None]
    flow, blind = Progressive(particles=200).run(model, y), Bootstrap(particles=200).run(model, y)
    assert flow.ok.all()
    assert (flow.ess > 5 * blind.ess).all()
    assert (flow.ess > 100).all()


def test_bearings_wrap():
    y = np.stack([np.array([[1000.0 - 2 * k], [np.pi - 0.02 * (k % 2)]]) for k in range(6)])
    y[:, 1] = np.angle(np.exp(1j * (y[:, 1] + 0.01)))
    east, west = (
        Progressive(particles=50).run(m, z, 3) for m, z in ((range_bearing(), y), (range_bearing(True), from_west(y)))
    )
    assert east.ok.all()
    np.testing.assert_allclose(east.mean, west.mean, rtol=1e-6, atol=1e-5)


def test_runs_that_take_other_steps_do_not_show():
    model, y = scalar(SENSORS["saturated"], r=0.05), np.array([[2.5, 0.2, -4.0, 1.5], [2.0, -0.3, 1.0, np.nan]])[:, None]
    estimator = Progressive(particles=30, gamma=1.0)
    together = estimator.run(model, y, Streams(("steps",)))
    for r in range(4):
        alone = estimator.run(model, y[..., r : r + 1], Streams(("steps",), r))
        for name in ("mean", "cov", "loglik", "ess"):
            np.testing.assert_array_equal(getattr(alone, name)[..., 0], getattr(together, name)[..., r])


@pytest.mark.parametrize("bad", [1e200, np.inf])
def test_an_impossible_measurement_loses_that_run_alone_and_neighbours_do_not_show(bad):
    case = CASES["multistatic-radar/phlab"]
    y = case.simulate(3).y[99:102].copy()  # the last step is within an outage
    y[0, :2, 1] = np.nan
    estimator = Progressive(particles=10, gamma=0.5, steps=8)
    clean = estimator.run(case.model, y, Streams(("alone",)))
    y[1, 0, 2] = bad
    together = estimator.run(case.model, y, Streams(("alone",)))
    assert list(together.status) == ["ok", "ok", LOST]
    for name in ("mean", "cov", "loglik", "ess"):
        np.testing.assert_array_equal(getattr(together, name)[..., :2], getattr(clean, name)[..., :2])
        for r in range(2):
            alone = estimator.run(case.model, y[..., r : r + 1], Streams(("alone",), r))
            np.testing.assert_array_equal(getattr(alone, name)[..., 0], getattr(together, name)[..., r])


def test_it_refuses_what_is_not_additive_and_gaussian():
    model = scalar(SENSORS["square"])
    heavy = StateSpaceModel(model.prior, model.dynamics, AdditiveSensor(SENSORS["square"], StudentT([[1.0]], 3.0)))
    assert Progressive().accepts(model) is None
    assert Progressive().accepts(heavy) == "its measurement noise is not Gaussian with mean zero"
    for wrong in ({"gamma": -1.0}, {"tolerance": 0.0}, {"first": 0.0}, {"first": 2.0}, {"steps": 0}):
        with pytest.raises(BadInput):
            Progressive(**wrong)


def test_many_components_are_refused_for_their_cost():
    filters = Progressive()
    assert filters.accepts(CASES["high-dimensional/10"].model) is None
    assert "cost too much" in filters.accepts(CASES["high-dimensional/20"].model)
