"""Noises against scipy.stats: densities, moments of samples, marginals, errors."""

import numpy as np
import pytest
from scipy import integrate, stats

from suite.noise import Gamma, Gaussian, GaussianMixture, Independent, StudentT
from tests.oracles import generators

COV = np.array([[2.0, 0.6, -0.3], [0.6, 1.0, 0.2], [-0.3, 0.2, 0.5]])
MEAN = np.array([1.0, -2.0, 0.5])
WIDE = Gaussian([3.0, 0.0, -1.0], np.diag([4.0, 0.1, 9.0]))
NOISES = {
    "gaussian": Gaussian(MEAN, COV),
    "student": StudentT(COV, 9.0),
    "mixture": GaussianMixture((0.7, 0.3), (Gaussian(MEAN, COV), WIDE)),
    "gamma": Gamma([0.8, 2.0, 5.0], [1.0, 0.5, 2.0]),
    "independent": Independent((Gaussian(MEAN[:2], COV[:2, :2]), StudentT([[0.5]], 9.0))),
}
ALL = pytest.mark.parametrize("noise", NOISES.values(), ids=NOISES)


def scipy_logpdf(noise, e):
    """Log-density of e[d, K] by scipy alone."""
    if isinstance(noise, Gaussian):
        return stats.multivariate_normal(noise.mean, noise.cov).logpdf(e.T)
    if isinstance(noise, StudentT):
        return stats.multivariate_t(np.zeros(len(noise.scale)), noise.scale, noise.dof).logpdf(e.T)
    if isinstance(noise, GaussianMixture):
        return np.log(sum(w * np.exp(scipy_logpdf(c, e)) for w, c in zip(noise.weights, noise.components, strict=True)))
    if isinstance(noise, Independent):
        upper, lower = noise.parts
        return scipy_logpdf(upper, e[: len(upper.mean)]) + scipy_logpdf(lower, e[len(upper.mean) :])
    return sum(stats.gamma.logpdf(x, a, scale=s) for x, a, s in zip(e, noise.shape, noise.scale, strict=True))


def points(noise, count=40, seed=0):
    spread = 2 * np.sqrt(np.diag(noise.cov))[:, None]
    e = noise.mean[:, None] + spread * np.random.default_rng(seed).standard_normal((len(noise.mean), count))
    return np.abs(e) + 1e-3 if isinstance(noise, Gamma) else e


@ALL
def test_logpdf_is_that_of_scipy(noise):
    e = points(noise)
    np.testing.assert_allclose(noise.logpdf(e), scipy_logpdf(noise, e), rtol=1e-10, atol=1e-10)


@ALL
def test_logpdf_over_trailing_axes(noise):
    e = points(noise, 24)
    flat = noise.logpdf(e)
    np.testing.assert_array_equal(noise.logpdf(e.reshape(3, 2, 3, 4)), flat.reshape(2, 3, 4))
    np.testing.assert_array_equal(noise.logpdf(e.reshape(3, 24, 1)), flat.reshape(24, 1))
    np.testing.assert_allclose(noise.logpdf(e[:, 0]), flat[0], rtol=1e-13)


@ALL
def test_logpdf_of_nan_is_nan(noise):
    e = points(noise, 3)
    e[1, 1] = np.nan
    with np.errstate(invalid="ignore"):
        assert list(np.isnan(noise.logpdf(e))) == [False, True, False]


@ALL
@pytest.mark.parametrize("rows", [(0,), (2,), (0, 2), (2, 0), (0, 1, 2)], ids=str)
def test_marginal(noise, rows):
    part = noise.marginal(rows)
    keep = list(rows)
    np.testing.assert_allclose(part.mean, noise.mean[keep])
    np.testing.assert_allclose(part.cov, noise.cov[np.ix_(keep, keep)])
    e = points(noise)[keep]
    np.testing.assert_allclose(part.logpdf(e), scipy_logpdf(part, e), rtol=1e-10, atol=1e-10)


@ALL
@pytest.mark.parametrize("row", [0, 1, 2])
def test_density_of_one_component_integrates_to_one(noise, row):
    part = noise.marginal((row,))
    low = 0.0 if isinstance(noise, Gamma) else -np.inf
    total, error = integrate.quad(lambda e: float(np.exp(part.logpdf(np.array([e])))), low, np.inf, limit=400)
    assert abs(total - 1) < 1e-6 + error


