"""The generalised likelihood ratio: against the joint Gaussian with and without input, its exact law, a textbook's loop."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

from estimators.glr import LikelihoodRatio
from estimators.kalman import Kalman
from suite.case import draw
from suite.innovation_tests import explained
from suite.model import AdditiveSensor, AdditiveTransition, Affine, StateSpaceModel
from suite.noise import Gaussian
from suite.nonadditive import NonadditiveSensor, NonadditiveTransition
from tests.estimators.references import PAIR, PUSHED, from_both_sides, scores
from tests.oracles import Linear, generators, joint, random_linear, range_bearing

STEPS = 9
MODELS = {
    "one input": PUSHED,
    "two inputs": PAIR,
    "two of four": random_linear(1, 4, 2, 2),
    "seen after a while": random_linear(2, 3, 1, 2),
    "far from seen": random_linear(4, 4, 1, 4),
}


def with_outages(y):
    """A step that nobody measured, and in each run a component that is missing now and then, or all for good."""
    y = y.copy()
    y[3] = y[:, :, 0] = y[1::2, 0, 1] = y[::3, -1, 2] = np.nan
    return y


def measured(p: Linear, steps: int):
    """Mean [T m] and covariance [T m, T m] of all measurements."""
    mean, cov, H, offset = joint(p, steps)
    return H @ mean + offset, H @ cov @ H.T + np.kron(np.eye(steps), p.R)


def shift(p: Linear, steps: int, onset: int):
    """What an input of one along each column of the gain from step `onset` on adds to all measurements: [T m, q]."""
    late = [sum((np.linalg.matrix_power(p.A, k - j) @ p.G for j in range(onset, k + 1)), 0 * p.G) for k in range(1, steps + 1)]
    return np.concat([p.H @ b for b in late])


def likelihood_ratio(p: Linear, y, onset: int) -> float:
    """Logarithm of the ratio of the likelihoods of one run's y[T, m] with the best input from a step on, and with none."""
    mean, cov = measured(p, len(y))
    seen = ~np.isnan(y.ravel())
    if not seen.any():
        return 0.0
    mean, cov, b = mean[seen], cov[np.ix_(seen, seen)], shift(p, len(y), onset)[seen]
    whiten = np.linalg.inv(np.linalg.cholesky(cov))
    u = np.linalg.lstsq(whiten @ b, whiten @ (y.ravel()[seen] - mean), rcond=1e-9)[0]
    none, best = stats.multivariate_normal(mean, cov).logpdf(np.stack([y.ravel()[seen], y.ravel()[seen] - b @ u]))
    return best - none


@pytest.mark.parametrize("missing", [False, True], ids=["complete", "missing"])
@pytest.mark.parametrize("name", MODELS)
def test_equals_the_likelihood_ratio_of_the_joint_gaussian_for_the_likeliest_onset(name, missing):
    p = MODELS[name]
    _, y = p.simulate(STEPS, runs=3, seed=1)
    y = with_outages(y) if missing else y
    ratio = np.full((STEPS + 1, STEPS + 1, 3), -np.inf)
    for k in range(1, STEPS + 1):
        for onset in range(1, k + 1):
            ratio[k, onset] = [likelihood_ratio(p, y[:k, :, r], onset) for r in range(3)]
    for window in (1, 3, 50):
        expected = [ratio[k, max(1, k + 1 - window) :].max(0) for k in range(1, STEPS + 1)]
        np.testing.assert_allclose(LikelihoodRatio(window).run(p.model, y).statistic, expected, rtol=1e-8, atol=1e-8)


def test_the_gain_of_a_singular_noise_need_not_be_named():
    p = PUSHED
    plain = dataclasses.replace(p, G=np.eye(2), Q=p.G @ p.Q @ p.G.T, w=p.G @ p.w)
    _, y = p.simulate(STEPS, runs=3, seed=2)
    a, b = (LikelihoodRatio().run(q.model, y).statistic for q in (p, plain))
    np.testing.assert_allclose(a, b, rtol=1e-9)


def test_matrices_and_noises_may_depend_on_time():
    # The input is constant in units of the noise's deviations; by a joint Gaussian built up step by step.
    steps, rng = 6, np.random.default_rng(3)
    As, size = rng.standard_normal((steps + 1, 2, 2)), rng.uniform(0.5, 2, steps + 1)
    G, H = np.array([[0.5], [1.0]]), np.array([[1.0, 0.3]])
    model = StateSpaceModel(
        Gaussian([1.0, -1.0], np.eye(2)),
        AdditiveTransition(Affine(lambda k: As[k]), lambda k: Gaussian.diagonal([size[k] ** 2]), gain=G),
        AdditiveSensor(Affine(H), Gaussian.diagonal([0.5])),
    )
    y = 3 * rng.standard_normal((steps, 1, 1))
    # State k as a mean, and a matrix on x_0's error, the noises w_1, ..., w_T of deviation one, and the input since the onset.
    expected = []
    for onset in range(1, steps + 1):
        mean, into, push = np.array([1.0, -1.0]), np.hstack([np.eye(2), np.zeros((2, steps))]), np.zeros((2, 1))
        means, intos, pushes = [], [], []
        for k in range(1, steps + 1):
            entry = G * size[k]
            mean, into, push = As[k] @ mean, As[k] @ into, As[k] @ push + entry * (k >= onset)
            into[:, 2 + k - 1] += entry[:, 0]
            means.append(H @ mean)
            intos.append(H @ into)
            pushes.append(H @ push)
        L, b = np.concat(intos), np.concat(pushes)[:, 0]
        e, S = y[:, 0, 0] - np.concat(means), L @ L.T + 0.5 * np.eye(steps)
        expected.append(0.5 * (b @ np.linalg.solve(S, e)) ** 2 / (b @ np.linalg.solve(S, b)))
    np.testing.assert_allclose(LikelihoodRatio().run(model, y).statistic[-1, 0], max(expected), rtol=1e-9)


