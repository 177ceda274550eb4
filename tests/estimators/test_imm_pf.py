"""Interacting multiple model particle filters against what many particles become: IMMs, on a grid and by Kalman filters, and
the exact posterior."""

import dataclasses
import functools

import numpy as np
import pytest

from estimators.imm import InteractingExtended
from estimators.imm_aupf import InteractingUniformResampling
from estimators.imm_pf import InteractingParticles
from estimators.imm_regularized import InteractingRegularized
from estimators.uniform_resampling import UniformResampling
from suite import particles
from suite.jump import JumpModel
from suite.kernel import bandwidth
from suite.linalg import Array
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gamma, Gaussian
from suite.problems import PROBLEMS
from tests.estimators.references import normal, repeated, scores, unbiased
from tests.estimators.test_uniform_resampling import FRACTION, mixed
from tests.jump_oracles import THREE, TWO, JumpLinear, enumeration
from tests.oracles import generators

FILTERS = (InteractingParticles, InteractingUniformResampling, InteractingRegularized)
LIKELIHOODS = pytest.mark.parametrize("likelihood", ["gaussian", "particles"])
BOXES = pytest.mark.parametrize("box", ["kept", "survivors", "deviations"])
MODELS = pytest.mark.parametrize("p", [TWO, THREE], ids=["two", "three"])


def measured(p: JumpLinear, steps: int) -> Array:
    """Measurements of one run, one of which is missing, another in part."""
    y = p.simulate(steps, 1, seed=5)[1]
    y[1], y[3, 0] = np.nan, np.nan
    return y


@LIKELIHOODS
@MODELS
def test_with_linear_modes_it_becomes_the_interacting_kalman_filters(p, likelihood):
    # Means over 60 runs of 1500 particles, whose bias of order 1/N is below the standard error. 5 steps x 9 figures in 5
    # tests: 7 standard errors of Student's t with 59 degrees of freedom are passed with probability below 1e-6.
    y = measured(p, 5)
    exact = InteractingExtended().run(p.model, y)
    found = InteractingParticles(1500, likelihood).run(p.model, repeated(y, 60), 1)
    for name in ("mean", "cov", "loglik", "mode"):
        worst = np.abs(scores(getattr(found, name), getattr(exact, name)[..., 0])).max()
        assert worst < 7, name


def curved(prior: Gaussian, push: float) -> JumpModel:
    """Three scalar modes that differ in motion and sensor, one of which never stays."""

    def look(x, k):
        return x + 0.8 * np.sin(x)  # monotone: what is likely is an interval, and so is what is kept

    first = StateSpaceModel(
        Gaussian([1.0], [[2.0]]),
        AdditiveTransition(lambda x, k: 0.7 * x + 2 * np.sin(x), Gaussian.noise([[1.0]])),
        AdditiveSensor(look, Gaussian([0.2], [[6.0]])),
    )
    second = dataclasses.replace(first, prior=prior, dynamics=AdditiveTransition(Affine([[0.9]]), Gaussian([push], [[2.0]])))
    third = dataclasses.replace(second, sensor=AdditiveSensor(look, Gaussian.noise([[9.0]])))
    law = np.array([[0.8, 0.2, 0.0], [0.3, 0.5, 0.2], [0.5, 0.5, 0.0]])
    return JumpModel((first, second, third), law, np.array([0.6, 0.4, 0.0]))


APART = curved(Gaussian([-1.0], [[0.5]]), -3.0), np.array([4.0, -2.0, 3.0, -1.0])[:, None, None]
"""Modes that mix to anything but a Gaussian, and measurements."""
ALIKE = curved(Gaussian([2.0], [[1.0]]), 0.3), np.array([2.7, 2.5, 2.4, 2.3])[:, None, None]
"""Modes and measurements that make both ends of all boxes lie among many particles."""
GRID = np.linspace(-13, 13, 1301)


@functools.cache
def ahead(mode: StateSpaceModel) -> Array:
    """Density [G, G] of the next state given the last, under constant laws."""
    dynamics = mode.dynamics
    return normal(GRID[:, None] - dynamics.mean(GRID[None], 1)[0] - dynamics.noise.mean, dynamics.noise.cov[0, 0])