@ALL
def test_marginal_integrates_the_others_out(noise):
    pair, alone = noise.marginal((0, 1)), noise.marginal((0,))
    low = 0.0 if isinstance(noise, Gamma) else -np.inf
    for x in points(noise, 3)[0]:
        density = integrate.quad(lambda e, at=x: float(np.exp(pair.logpdf(np.array([at, e])))), low, np.inf, limit=400)[0]
        np.testing.assert_allclose(density, np.exp(alone.logpdf(np.array([x]))), rtol=1e-5)


@ALL
def test_samples_have_the_stated_moments(noise):
    # 200 groups of 2000 draws: means of the groups' moments are normal, and each is held to 5 standard errors that the
    # groups themselves give. 12 figures a noise: a false alarm has probability below 1e-4 for all of them together.
    draws = noise.sample(generators(200, "moments", type(noise).__name__), (200, 2000))
    assert draws.shape == (3, 200, 2000)
    means = draws.mean(-1)
    centred = draws - noise.mean[:, None, None]
    covs = np.einsum("irn,jrn->ijr", centred, centred) / 2000
    for found, expected in ((means, noise.mean), (covs, noise.cov)):
        error = found.std(-1, ddof=1) / np.sqrt(200)
        assert (np.abs(found.mean(-1) - expected) < 5 * error + 1e-12).all()


@ALL
@pytest.mark.parametrize("row", [0, 1, 2])
def test_samples_follow_their_density(noise, row):
    # Kolmogorov and Smirnov at a level of 1e-6, against the integral of the stated density.
    part = noise.marginal((row,))
    draws = np.sort(part.sample(generators(20, "law", type(noise).__name__, row), (20, 250)).ravel())
    low = 1e-9 if isinstance(noise, Gamma) else draws[0] - 40 * draws.std()
    grid = np.linspace(low, draws[-1] + 5 * draws.std(), 200_001)
    if isinstance(noise, Gamma):  # its density may be infinite at zero
        grid = np.concatenate([np.geomspace(1e-12, 1e-3, 20_000), np.linspace(1e-3, grid[-1], 200_001)[1:]])
    below = integrate.cumulative_simpson(np.exp(part.logpdf(grid[None])), x=grid, initial=0.0)
    assert stats.kstest(draws, lambda x: np.interp(x, grid, np.clip(below, 0, 1))).pvalue > 1e-6


@pytest.mark.parametrize("rest", [(), (7,), (3, 2)], ids=str)
@ALL
def test_samples_depend_on_the_run_alone(noise, rest):
    whole = noise.sample(generators(3, "shape"), (3, *rest))
    assert whole.shape == (3, 3, *rest)
    np.testing.assert_array_equal(noise.sample(generators(1, "shape"), (1, *rest))[:, 0], whole[:, 0])


def test_independent_parts_do_not_correlate():
    noise = Independent((Gaussian.noise(COV), Gamma([2.0, 3.0], [1.0, 0.5]), Gaussian.diagonal([4.0])))
    np.testing.assert_allclose(noise.mean, [0, 0, 0, 2, 1.5, 0])
    np.testing.assert_array_equal(noise.cov, noise.cov.T)
    np.testing.assert_allclose(noise.cov[:3, :3], COV)
    np.testing.assert_allclose(np.diag(noise.cov)[3:], [2, 0.75, 4])
    assert np.count_nonzero(noise.cov) == 12
    part = noise.marginal((5, 1, 2, 4))
    np.testing.assert_array_equal(part.mean, [0, 0, 0, 1.5])
    np.testing.assert_array_equal(part.cov, noise.cov[np.ix_([5, 1, 2, 4], [5, 1, 2, 4])])
    # 5 sigma of 30 correlations of 40000 draws: a false alarm has probability below 2e-5.
    draws = noise.sample(generators(40, "independent"), (40, 1000)).reshape(6, -1)
    scale = np.sqrt(np.diag(noise.cov))
    assert (np.abs(np.corrcoef(draws) - noise.cov / np.outer(scale, scale)) < 5 / np.sqrt(40_000)).all()


def test_singular_gaussian_samples_stay_in_its_range():
    gain = np.array([[1.0, 0.0], [2.0, 1.0], [0.0, -3.0]])
    noise = Gaussian(MEAN, gain @ gain.T)
    draws = noise.sample(generators(5, "range"), (5, 100)).reshape(3, -1) - MEAN[:, None]
    normal = np.cross(gain[:, 0], gain[:, 1])
    assert np.abs(normal @ draws).max() < 1e-7 * np.abs(draws).max()
    assert np.linalg.matrix_rank(draws, tol=1e-6) == 2
    np.testing.assert_array_equal(Gaussian(MEAN, np.zeros((3, 3))).sample(generators(2, 0), (2, 4))[:, 1, 3], MEAN)


