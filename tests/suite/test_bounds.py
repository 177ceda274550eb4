"""Cramér-Rao bounds, against Kalman filters, other forms of the recursion, and Fisher informations of whole trajectories."""

import dataclasses
import itertools

import numpy as np
import pytest

from cases.ballistic import CASES as BALLISTIC
from estimators.bootstrap import Bootstrap
from estimators.kalman import Kalman
from suite import bounds
from suite.bounds import Trajectories, best_fitting_gaussian, bound, trajectories
from suite.case import draw
from suite.fisher import information
from suite.jump import JumpModel
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gamma, Gaussian, GaussianMixture, StudentT
from suite.problems import PROBLEMS
from tests.bound_oracles import near, outages, riccati, swing
from tests.jump_oracles import TWO
from tests.oracles import filterpy_kalman, generators, random_linear

STEPS = 6
PROBLEM = {case.name.removeprefix("check/"): case.model for case in PROBLEMS}


def weighed(H, R, y):
    """E[Hᵀ R⁻¹ H] over runs of H[m, n, R], with the rows observed in each."""
    total = 0.0
    for r in range(H.shape[2]):
        rows = np.flatnonzero(~np.isnan(y[:, r]))
        total = total + H[rows, :, r].T @ np.linalg.inv(R[np.ix_(rows, rows)]) @ H[rows, :, r] if len(rows) else total
    return total / H.shape[2]


def tichavsky(model, x, Q, y):
    """The recursion as printed, for J = inv(bound), with D11, D12 and D22; Q must have an inverse."""
    J, inverse, found = np.linalg.inv(model.prior.cov), np.linalg.inv(Q), []
    for k in range(1, len(x)):
        F, H = model.dynamics.jacobian(x[k - 1], k), model.sensor.jacobian(x[k], k)
        D11 = np.einsum("pir,pq,qjr->ij", F, inverse, F) / x.shape[2]
        D12 = -F.mean(-1).T @ inverse
        J = inverse + weighed(H, model.sensor.noise.cov, y[k - 1]) - D12.T @ np.linalg.inv(J + D11) @ D12
        found.append(np.linalg.inv(J))
    return np.stack(found)


@pytest.mark.parametrize("gaps", [False, True], ids=["complete", "gaps"])
@pytest.mark.parametrize("dirac", [False, True], ids=["spread", "point"])
@pytest.mark.parametrize("shape", [(1, 1, 1), (2, 1, 1), (3, 2, 1), (4, 2, 2), (5, 3, 2), (4, 4, 4), (2, 3, 1)], ids=str)
def test_equals_the_kalman_covariance_on_linear_models(shape, dirac, gaps):
    problem = random_linear(sum(shape), *shape, dirac=dirac)
    y = np.zeros((12, shape[1]))
    if gaps:
        y[np.random.default_rng(1).random(y.shape) < 0.3] = np.nan
    drawn = trajectories(problem.model, 12, generators(4, "linear"))
    found = bound(problem.model, drawn, np.repeat(y[:, :, None], 4, axis=2))
    near(found.cov, filterpy_kalman(problem, y)[1])
    assert (found.kind, found.reason) == (bounds.POSTERIOR, "")
    assert (found.error <= 1e-12 * np.abs(found.cov).max()).all()


def test_functions_and_noises_may_change_with_time():
    A = lambda k: np.array([[1.0, 0.5 * k], [-0.1, 0.9]])  # noqa: E731
    H = lambda k: np.array([[np.cos(k), 1.0]])  # noqa: E731
    Q = lambda k: Gaussian.diagonal([0.1 * k, 1 / k])  # noqa: E731
    R = Gaussian.noise([[0.5]])
    model = StateSpaceModel(Gaussian.diagonal([1.0, 2.0]), AdditiveTransition(Affine(A), Q), AdditiveSensor(Affine(H), R))
    P, found = model.prior.cov, bound(model, trajectories(model, 5, generators(3, "time")))
    for k in range(1, 6):
        P = riccati(P, A(k), Q(k).cov, H(k), R.cov, np.zeros(1))
        near(found.cov[k - 1], P)


