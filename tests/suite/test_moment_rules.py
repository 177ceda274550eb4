"""Moment rules against exact moments of polynomials, closed forms, and the formulas of their papers."""

import itertools
from math import comb, factorial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cases import CASES
from suite.model import AdditiveSensor, AdditiveTransition, Affine
from suite.moment_rules import about, affine, cubature, gauss_hermite, taylor, unscented
from suite.noise import Gaussian
from suite.nonadditive import Augmented, NonadditiveSensor, NonadditiveTransition

SPREADS = [(1.0, 2.0, 0.0), (0.5, 0.0, 1.0), (1e-2, 2.0, 0.0), (1.0, 0.0, 3.0)]
RULES = {
    "taylor": taylor, "cubature": cubature(), "gauss-hermite": gauss_hermite(3),
    **{f"unscented {spread}": unscented(*spread) for spread in SPREADS},
}  # fmt: skip
seeds = st.integers(0, 2**32 - 1)


def law(function, angles=()):
    return AdditiveSensor(function, Gaussian.diagonal([1.0]), angles)


def gaussians(runs=3, n=3, seed=0, rank=None):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((runs, n)), rng.standard_normal((runs, n, rank or n)) @ np.eye(rank or n, n)


def moments(spread):
    """Mean [R, p], covariance [R, p, p], and covariance with the argument [R, n, p]."""
    turned = np.swapaxes(spread.dy, 1, 2)
    return spread.value, spread.dy @ turned, spread.dx @ turned


def same(found, expected, tolerance):
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_allclose(a, b, rtol=tolerance, atol=tolerance * max(1.0, np.abs(b).max()))


@pytest.mark.parametrize("rank", [1, 2, 3])
@pytest.mark.parametrize("rule", [affine, *RULES.values()], ids=["affine", *RULES])
def test_rules_are_exact_for_affine_functions(rule, rank):
    mean, root = gaussians(rank=rank)
    matrix, offset = np.random.default_rng(1).standard_normal((2, 3)), np.array([1.0, -2.0])
    cov = root @ np.swapaxes(root, 1, 2)
    function = law(Affine(matrix, offset))
    found = rule(mean, root, function, 1)
    same(moments(found), (mean @ matrix.T + offset, matrix @ cov @ matrix.T, cov @ matrix.T), 1e-11)
    np.testing.assert_allclose(found.dx @ np.swapaxes(found.dx, 1, 2), cov, rtol=1e-12, atol=1e-12)


