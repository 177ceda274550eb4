"""The chi-square test of the innovations: against filterpy's innovations, its exact law, and its growth in a manoeuvre."""

import dataclasses

import numpy as np
import pytest
from scipy import integrate, special, stats

from estimators.kalman import Kalman
from estimators.nis_chi2 import InnovationSquared
from suite.case import draw
from suite.innovation_tests import log_survival
from suite.noise import Gaussian
from suite.nonadditive import NonadditiveTransition
from tests.estimators.references import PAIR, PUSHED, from_both_sides, scores
from tests.oracles import Linear, filterpy_kalman, generators, joint, random_linear, wavy_model

STEPS = 12


def with_outages(y):
    y = y.copy()
    y[np.random.default_rng(0).random(y.shape) < 0.3] = np.nan
    y[[2, 5, 6, 7]] = np.nan
    y[:, :, 0] = np.nan
    return y


def innovations_squared(p: Linear, y):
    """Normalised innovations squared [T], and how many components were seen [T], of one run's y[T, m]; by filterpy."""
    means, covs, _ = filterpy_kalman(p, y)
    nis, seen = np.zeros(len(y)), (~np.isnan(y)).sum(1)
    for k, z in enumerate(y):
        x, P = (means[k - 1], covs[k - 1]) if k else (p.m0, p.P0)
        rows = ~np.isnan(z)
        x, P = p.A @ x + p.a + p.G @ p.w, p.A @ P @ p.A.T + p.G @ p.Q @ p.G.T
        e, S = (z - p.H @ x - p.h - p.v)[rows], (p.H @ P @ p.H.T + p.R)[np.ix_(rows, rows)]
        nis[k] = e @ np.linalg.inv(S) @ e
    return nis, seen


@pytest.mark.parametrize("missing", [False, True], ids=["complete", "missing"])
@pytest.mark.parametrize("window", [1, 2, 5, 100])
@pytest.mark.parametrize("p", [PAIR, PUSHED, random_linear(5, 4, 3, 2)], ids=["pair", "pushed", "random"])
def test_equals_sums_over_the_window_of_the_innovations_of_filterpy(p, window, missing):
    _, y = p.simulate(STEPS, runs=3, seed=1)
    y = with_outages(y) if missing else y
    found = InnovationSquared(window).run(p.model, y).statistic
    for r in range(3):
        nis, seen = innovations_squared(p, y[:, :, r])
        for k in range(STEPS):
            inside = slice(max(0, k + 1 - window), k + 1)
            expected = -stats.chi2.logsf(nis[inside].sum(), seen[inside].sum()) if seen[inside].any() else 0.0
            np.testing.assert_allclose(found[k, r], expected, rtol=1e-9, atol=1e-12)