def interacting(model: JumpModel, y: Array, likelihood: str, between=None, matched: bool = True):
    """Means, variances, log-likelihoods [T] and mode probabilities [T, M] of an IMM with densities on a grid.

    Modes mix as Gaussians of the same moments where `matched`, otherwise as they are, which is exact. between: the density
    that a mode goes on from where that is not its posterior, as in `on_a_grid`.
    """
    step, p, found = GRID[1] - GRID[0], model.initial, []
    after = [normal(GRID - mode.prior.mean, mode.prior.cov[0, 0]) for mode in model.modes]
    for z in y[:, 0, 0]:
        c = p @ model.transition
        before, after, fits = after, [], []
        for j, mode in enumerate(model.modes):
            start = (model.transition[:, j] * p / c[j]) @ np.stack(before)
            if matched:
                start = normal(GRID - moments(start)[0], moments(start)[1])
            predicted = ahead(mode) @ start * step
            expected = mode.sensor.mean(GRID[None], 1)[0] + mode.sensor.noise.mean
            density = normal(z - expected, mode.sensor.noise.cov[0, 0])
            evidence = predicted @ density * step
            posterior = predicted * density / evidence
            after.append(between(predicted[:, None], density[:, None], posterior[:, None])[:, 0] if between else posterior)
            centre, size = moments(predicted, expected)
            fits.append(evidence if likelihood == "particles" else normal(z - centre, size + mode.sensor.noise.cov[0, 0]))
        p = c * fits / (c @ fits)
        found.append((*moments(p @ np.stack(after)), np.log(c @ fits), p))
    means, variances, logliks, probabilities = (np.stack(part) for part in zip(*found, strict=True))
    return means, variances, logliks, probabilities


def moments(density: Array, values: Array = GRID) -> tuple[float, float]:
    """Mean and variance of a function of the state."""
    share = density * (GRID[1] - GRID[0])
    mean = values @ share
    return mean, (values - mean) ** 2 @ share


def worst(found, exact):
    """The largest of the scores of an estimate of a scalar model."""
    figures = (found.mean[:, 0], found.cov[:, 0, 0], found.loglik, found.mode)
    return max(np.abs(scores(a, b)).max() for a, b in zip(figures, exact, strict=True))


@LIKELIHOODS
@pytest.mark.parametrize("threshold", [0.0, 1.0])
def test_with_curved_modes_it_becomes_the_interacting_filters_on_a_grid(threshold, likelihood):
    # As above: 4 steps x 6 figures in 4 tests.
    found = InteractingParticles(1500, likelihood, threshold, "stratified").run(APART[0], repeated(APART[1], 60), 2)
    assert worst(found, interacting(*APART, likelihood)) < 7
    # It becomes neither the one with the other likelihood, nor the exact posterior.
    other = {"gaussian": "particles", "particles": "gaussian"}[likelihood]
    assert worst(found, interacting(*APART, other)) > 20
    assert worst(found, interacting(*APART, "particles", matched=False)) > 20


@pytest.mark.parametrize(("box", "likelihood"), [("kept", "gaussian"), ("survivors", "particles"), ("deviations", "gaussian")])
def test_with_uniform_resampling_it_becomes_filters_on_a_grid_that_do_the_same(box, likelihood):
    # As above: 4 steps x 6 figures in 3 tests.
    model, y = ALIKE
    even = InteractingUniformResampling(1500, likelihood, resampling="stratified", fraction=FRACTION, box=box)
    found = even.run(model, repeated(y, 60), 3)
    assert worst(found, interacting(model, y, likelihood, mixed(GRID, box))) < 7
    assert worst(found, interacting(model, y, likelihood)) > 20


@BOXES
def test_uniform_resampling_in_a_mode_is_that_of_the_filter_of_a_single_model(box):
    settings = {"particles": 200, "fraction": 0.8, "box": box, "resampling": "residual"}
    rng = generators(2, "cloud")
    cloud = particles.weighted(rng.standard_normal((3, 2, 200)), rng.standard_normal((1, 2, 200))[0], particles.all_of(2, 200))
    single, rng = UniformResampling(**settings), generators(2, "resampled")
    start = particles.resample(cloud, single.survivors, 1.0, rng)
    filled = single.filled(cloud, start, rng)
    found = InteractingUniformResampling(**settings).resampled(cloud, generators(2, "resampled"))
    np.testing.assert_array_equal(found.x, filled)
    np.testing.assert_array_equal(found.logw, start.logw)
    assert not (found.x == start.x)[:, :, 160:].any()