def power(mu, var, d):
    """E[u^d] for u ~ N(mu, var)."""
    odd = [np.prod(np.arange(1, 2 * j, 2)) for j in range(d // 2 + 1)]
    return sum(comb(d, 2 * j) * odd[j] * mu ** (d - 2 * j) * var**j for j in range(d // 2 + 1))


class Polynomial:
    """C times powers of random affine functions of the state: p polynomials of a degree, with their exact moments."""

    def __init__(self, rng, n, degree, p=2, ridges=4):
        self.A, self.b = rng.standard_normal((ridges, n)) / np.sqrt(n), rng.standard_normal(ridges)
        self.degrees = np.array([degree, *rng.integers(0, degree + 1, ridges - 1)])
        self.C = rng.standard_normal((p, ridges))

    def __call__(self, x, k):
        u = np.tensordot(self.A, x, 1) + self.b.reshape(-1, *(1,) * (x.ndim - 1))
        return np.tensordot(self.C, np.stack([v**d for v, d in zip(u, self.degrees, strict=True)]), 1)

    def moments(self, mean, cov):
        """By E[u^d v^e] = sum over j of j! C(d, j) C(e, j) cov(u, v)^j E[u^(d - j)] E[v^(e - j)], and by Stein's lemma."""
        mu, S, degrees = self.A @ mean + self.b, self.A @ cov @ self.A.T, self.degrees.tolist()
        first = np.array([power(m, s, d) for m, s, d in zip(mu, np.diag(S), degrees, strict=True)])
        slope = np.array([d * power(m, s, d - 1) if d else 0.0 for m, s, d in zip(mu, np.diag(S), degrees, strict=True)])

        def product(i, j):
            terms = range(1, min(degrees[i], degrees[j]) + 1)
            return sum(
                factorial(t) * comb(degrees[i], t) * comb(degrees[j], t) * S[i, j] ** t
                * power(mu[i], S[i, i], degrees[i] - t) * power(mu[j], S[j, j], degrees[j] - t)
                for t in terms
            )  # fmt: skip

        inner = np.array([[product(i, j) for j in range(len(mu))] for i in range(len(mu))])
        return self.C @ first, self.C @ inner @ self.C.T, cov @ self.A.T @ (slope[:, None] * self.C.T)


def case_of(n, degree, rank, seed):
    polynomial = Polynomial(np.random.default_rng(seed), n, degree)
    mean, root = gaussians(1, n, seed, min(rank, n))
    exact = polynomial.moments(mean[0], root[0] @ root[0].T)
    return mean, root, law(polynomial), exact


def test_the_oracle_agrees_with_a_quadrature():
    polynomial = Polynomial(np.random.default_rng(2), 2, 4)
    mean, root = gaussians(1, 2, 2)
    line = np.linspace(-12, 12, 801)
    z = np.stack(np.meshgrid(line, line)).reshape(2, -1)
    weight = np.exp(-0.5 * (z * z).sum(0))
    x = mean.T + root[0] @ z
    values = polynomial(x, 1)
    found = np.average(values, axis=1, weights=weight), np.cov(values, aweights=weight, ddof=0)
    cross = (x - mean.T) * weight @ values.T / weight.sum()
    same((*found, cross), polynomial.moments(mean[0], root[0] @ root[0].T), 1e-9)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.integers(1, 4), st.integers(0, 3), st.integers(1, 4), st.sampled_from(["cubature", *SPREADS[:2], SPREADS[3]]), seeds)
def test_unscented_and_cubature_means_are_exact_to_degree_3(n, degree, rank, spread, seed):
    rule = cubature() if spread == "cubature" else unscented(*spread)
    mean, root, function, exact = case_of(n, degree, rank, seed)
    value, _, cross = moments(rule(mean, root, function, 1))
    same([value[0]], exact[:1], 1e-10)
    if degree < 3:
        same([cross[0]], exact[2:], 1e-10)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.integers(1, 3), st.integers(2, 5), st.integers(0, 9), st.integers(1, 3), seeds)
def test_gauss_hermite_is_exact_to_degree_2_order_minus_1(n, order, degree, rank, seed):
    degree = min(degree, 2 * order - 1)
    mean, root, function, exact = case_of(n, degree, rank, seed)
    found = [part[0] for part in moments(gauss_hermite(order)(mean, root, function, 1))]
    same(found[:1], exact[:1], 1e-9)
    if degree < order:
        same(found[1:], exact[1:], 1e-9)


@pytest.mark.parametrize(("rule", "degree"), [(cubature(), 4), (gauss_hermite(2), 4), (gauss_hermite(4), 8)])
def test_rules_are_not_exact_one_degree_further(rule, degree):
    mean, root, function, exact = case_of(2, degree, 2, 7)
    assert np.abs(rule(mean, root, function, 1).value[0] - exact[0]).max() > 1e-3


@pytest.mark.parametrize("std", [0.3, 1.0])
def test_gauss_hermite_converges_with_its_order(std):
    # x ~ N(m, s²): E sin = sin(m) exp(-s²/2), E exp = exp(m + s²/2), Var exp = E² (exp(s²) - 1), Cov(x, exp) = s² E.
    m, s2 = 0.4, std**2
    function = law(lambda x, k: np.stack([np.sin(x[0]), np.exp(x[0])]))
    grow = np.exp(m + s2 / 2)
    exact = np.array([np.sin(m) * np.exp(-s2 / 2), grow, grow**2 * (np.exp(s2) - 1), s2 * grow])
    errors = []
    for order in (2, 4, 6, 8, 12, 16):
        value, square, cross = moments(gauss_hermite(order)(np.array([[m]]), np.array([[[std]]]), function, 1))
        errors.append(np.abs(np.array([*value[0], square[0, 1, 1], cross[0, 0, 1]]) / exact - 1).max())
    # The error of order p goes as p! / (2p)! times the derivative of order 2p: 9 times less from order 2 to 4 for the steepest,
    # exp(2x) with s = 1, and ever faster from there.
    for before, after in itertools.pairwise(errors):
        assert after < max(before / 5, 1e-14)
    assert errors[-1] < 1e-11


def plain_unscented(mean, cov, function, alpha, beta, kappa):
    """The scaled unscented transform of one Gaussian as its paper writes it, with lambda and two sets of weights."""
    n = len(mean)
    lam = alpha**2 * (n + kappa) - n
    root = np.linalg.cholesky((n + lam) * cov)
    points = [mean, *(mean + root[:, i] for i in range(n)), *(mean - root[:, i] for i in range(n))]
    wm = [lam / (n + lam)] + [0.5 / (n + lam)] * (2 * n)
    wc = [lam / (n + lam) + 1 - alpha**2 + beta, *wm[1:]]
    values = [function(p) for p in points]
    value = sum(w * v for w, v in zip(wm, values, strict=True))
    square = sum(w * np.outer(v - value, v - value) for w, v in zip(wc, values, strict=True))
    cross = sum(w * np.outer(p - mean, v - value) for w, p, v in zip(wc, points, values, strict=True))
    return value, square, cross


def plain_cubature(mean, cov, function):
    """The third-degree cubature rule of one Gaussian as its paper writes it."""
    n = len(mean)
    xi = np.sqrt(n) * np.concatenate([np.eye(n), -np.eye(n)])
    points = [mean + np.linalg.cholesky(cov) @ offset for offset in xi]
    values = [function(p) for p in points]
    value = sum(values) / (2 * n)
    square = sum(np.outer(v, v) for v in values) / (2 * n) - np.outer(value, value)
    return value, square, sum(np.outer(p, v) for p, v in zip(points, values, strict=True)) / (2 * n) - np.outer(mean, value)


def bent(x, k):
    return np.stack([x[0] * x[1], np.sin(x[2]) + k, x[0] ** 2, np.exp(0.3 * x[1])])


def against(rule, plain, tolerance):
    mean, root = gaussians(seed=2)
    lower = np.linalg.cholesky(root @ np.swapaxes(root, 1, 2))
    found = moments(rule(mean, lower, law(bent), 2))
    for r in range(3):
        same([part[r] for part in found], plain(mean[r], lower[r] @ lower[r].T, lambda x: bent(x, 2)), tolerance)


@settings(max_examples=50, deadline=None, derandomize=True)
@given(st.floats(0.05, 1), st.floats(0, 4), st.floats(0, 4))
def test_unscented_rule_equals_the_textbook(alpha, beta, kappa):
    # The weights of the textbook are of the size 1 / alpha² and lose that many digits.
    against(unscented(alpha, beta, kappa), lambda *given: plain_unscented(*given, alpha, beta, kappa), 1e-12 / alpha**2)


def test_cubature_rule_equals_the_textbook_and_the_unscented_one_without_a_centre():
    against(cubature(), plain_cubature, 1e-12)
    against(cubature(), lambda *given: plain_unscented(*given, 1.0, 0.0, 0.0), 1e-12)


@pytest.mark.parametrize("name", RULES)
def test_moments_of_an_angle_near_pi(name):
    # The angle is the state itself, wrapped: N(pi - 0.01, 0.1²) has that mean, whatever branch its points fall on.
    sensor = AdditiveSensor(
        lambda x, k: x - 2 * np.pi * (x > np.pi), Gaussian.diagonal([1.0]), (0,), lambda x, k: np.ones((1, *x.shape))
    )
    value, square, cross = moments(RULES[name](np.array([[np.pi - 0.01]]), np.array([[[0.1]]]), sensor, 1))
    np.testing.assert_allclose(np.exp(1j * value), np.exp(1j * (np.pi - 0.01)), rtol=1e-11)
    np.testing.assert_allclose(square, 0.01, rtol=1e-10)
    np.testing.assert_allclose(cross, 0.01, rtol=1e-10)


def test_expansion_about_a_point_is_the_tangent_there():
    mean, root = gaussians(seed=3)
    point = mean + 0.3
    function = lambda x, k: np.stack([x[0] ** 2 * x[1], x[2] ** 3])  # noqa: E731
    found = about(point)(mean, root, law(function), 1)
    for r, (x, m) in enumerate(zip(point, mean, strict=True)):
        slope = np.array([[2 * x[0] * x[1], x[0] ** 2, 0.0], [0.0, 0.0, 3 * x[2] ** 2]])
        np.testing.assert_allclose(found.value[r], function(x, 1), rtol=1e-12)
        np.testing.assert_allclose(found.aside[r], slope @ (m - x), rtol=1e-12)
        np.testing.assert_allclose(found.dy[r], slope @ root[r], rtol=1e-12, atol=1e-14)


def laws(model):
    """The functions of a model that a Taylor expansion differentiates, the noises inside them, and the spread of the state."""
    for each in getattr(model, "modes", (model,)):
        for part in (each.dynamics, each.sensor):
            if isinstance(part, AdditiveTransition | AdditiveSensor):
                yield part, Gaussian.noise(np.zeros((0, 0))), each.prior
            elif isinstance(part, NonadditiveTransition | NonadditiveSensor):
                yield Augmented(part, each.n), part.noise_at(1), each.prior


@pytest.mark.parametrize("name", CASES)
def test_jacobians_of_the_cases_are_differences(name):
    """By central differences of fourth order, at true states; rounding leaves them some 1e-13 of a value over its step."""
    case = CASES[name]
    truth = case.simulate(2, seed=3).x
    checked = 0
    for function, noise, prior in laws(case.model):
        usual = np.sqrt(np.concatenate([np.diag(prior.cov), np.diag(noise.cov)]))
        for k in (1, len(truth) // 2, len(truth) - 1):
            at = np.concatenate([truth[k - 1], np.repeat(noise.mean[:, None], truth.shape[2], axis=1)])
            value, slope = function.linearised(at, k + 1)
            np.testing.assert_array_equal(value, function.mean(at, k + 1))
            for j in range(len(at)):
                size = 1e-4 * np.maximum(np.abs(at[j]), usual[j] or 10.0)
                step = size * (np.arange(len(at)) == j)[:, None]
                up, down, further, back = (function.mean(at + t * step, k + 1) for t in (1, -1, 2, -2))
                expected = (8 * function.residual(up, down) - function.residual(further, back)) / (12 * size)
                error = np.abs(slope[:, j] - expected)
                assert (error <= 1e-7 * np.abs(expected) + 1e-12 * np.abs(value).max(0) / size).all()
                checked += expected.size
    assert checked > 0