@pytest.mark.parametrize("gaps", [False, True], ids=["complete", "gaps"])
@pytest.mark.parametrize("name", ["swing", "angle", "scalar"])
def test_agrees_with_the_printed_recursion_on_curved_models(name, gaps):
    model = swing() if name == "swing" else PROBLEM[name]
    drawn = trajectories(model, STEPS, generators(70, name))
    y = outages(STEPS, model.m, 70) if gaps else np.zeros((STEPS, model.m, 70))
    found = bound(model, drawn, y if gaps else None)
    near(found.cov, tichavsky(model, drawn.x, model.dynamics.noise.cov, y), 1e-8)
    assert found.kind == bounds.POSTERIOR


def branching(model, steps):
    """Trajectories x[T + 1, n, R] whose noises average to zero over the runs that share a past, as those of all runs do."""
    rng, roots = np.random.default_rng(7), (model.prior.lower, model.dynamics.noise.lower)
    x = model.prior.mean[:, None] + roots[0] @ rng.standard_normal((2, 5))
    path = [x]
    for k in range(1, steps + 1):
        noise = roots[1] @ rng.standard_normal((2, 2))
        ahead = [model.dynamics.mean(path[-1], k) + sign * w[:, None] for w in noise.T for sign in (-1, 1)]
        path = [np.tile(each, 4) for each in path] + [np.concatenate(ahead, axis=1)]
    return np.stack(path)


def joint_logpdf(model, path, y):
    """log p(x_0, ..., x_T, y_1, ..., y_T) [R], but for a constant, of path[T + 1, n, R]; NaN in y[T, m, R] drops out."""
    P, Q, R = (np.linalg.inv(law.cov) for law in (model.prior, model.dynamics.noise, model.sensor.noise))
    start = path[0] - model.prior.mean[:, None]
    total = np.einsum("ir,ij,jr->r", start, P, start)
    for k in range(1, len(path)):
        w, v = path[k] - model.dynamics.mean(path[k - 1], k), y[k - 1] - model.sensor.mean(path[k], k)
        seen = ~np.isnan(v).any(0)
        total = total + np.einsum("ir,ij,jr->r", w, Q, w)
        total[seen] += np.einsum("ir,ij,jr->r", v[:, seen], R, v[:, seen])
    return -0.5 * total


@pytest.mark.parametrize("gaps", [False, True], ids=["complete", "gaps"])
def test_is_the_last_block_of_the_inverse_information_of_the_whole_trajectory(gaps):
    """The information is the mean of minus the second differences of the joint log-density: no recursion at all.

    Measurements are their means: the log-density's curvature is linear in them. Noises average to zero given the past, so
    that the terms do which are zero only in expectation.
    """
    model, steps, h = swing(), 3, 1e-3
    path = branching(model, steps)
    y = np.stack([model.sensor.mean(path[k], k) for k in range(1, steps + 1)])
    if gaps:
        y[1, :, ::2] = y[0, :, 1::5] = np.nan
    size = path[0].shape[0] * (steps + 1)
    units = h * np.eye(size).reshape(size, steps + 1, 2, 1)
    second = np.empty((size, size))
    for i, j in itertools.product(range(size), repeat=2):
        corners = {(a, b): joint_logpdf(model, path + a * units[i] + b * units[j], y) for a in (-1, 1) for b in (-1, 1)}
        second[i, j] = np.mean(corners[1, 1] - corners[1, -1] - corners[-1, 1] + corners[-1, -1]) / (4 * h * h)
    modes = np.zeros((steps + 1, path.shape[2]), int)
    found = bound(model, Trajectories(path, modes), y)
    near(found.cov[-1], np.linalg.inv(-second)[-2:, -2:], 1e-5)
    assert not np.allclose(found.cov[-1], tichavsky(model, path.mean(-1, keepdims=True), model.dynamics.noise.cov, y)[-1], 0.05)


