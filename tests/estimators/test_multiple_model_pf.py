"""The multiple-model particle filter against exact answers: enumeration of mode sequences, a grid over mode and state."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

from estimators.multiple_model_pf import MultipleModelParticleFilter
from suite.jump import JumpModel, simulated
from suite.model import AdditiveSensor, AdditiveTransition, StateSpaceModel
from suite.modes import LARGEST
from suite.noise import Gaussian
from tests.estimators.references import repeated, scores, unbiased
from tests.jump_oracles import THREE, TWO, JumpLinear, enumeration
from tests.oracles import filterpy_kalman, generators, joint_loglik

BAND = 6.0
"""Standard errors. All tests of this file together look at fewer than 300 figures, each the mean of thousands of draws: a false
alarm has probability below 1e-6."""


def unbiased_modes(estimate, mode, loglik):
    """Standard scores [T, M] of Z'/Z (mode' - mode), whose expectation is zero for the reason that `unbiased` gives."""
    ratio = np.exp(np.cumsum(estimate.loglik - loglik[:, None], axis=0))
    return scores(ratio[:, None] * (estimate.mode - mode[:, :, None]), 0.0)


def assert_unbiased(estimate, mean, cov, loglik, mode):
    assert np.abs(unbiased(estimate, mean, cov, loglik)).max() < BAND
    assert np.abs(unbiased_modes(estimate, mode, loglik)).max() < BAND


def with_gaps(problem, seed):
    _, y, _ = problem.simulate(steps=5, runs=1, seed=seed)
    y[1] = np.nan
    y[3, 1] = np.nan  # one of two sensors
    return y


@pytest.mark.parametrize("problem", [TWO, THREE], ids=["two", "three"])
@pytest.mark.parametrize("settings", [{}, {"threshold": 1.0, "resampling": "multinomial"}], ids=["default", "always"])
def test_figures_are_unbiased_on_linear_modes(problem, settings):
    y = with_gaps(problem, seed=3)
    exact = enumeration(problem, y)
    estimate = MultipleModelParticleFilter(particles=60, **settings).run(problem.model, repeated(y, 3000), 4)
    assert_unbiased(estimate, *(part[..., 0] for part in (exact.mean, exact.cov, exact.loglik, exact.mode)))


def test_it_resamples_when_few_particles_are_effective():
    """A run that was not resampled has as many ancestors as particles; one that was has fewer."""
    y = THREE.simulate(steps=10, runs=20, seed=2)[1]
    for threshold in (0.3, 0.7):
        estimate = MultipleModelParticleFilter(particles=80, threshold=threshold).run(THREE.model, y, 2)
        low = estimate.ess[:-1] < threshold * 80
        np.testing.assert_array_equal(estimate.ancestors[1:] < 80, low)
        assert 0 < low.mean() < 1


def test_error_falls_as_one_over_the_root_of_particles():
    # The logarithm of a root mean square over 200 runs has a standard deviation below 0.07 also where the runs' errors have
    # heavier tails than normal ones; the slope over a factor of 64, in four points, one below 0.07 / (log 4 · sqrt 5) = 0.023.
    y = TWO.simulate(steps=5, runs=1, seed=8)[1]
    exact = enumeration(TWO, y)
    counts, errors = [50, 200, 800, 3200], []
    for count in counts:
        estimate = MultipleModelParticleFilter(particles=count).run(TWO.model, repeated(y, 200), 2)
        state = (estimate.mean[-1] - exact.mean[-1]) / np.sqrt(np.diag(exact.cov[-1, :, :, 0]))[:, None]
        errors.append([np.sqrt((state**2).mean()), np.sqrt(((estimate.mode[-1] - exact.mode[-1]) ** 2).mean())])
    slopes = np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert (np.abs(slopes + 0.5) < 0.14).all()


def drift(side):
    return lambda x, k: 0.7 * x + side * (1 + 2 * np.sin(x)) + 0.5 * np.cos(k)


CURVED = tuple(
    StateSpaceModel(
        Gaussian([start], [[2.0]]),
        AdditiveTransition(drift(side), Gaussian.noise([[q]])),
        AdditiveSensor(lambda x, k: np.sqrt(1 + x * x), Gaussian.noise([[r]])),
    )
    for side, start, q, r in ((0.0, 0.5, 0.5, 1.0), (1.0, -1.0, 1.0, 2.0))
)


def grid_over_modes(model, grid, y):
    """Means [T, 1], variances [T, 1, 1], log-likelihoods [T] and mode probabilities [T, M] of a scalar jump model, y[T]."""
    dx = grid[1] - grid[0]
    density = np.stack(
        [
            p * stats.norm.pdf(grid, m.prior.mean[0], m.prior.cov[0, 0] ** 0.5)
            for p, m in zip(model.initial, model.modes, strict=True)
        ]
    )
    found = []
    for k, z in enumerate(y, start=1):
        ahead = []
        for j, m in enumerate(model.modes):
            kernel = stats.norm.pdf(grid[:, None], m.dynamics.mean(grid[None], k)[0], m.dynamics.noise.cov[0, 0] ** 0.5)
            likelihood = (
                1.0 if np.isnan(z) else stats.norm.pdf(z, m.sensor.mean(grid[None], k)[0], m.sensor.noise.cov[0, 0] ** 0.5)
            )
            ahead.append(kernel @ (model.transition[:, j] @ density) * dx * likelihood)
        density = np.stack(ahead)
        evidence = density.sum() * dx
        density /= evidence
        total = density.sum(0) * dx
        mean = grid @ total
        found.append((np.array([mean]), np.array([[(grid - mean) ** 2 @ total]]), np.log(evidence), density.sum(1) * dx))
    return tuple(np.stack(part) for part in zip(*found, strict=True))


def test_figures_are_unbiased_on_curved_modes():
    model = JumpModel(CURVED, [[0.8, 0.2], [0.4, 0.6]], [0.7, 0.3])
    y = simulated(model, 5, generators(1, "curved"))[1]
    y[2] = np.nan
    exact = grid_over_modes(model, np.linspace(-25, 25, 1001), y[:, 0, 0])
    estimate = MultipleModelParticleFilter(particles=60).run(model, repeated(y, 3000), 7)
    assert_unbiased(estimate, *exact)
    assert np.sqrt(exact[1].max()) > 1.5  # the sensor does not see the sign


def test_a_mode_for_ever_is_a_comparison_of_models():
    """With an identity as transition matrix a mode's probability is that of its model, from the joint law of all y."""
    problem = dataclasses.replace(TWO, P=np.eye(2))
    y = problem.simulate(steps=4, runs=1, seed=5)[1]
    singly = np.array([[joint_loglik(mode, y[:k, :, 0]) for mode in problem.modes] for k in range(1, 5)]) + np.log(TWO.p0)
    total = np.logaddexp.reduce(singly, axis=1)
    estimate = MultipleModelParticleFilter(particles=80).run(problem.model, repeated(y, 3000), 6)
    mode, loglik = np.exp(singly - total[:, None]), np.diff(total, prepend=0.0)
    assert np.abs(unbiased_modes(estimate, mode, loglik)).max() < BAND
    assert np.abs(scores(np.exp(np.cumsum(estimate.loglik, axis=0) - total[:, None]), 1.0)).max() < BAND