@BOXES
@pytest.mark.parametrize("settings", [{"fraction": 1.0}, {"threshold": 0.0}])
def test_with_nothing_drawn_anew_it_is_the_filter_without_uniform_resampling(settings, box):
    y = repeated(measured(THREE, 6), 4)
    mine = InteractingUniformResampling(80, box=box, **settings).run(THREE.model, y, 1)
    theirs = InteractingParticles(80, threshold=settings.get("threshold", 1.0)).run(THREE.model, y, 1)
    for part in ("mean", "cov", "loglik", "ess", "mode"):
        a, b = getattr(mine, part), getattr(theirs, part)
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9 * np.abs(b).max())


ONE = JumpLinear(TWO.modes[:1], np.ones((1, 1)), np.ones(1))


@pytest.mark.parametrize("resampling", ["systematic", "multinomial"])
@pytest.mark.parametrize("p", [ONE, TWO, THREE], ids=["one", "two", "three"])
def test_drawing_from_all_clouds_is_unbiased_at_any_number_of_particles(p, resampling):
    # 5 steps x up to 9 figures in 6 tests, over 2500 runs: 6 standard errors are passed with probability below 1e-6.
    y = measured(p, 5)
    exact = enumeration(p, y)
    found = InteractingRegularized(40, kernel=0.0, resampling=resampling).run(p.model, repeated(y, 2500), 4)
    figures = unbiased(found, exact.mean[..., 0], exact.cov[..., 0], exact.loglik[:, 0])
    ratio = np.exp(np.cumsum(found.loglik - exact.loglik, axis=0))
    probabilities = scores(ratio[:, None] * (found.mode - exact.mode), 0.0)
    assert np.abs(figures).max() < 6
    assert np.abs(probabilities).max() < 6
    assert ratio.std(1).min() > 0.01  # there is something to average


def test_drawing_from_all_clouds_becomes_the_exact_posterior():
    # As for the others: 4 steps x 6 figures.
    exact = interacting(*APART, "particles", matched=False)
    found = InteractingRegularized(2000, kernel=0.0).run(APART[0], repeated(APART[1], 60), 5)
    assert worst(found, exact) < 7
    # Its error falls as the square root: over 4 means of 60 runs a factor 4 is known to a standard error of some 10 %.
    fewer = InteractingRegularized(125, kernel=0.0).run(APART[0], repeated(APART[1], 60), 6)
    error = [np.sqrt(np.mean((each.mean[:, 0] - exact[0][:, None]) ** 2)) for each in (fewer, found)]
    assert 2.2 < error[0] / error[1] < 7.2


def test_the_kernel_widens_each_cloud_by_its_own_covariance():
    # 3 covariances of 200,000 draws: 6 standard errors (below 1e-8), where fourth moments are at most a normal law's.
    count, rng = 200_000, generators(2, "kernel")
    x = np.array([[2.0], [50.0]])[:, :, None] * rng.standard_normal((2, 2, count))
    logw = np.stack([-0.5 * x[0, 0], np.zeros(count)])
    cloud = particles.weighted(x, logw, particles.all_of(2, count))
    root = np.linalg.cholesky(np.moveaxis(cloud.moments[1], -1, 0))
    plain, moved = (InteractingRegularized(count, w).regularised(cloud, root, generators(2, "moves")) for w in (0.0, 3.0))
    move = moved - plain
    np.testing.assert_array_equal(move[:, 1], 0.0)  # equal weights are not resampled
    expected = (3 * bandwidth(2, count)) ** 2 / 6 * cloud.moments[1][..., 0]
    error = np.sqrt((expected**2 + np.outer(np.diag(expected), np.diag(expected))) / count)
    assert (np.abs(np.cov(move[:, 0]) - expected) < 6 * error).all()


def test_by_default_the_kernel_is_there_and_widens_the_posterior():
    y = repeated(measured(TWO, 5), 60)
    wide, exact = InteractingRegularized(100).run(TWO.model, y, 1), InteractingRegularized(100, kernel=0.0).run(TWO.model, y, 1)
    assert wide.cov[-1, 0, 0].mean() > 1.05 * exact.cov[-1, 0, 0].mean()