def test_the_ballistic_case_has_its_known_bound():
    """Roots of the bound at k = 5, 10, ..., 50, printed to 0.1, and for beta from k = 30 to 1, from 20 000 trajectories.

    Within 6 standard errors of both, t-distributed with 31 degrees of freedom: false alarm 1e-6 for each of 45 numbers. The
    errors are small enough for that to say something.
    """
    known = {
        0: (331.7, 320.4, 316.7, 312.5, 299.9, 274.7, 236.8, 184.5, 128.2, 82.2),
        1: (14.6, 11.1, 11.1, 11.2, 11.1, 10.8, 10.7, 12.3, 14.1, 8.8),
        2: (822.9, 758.5, 720.3, 684.7, 634.3, 562.0, 467.2, 341.6, 225.8, 143.8),
        3: (20.3, 20.6, 20.7, 20.2, 19.0, 17.5, 15.6, 13.1, 10.7, 6.5),
        4: (2499, 2486, 2261, 1492, 889),
    }
    count, model = 400, next(case for case in BALLISTIC if case.name == "ballistic/1").model
    found = bound(model, trajectories(model, 50, generators(count, "ballistic")))
    for i, values in known.items():
        root, error = (part[4::5][-len(values) :] for part in found.rmse([i]))
        assert (error < 0.02 * root).all()
        rounding = 0.5 if i == 4 else 0.05
        assert (np.abs(root - values) < 6 * error * np.sqrt(1 + count / 20_000) + rounding).all()


def test_noise_of_lower_rank_is_the_limit_of_noise_that_gets_small():
    """The printed recursion loses as many digits as the noise is small: 1e-5 leaves four."""
    gain = np.array([[0.0], [1.0]])
    model = swing(gain)
    drawn = trajectories(model, STEPS, generators(60, "rank"))
    found = bound(model, drawn)
    assert (found.kind, found.reason) == (bounds.POSTERIOR, "")
    almost = tichavsky(model, drawn.x, gain @ gain.T * 0.4 + 1e-5 * np.eye(2), np.zeros((STEPS, 2, 60)))
    near(found.cov, almost, 1e-4)


def test_where_the_noise_does_not_reach_the_bound_is_conditional_and_says_so():
    model = swing(np.array([[0.5], [1.0]]))
    drawn, y = trajectories(model, STEPS, generators(50, "outside")), outages(STEPS, 2, 50)
    expected = np.zeros((STEPS, 2, 2, 50))
    for r in range(50):
        P = model.prior.cov
        for k in range(1, STEPS + 1):
            before, now = drawn.x[k - 1, :, r : r + 1], drawn.x[k, :, r : r + 1]
            F, H = model.dynamics.jacobian(before, k)[..., 0], model.sensor.jacobian(now, k)[..., 0]
            P = expected[k - 1, :, :, r] = riccati(P, F, model.dynamics.noise_cov(k), H, model.sensor.noise.cov, y[k - 1, :, r])
    found = bound(model, drawn, y)
    near(found.cov, expected.mean(-1))
    assert found.kind == bounds.CONDITIONAL
    assert "no strict bound" in found.reason


def test_other_noises_count_by_their_fisher_information():
    process = StudentT([[0.5, 0.2], [0.2, 0.9]], 3.5)
    mixture = GaussianMixture((0.8, 0.2), (Gaussian.noise([[1.0]]), Gaussian.noise([[40.0]])))
    problem = random_linear(3, 3, 1, 2)
    model = StateSpaceModel(
        Gaussian(problem.m0, problem.P0),
        AdditiveTransition(Affine(problem.A), process, gain=problem.G),
        AdditiveSensor(Affine(problem.H), mixture),
    )
    found = bound(model, trajectories(model, STEPS, generators(3, "other")))
    alike = dataclasses.replace(problem, Q=np.linalg.inv(information(process)), R=1 / information(mixture))
    near(found.cov, filterpy_kalman(alike, np.zeros((STEPS, 1)))[1])
    assert (
        found.cov[-1].diagonal()
        < filterpy_kalman(dataclasses.replace(problem, Q=process.cov, R=mixture.cov), np.zeros((STEPS, 1)))[1][-1].diagonal()
    ).all()


def test_a_block_counts_by_the_trace_over_its_components():
    model = swing()
    found = bound(model, trajectories(model, STEPS, generators(40, "block")))
    near(found.rmse([0, 1])[0] ** 2, found.cov[:, 0, 0] + found.cov[:, 1, 1])
    near(found.rmse([1])[1] * 2 * found.rmse([1])[0], found.error[:, 1], 0.05)