@pytest.mark.parametrize(("name", "rank"), [("one input", 1), ("two inputs", 2), ("seen after a while", 1)])
def test_without_a_manoeuvre_the_ratio_of_one_onset_is_chi_square(name, rank):
    # With a window of one step the onset is the step itself, and steps are independent. Three calls; a false alarm of the
    # test by Kolmogorov and Smirnov has probability 1e-9 in each.
    _, y = MODELS[name].simulate(steps=40, runs=100, seed=5)
    statistic = LikelihoodRatio(1).run(MODELS[name].model, y).statistic
    assert stats.kstest(2 * statistic.ravel(), stats.chi2(rank).cdf).pvalue > 1e-9


def test_where_one_of_two_sensors_fails_one_degree_is_left():
    _, y = PAIR.simulate(steps=40, runs=100, seed=6)
    y[:, 1] = np.nan
    statistic = LikelihoodRatio(1).run(PAIR.model, y).statistic
    assert stats.kstest(2 * statistic.ravel(), stats.chi2(1).cdf).pvalue > 1e-9  # probability of a false alarm


@pytest.mark.parametrize("name", ["one input", "two inputs", "two of four"])
def test_a_manoeuvre_raises_the_ratio_by_its_noncentrality(name):
    # An input from the first step on shifts the mean of y_1, ..., y_k by b. Twice the ratio for an onset at step k, a
    # projection of rank r of white innovations, gets the mean r + what the same projection gives of b. Six steps within
    # 5 standard errors: a false alarm has probability below 4e-6 in each of three calls.
    p, steps = MODELS[name], 6
    rank = min(p.G.shape[1], len(p.H))
    moved = dataclasses.replace(p, w=p.w + 5.0)
    _, y = moved.simulate(steps, runs=1500, seed=8)
    pushed = measured(moved, steps)[0].reshape(steps, -1)
    excess = np.array([2 * likelihood_ratio(p, pushed[:k], onset=k) for k in range(1, steps + 1)])
    assert excess.max() > 0.5 * rank
    statistic = LikelihoodRatio(1).run(p.model, y).statistic
    assert np.abs(scores(2 * statistic, rank + excess)).max() < 5
    # With the true onset in the window its ratio counts, that of all steps together, and the largest is no smaller.
    whole = 2 * likelihood_ratio(p, pushed, onset=1)
    assert whole > 2 * excess[-1]
    assert scores(2 * LikelihoodRatio(steps).run(p.model, y).statistic[-1], rank + whole) > -5


def derivative(function, x):
    step = 1e-6
    columns = [(function(x + step * e) - function(x - step * e)) / (2 * step) for e in np.eye(len(x))]
    return np.stack(columns, axis=-1)


def textbook(model: StateSpaceModel, y, window: int):
    """The statistic [T] of one run's y[T, m] by an extended Kalman filter in covariances and its signatures; no gaps."""
    x, P, D = model.prior.mean, model.prior.cov, model.dynamics.gain
    Q, R, found, signatures = model.dynamics.noise.cov, model.sensor.noise.cov, [], []
    for k, z in enumerate(y, start=1):
        F = derivative(lambda s, k=k: model.dynamics.mean(s[:, None], k)[:, 0], x)
        x, P = model.dynamics.mean(x[:, None], k)[:, 0] + D @ model.dynamics.noise.mean, F @ P @ F.T + D @ Q @ D.T
        H = derivative(lambda s, k=k: model.sensor.mean(s[:, None], k)[:, 0], x)
        nu = z - model.sensor.mean(x[:, None], k)[:, 0] - model.sensor.noise.mean
        for i in model.sensor.angles:
            nu[i] = np.angle(np.exp(1j * nu[i]))
        S = np.linalg.inv(H @ P @ H.T + R)
        K = P @ H.T @ S
        none = (np.zeros_like(D), np.zeros((D.shape[1],) * 2), np.zeros(D.shape[1]))
        after = []
        for phi, A, b in [*signatures, none][-window:]:
            ahead = F @ phi + D
            psi = H @ ahead
            after.append((ahead - K @ psi, A + psi.T @ S @ psi, b + psi.T @ S @ nu))
        signatures = after
        x, P = x + K @ nu, P - K @ H @ P
        found.append(max(0.5 * b @ np.linalg.pinv(A, rcond=1e-9) @ b for _, A, b in signatures))
    return np.array(found)


