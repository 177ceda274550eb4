"""The Rao-Blackwellised filter of modes against the exact sum over all sequences of modes, of which it draws some."""

import dataclasses

import numpy as np
import pytest

from estimators.kalman import Kalman
from estimators.mode_rao_blackwellised import ModeRaoBlackwellised, branched
from suite.estimator import StepError
from suite.jump import JumpModel
from suite.model import AdditiveSensor, AdditiveTransition
from suite.noise import Gaussian, StudentT
from suite.problems import CURVED
from suite.resampling import SCHEMES
from tests.estimators.references import repeated, scores, unbiased
from tests.jump_oracles import PARTS, THREE, TWO, JumpLinear, enumeration, near
from tests.oracles import generators, random_linear

PROBLEMS = pytest.mark.parametrize("problem", [TWO, THREE], ids=["two", "three"])
BAND = 6.0
"""Standard errors. All tests of this file together look at fewer than 1000 figures: a false alarm has probability below 2e-6
for normal means, and those of a thousand bounded ratios are close to it."""


def with_gaps(y):
    """One of two sensors missing in the second step, both in the third."""
    y = y.copy()
    y[1, 1], y[2] = np.nan, np.nan
    return y


@pytest.mark.parametrize("scheme", SCHEMES)
@PROBLEMS
def test_figures_are_unbiased(problem, scheme):
    """The likelihood, and with it as a factor mean, covariance and mode probabilities, at a handful of particles."""
    y = with_gaps(problem.simulate(steps=5, runs=1, seed=3)[1])
    y[1:, 0] += 4.0  # a jump, which some histories foresee and some do not
    exact = enumeration(problem, y)
    filtered = ModeRaoBlackwellised(particles=4, threshold=0.95, resampling=scheme)
    found = filtered.run(problem.model, repeated(y, 1000), 1)
    assert 0.1 < (found.ess[:-1] < 0.95 * 4).mean() < 0.9  # some runs resample, some do not
    worst = np.abs(unbiased(found, exact.mean[..., 0], exact.cov[..., 0], exact.loglik[:, 0])).max()
    ratio = np.exp(np.cumsum(found.loglik - exact.loglik, axis=0))
    of_modes = np.abs(scores(ratio[:, None] * (found.mode - exact.mode), 0.0)).max()
    assert max(worst, of_modes) < BAND


@PROBLEMS
def test_errors_fall_with_the_root_of_the_number_of_particles(problem):
    # 9 times the particles: errors of a third. The median size of 200 normal errors has a standard error of 8 percent, the
    # ratio of two one of 12; a factor of 2 is passed with probability below 1e-8 each. (Mean squares are ruled by few runs.)
    y = problem.simulate(steps=3, runs=1, seed=4)[1]
    exact = enumeration(problem, y)
    few, many = (ModeRaoBlackwellised(particles=n).run(problem.model, repeated(y, 200), 2) for n in (20, 180))
    for part in ("mean", "mode", "loglik"):
        size = [np.median(np.abs(getattr(found, part) - getattr(exact, part))[-1]) for found in (few, many)]
        assert 1.5 < size[0] / size[1] < 6