@pytest.mark.parametrize("name", ["swing", "outside", "two", "fit"])
def test_the_order_of_runs_does_not_matter(name):
    model = {"swing": swing(), "outside": swing(np.array([[0.5], [1.0]]))}.get(name, TWO.model)
    drawn, y = trajectories(model, STEPS, generators(50, "order")), outages(STEPS, 2, 50)
    order = np.random.default_rng(2).permutation(50)
    compute = best_fitting_gaussian if name == "fit" else bound
    other = compute(model, Trajectories(drawn.x[:, :, order], drawn.mode[:, order]), y[:, :, order])
    near(other.cov, compute(model, drawn, y).cov, 1e-12)


@pytest.mark.parametrize("name", ["swing", "two", "copies"])
def test_a_trajectory_that_is_not_finite_is_left_out_and_told(name):
    model, copies = swing() if name == "swing" else TWO.model, 2 if name == "copies" else 1
    drawn, y = trajectories(model, STEPS, generators(20 // copies, "bad"), copies), outages(STEPS, 2, 20)
    rest = bound(model, Trajectories(drawn.x[:, :, copies:], drawn.mode[:, copies:], copies), y[:, :, copies:])
    drawn.x[3, 1, 0] = np.nan
    found = bound(model, drawn, y)
    np.testing.assert_array_equal(found.cov, rest.cov)
    assert found.reason == f"{copies} of 20 trajectories are not finite and left out"
    drawn.x[2, 0] = np.inf
    none = bound(model, drawn, y)
    assert (none.kind, none.reason) == (bounds.NONE, "20 of 20 trajectories are not finite and left out")


def test_a_single_trajectory_has_a_bound_but_no_error():
    model = swing()
    found = bound(model, trajectories(model, STEPS, generators(1, "single")))
    assert np.isfinite(found.cov).all()
    assert np.isnan(found.error).all()
    assert np.isnan(found.rmse([0])[1]).all()


SINGULAR, ODD = Gaussian.diagonal([1.0, 0.0]), Gaussian.diagonal([1.0, 1.0])
REFUSED = {
    "nonadditive": (PROBLEM["nonadditive"], "its process noise is not additive"),
    "law": (PROBLEM["spread"], "its process noise is not additive"),
    "exact": (dataclasses.replace(swing(), sensor=AdditiveSensor(Affine(np.eye(2)), SINGULAR)), "measurement noise has no"),
    "edge": (
        dataclasses.replace(swing(), dynamics=AdditiveTransition(Affine(np.eye(2)), Gamma([1, 3], [1, 1]))),
        "process noise",
    ),
    "odd": (dataclasses.replace(swing(), sensor=AdditiveSensor(lambda x, k: np.cbrt(x), ODD)), "cannot be differentiated"),
}


@pytest.mark.parametrize(("model", "words"), REFUSED.values(), ids=REFUSED)
def test_without_a_bound_the_reason_is_given(model, words):
    drawn = trajectories(model, STEPS, generators(3, "none"))
    both = JumpModel((model,), np.eye(1), np.ones(1))
    for found in (bound(model, drawn), bound(both, drawn), best_fitting_gaussian(both, drawn)):
        assert found.kind == bounds.NONE
        assert words in found.reason
        assert found.cov.shape == (STEPS, model.n, model.n)
        assert np.isnan(found.cov).all()
        assert np.isnan(found.error).all()
        assert np.isnan(found.rmse([0])[0]).all()


@pytest.mark.parametrize(("name", "estimator"), [
    ("linear", Kalman()), ("singular", Kalman()), ("point", Kalman()), ("linear", Bootstrap(particles=300)),
    ("tails", Bootstrap(particles=300)),
])  # fmt: skip
def test_no_estimator_beats_it_on_linear_models(name, estimator):
    """Mean square errors of 500 runs, not 6 standard errors below: false alarm 1e-9 a number. The Kalman filter's are on it."""
    model, runs = PROBLEM[name], 500
    truth = draw(model, 5, generators(runs, "beat", name))
    square = (estimator.run(model, truth.y).mean - truth.x) ** 2
    score = (square.mean(-1) - np.diagonal(bound(model, trajectories(model, 5, generators(2))).cov, axis1=1, axis2=2)) / (
        square.std(-1) / np.sqrt(runs)
    )
    assert (score > -6).all()
    assert estimator.name != "kalman" or (score < 6).all()