def test_the_estimate_is_that_of_the_kalman_filter():
    _, y = PAIR.simulate(STEPS, runs=3, seed=1)
    y = with_outages(y)
    found, exact = InnovationSquared().run(PAIR.model, y), Kalman().run(PAIR.model, y)
    for name in ("mean", "cov", "loglik", "innovation"):
        np.testing.assert_allclose(getattr(found, name), getattr(exact, name), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("missing", [False, True], ids=["complete", "missing"])
@pytest.mark.parametrize("window", [1, 4])
def test_without_a_manoeuvre_the_probability_is_uniform(window, missing):
    # Innovations are independent, and so are their sums over windows that do not meet. Four calls; a false alarm of the test
    # by Kolmogorov and Smirnov has probability 1e-9 in each. Where components are missing, only steps with some are taken.
    p, steps, runs = random_linear(3, 3, 2, 1), 40, 200
    _, y = p.simulate(steps, runs, seed=7)
    if missing:
        y[np.random.default_rng(8).random(y.shape) < 0.4] = np.nan
    statistic = InnovationSquared(window).run(p.model, y).statistic[window - 1 :: window]
    seen = (~np.isnan(y)).reshape(-1, 2 * window, runs).any(1)
    assert seen.all() == (window > 1 or not missing)
    assert stats.kstest(np.exp(-statistic[seen]), "uniform").pvalue > 1e-9


def test_a_manoeuvre_raises_the_statistic_as_far_as_the_innovations_are_off():
    # A mean of the noise that the filter does not know of is an input from the first step on. It shifts the mean of y_1,
    # ..., y_k by b, and the sum of squares over a window becomes noncentral chi-square, the noncentrality the growth of
    # bᵀ Σ⁻¹ b over the window. The mean of the statistic follows by quadrature. Six steps within 5 standard errors: a false
    # alarm has probability below 6e-6.
    window, steps, p = 3, 6, PAIR
    moved = dataclasses.replace(p, w=p.w + np.array([2.0, 1.5]))
    _, y = moved.simulate(steps, runs=2000, seed=9)
    mean, cov, H, _ = joint(p, steps)
    shift, spread = H @ (joint(moved, steps)[0] - mean), H @ cov @ H.T + np.kron(np.eye(steps), p.R)
    off = [0.0] + [shift[: 2 * k] @ np.linalg.solve(spread[: 2 * k, : 2 * k], shift[: 2 * k]) for k in range(1, steps + 1)]
    expected = []
    for k in range(1, steps + 1):
        dof, excess = 2 * min(k, window), off[k] - off[max(0, k - window)]
        law = stats.ncx2(dof, excess)
        expected.append(integrate.quad(lambda s, f=law.pdf, d=dof: -stats.chi2.logsf(s, d) * f(s), 0, law.isf(1e-12))[0])
    assert min(expected) > 1.5  # it is 1 without a manoeuvre
    assert expected[2] > 3
    found = InnovationSquared(window).run(p.model, y).statistic
    assert np.abs(scores(found, np.array(expected))).max() < 5


@pytest.mark.parametrize("dof", [1, 2, 3, 7, 10, 40, 401])
def test_the_survival_probability_is_right_far_beyond_the_smallest_number(dof):
    x = np.concat([np.linspace(0, 600, 60), dof * np.linspace(0.1, 2, 20)])
    np.testing.assert_allclose(log_survival(x, np.full(len(x), dof)), stats.chi2.logsf(x, dof), rtol=1e-11, atol=1e-13)
    # Beyond, by the continued fraction of the incomplete gamma function (Abramowitz and Stegun, 1964, eq. 6.5.31).
    far, a = np.array([2e3, 1e4, 1e8, 1e300]), dof / 2
    z, tail = far / 2, np.zeros(4)
    for i in range(400, 0, -1):
        tail = i * (i - a) / (z + 2 * i + 1 - a - tail)
    expected = a * np.log(z) - z - special.gammaln(a) - np.log(z + 1 - a - tail)
    np.testing.assert_allclose(log_survival(far, np.full(4, dof)), expected, rtol=1e-11)


def test_degrees_of_freedom_may_differ_from_run_to_run():
    x, dof = np.array([3.0, 4.0, 5.0, 6.0]), np.array([0, 1, 5, 8])
    expected = [0.0, *stats.chi2.logsf(x[1:], dof[1:])]
    np.testing.assert_allclose(log_survival(x, dof), expected, rtol=1e-12)


def test_equals_an_extended_kalman_filter_by_hand_on_a_curved_model():
    model = wavy_model()
    y = draw(model, 20, generators(3, "wavy")).y
    x, P, nis = np.zeros(3), np.ones(3), []
    for z in y[:, 0]:
        x, P = 0.8 * x + 0.2 * np.sin(2 * x), (0.8 + 0.4 * np.cos(2 * x)) ** 2 * P + 0.7
        H, e = 1 + 0.8 * np.cos(2 * x), z - x - 0.4 * np.sin(2 * x)
        S = H * P * H + 0.5
        x, P = x + P * H / S * e, P * 0.5 / S
        nis.append(e * e / S)
    expected = -stats.chi2.logsf(np.array(nis)[6:11].sum(0), 5)
    np.testing.assert_allclose(InnovationSquared(5).run(model, y).statistic[10], expected, rtol=1e-9)


def test_nothing_observed_is_nothing_found():
    estimate = InnovationSquared().run(PAIR.model, np.full((6, 2, 2), np.nan))
    assert estimate.ok.all()
    assert (estimate.statistic == 0).all()


def test_bearings_wrap():
    _, a, b = from_both_sides(InnovationSquared())
    np.testing.assert_allclose(a.statistic, b.statistic, rtol=1e-7, atol=1e-9)


def test_noise_may_be_inside_the_function():
    p = random_linear(2, 2, 2, 2)

    def move(x, w, k):
        pushed = w[0] - w[1], w[0] + 2 * w[1]
        return np.stack([a[0] * x[0] + a[1] * x[1] + b + push for a, b, push in zip(p.A, p.a, pushed, strict=True)])

    outside = dataclasses.replace(p, G=np.array([[1.0, -1.0], [1.0, 2.0]])).model
    inside = dataclasses.replace(outside, dynamics=NonadditiveTransition(move, Gaussian(p.w, p.Q)))
    _, y = p.simulate(STEPS, runs=2, seed=3)
    a, b = (InnovationSquared().run(model, y).statistic for model in (outside, inside))
    np.testing.assert_allclose(a, b, rtol=1e-9)