def curved(gain):
    def bend(x, k):
        return np.stack([x[0] + 0.1 * np.sin(x[1]), 0.9 * x[1] + 0.2 * np.cos(x[0] + 0.1 * k)])

    def look(x, k):
        return np.stack([x[0] * x[0] + x[1], np.exp(0.2 * x[1]), x[0] * x[1]])

    q = gain.shape[1]
    return StateSpaceModel(
        Gaussian([1.0, -0.5], [[0.5, 0.1], [0.1, 0.3]]),
        AdditiveTransition(bend, Gaussian(np.full(q, 0.3), 0.2 * np.eye(q) + 0.05), gain=gain),
        AdditiveSensor(look, Gaussian([0.1, 0.0, -0.2], [[0.5, 0.1, 0.0], [0.1, 0.4, 0.1], [0.0, 0.1, 0.6]])),
    )


@pytest.mark.parametrize("window", [1, 4, 50])
@pytest.mark.parametrize("gain", [[[1.0], [0.5]], [[1.0, 0.2], [0.0, 1.0]]], ids=["one input", "two inputs"])
def test_equals_a_textbook_loop_on_a_curved_model(gain, window):
    model = curved(np.array(gain))
    y = draw(model, 15, generators(3, "curved")).y
    estimate = LikelihoodRatio(window).run(model, y)
    for r in range(3):
        np.testing.assert_allclose(estimate.statistic[:, r], textbook(model, y[:, :, r], window), rtol=1e-6, atol=1e-8)


def test_bearings_wrap():
    east = range_bearing()
    truth, a, b = from_both_sides(LikelihoodRatio())
    np.testing.assert_allclose(a.statistic, b.statistic, rtol=1e-6, atol=1e-8)
    dynamics = dataclasses.replace(east.dynamics, gain=np.eye(4))
    expected = textbook(dataclasses.replace(east, dynamics=dynamics), truth.y[:, :, 0], 10)
    np.testing.assert_allclose(a.statistic[:, 0], expected, rtol=1e-5, atol=1e-7)


def test_the_estimate_is_that_of_the_kalman_filter():
    _, y = PAIR.simulate(STEPS, runs=3, seed=1)
    y = with_outages(y)
    found, exact = LikelihoodRatio().run(PAIR.model, y), Kalman().run(PAIR.model, y)
    for name in ("mean", "cov", "loglik", "innovation"):
        np.testing.assert_allclose(getattr(found, name), getattr(exact, name), rtol=1e-9, atol=1e-9)


def test_regressors_that_say_nothing_new_are_passed_over():
    rng = np.random.default_rng(1)
    x, z = rng.standard_normal((50, 3)) * [1.0, 1e6, 1e-6], rng.standard_normal(50)
    x = np.column_stack([0 * z, x[:, 0], x[:, 1], x[:, 0] - 3e-6 * x[:, 1], x[:, 2]])
    joint = np.column_stack([x, z])
    u, _, _ = np.linalg.svd(x[:, [1, 2, 4]] / np.linalg.norm(x[:, [1, 2, 4]], axis=0), full_matrices=False)
    np.testing.assert_allclose(explained((joint.T @ joint)[None]), [np.sum((u.T @ z) ** 2)], rtol=1e-9)


@pytest.mark.parametrize(("angle", "counts"), [(1e-3, True), (1e-4, True), (1e-6, False), (0.0, False)])
def test_regressors_count_until_they_are_all_but_parallel(angle, counts):
    # They leave angle² of each other unexplained, which the tolerance of 1e-10 parts.
    x, z = np.array([[1.0, 1.0], [0.0, angle], [0.0, 0.0]]), np.array([2.0, 3.0, 5.0])
    joint = np.column_stack([x, z])
    np.testing.assert_allclose(explained((joint.T @ joint)[None]), [4.0 + 9.0 * counts], rtol=1e-6)


def test_nothing_observed_is_nothing_found():
    estimate = LikelihoodRatio().run(PAIR.model, np.full((6, 2, 2), np.nan))
    assert estimate.ok.all()
    assert (estimate.statistic == 0).all()


def test_refuses_what_no_input_can_enter():
    model = PAIR.model
    assert LikelihoodRatio().accepts(model) is None
    still = AdditiveTransition(model.dynamics.mean, Gaussian.noise(np.zeros((2, 2))))
    inside = NonadditiveTransition(lambda x, w, k: x + w, Gaussian.noise(np.eye(2)))
    blurred = NonadditiveSensor(lambda x, v, k: x + v, Gaussian.noise(np.eye(2)), dim=2)
    assert "no process noise" in LikelihoodRatio().accepts(dataclasses.replace(model, dynamics=still))
    assert "process noise is not additive" in LikelihoodRatio().accepts(dataclasses.replace(model, dynamics=inside))
    assert "measurement noise is not additive" in LikelihoodRatio().accepts(dataclasses.replace(model, sensor=blurred))