def all_branches(belief, count):
    """The belief whose histories are all branches of another one: each goes on in the mode that it stands for, for certain."""
    total = belief.mean.shape[2] * count
    mean, root = np.repeat(belief.mean, count, axis=2), np.repeat(belief.root, count, axis=2)
    here = np.arange(total) % count == np.arange(count)[:, None, None]
    logw = belief.histories.logw[..., None] + np.moveaxis(belief.logp, 0, -1)
    logp = np.where(np.broadcast_to(here, mean.shape[:3]), 0.0, -np.inf)
    parents = np.broadcast_to(np.arange(total) // count, logp.shape[1:])
    return branched(mean, root, logp, logw.reshape(-1, total), parents, belief.nominal)


@PROBLEMS
def test_with_all_histories_it_is_exact(problem):
    """When nothing is left to chance, as each sequence of modes is there once with its weight."""
    _, y, _ = problem.simulate(steps=4, runs=3, seed=5)
    y[1, 0, 0], y[2, :, 1] = np.nan, np.nan
    model, exact, count, rng = problem.model, enumeration(problem, y), len(problem.p0), generators(3, "all")
    belief = ModeRaoBlackwellised(particles=1).init(model, rng)
    for k, z in enumerate(y, start=1):
        belief = all_branches(belief, count)
        with np.errstate(invalid="ignore"):
            belief = ModeRaoBlackwellised(particles=count**k, threshold=0.0).step(model, belief, z, k, rng)
            found = belief.read()
        for part in PARTS:
            np.testing.assert_allclose(getattr(found, part), getattr(exact, part)[k - 1], rtol=1e-9, atol=1e-9)
        odds = exact.logp[k - 1]
        np.testing.assert_allclose(found.statistic, np.log1p(-np.exp(odds[0])) - odds[0], rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("mode", [0, 1])
def test_the_first_step_is_exact_at_one_particle_where_its_mode_is_known(mode):
    """All modes that may follow are weighed, whichever is drawn."""
    problem = dataclasses.replace(THREE, p0=np.eye(3)[mode])
    y = problem.simulate(steps=1, runs=5, seed=6)[1]
    exact = enumeration(problem, y)
    found = ModeRaoBlackwellised(particles=1).run(problem.model, y, 3)
    near(found, exact)
    np.testing.assert_allclose(found.statistic, np.log(exact.mode[:, 1:].sum(1) / exact.mode[:, 0]), rtol=1e-9)


@pytest.mark.parametrize("count", [1, 7])
def test_identical_modes_are_the_kalman_filter_at_any_number_of_particles(count):
    linear = random_linear(3, 3, 2, 1)
    problem = JumpLinear((linear,) * 3, THREE.P, THREE.p0)
    y = with_gaps(linear.simulate(steps=6, runs=3, seed=1)[1])
    near(ModeRaoBlackwellised(particles=count).run(problem.model, y, 4), Kalman().run(linear.model, y), PARTS[:3])
    alone = JumpModel((linear.model,), [[1.0]], [1.0])
    near(ModeRaoBlackwellised(particles=count).run(alone, y, 4), Kalman().run(linear.model, y), PARTS[:3])


def test_an_outlier_still_tells_modes_apart():
    """A first measurement some 1e4 deviations off: all likelihoods underflow, and what says most for it is the widest mode."""
    problem = dataclasses.replace(TWO, p0=np.array([1.0, 0.0]))
    y = problem.simulate(steps=4, runs=1, seed=5)[1]
    y[0, :, 0] = [2e4, -1e4]
    exact = enumeration(problem, y)
    found = ModeRaoBlackwellised(particles=50).run(problem.model, y, 5)
    assert found.ok.all()
    np.testing.assert_allclose(found.loglik[0], exact.loglik[0], rtol=1e-12)
    np.testing.assert_allclose(found.statistic[0, 0], exact.logp[0, 1, 0] - exact.logp[0, 0, 0], rtol=1e-12)
    np.testing.assert_array_equal(found.mode[0, :, 0], [0.0, 1.0])
    np.testing.assert_allclose(found.mode.sum(1), 1.0, rtol=1e-12)


def test_runs_with_other_gaps_keep_their_bits():
    y = THREE.simulate(steps=6, runs=4, seed=7)[1]
    y[0, 0, 0] = y[0, :, 1] = y[2, 1, 2] = y[3, :, 1:3] = np.nan
    full = np.where(np.isnan(y), 0.5, y)
    full[..., 0] = y[..., 0]
    found, other = (ModeRaoBlackwellised(particles=20).run(THREE.model, z, 6) for z in (y, full))
    assert found.ok.all()
    for part in (*PARTS, "statistic", "ess", "ancestors"):
        np.testing.assert_array_equal(getattr(found, part)[..., 0], getattr(other, part)[..., 0])


def test_a_history_that_cannot_be_costs_nothing():
    """A mode without any noise gives its measurements no density: histories that stay in it have no weight, the others all."""
    silent = dataclasses.replace(TWO.modes[1], R=np.zeros((2, 2)), Q=np.zeros((1, 1)), P0=np.zeros((2, 2)))
    apart = dataclasses.replace(TWO, modes=(TWO.modes[0], silent), P=np.eye(2), p0=np.array([0.5, 0.5]))
    y = TWO.simulate(steps=4, runs=3, seed=8)[1]
    found = ModeRaoBlackwellised(particles=20, threshold=0.0).run(apart.model, y, 7)
    alone = Kalman().run(TWO.modes[0].model, y)
    near(found, alone, ("mean", "cov"))
    np.testing.assert_allclose(found.mode, np.broadcast_to([[1.0], [0.0]], (4, 2, 3)), rtol=1e-12)
    share = np.round(20 * np.exp(found.loglik[0] - alone.loglik[0]))
    assert ((share > 0) & (share < 20)).all()  # fair coins: not with a probability of 2e-6 for each of three runs
    np.testing.assert_allclose(found.ess, np.repeat(share[None], 4, axis=0), rtol=1e-9)
    np.testing.assert_allclose(found.loglik[0], alone.loglik[0] + np.log(share / 20), rtol=1e-9)
    np.testing.assert_allclose(found.loglik[1:], alone.loglik[1:], rtol=1e-9)


def test_a_run_in_which_no_history_can_be_is_lost_alone():
    y = TWO.simulate(steps=4, runs=2, seed=8)[1]
    y[1, 0, 0] = np.inf
    found, other = (ModeRaoBlackwellised(particles=20).run(TWO.model, z, 7) for z in (y, np.nan_to_num(y, posinf=1.0)))
    np.testing.assert_array_equal(found.ok, [False, True])
    assert found.reason[0].startswith("step 2:")
    for part in PARTS:
        np.testing.assert_array_equal(getattr(found, part)[..., 1], getattr(other, part)[..., 1])


def test_what_it_accepts():
    filtered, plain = ModeRaoBlackwellised(), TWO.model
    assert filtered.accepts(plain) is None
    assert filtered.accepts(plain.modes[0]) == "the model has a single mode"
    wrong = dataclasses.replace(CURVED, sensor=AdditiveSensor(CURVED.sensor.mean, CURVED.sensor.noise))
    assert filtered.accepts(JumpModel((CURVED, wrong), TWO.P, TWO.p0)) == "mode 1: the mode is not linear with Gaussian noises"


def test_noise_that_ceases_to_be_gaussian_is_named():
    first, second = TWO.model.modes

    def noise(k):
        return Gaussian.diagonal([1.0]) if k < 2 else StudentT(np.eye(1), 4.0)

    changing = dataclasses.replace(second, dynamics=AdditiveTransition(second.dynamics.mean, noise, gain=second.dynamics.gain))
    model = JumpModel((first, changing), TWO.P, TWO.p0)
    assert ModeRaoBlackwellised().accepts(model) is None
    with pytest.raises(StepError, match="step 2: ValueError: the process noise of this step is not Gaussian"):
        ModeRaoBlackwellised(particles=3).run(model, np.zeros((2, 2, 1)))