@pytest.mark.parametrize("make", [Gaussian.noise, lambda cov: StudentT(cov, 5.0)], ids=["gaussian", "student"])
def test_a_singular_law_has_no_density(make):
    noise = make(np.ones((2, 2)))
    with pytest.raises(ValueError, match="singular"):
        noise.logpdf(np.zeros((2, 3)))
    assert np.isfinite(noise.marginal((1,)).logpdf(np.zeros((1, 3)))).all()


def test_gamma_has_no_density_below_zero():
    noise = Gamma([2.0, 2.0], [1.0, 1.0])
    e = np.array([[1.0, -1.0, 0.0, 1.0], [1.0, 1.0, 1.0, -1e-9]])
    assert list(np.isneginf(noise.logpdf(e))) == [False, True, True, True]


def test_densities_far_out_do_not_underflow():
    mixture = NOISES["mixture"]
    far = np.full((3, 1), 1e3)
    expected = np.logaddexp(*[np.log(w) + c.logpdf(far) for w, c in zip(mixture.weights, mixture.components, strict=True)])
    np.testing.assert_allclose(mixture.logpdf(far), expected)
    assert np.isfinite(mixture.logpdf(far)).all()


ONES = [[1.0, 0.0], [0.0, 1.0]]
RAGGED = [[1.0, 0.0], [0.0]]
PAIR = Gaussian.diagonal([1.0, 2.0])


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Gaussian([0.0], ONES), r"Gaussian\.cov has shape \(2, 2\), a mean of 1 components needs \(1, 1\)"),
        (lambda: Gaussian([[0.0]], [[1.0]]), r"Gaussian\.mean has shape \(1, 1\), it must be a vector"),
        (lambda: Gaussian(0.0, [[1.0]]), r"Gaussian\.mean has shape \(\), it must be a vector"),
        (lambda: Gaussian([0.0, np.nan], ONES), r"Gaussian\.mean\[1\] is nan, not a finite number"),
        (lambda: Gaussian([-np.inf, 0.0], ONES), r"Gaussian\.mean\[0\] is -inf, not a finite number"),
        (lambda: Gaussian(["a", "b"], ONES), r"Gaussian\.mean is not an array of numbers"),
        (lambda: Gaussian([1j, 0.0], ONES), r"Gaussian\.mean is not an array of numbers"),
        (lambda: Gaussian([[0.0], [0.0, 1.0]], ONES), r"Gaussian\.mean is not an array of numbers"),
        (lambda: Gaussian(None, ONES), r"Gaussian\.mean has shape \(\)"),
        (lambda: Gaussian([0.0, 0.0], [[1e6, 5e-4], [-5e-4, 1e-6]]), r"Gaussian\.cov is not symmetric: \[0, 1\] is 0.0005, "),
        (lambda: Gaussian.noise(3.0), r"Gaussian\.cov has shape \(\), it must be a matrix"),
        (lambda: Gaussian.noise([1.0, 2.0]), r"Gaussian\.cov has shape \(2,\), it must be a matrix"),
        (lambda: Gaussian.noise([[1.0, 2.0]]), r"Gaussian\.cov has shape \(1, 2\)"),
        (lambda: Gaussian.noise(RAGGED), r"Gaussian\.cov is not an array of numbers"),
        (lambda: Gaussian.noise("eye"), r"Gaussian\.cov is not an array of numbers"),
        (lambda: Gaussian.noise([["1.0"]]), r"Gaussian\.cov is not an array of numbers"),
        (lambda: Gaussian.noise([[1.0, 0.0], [np.inf, 1.0]]), r"Gaussian\.cov\[1, 0\] is inf, not a finite number"),
        (lambda: Gaussian.noise([[1.0, 2.0], [2.0, 1.0]]), r"Gaussian\.cov is not positive semidefinite"),
        (lambda: Gaussian.noise([[1.0, 0.5], [0.0, 1.0]]), r"Gaussian\.cov is not symmetric: \[0, 1\] is 0.5, \[1, 0\] is 0.0"),
        (lambda: Gaussian.diagonal([1.0, -2.5]), r"Gaussian\.cov\[1, 1\] is -2.5, a negative variance"),
        (lambda: Gaussian.diagonal([np.nan]), r"Gaussian\.variances\[0\] is nan, not a finite number"),
        (lambda: Gaussian.diagonal(ONES), r"Gaussian\.variances has shape \(2, 2\), it must be a vector"),
        (lambda: Gaussian.diagonal(1.0), r"Gaussian\.variances has shape \(\), it must be a vector"),
        (lambda: StudentT(ONES, 2.0), r"StudentT\.dof is 2.0, a finite covariance needs more than 2"),
        (lambda: StudentT(ONES, np.nan), r"StudentT\.dof is nan, not a finite number"),
        (lambda: StudentT(ONES, np.inf), r"StudentT\.dof is inf, not a finite number"),
        (lambda: StudentT(ONES, "many"), r"StudentT\.dof is not an array of numbers"),
        (lambda: StudentT(-np.eye(2), 3.0), r"StudentT\.scale\[0, 0\] is -1.0, a negative variance"),
        (lambda: StudentT(2.0, 3.0), r"StudentT\.scale has shape \(\), it must be a matrix"),
        (lambda: StudentT([[1.0, 2.0]], 3.0), r"StudentT\.scale has shape \(1, 2\), it must be square"),
        (lambda: StudentT(RAGGED, 3.0), r"StudentT\.scale is not an array of numbers"),
        (lambda: StudentT([[np.nan]], 3.0), r"StudentT\.scale\[0, 0\] is nan, not a finite number"),
        (lambda: StudentT([[1.0, 0.5], [0.4, 1.0]], 3.0), r"StudentT\.scale is not symmetric"),
        (lambda: StudentT([[1.0, 2.0], [2.0, 1.0]], 3.0), r"StudentT\.scale is not positive semidefinite"),
        (lambda: GaussianMixture((0.5, 0.4), (WIDE, WIDE)), r"GaussianMixture\.weights sums to 0.9, not to 1"),
        (lambda: GaussianMixture((1.5, -0.5), (WIDE, WIDE)), r"GaussianMixture\.weights\[1\] is -0.5, not positive"),
        (lambda: GaussianMixture((0.0, 1.0), (WIDE, WIDE)), r"GaussianMixture\.weights\[0\] is 0.0, not positive"),
        (lambda: GaussianMixture((0.5, np.nan), (WIDE, WIDE)), r"GaussianMixture\.weights\[1\] is nan, not a finite number"),
        (lambda: GaussianMixture(1.0, (WIDE,)), r"GaussianMixture\.weights has shape \(\), it must be a vector"),
        (lambda: GaussianMixture((1.0,), (WIDE, WIDE)), r"GaussianMixture\.weights has 1 entries for 2 components"),
        (lambda: GaussianMixture((), ()), r"GaussianMixture\.components is empty"),
        (lambda: GaussianMixture((1.0,), WIDE), r"GaussianMixture\.components is of type Gaussian, not a tuple of Gaussian"),
        (lambda: GaussianMixture((1.0,), (3.0,)), r"GaussianMixture\.components\[0\] is of type float, not a Gaussian"),
        (
            lambda: GaussianMixture((0.5, 0.5), (WIDE, PAIR)),
            r"GaussianMixture\.components\[1\] is of dimension 2, components\[0\] of 3",
        ),
        (lambda: Gamma([1.0, 2.0], [1.0]), r"Gamma\.scale has 1 entries, Gamma\.shape has 2"),
        (lambda: Gamma([1.0, 0.0], [1.0, 1.0]), r"Gamma\.shape\[1\] is 0.0, not positive"),
        (lambda: Gamma([1.0], [-1.0]), r"Gamma\.scale\[0\] is -1.0, not positive"),
        (lambda: Gamma([np.nan], [1.0]), r"Gamma\.shape\[0\] is nan, not a finite number"),
        (lambda: Gamma([1.0], [np.inf]), r"Gamma\.scale\[0\] is inf, not a finite number"),
        (lambda: Gamma(1.0, 1.0), r"Gamma\.shape has shape \(\), it must be a vector"),
        (lambda: Independent(()), r"Independent\.parts is empty"),
        (lambda: Independent(PAIR), r"Independent\.parts is of type Gaussian, not a tuple of Law"),
        (lambda: Independent((PAIR, np.eye(2))), r"Independent\.parts\[1\] is of type ndarray, not a Law"),
        (lambda: NOISES["independent"].marginal((0, 2, 1)), "components of one part must stand together"),
    ],
)
def test_bad_laws_are_refused_by_name(make, words):
    with pytest.raises(ValueError, match="^" + words) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_laws_may_come_as_lists_of_whole_numbers():
    mixture = GaussianMixture(np.array([0.25, 0.75]), [Gaussian([1, 0], [[1, 0], [0, 4]]), PAIR])
    assert mixture.weights == (0.25, 0.75)
    np.testing.assert_array_equal(mixture.mean, [0.25, 0.0])
    np.testing.assert_array_equal(Independent([Gaussian.diagonal([1, 2]), Gamma([1], [2])]).mean, [0, 0, 2])
    assert StudentT([[2]], 3).cov == 6
