"""Fisher information of noises, against integrals by other means."""

import itertools
from dataclasses import dataclass

import numpy as np
import pytest
from scipy import integrate, stats

from suite.fisher import information, noise_factor, of_components, whitening
from suite.noise import Gamma, Gaussian, GaussianMixture, Independent, StudentT


def scalar(density, points):
    """E[(p'/p)²] of a density, p' by differences, by Simpson's rule on 20 000 even pieces between each two points."""
    total = 0.0
    for a, b in itertools.pairwise(points):
        e, h = np.linspace(a, b, 20_001), 1e-4
        slope = (density(e - 2 * h) - 8 * density(e - h) + 8 * density(e + h) - density(e + 2 * h)) / (12 * h)
        total += integrate.simpson(slope**2 / density(e), x=e)
    return total


@pytest.mark.parametrize("dof", [2.5, 4.0, 30.0])
def test_of_a_scalar_student_t(dof):
    expected = 2 * scalar(stats.t(dof, scale=1.7).pdf, [0, 1, 3, 10, 100, 1e4])
    np.testing.assert_allclose(information(StudentT([[1.7**2]], dof)), [[expected]], rtol=1e-6)


def test_of_a_student_t_with_several_components():
    """E[s sᵀ] over a fine polar grid of the standard law, whose directions are even; then scaled."""
    scale, dof = np.array([[2.0, 0.7], [0.7, 0.5]]), 3.0
    radius = lambda r: r * (1 + r * r / dof) ** (-(dof + 2) / 2)  # noqa: E731 - density of the length, but for a constant
    slope = lambda r: ((dof + 2) / dof * r / (1 + r * r / dof)) ** 2 * radius(r)  # noqa: E731
    square = integrate.quad(slope, 0, np.inf, epsabs=0)[0] / integrate.quad(radius, 0, np.inf, epsabs=0)[0]
    np.testing.assert_allclose(information(StudentT(scale, dof)), square / 2 * np.linalg.inv(scale), rtol=1e-6)


@pytest.mark.parametrize("wide", [1.5, 10.0, 1000.0])
@pytest.mark.parametrize("shift", [0.0, 3.0])
def test_of_a_scalar_mixture(wide, shift):
    mixture = GaussianMixture((0.9, 0.1), (Gaussian([0.2], [[1.0]]), Gaussian([shift], [[wide**2]])))
    density = lambda e: 0.9 * stats.norm.pdf(e, 0.2) + 0.1 * stats.norm.pdf(e, shift, wide)  # noqa: E731
    points = sorted({-10 * wide, -3 * wide, *np.arange(-10.0, 11.0), 3 * wide, 10 * wide})
    np.testing.assert_allclose(information(mixture), [[scalar(density, points)]], rtol=1e-6)


def test_a_mixture_of_one_law_is_that_law():
    one = Gaussian([1.0], [[4.0]])
    np.testing.assert_allclose(information(GaussianMixture((0.3, 0.7), (one, one))), [[0.25]], rtol=1e-9)


def test_of_a_mixture_with_several_components():
    """Two far apart, in a plane: each draw tells which one it is from. 0.5 % is the stated error, 3 % are 6 of it."""
    parts = Gaussian([-50.0, 0.0], [[1.0, 0.3], [0.3, 2.0]]), Gaussian([50.0, 0.0], [[9.0, 0.0], [0.0, 0.5]])
    expected = 0.6 * np.linalg.inv(parts[0].cov) + 0.4 * np.linalg.inv(parts[1].cov)
    found = information(GaussianMixture((0.6, 0.4), parts))
    np.testing.assert_allclose(found, expected, rtol=0.03, atol=0.03 * expected.min(where=expected > 0, initial=1))


def test_of_a_gamma_law():
    expected = scalar(stats.gamma(4.5, scale=0.8).pdf, [1e-3, 0.1, 1, 3, 10, 40])
    np.testing.assert_allclose(information(Gamma([4.5, 3.0], [0.8, 2.0])), np.diag([expected, 0.25]), rtol=1e-4)


def test_independent_noises_inform_apart():
    one, two = Gaussian([0.0, 1.0], [[2.0, 0.5], [0.5, 1.0]]), StudentT([[3.0]], 5.0)
    expected = np.zeros((3, 3))
    expected[:2, :2], expected[2, 2] = np.linalg.inv(one.cov), 6 / 8 / 3
    np.testing.assert_allclose(information(Independent((one, two))), expected, rtol=1e-12)


def test_components_alone_tell_less():
    noise = Gaussian.noise([[2.0, 1.0], [1.0, 3.0]])
    np.testing.assert_allclose(of_components(noise, (1,)), [[1 / 3]])
    np.testing.assert_allclose(information(noise)[1, 1], 0.4)


@dataclass(frozen=True)
class Plain:
    """A law of which only the density is known: logistic, or even between -1 and 1."""

    smooth: bool
    mean = np.zeros(1)

    @property
    def _law(self):
        return stats.logistic() if self.smooth else stats.uniform(-1, 2)

    @property
    def cov(self):
        return np.array([[self._law.var()]])

    def sample(self, rng, shape):
        return self._law.ppf(rng.random((1, *shape)))

    def logpdf(self, e):
        return self._law.logpdf(e[0])


def test_of_any_law_with_a_smooth_density():
    """That of the logistic law is 1/3 exactly; 1.5 % are 6 standard errors: sd of score² is 0.3, over 200 000 draws."""
    np.testing.assert_allclose(information(Plain(True)), [[1 / 3]], rtol=0.015)


@pytest.mark.parametrize(
    ("noise", "words"),
    [
        (Plain(False), "not smooth"),
        (Gamma([2.0, 5.0], [1.0, 1.0]), "shape of 2 or less"),
        (Gaussian.diagonal([1.0, 0.0]), "singular"),
        (StudentT([[0.0]], 3.0), "singular"),
        (GaussianMixture((0.5, 0.5), (Gaussian.noise([[1.0]]), Gaussian.noise([[0.0]]))), "without spread"),
    ],
    ids=str,
)
def test_laws_without_a_finite_information_are_named(noise, words):
    with pytest.raises(ValueError, match=words):
        information(noise)


def test_a_factor_of_the_inverse():
    noise = StudentT([[2.0, 0.7], [0.7, 0.5]], 3.0)
    root = noise_factor(noise)
    np.testing.assert_allclose(root @ root.T @ information(noise), np.eye(2), atol=1e-12)
    singular = Gaussian.noise([[1.0, 2.0], [2.0, 4.0]])
    np.testing.assert_array_equal(noise_factor(singular), singular.lower)


@pytest.mark.parametrize("units", [np.ones(4), np.array([1e-6, 1.0, 1e5, 1e-3])], ids=["alike", "apart"])
@pytest.mark.parametrize("rank", [0, 2, 4])
def test_whitening_on_the_range_and_across(rank, units):
    root = units[:, None] * (np.random.default_rng(3).standard_normal((4, rank)) @ np.eye(rank, 4))
    inside, across = whitening(root)
    np.testing.assert_allclose(inside @ root @ root.T @ inside.T, np.diag([1.0] * rank + [0.0] * (4 - rank)), atol=1e-9)
    np.testing.assert_allclose(across @ root, 0.0, atol=1e-12)
    assert np.linalg.matrix_rank(np.concatenate([inside, across]) * units) == 4
