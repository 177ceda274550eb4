"""Bounds of jump-Markov models, against Kalman covariances along each sequence of modes and moments of all modes together.

Then the Monte Carlo error of the bounds of all kinds.
"""

import dataclasses
import itertools

import numpy as np
import pytest

from suite import bounds
from suite.bounds import Trajectories, best_fitting_gaussian, bound, trajectories
from suite.jump import JumpModel
from suite.model import StateSpaceModel
from suite.noise import Gaussian
from tests.bound_oracles import TURNING, near, riccati, swing
from tests.jump_oracles import THREE, TWO
from tests.oracles import generators

STEPS = 6


def by_sequence(problem, drawn):
    """Mean over runs of the Kalman covariance along each one's modes [T, n, n]."""
    total = 0.0
    for modes in drawn.mode.T:
        P, found = problem.modes[modes[0]].P0, []
        for r in modes[1:]:
            p = problem.modes[r]
            P = riccati(P, p.A, p.G @ p.Q @ p.G.T, p.H, p.R, np.zeros(len(p.H)))
            found.append(P)
        total = total + np.stack(found)
    return total / drawn.mode.shape[1]


@pytest.mark.parametrize("problem", [TWO, THREE], ids=["two", "three"])
@pytest.mark.parametrize("copies", [1, 3])
def test_known_modes_average_the_kalman_covariance_over_sequences(problem, copies):
    drawn = trajectories(problem.model, STEPS, generators(40, "modes"), copies)
    found = bound(problem.model, drawn)
    near(found.cov, by_sequence(problem, drawn))
    assert (found.kind, found.reason) == (bounds.KNOWN_MODES, "")


def test_given_a_sequence_of_modes_expectations_are_over_its_trajectories():
    """Both modes curve: the posterior bound of a model that changes with time, as the sequence says."""
    calm, wild = swing(), swing()
    wild = dataclasses.replace(wild, dynamics=dataclasses.replace(wild.dynamics, noise=Gaussian.diagonal([2.0, 1.0])))
    model = JumpModel((calm, wild), np.array([[0.6, 0.4], [0.4, 0.6]]), np.array([0.5, 0.5]))
    drawn = trajectories(model, 4, generators(3, "given"), copies=30)
    expected = 0.0
    for s in range(3):
        runs = slice(30 * s, 30 * s + 30)
        modes = drawn.mode[:, 30 * s]
        assert (drawn.mode[:, runs] == modes[:, None]).all()
        of_time = dataclasses.replace(calm.dynamics, noise=lambda k, modes=modes: model.modes[modes[k]].dynamics.noise)
        one = StateSpaceModel(calm.prior, of_time, calm.sensor)
        expected = expected + bound(one, Trajectories(drawn.x[:, :, runs], np.zeros((5, 30), int))).cov / 3
    found = bound(model, drawn)
    near(found.cov, expected)
    assert (found.kind, found.reason) == (bounds.KNOWN_MODES, "")
    alone = bound(model, trajectories(model, 4, generators(3, "given")))
    assert "single trajectory" in alone.reason


def test_trajectories_follow_the_model():
    """Modes by the chain, states by their means: within 5 standard errors, false alarm 6e-7 a number, 32 numbers."""
    drawn = trajectories(TWO.model, 4, generators(2000, "follow"), copies=2)
    assert drawn.x.shape == (5, 2, 4000)
    assert (drawn.mode[:, ::2] == drawn.mode[:, 1::2]).all()
    assert (drawn.x[:, :, ::2] != drawn.x[:, :, 1::2]).all()
    law = TWO.p0
    for k in range(5):
        assert abs((drawn.mode[k, ::2] == 1).mean() - law[1]) < 5 * np.sqrt(law[0] * law[1] / 2000)
        law = law @ TWO.P
    for k, r in itertools.product(range(1, 5), range(2)):
        p, at = TWO.modes[r], np.flatnonzero(drawn.mode[k] == r)
        rest = drawn.x[k][:, at] - (p.A @ drawn.x[k - 1][:, at] + p.a[:, None] + p.G @ p.w[:, None])
        assert (np.abs(rest.mean(1)) < 5 * np.sqrt((p.G @ p.Q @ p.G.T).diagonal() / len(at))).all()


