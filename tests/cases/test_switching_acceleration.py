"""Acceleration that comes and goes: both models, the simulated flight, and the toolbox's figures by its own IMM and by ours."""

import numpy as np
import pytest
from scipy.linalg import expm

from cases import switching_acceleration
from estimators.imm import InteractingExtended
from estimators.kalman import Kalman
from tests.toolbox_imm import Member, imm, kalman, linear

SWITCHING, ALONE = switching_acceleration.CASES
MANOEUVRE = np.isin(np.arange(1, 201), [*range(51, 71), *range(121, 151)])
TPM, MU0 = np.array([[0.98, 0.02], [0.02, 0.98]]), np.array([0.9, 0.1])
START = np.array([0.0, 0, 0, -1, 0, 0])
RUNS = 120


def discrete(order, density):
    """Transition and noise over 0.1 s of a chain of integrators driven by white noise, by Van Loan's exponential."""
    n = order + 1
    chain, driven = np.eye(n, k=1), np.zeros((n, n))
    driven[-1, -1] = density
    whole = expm(0.1 * np.block([[-chain, driven], [np.zeros((n, n)), chain.T]]))
    F = whole[n:, n:].T
    return np.kron(F, np.eye(2)), np.kron(F @ whole[:n, n:], np.eye(2))


(F1, Q1), (F2, Q2) = discrete(1, 0.01), discrete(2, 1.0)


def member(F, Q, variances):
    d = len(F)
    return Member(START[:d], np.diag(variances), linear(F), Q, linear(np.eye(2, d)), 0.1 * np.eye(2))


STEADY, ACCELERATED = member(F1, Q1, [0.1] * 4), member(F2, Q2, [0.1] * 4 + [0.5] * 2)


@pytest.fixture(scope="module")
def truth():
    """A few hundred runs."""
    return SWITCHING.simulate(RUNS, seed=3)


def of_runs(mean, truth):
    """Mean square error of a coordinate of each run, of estimates [T, R, n]."""
    return ((mean[..., :2] - truth.x[:, :2].transpose(0, 2, 1)) ** 2).mean((0, 2))


def test_models_are_the_stated_ones():
    steady, accelerated = SWITCHING.model.modes
    np.testing.assert_allclose(steady.dynamics.mean.matrix(1), np.pad(F1, (0, 2)), atol=1e-15)
    np.testing.assert_allclose(steady.dynamics.noise_cov(1), np.pad(Q1, (0, 2)), rtol=1e-9, atol=1e-18)
    np.testing.assert_array_equal(steady.prior.cov, np.diag([0.1, 0.1, 0.1, 0.1, 0, 0]))
    assert ALONE.model is accelerated
    np.testing.assert_allclose(accelerated.dynamics.mean.matrix(1), F2, atol=1e-15)
    np.testing.assert_allclose(accelerated.dynamics.noise_cov(1), Q2, rtol=1e-9, atol=1e-18)
    np.testing.assert_array_equal(accelerated.prior.cov, np.diag([0.1, 0.1, 0.1, 0.1, 0.5, 0.5]))
    for mode in (steady, accelerated):
        np.testing.assert_array_equal(mode.prior.mean, START)
        np.testing.assert_array_equal(mode.sensor.mean.matrix(1), np.eye(2, 6))
        np.testing.assert_allclose(mode.sensor.noise.cov, 0.1 * np.eye(2))
        assert mode.linear == (2, 3, 4, 5)
    np.testing.assert_array_equal(SWITCHING.model.transition, TPM)
    np.testing.assert_array_equal(SWITCHING.model.initial, MU0)
    assert SWITCHING.model.nominal == 0
    for case in (SWITCHING, ALONE):
        assert (case.steps, case.interval) == (200, 0.1)


def test_modes_are_in_force_at_the_stated_steps(truth):
    np.testing.assert_array_equal(truth.mode, MANOEUVRE[:, None].repeat(RUNS, 1))
    assert ALONE.simulate(2).mode is None
    acceleration = truth.x[:, 4:]
    assert not acceleration[~MANOEUVRE].any()
    assert acceleration[MANOEUVRE].all()