def test_modes_that_do_not_differ_leave_the_posterior_of_one_model():
    problem = JumpLinear((TWO.modes[0],) * 3, THREE.P, THREE.p0)
    y = with_gaps(problem, seed=2)
    chain = np.stack([THREE.p0 @ np.linalg.matrix_power(THREE.P, k) for k in range(1, 6)])
    estimate = MultipleModelParticleFilter(particles=60).run(problem.model, repeated(y, 3000), 9)
    assert_unbiased(estimate, *filterpy_kalman(TWO.modes[0], y[:, :, 0]), chain)


def test_the_statistic_is_the_log_of_the_odds_of_a_manoeuvre():
    y = THREE.simulate(steps=6, runs=5, seed=1)[1]
    for nominal in range(3):
        model = dataclasses.replace(THREE.model, nominal=nominal)
        estimate = MultipleModelParticleFilter(particles=500).run(model, y, 1)
        inside = np.delete(estimate.mode, nominal, axis=1).sum(1)
        np.testing.assert_allclose(estimate.statistic, np.log(inside) - np.log(estimate.mode[:, nominal]), rtol=1e-9)
    for start, expected in (([1.0, 0.0], -LARGEST), ([0.0, 1.0], LARGEST)):
        model = dataclasses.replace(TWO, P=np.eye(2), p0=np.array(start)).model
        estimate = MultipleModelParticleFilter(particles=50).run(model, y, 1)
        np.testing.assert_array_equal(estimate.statistic, expected)
        np.testing.assert_allclose(estimate.mode, np.broadcast_to(np.array(start)[:, None], estimate.mode.shape), atol=1e-14)


def test_a_measurement_far_from_all_still_tells_the_modes_apart():
    """Half a million standard deviations off, where every likelihood is zero as a number."""
    y = np.full((1, 2, 2), 5e5)
    estimate = MultipleModelParticleFilter(particles=400).run(TWO.model, y, 3)
    assert estimate.ok.all()
    assert (estimate.loglik < -1e9).all()
    assert (estimate.mode[0, 1] == 1).all()  # the wider mode comes closest
    assert (estimate.statistic > 1e3).all()
    assert (estimate.statistic < LARGEST).all()


def test_models_of_one_mode_and_laws_without_likelihood_are_refused():
    assert MultipleModelParticleFilter().accepts(TWO.modes[0].model) == "the model has a single mode"
    sure = dataclasses.replace(TWO.modes[1], R=np.zeros((2, 2)))
    model = JumpModel((TWO.modes[0].model, sure.model), TWO.P, TWO.p0, names=("straight", "turn"))
    assert MultipleModelParticleFilter().accepts(model).startswith("turn: its measurements have no likelihood")
    assert MultipleModelParticleFilter().accepts(TWO.model) is None