def fitted(problem, m, C, p, k_steps, P):
    """Best-fitting Gaussian recursion on moments m, C, p, and the bound P, for modes with one sensor: [T, n, n]."""
    found = []
    for _ in range(k_steps):
        p = p @ problem.P
        Phi = sum(w * one.A for w, one in zip(p, problem.modes, strict=True))
        ahead = [one.A @ m + one.a + one.G @ one.w for one in problem.modes]
        mean = sum(w * each for w, each in zip(p, ahead, strict=True))
        cov = sum(
            w * (one.A @ C @ one.A.T + one.G @ one.Q @ one.G.T + np.outer(each - mean, each - mean))
            for w, one, each in zip(p, problem.modes, ahead, strict=True)
        )
        sensor = problem.modes[0]
        P = riccati(P, Phi, cov - Phi @ C @ Phi.T, sensor.H, sensor.R, np.zeros(len(sensor.H)))
        m, C = mean, cov
        found.append(P)
    return np.stack(found)


def test_best_fitting_gaussian_of_modes_that_differ_in_noise_is_exact():
    drawn = trajectories(TWO.model, STEPS, generators(40, "fit"))
    found = best_fitting_gaussian(TWO.model, drawn)
    start = TWO.modes[0]
    near(found.cov, fitted(TWO, start.m0, start.P0, TWO.p0, STEPS, start.P0))
    assert found.kind == bounds.BEST_FIT
    assert (found.error < 1e-12).all()


def test_best_fitting_gaussian_matches_the_moments_of_all_modes():
    """Sample moments of x_0 that are exact make the first step exact; later ones are within 6 jackknife errors: 1e-6 each."""
    p, runs = TURNING, 1500
    m = sum(w * one.m0 for w, one in zip(p.p0, p.modes, strict=True))
    C = sum(w * (one.P0 + np.outer(one.m0 - m, one.m0 - m)) for w, one in zip(p.p0, p.modes, strict=True))
    expected = fitted(p, m, C, p.p0, STEPS, C)
    drawn = trajectories(p.model, STEPS, generators(runs, "moments"))
    found = best_fitting_gaussian(p.model, drawn)
    off = np.diagonal(found.cov - expected, axis1=1, axis2=2)
    assert (np.abs(off) < 6 * found.error).all()
    assert (found.error < 0.03 * np.diagonal(expected, axis1=1, axis2=2)).all()
    centred = drawn.x[0] - drawn.x[0].mean(1, keepdims=True)
    exact = np.linalg.cholesky(C) @ np.linalg.solve(np.linalg.cholesky(np.cov(centred, bias=True)), centred) + m[:, None]
    first = Trajectories(np.stack([exact, drawn.x[1]]), drawn.mode[:2])
    near(best_fitting_gaussian(p.model, first).cov, expected[:1])


@pytest.mark.parametrize("kind", ["posterior", "conditional", "modes", "copies", "fit"])
def test_the_stated_error_is_the_scatter_of_the_bound(kind):
    """Over 40 bounds the scatter itself scatters by 11 %, and their mean square error by less: 60 % are 5 of that."""
    model = {"posterior": swing(), "conditional": swing(np.array([[0.5], [1.0]])), "fit": TURNING.model}.get(kind, TWO.model)
    copies, compute = (4 if kind == "copies" else 1), best_fitting_gaussian if kind == "fit" else bound
    found = [compute(model, trajectories(model, 1, generators(40, kind, i), copies)) for i in range(40)]
    for figures in ([(np.diagonal(b.cov, axis1=1, axis2=2), b.error) for b in found], [b.rmse([0, 1]) for b in found]):
        values, errors = (np.stack(part)[:, -1] for part in zip(*figures, strict=True))
        ratio = np.sqrt((errors**2).mean(0)) / values.std(0, ddof=1)
        assert ((ratio > 0.5) & (ratio < 1.6)).all(), ratio


@pytest.mark.parametrize("kind", ["posterior", "conditional", "modes", "copies", "fit"])
def test_what_is_left_out_is_the_bound_without_a_group(kind):
    model = {"posterior": swing(), "conditional": swing(np.array([[0.5], [1.0]])), "fit": TURNING.model}.get(kind, TWO.model)
    copies, compute = (3 if kind == "copies" else 1), best_fitting_gaussian if kind == "fit" else bound
    drawn = trajectories(model, 3, generators(5, "left out", kind), copies)
    found = compute(model, drawn)
    assert found.left_out.shape == (5, 3, 2)
    for g in range(5):
        rest = np.arange(5 * copies) // copies != g
        alone = compute(model, Trajectories(drawn.x[:, :, rest], drawn.mode[:, rest], copies))
        near(found.left_out[g], np.diagonal(alone.cov, axis1=1, axis2=2))