@pytest.mark.parametrize("kind", FILTERS)
def test_a_mode_that_cannot_be_reached_has_no_part_in_anything(kind):
    closed = dataclasses.replace(TWO, P=np.eye(2), p0=np.array([1.0, 0.0]))
    far = dataclasses.replace(closed, modes=(TWO.modes[0], dataclasses.replace(TWO.modes[1], w=np.array([1e200]))))
    y = repeated(measured(TWO, 5), 3)
    found, other = kind(50).run(closed.model, y, 1), kind(50).run(far.model, y, 1)
    np.testing.assert_array_equal(found.mode, np.broadcast_to([[1.0], [0.0]], found.mode.shape))
    for part in ("mean", "cov", "loglik", "ess", "statistic"):
        assert np.isfinite(getattr(found, part)).all()
        np.testing.assert_array_equal(getattr(found, part), getattr(other, part))


def one_sided() -> JumpModel:
    """Two modes, one of which pushes the state up by 1000, under noise that is never negative."""
    still = StateSpaceModel(
        Gaussian([0.0], [[1.0]]),
        AdditiveTransition(Affine([[1.0]]), Gaussian.noise([[1.0]])),
        AdditiveSensor(Affine([[1.0]]), Gamma([20.0], [1.0])),
    )
    pushed = dataclasses.replace(
        still, dynamics=AdditiveTransition(Affine([[1.0]], np.array([1000.0])), Gaussian.noise([[1.0]]))
    )
    return JumpModel((still, pushed), np.array([[0.9, 0.1], [0.1, 0.9]]), np.array([0.5, 0.5]))


@pytest.mark.parametrize(
    "kind", [*FILTERS, lambda n: InteractingParticles(n, "particles"), lambda n: InteractingUniformResampling(n, "particles")]
)
def test_a_mode_whose_particles_are_all_impossible_comes_back_from_the_others(kind):
    y = np.array([[20.0, 20.0, 1020.0, -500.0], [1020.0, 20.0, 1020.0, 20.0], [1020.0, 1020.0, 1020.0, 20.0]])[:, None]
    found = kind(100).run(one_sided(), y, 1)
    assert found.status == ["ok", "ok", "ok", "lost"]
    assert "step 1" in found.reason[3]
    assert "zero likelihood" in found.reason[3]
    np.testing.assert_array_equal(found.mode[:2, 1, :2], [[0, 0], [1, 0]])
    assert (found.mode[2, :, :2] > [[0.999, -1], [-1, 0.999]]).all()
    np.testing.assert_allclose(found.mean[:, 0, :3], y[:, 0, :3] - 20, atol=10)
    assert np.isfinite(found.statistic[:, :3]).all()


@pytest.mark.parametrize("kind", FILTERS)
def test_without_a_measurement_modes_follow_their_chain_and_weights_stay_equal(kind):
    found = kind(64).run(THREE.model, np.full((4, 2, 3), np.nan), 1)
    for k in range(4):
        chain = THREE.p0 @ np.linalg.matrix_power(THREE.P, k + 1)
        np.testing.assert_allclose(found.mode[k], np.tile(chain[:, None], 3), rtol=1e-12)
    np.testing.assert_allclose(found.loglik, 0.0, atol=1e-12)
    np.testing.assert_allclose(found.ess, 64)


@pytest.mark.parametrize("kind", FILTERS)
def test_a_run_of_very_many_particles_has_the_same_bits_alone(kind):
    y = repeated(measured(TWO, 4)[2:], 2) + np.array([0.0, 0.5])
    assert particles.BLOCK < 33_000
    both, alone = kind(33_000).run(TWO.model, y, 1), kind(33_000).run(TWO.model, y[..., :1], 1)
    for part in ("mean", "cov", "loglik", "ess", "mode", "statistic"):
        np.testing.assert_array_equal(getattr(both, part)[..., :1], getattr(alone, part))


def test_a_gaussian_likelihood_needs_an_additive_sensor():
    models = {case.name.removeprefix("check/"): case.model for case in PROBLEMS}
    spread = JumpModel((models["spread"],), np.ones((1, 1)), np.ones(1), names=("wide",))
    assert InteractingParticles().accepts(spread) == "wide: its measurement noise is not additive"
    assert InteractingParticles(likelihood="particles").accepts(spread) is None
    assert InteractingRegularized().accepts(spread) is None
    blind = JumpModel((models["nonadditive"],), np.ones((1, 1)), np.ones(1))
    for kind in FILTERS:
        assert "single mode" in kind().accepts(models["linear"])
        assert kind().accepts(blind) is not None