@pytest.mark.parametrize("case", [SWITCHING, ALONE], ids=lambda case: case.name)
def test_simulated_noises_are_those_of_the_mode_in_force(case):
    # 120 runs of 150 and of 50 steps, and 200 measurements: 4 + 6 + 2 means and 10 + 21 + 3 covariances within 5.5 standard
    # errors, in 2 cases: false alarm below 4e-6.
    truth = case.simulate(RUNS, seed=5)
    x = np.concatenate([np.broadcast_to(START[:, None], (1, 6, RUNS)), truth.x])
    steady = x[1:, :4] - np.einsum("ij,tjr->tir", F1, x[:-1, :4])
    manoeuvre = x[1:] - np.einsum("ij,tjr->tir", F2, x[:-1])
    seen = truth.y - truth.x[:, :2]
    for noise, cov in ((steady[~MANOEUVRE], Q1), (manoeuvre[MANOEUVRE], Q2), (seen, 0.1 * np.eye(2))):
        flat = np.moveaxis(noise, 1, 0).reshape(len(cov), -1)
        count, power = flat.shape[1], np.outer(np.diag(cov), np.diag(cov))
        assert (np.abs(flat.mean(1)) < 5.5 * np.sqrt(np.diag(cov) / count)).all()
        assert (np.abs(flat @ flat.T / count - cov) < 5.5 * np.sqrt((power + cov**2) / count)).all()


PRINTED = {
    ("switching-acceleration", "kalman"): 0.1554,
    ("switching-acceleration", "imm-ekf"): 0.0229,
    ("switching-acceleration/single-model", "kalman"): 0.0317,
}


def test_published_figures_are_the_printed_ones():
    cases = switching_acceleration.CASES
    assert {(case.name, p.estimator): p.value for case in cases for p in case.published} == PRINTED
    assert {p.runs for case in cases for p in case.published} == {1000}
    assert [case.experiment.estimators for case in cases] == [("kalman", "imm-ekf"), ("kalman",)]


def test_our_filters_reproduce_the_figures():
    # Within 5 standard errors of the difference, the figures being means of 1000 runs: below 2e-6 for all three.
    for case, estimator in ((SWITCHING, Kalman()), (SWITCHING, InteractingExtended()), (ALONE, Kalman())):
        truth = case.simulate(RUNS, seed=7)
        run = of_runs(estimator.run(case.model, truth.y).mean.transpose(0, 2, 1), truth)
        error = run.std(ddof=1) * np.sqrt(1 / RUNS + 1 / 1000)
        assert abs(run.mean() - PRINTED[case.name, estimator.name]) < 5 * error + 5e-5


def test_filters_are_the_toolboxs(truth):
    """To rounding for one model, and for the IMM with the spread of what a model lacks; without it errors hardly differ."""
    y = truth.y[..., :20].transpose(0, 2, 1)
    for model, single in ((SWITCHING.model, STEADY), (ALONE.model, ACCELERATED)):
        mean = Kalman().run(model, truth.y[..., :20]).mean.transpose(0, 2, 1)
        np.testing.assert_allclose(mean[..., : len(single.mean)], kalman(single, y), rtol=1e-8, atol=1e-8)
    estimate = InteractingExtended().run(SWITCHING.model, truth.y[..., :20])
    ours = estimate.mean.transpose(0, 2, 1)
    same, mode = imm((STEADY, ACCELERATED), TPM, MU0, y, spread=True)
    np.testing.assert_allclose(ours, same, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(estimate.mode.transpose(0, 2, 1), mode, rtol=1e-6, atol=1e-9)
    toolbox, _ = imm((STEADY, ACCELERATED), TPM, MU0, y, spread=False)
    part = truth.x[..., :20][:, :2].transpose(0, 2, 1)
    errors = [((mean[..., :2] - part) ** 2).mean() for mean in (ours, toolbox)]
    assert 0 < abs(errors[1] / errors[0] - 1) < 0.01


def test_a_good_filter_does_not_diverge(truth):
    for case, estimator in ((SWITCHING, InteractingExtended()), (ALONE, Kalman())):
        estimate = estimator.run(case.model, truth.y)
        error = np.sqrt(((estimate.mean - truth.x)[:, :2] ** 2).sum(1))
        assert estimate.ok.all()
        assert (error > case.divergence.limit).sum(0).max() < case.divergence.steps
